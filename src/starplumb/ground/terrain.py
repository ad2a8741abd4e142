"""Where a line of sight first meets the ground, given the ground's heights.

The ray is walked down from above the highest ground that it may meet in steps no longer on the ground than one cell of
the height model, so that no ridge is stepped over, and the first crossing is closed in on by bisection.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..physics.earth import C_JT, itrf_to_geodetic
from ..table.campaign import Campaign
from ..table.geometry import locate

Array = NDArray[np.float64]
Index = NDArray[np.int64]

HeightAt = Callable[[Array, Array], Array]
"""Heights (n,) m above the ellipsoid at latitudes and longitudes (n,) rad; NaN where they are not known."""

HIGHEST, LOWEST = 9000.0, -500.0
"""No ground lies above or below, m."""
_ROUGH = 96
"""Steps of the first walk, which finds the range of heights along the ray."""
_MOST = 4000
"""Steps of the second walk at most."""
_HALVINGS = 40


def ground_height(
    campaign: Campaign, C_EK: Array, image: int, pixel: Array, height_at: HeightAt, step_m: float
) -> float:
    """Height (m) of the ground that a pixel (2,) of an image sees; NaN where the ray meets no known ground.

    ``step_m`` is the cell of the height model.  Raises EpochError for an image outside the orbit or attitude.
    """

    def along(height: Array) -> Array:
        """Points (k, 3) of the ray at heights (k,)."""
        index = np.full(height.size, image)
        column, row = np.broadcast_to(pixel[:, None], (2, height.size))
        return locate(campaign, C_EK, index, column, row, height)

    def above(height: Array) -> Array:
        """Height of the ray above the ground, at heights (k,) of the ray."""
        latitude, longitude, _ = itrf_to_geodetic(along(height))
        return height - height_at(latitude, longitude)

    rough = np.linspace(HIGHEST, LOWEST, _ROUGH)
    ground = rough - above(rough)
    if not np.any(np.isfinite(ground)):
        return float("nan")
    margin = rough[0] - rough[1]
    top, bottom = np.nanmax(ground) + margin, np.nanmin(ground) - margin
    walked = float(np.linalg.norm(np.diff(along(np.array([top, bottom])), axis=0)))
    heights = np.linspace(top, bottom, int(np.clip(np.ceil(walked / step_m), 2, _MOST)) + 1)
    gap = above(heights)
    first = np.flatnonzero((gap[:-1] > 0.0) & (gap[1:] <= 0.0))
    if first.size == 0:
        return float("nan")
    high, low = heights[first[0]], heights[first[0] + 1]
    for _ in range(_HALVINGS):
        middle = 0.5 * (high + low)
        is_above = above(np.array([middle]))[0] > 0.0
        high, low = (middle, low) if is_above else (high, middle)
    return float(0.5 * (high + low))


def slopes(height_at: HeightAt, p_J: Array, step_m: float) -> Array:
    """How much the ground rises to the east and to the north of points p_J (n, 3), (n, 2) m per m.

    By its heights one cell, ``step_m``, to either side, or to the one that is known; NaN where neither is.
    """
    latitude, longitude, _ = itrf_to_geodetic(p_J)
    here, C = height_at(latitude, longitude), C_JT(latitude, longitude)
    rise = np.empty((len(p_J), 2))
    for axis in range(2):
        sides = (p_J + side * step_m * C[..., :, axis] for side in (-1.0, 1.0))
        before, after = (height_at(*itrf_to_geodetic(p)[:2]) for p in sides)
        known = np.isfinite(before).astype(np.float64) + np.isfinite(after)
        run = np.where(known > 0.0, known * step_m, np.nan)
        rise[:, axis] = (
            np.where(np.isnan(after), here, after) - np.where(np.isnan(before), here, before)
        ) / run
    return rise
