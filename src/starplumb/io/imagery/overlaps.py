"""Tiles of one orthoimage show the same ground where they overlap, or one of them lies wrongly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ...physics.units import DEG
from .ortho import METRES_A_DEGREE, Tile

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]
"""West, east, south, north, deg."""

ALIKE = 0.4
"""Correlation below which two tiles show other ground: another date or sensor leaves more."""
WINDOW = 64
"""Cells along each side of a window that is compared."""
LEAST = 400
"""Cells that both tiles must know in a window."""
MOST_PAIRS = 200
_ALONG = (0.5, 0.25, 0.75)
"""Where along both sides of an overlap windows lie."""


def require_agreement(tiles: Sequence[Tile]) -> None:
    """Raise InputError about the first two tiles that overlap and show other ground there."""
    boxes = [_box(tile) for tile in tiles]
    seen = 0
    for (one, a), (other, b) in combinations(zip(tiles, boxes, strict=True), 2):
        common = max(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), min(a[3], b[3])
        if common[0] >= common[1] or common[2] >= common[3] or seen >= MOST_PAIRS:
            continue
        seen += 1
        alike = [c for c in _correlations(one, other, common) if np.isfinite(c)]
        if alike and max(alike) < ALIKE:
            first, second = (tile.image.pixels.path for tile in (one, other))
            raise InputError(
                f"{second}: found other ground than {first} shows where the two overlap (correlation "
                f"{max(alike):.2f}), wanted tiles that agree; one lies wrongly (reference system, world file) or is of "
                "another band"
            )


def _box(tile: Tile) -> Box:
    columns, rows = tile.image.size_px
    u, v = (np.linspace(-0.5, n - 0.5, 9) for n in (columns, rows))
    border = np.concatenate(
        [np.stack([u, np.full(9, end)], -1) for end in (v[0], v[-1])]
        + [np.stack([np.full(9, end), v], -1) for end in (u[0], u[-1])]
    )
    longitude, latitude = tile.places(border[:, 0], border[:, 1])
    return float(longitude.min()), float(longitude.max()), float(latitude.min()), float(latitude.max())


def _correlations(one: Tile, other: Tile, common: Box) -> Iterator[float]:
    """Those of windows of the overlap; NaN where there is too little to compare."""
    west, east, south, north = common
    step_m = max(one.cell_m, other.cell_m)
    side = step_m * np.arange(WINDOW) / METRES_A_DEGREE
    side -= 0.5 * side[-1]
    for along in _ALONG:
        latitude, longitude = south + along * (north - south), west + along * (east - west)
        y, x = np.meshgrid(latitude - side, longitude + side / np.cos(latitude * DEG), indexing="ij")
        yield _correlation(*(tile.sample(y * DEG, x * DEG, step_m) for tile in (one, other)))


def _correlation(a: Array, b: Array) -> float:
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < LEAST:
        return np.nan
    a, b = a[both] - a[both].mean(), b[both] - b[both].mean()
    power = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return float(np.sum(a * b)) / power if power > 0.0 else np.nan
