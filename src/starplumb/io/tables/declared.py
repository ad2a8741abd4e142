"""What a user declares of a table: its own names of columns, which rows to keep, and how it writes times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import EpochError, InputError, did_you_mean
from ...physics.timescales import of_count, parse
from ..text.files import show
from ..text.numbers import decimal
from .schema import Schema, Value

Epochs = NDArray[np.int64]
Format = Literal["iso", "unix", "unix_ms", "gps_seconds", "gps_week", "jd", "mjd", "doy", "seconds_since"]

_DAY_NS = 86_400 * 10**9
_ORIGIN_MJD = {
    "unix": 40_587,
    "unix_ms": 40_587,
    "gps_seconds": 44_244,
    "gps_week": 44_244,
    "mjd": 0,
    "jd": 0,
}
"""The day from whose 0h a format counts: 1970-01-01, 1980-01-06, and those of Julian dates."""
_UNIT_NS = {
    "unix": 10**9,
    "unix_ms": 10**6,
    "gps_seconds": 10**9,
    "mjd": _DAY_NS,
    "jd": _DAY_NS,
    "seconds_since": 10**9,
}
OWN_SCALE = {"unix": "UTC", "unix_ms": "UTC", "gps_seconds": "GPS", "gps_week": "GPS"}
"""The scale that a format counts in where none is stated."""


@dataclass(frozen=True)
class Times:
    """Times as a table writes them, in the columns named; ``scale`` None: the format's own, else the campaign's."""

    columns: tuple[str, ...]
    format: Format = "iso"
    scale: str | None = None
    since: str | None = None

    def epochs(self, cells: Sequence[Sequence[str]], scale: str) -> Epochs:
        """``t_ns`` (n,) of the cells of each column.  Raises EpochError for a cell that is no such time."""
        own = self.scale or OWN_SCALE.get(self.format, scale)
        if self.format in ("iso", "doy"):
            return parse(cells[0], own)
        if self.format == "gps_week":
            counted = [
                Decimal(604_800) * _decimal(w, i) + _decimal(s, i)
                for i, (w, s) in enumerate(zip(*cells, strict=True))
            ]
            return of_count(_ORIGIN_MJD[self.format], _whole(counted, 10**9), own)
        numbers = [_decimal(cell, i) for i, cell in enumerate(cells[0])]
        if self.format == "jd":
            numbers = [number - Decimal("2400000.5") for number in numbers]
        count = _whole(numbers, _UNIT_NS[self.format])
        if self.since is not None:
            return np.asarray(parse([self.since], own)[0] + count, dtype=np.int64)
        return of_count(_ORIGIN_MJD[self.format], count, own)


def _decimal(cell: str, row: int) -> Decimal:
    number = decimal(cell)
    if number is None or abs(number) > 10**15:
        raise EpochError(
            f'found {show(cell)}, wanted a number, as time.format says; a date is format = "iso"', row
        )
    return number


def _whole(numbers: Sequence[Decimal], unit_ns: int) -> NDArray[np.int64]:
    """Numbers in whole nanoseconds."""
    try:
        return np.array([int((number * unit_ns).to_integral_value()) for number in numbers], dtype=np.int64)
    except OverflowError:
        row = int(np.argmax([abs(number * unit_ns) > 2**62 for number in numbers]))
        raise EpochError(f"found {numbers[row]}, wanted a time of this millennium", row) from None


@dataclass(frozen=True)
class Declared:
    """``key`` is the section that declares; ``columns`` takes our names to the table's; ``keep`` the values that a row
    must have, one of several, to be used at all; ``stated`` the one value of columns that the table lacks, by
    the key ``stated_by``; ``separator`` and ``decimal`` are those of a text file."""

    key: str = ""
    columns: Mapping[str, str] = field(default_factory=dict)
    keep: Mapping[str, tuple[Value, ...]] = field(default_factory=dict)
    time: Times | None = None
    stated: Mapping[str, float] = field(default_factory=dict)
    stated_by: str = ""
    separator: str = ","
    decimal: str = "."

    def name(self, column: str) -> str:
        """The table's own name of a column of ours."""
        if column == "time" and self.time is not None:
            return ", ".join(self.time.columns)
        return self.columns.get(column, column)

    def schema(self, asked: Schema, source: str) -> Schema:
        """What is asked for in the table's own names.  Raises InputError for a name of ours that nobody asks for."""
        replacing = tuple(name for others in asked.instead.values() for name in others)
        ours = (*asked.texts, *asked.numbers, *asked.optional_texts, *asked.optional_numbers, *replacing)
        for name in self.columns:
            if name not in ours or (name == "time" and self.time is not None):
                hint = did_you_mean(name, ours)
                wanted = f"{', '.join(ours)}{hint}" if name not in ours else "it in time.column only"
                raise InputError(f"{source}: {self.key}.columns: found {show(name)}, wanted {wanted}")
        stamps = () if self.time is None or "time" not in asked.texts else self.time.columns
        texts = [name for name in asked.texts if name != "time" or not stamps]
        given = [name for name in asked.optional_texts if name in self.columns]
        numbers = [name for name in asked.optional_numbers if name in self.columns]
        return replace(
            asked,
            texts=self._names(*texts, *given),
            numbers=self._names(*(name for name in asked.numbers if name not in self.stated), *numbers),
            optional_texts=self._names(*(name for name in asked.optional_texts if name not in given)),
            optional_numbers=self._names(
                *(name for name in asked.optional_numbers if name not in numbers),
                *(name for name in asked.numbers if name in self.stated),
            ),
            instead={self.name(one): self._names(*others) for one, others in asked.instead.items()},
            unknown=self._names(*asked.unknown),
            stamps=stamps,
            keep=self.keep,
            separator=self.separator,
            decimal=self.decimal,
        )

    def _names(self, *ours: str) -> list[str]:
        return list(dict.fromkeys(map(self.name, ours)))


UNDECLARED = Declared()
