"""CSV tables: read column by column, refused with the file's own line and column where anything in them is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from .header import Wanted, cell_error, worded
from .plain import read_plain
from .rows import read_rows

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]


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
        return cell_error(self.path, int(self.line[row]), column, found, wanted)

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
        if len(set(keys)) == len(keys):
            return
        first: dict[object, int] = {}
        for row, key in enumerate(keys):
            if (earlier := first.setdefault(key, row)) != row:
                found = f"{worded(key)} again (first in row {self.line[earlier]})"
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
    wanted = Wanted(texts, numbers, optional_texts, optional_numbers)
    found = read_plain(path, wanted) or read_rows(path, wanted)
    ignored = [
        name or "(unnamed)" for name in found.header if name not in found.numbers and name not in found.texts
    ]
    notices = (
        [f"{path}: ignored the column{'s' * (len(ignored) > 1)} {', '.join(ignored)}"] if ignored else []
    )
    return Table(path, found.numbers, found.texts, found.line, notices)
