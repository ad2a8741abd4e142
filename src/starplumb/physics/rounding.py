"""How coarse written numbers are: the decimal step of a column of values or of epochs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]

ROUNDING = float(1.0 / np.sqrt(12.0))
"""Standard deviation of an error that is uniform over a step of 1."""
MOST_DECIMALS = 12
_TT_NS = 184_000_000
"""What TT is ahead of whole seconds of TAI."""


def decimal_step(values: Array, fuzz: float = 0.0) -> float:
    """Largest power of ten, at most 1, of which all values are multiples to ``fuzz`` and rounding; 0 where none is."""
    x = np.asarray(values, dtype=np.float64).reshape(-1)
    if x.size == 0:
        return 0.0
    largest = np.max(np.abs(x))
    for digits in range(MOST_DECIMALS + 1):
        if _slack(largest, digits, fuzz) > 0.05:
            return 0.0
        if _multiples(x[:64], digits, fuzz) and _multiples(x, digits, fuzz):
            return float(10.0**-digits)
    return 0.0


def _multiples(x: Array, digits: int, fuzz: float) -> bool:
    """Whether all values are whole numbers of a step of so many decimals."""
    y = x * 10.0**digits
    return bool(np.all(np.abs(y - np.rint(y)) <= _slack(x, digits, fuzz)))


def _slack(x: Array, digits: int, fuzz: float) -> Array:
    """How far from a whole number of steps a value may be."""
    return np.asarray(np.maximum(8.0 * np.spacing(np.abs(x * 10.0**digits)), fuzz * 10.0**digits))


def time_step(t_ns: Epochs) -> float:
    """Largest power of ten of a second, at most 1, of which all epochs are multiples; 0 where they tell nothing.

    Epochs at multiples of ten seconds are so by design, as are those a whole number of their own spacings apart.
    """
    found = 0, t_ns
    for t in (t_ns, t_ns - _TT_NS):
        step = 10**9
        while step > 1 and np.any(t % step):
            step //= 10
        found = max(found, (step, t), key=lambda pair: pair[0])
    step, t = found
    return step * 1e-9 if np.any(t % (10 * step)) else 0.0


def is_grid(t_ns: Epochs, step_s: float) -> bool:
    """Whether epochs that are multiples of a step lie on one far coarser grid, and so are exact rather than rounded.

    Samples that are whole numbers of their own spacing apart, or three epochs or more of ten steps: the spacings of
    rounded times have no common measure but the step.
    """
    apart = np.diff(np.sort(t_ns))
    if apart.size < 2:
        return False
    measure = int(np.gcd.reduce(apart))
    return measure >= int(np.median(apart)) or (apart.size > 2 and measure >= 10 * round(step_s * 1e9))
