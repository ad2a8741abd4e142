"""What is asked of a CSV table, the check of its header against that, and the columns that come of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ..text.files import nearest, show

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wanted:
    """Names of the columns of text and of numbers that a table must have, and of those that it may have."""

    texts: Sequence[str]
    numbers: Sequence[str]
    optional_texts: Sequence[str] = ()
    optional_numbers: Sequence[str] = ()

    def texts_in(self, header: Sequence[str]) -> list[str]:
        """Columns of text that are to be read."""
        return [name for name in (*self.texts, *self.optional_texts) if name in header]

    def numbers_in(self, header: Sequence[str]) -> list[str]:
        """Columns of numbers that are to be read."""
        return [name for name in (*self.numbers, *self.optional_numbers) if name in header]

    def check(self, path: Path, line: int, header: Sequence[str]) -> None:
        """Raise InputError where the header is missing, split otherwise, doubled or incomplete."""
        needed = [*self.texts, *self.numbers]
        where = f"{path}, row {line}"
        if not header:
            raise InputError(f"{path}: found no header row, wanted {', '.join(needed)}")
        for mark, name in ((";", "semicolons"), ("\t", "tabs")):
            if len(header) == 1 and mark in header[0]:
                raise InputError(
                    f"{where}: found columns separated by {name}, wanted commas (and decimal points)"
                )
        doubled = [name for name, count in Counter(header).items() if count > 1 and name]
        if doubled:
            raise InputError(f"{where}: found the column {show(doubled[0])} more than once, wanted it once")
        lacking = [name for name in needed if name not in header]
        if lacking:
            known = (*needed, *self.optional_texts, *self.optional_numbers)
            near = nearest(lacking[0], [name for name in header if name not in known])
            hint = f" ({show(near)} is near it)" if near else ""
            columns = "the columns" if len(lacking) > 1 else "the column"
            found = show(", ".join(header))
            raise InputError(
                f"{where}: found the header {found}, wanted {columns} {', '.join(lacking)} too{hint}"
            )


@dataclass(frozen=True)
class Columns:
    """All of a file that was asked for: n rows, each with its line in the file, below one header."""

    header: Sequence[str]
    numbers: dict[str, Array]
    texts: dict[str, list[str]]
    line: NDArray[np.int64]


def cell_error(path: Path, line: int, column: str, found: object, wanted: str) -> InputError:
    """The sentence about one cell: file, line, column, what was found (None: nothing) and what is wanted."""
    text = "an empty cell" if found is None else worded(found)
    return InputError(f"{path}, row {line}, column {column}: found {text}, wanted {wanted}")


def worded(found: object) -> str:
    """A cell's content for a message."""
    return f"{found:.12g}" if isinstance(found, float) else show(found)
