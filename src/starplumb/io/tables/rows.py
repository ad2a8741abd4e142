"""CSV tables row by row, by the standard library's parser: whatever is wrong in one is found and named.

The file is walked once, in blocks; a block's columns are converted whole.  Only where that fails are its rows looked
at one by one, to name the offender.
"""

from __future__ import annotations

import csv
import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import StringIO
from itertools import chain, islice
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ..text.files import read_text
from .header import Array, Columns, Wanted, cell_error

_BLOCK = 1 << 10
_NUMBER = "a finite number with a decimal point"


def read_rows(path: Path, wanted: Wanted) -> Columns:
    """The columns of a file. Raises InputError naming the file and, where there is one, the row and column."""
    lines = _Lines(path, read_text(path))
    header = lines.header()
    wanted.check(path, lines.line, header)
    place = {name: i for i, name in enumerate(header)}
    numbers: dict[str, list[Array]] = {name: [] for name in wanted.numbers_in(header)}
    texts: dict[str, list[str]] = {name: [] for name in wanted.texts_in(header)}
    line_blocks = []
    with _collector_paused():
        for block in lines.blocks():
            columns = _transpose(path, block, header)
            for name, blocks in numbers.items():
                blocks.append(_to_numbers(path, block, name, columns[place[name]]))
            for name, column in texts.items():
                column += _to_texts(path, block, name, columns[place[name]])
            line_blocks.append(block.line)
    if not line_blocks:
        raise InputError(f"{path}: found a header without rows below it, wanted at least one row")
    values = {name: np.concatenate(blocks) for name, blocks in numbers.items()}
    return Columns(header, values, texts, np.concatenate(line_blocks))


@contextmanager
def _collector_paused() -> Iterator[None]:
    """A million rows are a million short-lived lists, which the cycle collector would visit in vain (half the
    time)."""
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


class _Lines:
    """The rows of a CSV text, the lines of the file they stand on, and csv's own errors in a sentence."""

    def __init__(self, path: Path, text: str) -> None:
        self._path = path
        source = StringIO(text, newline="")
        self._skipped = 0
        line = source.readline()
        while line.lstrip().startswith("#") or (line and not line.strip()):
            self._skipped += 1
            line = source.readline()
        self._reader = csv.reader(chain([line] if line else [], source), strict=True, skipinitialspace=True)

    @property
    def line(self) -> int:
        return self._skipped + self._reader.line_num

    def header(self) -> list[str]:
        """Names of the columns, without blanks around them; none at the end of the file."""
        return [cell.strip() for cell in next(self._guarded(), [])]

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
        """Blank lines, of which csv makes no cell or one, taken out, and cells that hold line breaks counted."""
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
            found = f"found what is not CSV ({error}), wanted cells separated by commas, quotes closed"
            raise InputError(f"{self._path}, row {self.line}: {found}") from None


def _transpose(path: Path, block: _Block, header: list[str]) -> list[tuple[str, ...]]:
    """Columns of a block. Raises InputError for a row with more or fewer cells than the header."""
    width = len(header)
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


def _to_numbers(path: Path, block: _Block, name: str, cells: tuple[str, ...]) -> Array:
    joined = "".join(cells)
    if joined.isascii() and "_" not in joined:  # float() takes 1_000 and the digits of other scripts
        try:
            values = np.fromiter(map(float, cells), dtype=np.float64, count=len(cells))
        except ValueError:
            values = np.full(len(cells), np.nan)
        if np.isfinite(values).all():
            return values
    row = next(i for i, cell in enumerate(cells) if not _is_number(cell))
    wanted = _NUMBER if cells[row].strip() else f"{_NUMBER} in every row"
    raise cell_error(path, int(block.line[row]), name, cells[row].strip() or None, wanted)


def _is_number(cell: str) -> bool:
    try:
        return cell.isascii() and "_" not in cell and isfinite(float(cell))
    except ValueError:
        return False


def _to_texts(path: Path, block: _Block, name: str, cells: tuple[str, ...]) -> list[str]:
    texts = list(map(str.strip, cells))
    if not all(texts):
        row = texts.index("")
        raise cell_error(path, int(block.line[row]), name, None, "text in every row")
    return texts
