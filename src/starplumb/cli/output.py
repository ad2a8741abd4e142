"""What every command prints with: tables for people, JSON for programs, notices on standard error."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
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
            self.show(*map(drawn, thing.tables), *thing.sentences, *sentences)

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


def drawn(cells: Cells) -> Table:
    """A small table with lines; one whose cells have several lines is drawn open, with room between its rows."""
    from rich import box
    from rich.table import Table

    several = any("\n" in cell for row in cells.rows for cell in row)
    open_style: dict[str, Any] = {"box": box.SIMPLE_HEAD, "leading": 1, "pad_edge": False} if several else {}
    table = Table(title=visible(cells.caption), title_justify="left", **open_style)
    for i, heading in enumerate(cells.head):
        text = i < cells.text_columns
        table.add_column(
            visible(heading), justify="left" if text else "right", overflow="fold" if text else "ellipsis"
        )
    for i, row in enumerate(cells.rows):
        if cells.totals and i == len(cells.rows) - cells.totals:
            table.add_section()
        table.add_row(*map(visible, row))
    return table
