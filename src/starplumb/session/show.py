"""How the objects of a session show themselves: the same tables and sentences as text, as HTML and in the commands."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from ..report.page import Table


class Shown:
    """What has tables and sentences: its ``repr`` is plain text, in a notebook it is an HTML table."""

    made_by: ClassVar[str] = ""
    """The function that gives such an object, for who is asked for one."""

    @property
    def tables(self) -> Sequence[Table]:
        """Small tables, for a person."""
        return ()

    @property
    def sentences(self) -> Sequence[str]:
        """What the tables do not say, a line each."""
        return ()

    def __repr__(self) -> str:
        return "\n".join([*(as_text(table) for table in self.tables), *map(for_python, self.sentences)])

    def _repr_html_(self) -> str:
        lines = "<br>\n".join(escape(for_python(sentence)) for sentence in self.sentences)
        return "\n".join([*(as_html(table) for table in self.tables), f"<p>{lines}</p>" if lines else ""])


def for_python(sentence: str) -> str:
    """Advice in a Python session: the option ``--estimate NAME`` as the argument ``estimate="NAME"``."""
    return re.sub(r"--estimate ([\w.=+-]*\w)", r'estimate="\1"', sentence)


def as_text(table: Table) -> str:
    """The table in aligned columns below its caption; a cell may have several lines."""
    rows = [row for cells in (table.head, *table.rows) for row in _lines(cells)]
    width = [max(len(row[i]) for row in rows) for i in range(len(table.head))]
    lines = [
        "  ".join(
            cell.ljust(w) if i < table.text_columns else cell.rjust(w)
            for i, (cell, w) in enumerate(zip(row, width, strict=True))
        ).rstrip()
        for row in rows
    ]
    return "\n".join([table.caption, *lines])


def _lines(cells: Sequence[str]) -> list[tuple[str, ...]]:
    """A row of cells of several lines as rows of one line each."""
    parts = [cell.split("\n") for cell in cells]
    height = max(map(len, parts))
    return list(zip(*(part + [""] * (height - len(part)) for part in parts), strict=True))


def as_html(table: Table) -> str:
    """The table as an HTML element, every text escaped."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.head)
    body = "\n".join(f"<tr>{''.join(map(_html_cell, row))}</tr>" for row in table.rows)
    return (
        f"<table>\n<caption>{escape(table.caption)}</caption>\n<thead><tr>{head}</tr></thead>\n"
        f"<tbody>\n{body}\n</tbody>\n</table>"
    )


def _html_cell(cell: str) -> str:
    return f"<td>{escape(cell).replace(chr(10), '<br>')}</td>"
