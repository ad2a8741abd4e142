"""CSV tables: read column by column, refused with the file's own line and column where anything in them is
wrong.

The file is walked once by the standard library's parser, in blocks; a block's columns are converted whole.
Only where that fails are its rows looked at one by one, to name the offender.
"""

from __future__ import annotations

import csv
import gc
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import StringIO
from itertools import chain, islice
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starplumb.errors import InputError

from .files import nearest, read_text, show

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]
_BLOCK = 1 << 10
_NUMBER = "a finite number with a decimal point"


@dataclass(frozen=True)
class Table:
    """Columns of a CSV file, n rows: ``numbers`` as (n,) arrays, ``texts`` as lists without blanks around
    them.

    ``line`` (n,) is where each row stands in the file, counted from 1; ``notices`` are sentences for the
    user.
    """

    path: Path
    numbers: dict[str, Array]
    texts: dict[str, list[str]]
    line: NDArray[np.int64]
    notices: list[str]

    def __len__(self) -> int:
        return int(self.line.size)

    def error(self, row: int, column: str, found: object, wanted: str) -> InputError:
        """The sentence about one cell: file, line, column, what was found and what is wanted."""
        return _cell_error(self.path, int(self.line[row]), column, found, wanted)

    def columns(self, *names: str) -> Array:
        """Number columns side by side, (n, k)."""
        return np.stack([self.numbers[name] for name in names], axis=-1)

    def has(self, *names: str) -> bool:
        """Whether all of these number columns are there. Raises InputError where only some of them are."""
        there = [name for name in names if name in self.numbers]
        if there and len(there) < len(names):
            lacking = ", ".join(name for name in names if name not in there)
            raise InputError(
                f"{self.path}: found the column {there[0]} without {lacking}, wanted all of them or none"
            )
        return bool(there)

    def require(self, good: NDArray[np.bool_], column: str, wanted: str) -> None:
        """Raise InputError about the first row for which ``good`` (n,) does not hold."""
        if not good.all():
            row = int(np.argmin(good))
            raise self.error(row, column, float(self.numbers[column][row]), wanted)

    def require_distinct(self, keys: Sequence[object], column: str, wanted: str) -> None:
        """Raise InputError, naming both rows, where a key occurs twice."""
        first: dict[object, int] = {}
        for row, key in enumerate(keys):
            if (earlier := first.setdefault(key, row)) != row:
                found = f"{_worded(key)} again (first in row {self.line[earlier]})"
                raise InputError(
                    f"{self.path}, row {self.line[row]}, column {column}: found {found}, wanted {wanted}"
                )


def read_table(
    path: Path,
    *,
    texts: Sequence[str] = (),
    numbers: Sequence[str] = (),
    optional_texts: Sequence[str] = (),
    optional_numbers: Sequence[str] = (),
) -> Table:
    """A CSV file with a header row: ``texts`` and ``numbers`` are wanted, other columns are passed over with
    a notice.

    Comma-separated UTF-8 with or without a mark, any line ends, blank lines and leading ``#`` lines passed
    over. Raises InputError naming the file and, where there is one, the row (the line of the file) and
    column.
    """
    lines = _Lines(path, read_text(path))
    header = _header(path, lines, [*texts, *numbers], [*optional_texts, *optional_numbers])
    place = {name: i for i, name in enumerate(header)}
    wanted_texts = [name for name in (*texts, *optional_texts) if name in place]
    wanted_numbers = [name for name in (*numbers, *optional_numbers) if name in place]
    number_blocks: dict[str, list[Array]] = {name: [] for name in wanted_numbers}
    text_columns: dict[str, list[str]] = {name: [] for name in wanted_texts}
    line_blocks = []
    with _collector_paused():
        for block in lines.blocks():
            columns = _transpose(path, block, header)
            for name in wanted_numbers:
                number_blocks[name].append(_to_numbers(path, block, name, columns[place[name]]))
            for name in wanted_texts:
                text_columns[name] += _to_texts(path, block, name, columns[place[name]])
            line_blocks.append(block.line)
    if not line_blocks:
        raise InputError(f"{path}: found a header without rows below it, wanted at least one row")
    values = {name: np.concatenate(blocks) for name, blocks in number_blocks.items()}
    ignored = [name or "(unnamed)" for name in header if name not in values and name not in text_columns]
    notices = (
        [f"{path}: ignored the column{'s' * (len(ignored) > 1)} {', '.join(ignored)}"] if ignored else []
    )
    return Table(path, values, text_columns, np.concatenate(line_blocks), notices)


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
        return [cell.strip() for cell in next(self._guarded(), [])]

    def blocks(self) -> Iterator[_Block]:
        rows = self._guarded()
        while True:
            start = self.line
            block = list(islice(rows, _BLOCK))
            if not block:
                return
            if self.line - start == len(block) and all(block):
                yield _Block(block, np.arange(start + 1, self.line + 1))
            else:
                yield from self._uneven(block, start)

    def _uneven(self, block: list[list[str]], start: int) -> Iterator[_Block]:
        """Blank lines taken out, and cells that hold line breaks counted."""
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


def _header(path: Path, lines: _Lines, wanted: Sequence[str], optional: Sequence[str]) -> list[str]:
    """Names of the columns. Raises InputError where the header is missing, split otherwise, doubled or
    incomplete."""
    header = lines.header()
    where = f"{path}, row {lines.line}"
    if not header:
        raise InputError(f"{path}: found no header row, wanted {', '.join(wanted)}")
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and mark in header[0]:
            raise InputError(
                f"{where}: found columns separated by {name}, wanted commas (and decimal points)"
            )
    doubled = [name for name, count in Counter(header).items() if count > 1 and name]
    if doubled:
        raise InputError(f"{where}: found the column {show(doubled[0])} more than once, wanted it once")
    lacking = [name for name in wanted if name not in header]
    if lacking:
        spare = [name for name in header if name not in wanted and name not in optional]
        near = nearest(lacking[0], spare)
        hint = f" ({show(near)} is near it)" if near else ""
        columns = "the columns" if len(lacking) > 1 else "the column"
        found = show(", ".join(header))
        raise InputError(
            f"{where}: found the header {found}, wanted {columns} {', '.join(lacking)} too{hint}"
        )
    return header


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
    raise _cell_error(path, int(block.line[row]), name, cells[row].strip() or None, wanted)


def _is_number(cell: str) -> bool:
    try:
        return cell.isascii() and "_" not in cell and isfinite(float(cell))
    except ValueError:
        return False


def _to_texts(path: Path, block: _Block, name: str, cells: tuple[str, ...]) -> list[str]:
    texts = list(map(str.strip, cells))
    if not all(texts):
        row = texts.index("")
        raise _cell_error(path, int(block.line[row]), name, None, "text in every row")
    return texts


def _cell_error(path: Path, line: int, column: str, found: object, wanted: str) -> InputError:
    text = "an empty cell" if found is None else _worded(found)
    return InputError(f"{path}, row {line}, column {column}: found {text}, wanted {wanted}")


def _worded(found: object) -> str:
    return f"{found:.12g}" if isinstance(found, float) else show(found)
