"""What every command prints with: tables for people, JSON for programs, notices on standard error."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from ..io.text.visible import visible
from .channels import complain, print_json

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

    from ..report.page import Table as Cells
    from ..session.show import Shown

Json = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON on standard output, nothing else.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Say more: what was read, and each step.")]


Item = TypeVar("Item")

PIPE_WIDTH = 120
"""Columns of a table that no terminal shows: the same whatever it is piped into."""


_DATE_AND_TIME = re.compile(r"\b(\d{4}-\d\d-\d\d)T(?=\d\d:\d\d)")


@dataclass(frozen=True)
class Output:
    """The way one command speaks: ``json`` prints only the document, ``quiet`` nothing, ``verbose`` details as well."""

    json: bool = False
    quiet: bool = False
    verbose: bool = False

    @property
    def console(self) -> Console:
        from rich.console import Console

        width = None if sys.stdout.isatty() else PIPE_WIDTH
        # names of campaigns and files are shown as they are, brackets and colons included
        return Console(highlight=False, soft_wrap=True, markup=False, emoji=False, width=width)

    def show(self, *parts: RenderableType) -> None:
        """Tables and sentences for a person."""
        if not (self.json or self.quiet):
            self.console.print(*(visible(p) if isinstance(p, str) else p for p in parts), sep="\n")

    def shown(self, thing: Shown, *sentences: str) -> None:
        """The tables and sentences of an object, and further sentences."""
        if not (self.json or self.quiet):
            self.show(*map(self.table, thing.tables), *thing.sentences, *sentences)

    def table(self, cells: Cells) -> Table:
        """A table as wide as the terminal takes."""
        return drawn(cells, self.console.width)

    def detail(self, *parts: RenderableType) -> None:
        if self.verbose:
            self.show(*parts)

    def document(self, document: dict[str, Any] | list[dict[str, Any]]) -> None:
        """The same result for a program."""
        if self.json:
            print_json(document)

    def notices(self, notices: Iterable[str]) -> None:
        """What was left out or looks odd, one line each on standard error."""
        if not self.quiet:
            for notice in notices:
                complain(f"note: {notice}")

    @contextmanager
    def doing(self, words: str) -> Iterator[None]:
        """What takes a while, said on a terminal's standard error while it lasts, nothing in a pipe."""
        if self.quiet or not sys.stderr.isatty():
            yield
            return
        from rich.console import Console

        with Console(stderr=True).status(words):
            yield

    def watched(self, items: Iterable[Item], doing: str, total: int) -> Iterable[Item]:
        """The items of long work with a progress bar on a terminal's standard error, none in a pipe."""
        from rich.console import Console

        console = Console(stderr=True)
        if self.quiet or not console.is_terminal:
            return items
        from rich.progress import track

        return track(items, doing, total=total, console=console, transient=True)


def drawn(cells: Cells, room: int) -> Table:
    """A small table with lines; one whose cells have several lines is drawn open, with space between its rows.

    Where there is no ``room`` for all columns, cells go on below, at their spaces as long as that helps.
    """
    from rich import box
    from rich.table import Table

    several = any("\n" in cell for row in cells.rows for cell in row)
    open_style: dict[str, Any] = {"box": box.SIMPLE_HEAD, "leading": 1, "pad_edge": False} if several else {}
    table = Table(title=visible(cells.caption), title_justify="left", **open_style)
    rows = [[visible(_apart(cell)) for cell in row] for row in cells.rows]
    head = [visible(heading) for heading in cells.head]
    widths = _widths([head, *rows], room, 3)
    if widths is None:  # too many columns for spaces beside their lines
        widths, table.padding = _widths([head, *rows], room, 1), (0, 0)
    for i, (heading, width) in enumerate(zip(head, widths or len(head) * [None], strict=True)):
        side: Any = "left" if i < cells.text_columns else "right"
        table.add_column(heading, justify=side, overflow="fold", width=width)
    for i, row in enumerate(rows):
        if cells.totals and i == len(rows) - cells.totals:
            table.add_section()
        table.add_row(*row)
    return table


def _widths(rows: Sequence[Sequence[str]], room: int, beside: int) -> list[int] | None:
    """Widths of columns that break no word, with lines and spaces ``beside`` each; None where there is none such."""
    from rich.cells import cell_len  # a Chinese letter takes two places

    columns = list(zip(*rows, strict=True))
    whole = [
        max(cell_len(line) for cell in column for line in [*cell.splitlines(), ""]) for column in columns
    ]
    words = [max(cell_len(word) for cell in column for word in [*cell.split(), ""]) for column in columns]
    spare = room - beside * len(columns) - 1 - sum(words)
    wish = sum(whole) - sum(words)
    if spare < 0:
        return None
    return [
        least + min(spare, wish) * (most - least) // max(wish, 1)
        for least, most in zip(words, whole, strict=True)
    ]


def _apart(cell: str) -> str:
    """A cell with room between date and time, so that it may go on below there."""
    return _DATE_AND_TIME.sub(r"\1 ", cell)
