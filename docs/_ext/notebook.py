"""Cells of a notebook in a page: ``{cell}`` runs its lines in the session that all cells of the page share.

A cell shows what a notebook would: what is printed, and the value of the last line as its HTML, its text or its figure
(the option ``alt`` describes the figure).
"""

from __future__ import annotations

import ast
import contextlib
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from executed import Executed
from sphinx.application import Sphinx


def value_of(code: str, session: dict[str, Any]) -> Any:
    """Run a cell; the value of its last line where this is an expression, else None."""
    lines = ast.parse(code).body
    last = lines.pop() if lines and isinstance(lines[-1], ast.Expr) else None
    exec(compile(ast.Module(lines, []), "cell", "exec"), session)
    return None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), session)  # noqa: S307


@contextlib.contextmanager
def inside(folder: os.PathLike[str]) -> Iterator[None]:
    """Work in a folder, and come back."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


class Cell(Executed):
    """One cell of the page's notebook."""

    option_spec: ClassVar = {"alt": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        code, printed = "\n".join(self.content), io.StringIO()
        folder = self.folder  # a page that begins has no session yet
        cells = self.env.temp_data.setdefault("cells", {"session": {}, "count": 0})
        cells["count"] += 1
        with inside(folder), contextlib.redirect_stdout(printed):
            value = value_of(code, cells["session"])
            shown = self.shown(value, f"cell-{cells['count']}.svg")
        text = [self.block(printed.getvalue().rstrip(), "text")] if printed.getvalue().strip() else []
        return [self.block(code, "python"), *text, *shown]

    def shown(self, value: Any, name: str) -> list[nodes.Node]:
        if value is None:
            return []
        if hasattr(value, "savefig"):
            return [self.figure(value, name)]
        if hasattr(value, "_repr_html_"):
            html = f'<div class="cell-output">{value._repr_html_()}</div>'
            return [nodes.raw("", html, format="html")]
        return [self.block(repr(value), "text")]

    def figure(self, value: Any, name: str) -> nodes.Node:
        target = self.published(name)
        target.parent.mkdir(parents=True, exist_ok=True)
        value.savefig(target, metadata={"Date": None})
        image = nodes.image(uri=f"/generated/executed/{target.name}", alt=self.options["alt"])
        self.set_source_info(image)
        return image


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("cell", Cell)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
