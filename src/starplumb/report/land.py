"""Coastlines under a map.

Natural Earth, 1:110 million, land, version 4.1 (public domain, naturalearthdata.com), in ``data/land.npy``: longitude
and latitude (n, 2) in hundredths of a degree, which is finer than the lines are, outlines parted by 32767,
also where they cross the 180th meridian.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from ..physics.units import DEG
from .charts.chart import HEIGHT, WIDTH, Line

Array = NDArray[np.float64]

GAP = 32767
LEAST_DEG = 12.0
"""A map shows at least so many degrees of latitude: less has no coast to know the place by."""
ASPECT = 0.75 * WIDTH / HEIGHT * 1.15
"""Of the inner rectangle of a map."""


@cache
def coastlines() -> Array:
    """Longitude and latitude (n, 2), deg, of polygons one after another, with NaN between them."""
    with (files("starplumb.report") / "data" / "land.npy").open("rb") as file:
        stored = np.load(file, allow_pickle=False)
    return np.where(stored == GAP, np.nan, stored / 100.0)


def coast(west: float, east: float, south: float, north: float) -> tuple[Line, ...]:
    """Coastlines within a region, deg; ``east`` may go beyond 180.  Nothing where there are none."""
    lines = (_within(coastlines() + np.array([turn, 0.0]), west, east, south, north) for turn in (0.0, 360.0))
    return tuple(Line(x, y, "muted", width=0.9) for x, y in lines if np.any(np.isfinite(x)))


def _within(at: Array, west: float, east: float, south: float, north: float) -> tuple[Array, Array]:
    """The pieces of a polyline that may cross a region, with NaN in place of the others."""
    x, y = at.T
    inside = (x >= west) & (x <= east) & (y >= south) & (y <= north)
    near = inside.copy()
    near[1:] |= inside[:-1]  # the first point beyond belongs to the piece
    near[:-1] |= inside[1:]
    kept = near | np.isnan(x)
    x, y = np.where(near, x, np.nan)[kept], np.where(near, y, np.nan)[kept]
    broken = np.flatnonzero(np.diff(np.flatnonzero(kept)) > 1) + 1
    return np.insert(x, broken, np.nan), np.insert(y, broken, np.nan)


def region(places: Array) -> tuple[float, float, float, float]:
    """West, east, south, north, deg, of a map that holds the places and has their proportions on the ground."""
    low, high = places.min(axis=0), places.max(axis=0)
    middle = 0.5 * (low + high)
    narrow = max(np.cos(middle[1] * DEG), 0.1)
    tall = max(LEAST_DEG, 1.3 * (high[1] - low[1]), 1.3 * (high[0] - low[0]) * narrow / ASPECT)
    wide = min(tall * ASPECT / narrow, 360.0)
    return (
        middle[0] - wide / 2,
        middle[0] + wide / 2,
        max(middle[1] - tall / 2, -90.0),
        min(middle[1] + tall / 2, 90.0),
    )
