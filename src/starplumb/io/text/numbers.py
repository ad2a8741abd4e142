"""Numbers written in text, by one rule for every reader.

A number is ASCII digits with at most one decimal point, a sign before them or none, and an exponent of ten or none; it
is read as the nearest double.  So ``nan``, ``1_000`` and digits of other scripts are none, though Python's ``float``
takes them; nor is one of 1e75 or more, whose square or fourth power no double holds, and which no quantity has.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.units import LEAST_SIGMA, MOST_SIGMA

Array = NDArray[np.float64]

MOST_FINITE = 1e75
"""What is as large as this counts as not finite."""
_LETTERS = b"0123456789.+-eE \t"
_BLANKS = " \t"
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+))(?:[eE]([-+]?\d{1,6}))?", re.ASCII)
_WHOLE = re.compile(r"[-+]?\d+", re.ASCII)
_MOST_DIGITS = 400
"""Of a decimal number that is kept exactly, and the largest of its exponents."""


SIGMA_WORDS = f"{LEAST_SIGMA:g} to {MOST_SIGMA:g}"
LEAST, MOST = 1e-9, 1e12
"""Of other positive numbers."""


def is_sigma(x: Array | float, exact: bool = True) -> Any:
    """Whether numbers, of any shape, can be sigmas; ``exact`` lets 0 be one, which claims an exact value."""
    return ((x >= LEAST_SIGMA) & (x <= MOST_SIGMA)) | (exact & (x == 0.0))


def numbers(texts: Sequence[str], power: int = 0) -> Array:
    """The doubles (n,) nearest to texts times ten to ``power``; NaN for a text that is no number."""
    joined = "".join(texts)
    if not joined.isascii() or joined.encode("ascii").translate(None, _LETTERS):
        return _singly(texts, power)
    scaled: Iterable[str] = (f"{text}e{power}" for text in texts) if power else texts
    try:
        values = np.fromiter(map(float, scaled), dtype=np.float64, count=len(texts))
    except ValueError:  # an exponent of its own, or no number
        return _singly(texts, power)
    values[~(np.abs(values) < MOST_FINITE)] = np.nan
    for row in np.flatnonzero(values == 0.0).tolist():  # an absurd exponent makes 0 too
        if "e" in texts[row] or "E" in texts[row]:
            values[row] = number(texts[row], power)
    return values


def number(text: str, power: int = 0) -> float:
    """The double nearest to a text times ten to ``power``; NaN where it is no number."""
    found = _NUMBER.fullmatch(text.strip(_BLANKS))
    if found is None:
        return np.nan
    value = float(f"{found[1]}e{int(found[2] or 0) + power}")
    return value if abs(value) < MOST_FINITE else np.nan


def decimal(text: str) -> Decimal | None:
    """A number with all its digits; None for a text that is no number, or one of an absurd size."""
    found = _NUMBER.fullmatch(text.strip(_BLANKS))
    if found is None or len(found[1]) > _MOST_DIGITS or abs(int(found[2] or 0)) > _MOST_DIGITS:
        return None
    return Decimal(found[0])


def whole(text: str, digits: int = 18) -> int | None:
    """A whole number of at most so many digits; None for any other text."""
    plain = text.strip(_BLANKS)
    return int(plain) if _WHOLE.fullmatch(plain) and len(plain.lstrip("+-")) <= digits else None


def finite_float(value: object) -> float | None:
    """A number of a document (TOML, JSON) as a double; None for text, truth values, and what a double does not hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return found if abs(found) < MOST_FINITE else None


def _singly(texts: Sequence[str], power: int) -> Array:
    return np.array([number(text, power) for text in texts], dtype=np.float64)
