"""An empty TOML document with every key of a model explained; what may be left out is commented out."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from textwrap import wrap
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from .sections import Section

_WIDTH = 120
Examples = Mapping[str, object]
"""Values by ``section.key``, or by the key alone where it means the same in every section."""


def template(model: type[BaseModel], examples: Examples, active: Collection[str], head: str = "") -> str:
    """The document: every section of ``model`` with its keys, their descriptions and a value each.

    A key is commented out unless it must be there or is among ``active`` (``section.key``); so is a section without a
    key that counts.
    """
    lines = head.splitlines()
    for name, field in model.model_fields.items():
        lines += ["", *_section(name, field, examples, active)]
    return "\n".join(lines) + "\n"


def _section(name: str, field: FieldInfo, examples: Examples, active: Collection[str]) -> Iterator[str]:
    part, several = _model_of(field.annotation)
    on = field.is_required() or any(key.startswith(f"{name}.") for key in active)
    off, title = ("" if on else "# "), f"[[{name}]]" if several == "list" else f"[{name}]"
    purpose = (part.__doc__ or "").replace("``", "")
    if purpose.strip("[].") != name:
        yield from _comment(purpose)
    yield f"{off}{title}"
    if several == "named":
        yield f"# NAME = {toml(_example(part, examples, name))}"
        return
    keys = {each.alias or key: each for key, each in part.model_fields.items()}
    counting = [key for key, each in keys.items() if on and (each.is_required() or f"{name}.{key}" in active)]
    for key in [*counting, *(key for key in keys if key not in counting)]:
        line = f"{'' if key in counting else '# '}{key} = {toml(value_of(name, key, keys[key], examples))}"
        yield from _explained(line, keys[key].description or "")


def _explained(line: str, text: str) -> Iterator[str]:
    """A key with what it is beside it, or above it where that is too long."""
    if len(line) + len(text) + 4 <= _WIDTH:
        yield f"{line}  # {text}"
        return
    yield from _comment(text)
    yield line


def _comment(text: str) -> Iterator[str]:
    for line in wrap(" ".join(text.split()), _WIDTH):
        yield f"# {line}"


def value_of(section: str, key: str, field: FieldInfo, examples: Examples) -> object:
    """A value that a key may have: the one given, what it is where it is left out, or one of its type."""
    for name in (f"{section}.{key}", key):
        if name in examples:
            return examples[name]
    default = field.get_default(call_default_factory=False)
    if not field.is_required() and default is not None and default != () and not isinstance(default, Section):
        return default
    return _of_type(field.annotation, examples, key)


def _of_type(kind: Any, examples: Examples, key: str) -> object:
    """A value of a type."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _of_type(parts[0], examples, key)
    if origin in (Union, UnionType):
        return _of_type(next(part for part in parts if part is not NoneType), examples, key)
    if origin is Literal:
        return parts[0]
    if origin is tuple:
        inner = parts[:1] if parts[-1] is Ellipsis else parts
        return [_of_type(part, examples, key) for part in inner]
    if origin is list:
        return [_of_type(parts[0], examples, key)]
    if origin is dict:
        return {"name": _of_type(parts[1], examples, key)}
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return _example(kind, examples, key)
    plain = {bool: False, int: 1, float: 1.0, str: "..."}
    return next(value for each, value in plain.items() if isinstance(kind, type) and issubclass(kind, each))


def _example(part: type[BaseModel], examples: Examples, name: str) -> dict[str, object]:
    """A section in one line: the keys that it must have, and those given for it."""
    fields = {field.alias or key: field for key, field in part.model_fields.items()}
    chosen = {word: f for word, f in fields.items() if f.is_required() or f"{name}.{word}" in examples}
    return {word: value_of(name, word, field, examples) for word, field in (chosen or fields).items()}


def _model_of(kind: Any) -> tuple[type[BaseModel], str]:
    """The model of a section, and whether there may be a "list" of such or several "named" ones."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType, Annotated):
        return _model_of(next(part for part in parts if part is not NoneType))
    if origin is list:
        return _model_of(parts[0])[0], "list"
    if origin is dict:
        return _model_of(parts[1])[0], "named"
    return kind, ""


def toml(value: object) -> str:
    """A value as TOML, in one line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value)
