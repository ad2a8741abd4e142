"""CSV tables by the standard library's parser: small files, and whatever is unusual or wrong in large ones.

The file is walked once, in blocks, whose columns are converted whole; the line of every row is known.
"""

from __future__ import annotations

import csv
import gc
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import StringIO
from itertools import chain, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ..text.files import read_beginning, read_text
from .cells import Array, Columns, none_kept, to_numbers, to_texts
from .schema import Schema

_BLOCK = 1 << 10
_LONG = 1 << 16
"""Bytes of a file from which its header is looked at first: as many as its beginning has."""
MOST_TABLE = 1_000_000_000
"""Bytes of a table that is read as a whole; a larger one that holds nothing unusual PyArrow reads in pieces."""


def require_header(path: Path, schema: Schema) -> None:
    """Raise InputError for a long file whose header is none, before the rest is read."""
    head = read_beginning(path)
    whole = head[: head.rfind(b"\n") + 1]
    if len(head) < _LONG or b'"' in whole or b"\0" in whole:
        return
    with suppress(UnicodeDecodeError):
        CsvLines(path, StringIO(whole.decode("utf-8-sig"), newline=""), schema.separator).header(schema)


def read_rows(path: Path, schema: Schema, most: int = MOST_TABLE) -> Columns:
    """The columns of a file. Raises InputError naming the file and, where there is one, the row and column."""
    lines = CsvLines(path, StringIO(read_text(path, most, None), newline=""), schema.separator)
    header = lines.header(schema)
    place = {name: i for i, name in enumerate(header)}
    numbers: dict[str, list[Array]] = {name: [] for name in schema.numbers_in(header)}
    texts: dict[str, list[str]] = {name: [] for name in (*schema.texts_in(header), *schema.stamps)}
    line_blocks, all_rows = [], 0
    with _collector_paused():
        for whole in _without_empty_end(lines.blocks()):
            all_rows += len(whole.rows)
            block = _kept(whole, schema, place) if schema.keep else whole
            if not block.rows:
                continue
            columns = _transposed(path, block, len(header))
            for name, blocks in numbers.items():
                blocks.append(
                    to_numbers(
                        *(str(path), name, columns[place[name]], block.line_of, schema.decimal),
                        name in schema.unknown,
                    )
                )
            for name, column in texts.items():
                column += to_texts(str(path), name, columns[place[name]], block.line_of)
            line_blocks.append(block.line)
    if not line_blocks and all_rows:
        raise none_kept(str(path), schema)
    if not (line_blocks or schema.may_be_empty):
        raise InputError(f"{path}: found a header without rows below it, wanted at least one row")
    line = np.concatenate([*line_blocks, np.empty(0, dtype=np.int64)])
    values = {name: np.concatenate([*blocks, np.empty(0)]) for name, blocks in numbers.items()}
    return Columns(header, values, dict(texts), line.size, lambda row: int(line[row]), all_rows - line.size)


@contextmanager
def _collector_paused() -> Iterator[None]:
    """Pause the cycle collector: a million rows are a million short-lived lists, and visiting them doubles the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@dataclass(frozen=True)
class _Block:
    """Consecutive rows as lists of cells, and their lines in the file."""

    rows: list[list[str]]
    line: NDArray[np.int64]

    def line_of(self, row: int) -> int:
        return int(self.line[row])


class CsvLines:
    """The rows of a CSV text, the lines of the file they stand on, and csv's own errors in a sentence.

    ``text`` gives lines with their ends, as a file opened with ``newline=""`` does.
    """

    def __init__(self, path: Path, text: Iterable[str], separator: str = ",") -> None:
        self._path = path
        self._skipped = 0
        source = iter(text)
        line = next(source, "")
        while line.lstrip().startswith("#") or (line and not line.strip()):
            self._skipped += 1
            line = next(source, "")
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

    def blocks(self) -> Iterator[_Block]:
        """Rows below the header, blank lines left out."""
        rows = self._guarded()
        while True:
            start = self.line
            block = list(islice(rows, _BLOCK))
            if not block:
                return
            if self.line - start == len(block) and min(map(len, block)) > 1:
                yield _Block(block, np.arange(start + 1, self.line + 1))
            else:
                yield from self._uneven(block, start)

    def _uneven(self, block: list[list[str]], start: int) -> Iterator[_Block]:
        """A block without its blank lines (csv makes one cell of them, or none), line breaks in cells counted."""
        line, kept, at = start, [], []
        for row in block:
            line += 1 + sum(cell.count("\n") or cell.count("\r") for cell in row)
            if any(cell.strip() for cell in row) or len(row) > 1:
                kept.append(row)
                at.append(line)
        if kept:
            yield _Block(kept, np.array(at, dtype=np.int64))

    def _guarded(self) -> Iterator[list[str]]:
        try:
            yield from self._reader
        except csv.Error as error:
            found = f"found text that is not CSV ({error}), wanted cells separated by commas, quotes closed"
            raise InputError(f"{self._path}, row {self.line}: {found}") from None


def _without_empty_end(blocks: Iterable[_Block]) -> Iterator[_Block]:
    """Blocks without the rows of empty cells that spreadsheets leave below the last one that holds something."""
    waiting: list[_Block] = []
    for block in blocks:
        full = next((n for n in range(len(block.rows), 0, -1) if any(map(str.strip, block.rows[n - 1]))), 0)
        if full:
            yield from waiting
            yield _Block(block.rows[:full], block.line[:full])
            waiting = []
        if full < len(block.rows):
            waiting.append(_Block(block.rows[full:], block.line[full:]))


def _kept(block: _Block, schema: Schema, place: Mapping[str, int]) -> _Block:
    """The rows of a block that are kept."""
    at = {name: place[name] for name in schema.keep}
    rows = [
        i
        for i, row in enumerate(block.rows)
        if schema.kept({name: row[j] for name, j in at.items() if j < len(row)})
    ]
    return _Block([block.rows[i] for i in rows], block.line[rows])


def _transposed(path: Path, block: _Block, width: int) -> list[tuple[str, ...]]:
    """Columns of a block. Raises InputError for a row with more or fewer cells than the header."""
    try:
        columns = list(zip(*block.rows, strict=True))
    except ValueError:
        columns = []
    if len(columns) != width:
        row = next(i for i, cells in enumerate(block.rows) if len(cells) != width)
        found = f"found {len(block.rows[row])} cell{'s' * (len(block.rows[row]) != 1)}"
        hint = " (are there decimal commas?)" if len(block.rows[row]) > width else ""
        raise InputError(f"{path}, row {block.line[row]}: {found}, wanted {width} as in the header{hint}")
    return columns
