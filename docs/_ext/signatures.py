"""Signatures with their types as they are written in the source: ``Array``, not what the name stands for."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Mapping
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.inspect import stringify_annotation

Names = Mapping[str, Any]


def plain(annotation: object, names: Names) -> str | None:
    """An annotation as it stands in the source, without the quotes that it is kept in; None where there is none."""
    if annotation is inspect.Parameter.empty:
        return None
    text = stringify_annotation(annotation, "smart").strip("'")
    return re.sub(r"(?<![\w.~'])[A-Z]\w*", lambda name: linked(name[0], names), text)


def linked(name: str, names: Names) -> str:
    """A class of ours by its whole name, of which the last part is shown: two modules may have one of the same name."""
    found = names.get(name)
    ours = isinstance(found, type) and found.__module__.startswith("starplumb")
    return f"~{found.__module__}.{found.__qualname__}" if ours else name


def parameter(p: inspect.Parameter, names: Names) -> str:
    annotation = plain(p.annotation, names)
    name = str(p.replace(annotation=p.empty, default=p.empty))
    typed = name if annotation is None else f"{name}: {annotation}"
    default = "" if p.default is p.empty else f"{' = ' if annotation else '='}{shown(p.default)}"
    return typed + default


def shown(default: object) -> str:
    """A default; an object without a text of its own is only hinted at."""
    text = repr(default)
    return "..." if " at 0x" in text or len(text) > 60 else text


def as_written(
    app: Sphinx, what: str, name: str, found: object, options: object, signature: str, returned: str
) -> tuple[str, str | None] | None:
    """The signature of a function, a method or a class; None leaves what Sphinx has made of it."""
    if signature is None or not callable(found):
        return None
    try:
        written = inspect.signature(found)
    except (TypeError, ValueError):
        return None
    names = vars(sys.modules[found.__module__])
    parameters = list(written.parameters.values())
    if what == "method" and parameters and parameters[0].name == "self":
        del parameters[0]
    parts: list[str] = []
    for p in parameters:
        if p.kind is p.KEYWORD_ONLY and not any(part.startswith("*") for part in parts):
            parts.append("*")
        parts.append(parameter(p, names))
    gives = None if what in ("class", "exception") else plain(written.return_annotation, names)
    return f"({', '.join(parts)})", gives


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-process-signature", as_written)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
