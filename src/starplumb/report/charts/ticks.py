"""Where an axis is ticked, and what is written there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .chart import Axis

Array = NDArray[np.float64]

STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
FEW, FINER = 3, (1.0, 2.0, 5.0)
"""Powers of ten on an axis below which these of each power are ticked too."""


def ticks(axis: Axis, most: int) -> tuple[Array, tuple[str, ...]]:
    """Places (k,) within the axis, with at most ``most`` steps between its ends, and their names."""
    if axis.names:
        every = -(-len(axis.names) // most)
        return np.arange(0.0, len(axis.names), every), axis.names[::every]
    if axis.log:
        low, high = np.log10(axis.low), np.log10(axis.high)
        powers = np.arange(np.ceil(low - 1e-9), np.floor(high + 1e-9) + 1)
        places = 10.0**powers
        if powers.size < FEW:
            each = 10.0 ** np.arange(np.floor(low), np.ceil(high) + 1)
            for parts in (FINER, np.arange(1.0, 10.0)):
                finer = np.outer(each, parts).ravel()
                places = finer[(finer >= axis.low) & (finer <= axis.high)]
                if places.size > 1:
                    break
        return places, tuple(f"{place:g}" for place in places)
    if axis.dates:
        return _dates(axis, most)
    step = _step(axis.high - axis.low, most)
    first, last = np.ceil(axis.low / step - 1e-9), np.floor(axis.high / step + 1e-9)
    at = step * np.arange(first, last + 1)
    return at, tuple(_named(value, step) for value in at.tolist())


DATES = (
    *(("m", 10), ("h", 1), ("h", 6), ("D", 1), ("D", 2), ("D", 7), ("D", 14)),
    *(("M", 1), ("M", 3), ("M", 6), ("Y", 1), ("Y", 2), ("Y", 5), ("Y", 10), ("Y", 20), ("Y", 50)),
)
"""Units of NumPy, and how many of them lie between two ticks of dates, the finest first."""


def _dates(axis: Axis, most: int) -> tuple[Array, tuple[str, ...]]:
    """The finest ticks of which no more than ``most`` fit; their names are ISO dates, as short as the unit allows."""
    ends = (np.array([axis.low, axis.high]) * 86_400e3).astype("datetime64[ms]")
    for unit, each in DATES:
        first, last = ends.astype(f"datetime64[{unit}]").astype(np.int64)
        count = np.arange(-(-first // each), last // each + 1) * each
        if count.size <= most:
            break
    at = count.astype(f"datetime64[{unit}]")
    days = at.astype("datetime64[ms]").astype(np.float64) / 86_400e3
    inside = (days >= axis.low) & (days <= axis.high)
    written = "m" if unit == "h" else unit
    return days[inside], tuple(map(str, at[inside].astype(f"datetime64[{written}]")))


def _step(width: float, most: int) -> float:
    """The least round step of which no more than ``most`` fit into a width."""
    raw = width / max(most, 1)
    power = 10.0 ** np.floor(np.log10(raw))
    return float(next(s for s in STEPS if s * power >= raw * (1.0 - 1e-9)) * power)


def _named(value: float, step: float) -> str:
    if max(abs(value), step) >= 1e7 or step < 1e-5:
        digits = 3 if value == 0.0 else max(3, int(np.log10(abs(value) / step)) + 2)
        return f"{value:.{digits}g}".replace("-", "−")
    places = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    if abs(step * 10.0**places - round(step * 10.0**places)) > 1e-6:
        places += 1  # steps of two and a half
    text = f"{value + 0.0:.{places}f}"
    return (text.lstrip("-") if float(text) == 0.0 else text).replace("-", "−")
