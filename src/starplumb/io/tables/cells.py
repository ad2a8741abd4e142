"""Cells as text, converted column by column to numbers and texts; an error names the first cell that does not fit."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ..text.files import composed, show
from ..text.numbers import numbers
from ..text.visible import IN_NAME
from .schema import Schema

Array = NDArray[np.float64]

NUMBER = "a finite number with a decimal point"
PRINTABLE = "text without control characters"


@dataclass(frozen=True)
class Columns:
    """What was read of a table: n rows below a header.

    ``row_number`` takes a row (from 0) to the number by which the user finds it: the line of a text file; ``left_out``
    is how many rows were not to be looked at.
    """

    header: Sequence[str]
    numbers: dict[str, Array]
    texts: dict[str, Sequence[str]]
    rows: int
    row_number: Callable[[int], int]
    left_out: int = 0


@dataclass(frozen=True)
class Part:
    """Consecutive rows of a text file: columns that are read, and the line of each row."""

    numbers: Mapping[str, Array]
    texts: Mapping[str, Sequence[str]]
    line: Sequence[int]


def none_kept(name: str, schema: Schema) -> InputError:
    """The sentence about a table all of whose rows are left out."""
    wanted = ", ".join(
        f"{column} = {' or '.join(map(show, values))}" for column, values in schema.keep.items()
    )
    return InputError(f"{name}: found no row with {wanted}, wanted at least one")


def cell_error(name: str, row_number: int, column: str, found: object, wanted: str) -> InputError:
    """The sentence about one cell: table, row, column, what was found (None: nothing) and what is wanted."""
    return found_error(f"{name}, row {row_number}, column {column}", found, wanted)


def found_error(where: str, found: object, wanted: str) -> InputError:
    """The sentence about a cell that stands ``where``."""
    text = "an empty cell" if found is None else as_found(found)
    return InputError(f"{where}: found {text}, wanted {wanted}")


def as_found(found: object) -> str:
    """A cell's content for a message."""
    return f"{found:.12g}" if isinstance(found, float) else show(found)


def to_numbers(
    name: str,
    column: str,
    cells: Sequence[str],
    row_number: Callable[[int], int],
    decimal: str = ".",
    unknown: bool = False,
) -> Array:
    """Finite numbers (n,) of n cells; where they may be ``unknown`` an empty one is NaN, and one may be ``inf``.

    Raises InputError about the first cell that is none of these.
    """
    if decimal != ".":
        cells = [cell.replace(decimal, ".") for cell in cells]
    values = numbers(cells)
    good = np.isfinite(values)
    if unknown and not good.all():
        words = np.array([cell.strip().lower() for cell in cells])
        values[words == "inf"] = np.inf
        good |= (words == "") | (words == "inf")
    if good.all():
        return values
    row = int(np.argmin(good))
    found = cells[row].strip() or None
    raise cell_error(name, row_number(row), column, found, NUMBER if found else f"{NUMBER} in every row")


def to_texts(name: str, column: str, cells: Sequence[str], row_number: Callable[[int], int]) -> list[str]:
    """Texts in one spelling (NFC), without blanks around them. Raises InputError about the first empty cell."""
    texts = list(map(str.strip, cells))
    if not "".join(texts).isascii():
        texts = list(map(composed, texts))
    if not all(texts):
        raise cell_error(name, row_number(texts.index("")), column, None, "text in every row")
    if re.search(IN_NAME, "".join(texts)):
        row = next(row for row, text in enumerate(texts) if re.search(IN_NAME, text))
        raise cell_error(name, row_number(row), column, texts[row], PRINTABLE)
    return texts
