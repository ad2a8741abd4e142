"""Rows of CSV text by the standard library's parser, in blocks whose columns are converted whole."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from io import StringIO
from itertools import chain, islice
from pathlib import Path
from sys import getsizeof

from ...physics.errors import InputError, counted
from .cells import Part, to_numbers, to_texts
from .schema import Schema

_BLOCK = 1 << 10
_CUT_OFF = "unexpected end of data"
_BLANK = [""]
MOST_EMPTY = 300_000_000
"""Bytes of memory of rows below the last one that holds something: a spreadsheet has a million."""


@dataclass(frozen=True)
class Block:
    """Consecutive rows as lists of cells, and their lines in the file."""

    rows: list[list[str]]
    line: Sequence[int]

    def kept(self, schema: Schema, header: Sequence[str]) -> Block:
        """The rows that are to be looked at."""
        at = {name: header.index(name) for name in schema.keep}
        rows = [
            i
            for i, row in enumerate(self.rows)
            if schema.kept({name: row[j] for name, j in at.items() if j < len(row)})
        ]
        return Block([self.rows[i] for i in rows], [self.line[i] for i in rows])

    def part(self, path: Path, schema: Schema, header: Sequence[str]) -> Part:
        """The columns that are read.  Raises InputError about the first cell that cannot be."""
        columns = dict(zip(header, _transposed(path, self, len(header)), strict=True))
        name, at = str(path), self.line.__getitem__
        numbers = {
            column: to_numbers(name, column, columns[column], at, schema.decimal, column in schema.unknown)
            for column in schema.numbers_in(header)
        }
        texts = {
            column: to_texts(name, column, columns[column], at)
            for column in (*schema.texts_in(header), *schema.stamps)
        }
        return Part(numbers, texts, self.line)


class CsvLines:
    """The rows of a CSV text, the lines of the file they stand on, and csv's own errors in a sentence.

    ``before`` lines stand above the text; where it is the ``top`` of a file comments and blank lines may stand above
    its header.
    """

    def __init__(
        self, path: Path, text: str, separator: str = ",", before: int = 0, top: bool = True
    ) -> None:
        self._path = path
        self._skipped = before
        source = iter(StringIO(text, newline=""))
        line = next(source, "")
        while top and (line.lstrip().startswith("#") or (line and not line.strip())):
            self._skipped += 1
            line = next(source, "")
        self.empty = not line
        lines = chain([line] if line else [], source)
        self._reader = csv.reader(lines, strict=True, skipinitialspace=True, delimiter=separator)

    @property
    def line(self) -> int:
        """The line that was read last, counted from 1."""
        return self._skipped + self._reader.line_num

    def header(self, schema: Schema) -> list[str]:
        """Names of the columns, without blanks around them; checked against ``schema``."""
        header = [cell.strip() for cell in next(self._guarded(), [])]
        schema.check(f"{self._path}, row {self.line}" if header else str(self._path), header)
        return header

    def blocks(self) -> Iterator[Block]:
        """Rows below the header, blank lines left out."""
        rows = self._guarded()
        while True:
            start = self.line
            block = list(islice(rows, _BLOCK))
            if not block:
                return
            if self.line - start == len(block) and min(map(len, block)) > 1:
                yield Block(block, range(start + 1, self.line + 1))
            else:
                yield from self._uneven(block, start)

    def _uneven(self, block: list[list[str]], start: int) -> Iterator[Block]:
        """A block without its blank lines (csv makes one cell of them, or none), line breaks in cells counted."""
        line, kept, at = start, [], []
        for row in block:
            line += 1
            if not row or row == _BLANK:
                continue
            line += sum(cell.count("\n") or cell.count("\r") for cell in row)
            if any(cell.strip() for cell in row) or len(row) > 1:
                kept.append(row)
                at.append(line)
        if kept:
            yield Block(kept, at)

    def cut_off(self) -> int | None:
        """Where the text ends within a row: the line at which the row before it ends."""
        end = self.line
        try:
            for _ in self._reader:
                end = self.line
        except csv.Error as error:
            return end if str(error) == _CUT_OFF else None
        return None

    def _guarded(self) -> Iterator[list[str]]:
        end = self.line
        try:
            for row in self._reader:
                yield row
                end = self.line
        except csv.Error as error:  # at the row that has the fault, not where a quote left open ended
            found = f"found text that is not CSV ({error}), wanted cells separated by commas, quotes closed"
            raise InputError(f"{self._path}, row {end + 1}: {found}") from None


def without_empty_end(blocks: Iterable[Block | Part], path: Path) -> Iterator[Block | Part]:
    """Blocks without the rows of empty cells that spreadsheets leave below the last one that holds something.

    Raises InputError where those rows, which wait for what follows, would fill the memory.
    """
    waiting: list[Block] = []
    held = 0
    for block in blocks:
        if isinstance(block, Part):
            yield from waiting
            yield block
            waiting, held = [], 0
            continue
        full = next((n for n in range(len(block.rows), 0, -1) if any(map(str.strip, block.rows[n - 1]))), 0)
        if full:
            yield from waiting
            yield Block(block.rows[:full], block.line[:full])
            waiting, held = [], 0
        if full < len(block.rows):
            waiting.append(Block(block.rows[full:], block.line[full:]))
            held += sum(map(getsizeof, waiting[-1].rows))
        if held > MOST_EMPTY:
            rows = sum(len(block.rows) for block in waiting)
            raise InputError(
                f"{path}, row {waiting[0].line[0]}: found {rows:,} rows of empty cells from here on, wanted values"
            )


def _transposed(path: Path, block: Block, width: int) -> list[tuple[str, ...]]:
    """Columns of a block. Raises InputError for a row with more or fewer cells than the header."""
    try:
        columns = list(zip(*block.rows, strict=True))
    except ValueError:
        columns = []
    if len(columns) != width:
        row = next(i for i, cells in enumerate(block.rows) if len(cells) != width)
        found = f"found {counted(len(block.rows[row]), 'cell')}"
        hint = " (are there decimal commas?)" if len(block.rows[row]) > width else ""
        raise InputError(f"{path}, row {block.line[row]}: {found}, wanted {width} as in the header{hint}")
    return columns
