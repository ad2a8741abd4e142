"""Single lines of an SP3 file: names of satellites, epochs, and three numbers in fields of fixed width."""

from __future__ import annotations

import re
from datetime import datetime, timedelta
from functools import cache
from pathlib import Path

import numpy as np

from ...physics import timescales
from ...physics.errors import EpochError, InputError
from ..text.files import show
from ..text.numbers import numbers, whole

_FIELDS = (slice(4, 18), slice(18, 32), slice(32, 46))
_EPOCH = re.compile(
    r"\* +(\d{1,4}) +(\d{1,2}) +(\d{1,2}) +(\d{1,2}) +(\d{1,2}) +(\d{1,2})(?:\.(\d*))?\s*", re.ASCII
)
_ABSENT = 999999.0
"""Fields of 999999.999999 mean that there is no position or velocity (as three zeros do)."""


@cache
def name_of(field: str) -> str:
    """Identifier in its usual form: letter and two digits (G 1 is G01, and 1 without a letter too)."""
    name = field.replace(" ", "0")
    return f"G{name[1:]}" if len(name) == 3 and name[0] == "0" and whole(name) else name


def read_epoch(path: str | Path, number: int, line: str, scale: str) -> str:
    """ISO 8601 text of an epoch line; its date is checked when it is parsed.

    Some centres write the full minute, hour or day as minute 60, second 60 or hour 24 of the one before.
    """
    found = _EPOCH.fullmatch(line)
    if found is None:
        raise InputError(
            f"{path}, line {number}: found {show(line.strip())}, wanted * year month day hour minute second"
        )
    year, month, day, hour, minute, second = map(int, found.groups()[:6])
    decimals = found[7] or "0"
    if hour > 24 or minute > 60 or second > 60:
        raise InputError(
            f"{path}, line {number}: found {show(line.strip())}, wanted hours to 24, minutes and seconds to 60"
        )
    text = f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{minute:02d}:{second:02d}.{decimals}"
    if (hour < 24 and minute < 60 and second < 60) or (scale == "UTC" and _is_leap_second(text)):
        return text
    try:
        carried = datetime(year, month, day) + timedelta(hours=hour, minutes=minute, seconds=second)
    except (ValueError, OverflowError):
        return text
    return f"{carried:%Y-%m-%dT%H:%M:%S}.{decimals}"


def _is_leap_second(text: str) -> bool:
    try:
        timescales.parse([text], "UTC")
    except EpochError:
        return False
    return True


def vector(path: str | Path, number: int, line: str, power: int) -> list[float] | None:
    """Three fixed-width fields times ten to ``power``, None where the file marks them as missing."""
    fields = [line[columns] for columns in _FIELDS]
    raw, scaled = numbers(fields), numbers(fields, power)
    if not (line.isascii() and np.isfinite([raw, scaled]).all()):
        raise InputError(
            f"{path}, line {number}: found {show(line[4:46].strip())}, wanted three numbers in fields of 14"
        )
    absent = not raw.any() or bool((np.abs(raw) >= _ABSENT).any())
    return None if absent else scaled.tolist()
