"""Where in a raw image something as small as a target stands out from what is around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..scene import Raw

Array = NDArray[np.float64]

STANDS = 6.0
"""Robust standard deviations above which a place is looked at."""
STRIP = 1024
"""Rows that are filtered at a time."""
_AROUND = 4.0
"""How many times as wide the surroundings are."""


def standing_out(raw: Raw, width_px: float, bright: bool) -> Array:
    """Places (n, 2) of an image that are brighter (or of either sign, where not ``bright``) than their surroundings,
    seen through a filter as wide as the target; the most outstanding first."""
    columns, rows = raw.size_px
    rim = int(np.ceil(4.0 * _AROUND * width_px))
    found = []
    for first in range(0, rows, STRIP):
        height = min(STRIP, rows - first)
        strip = raw.window(-rim, first - rim, columns + 2 * rim, height + 2 * rim)
        at, stands = _peaks(strip, width_px, bright)
        inside = (
            (at[:, 1] >= rim) & (at[:, 1] < rim + height) & (at[:, 0] >= rim) & (at[:, 0] < rim + columns)
        )
        found.append(np.column_stack([at - rim + [0.0, first], stands])[inside])
    places = np.concatenate(found)
    return np.asarray(places[np.argsort(-places[:, 2], kind="stable"), :2])


def _peaks(strip: Array, width_px: float, bright: bool) -> tuple[Array, Array]:
    from scipy.ndimage import gaussian_filter, maximum_filter

    known = np.isfinite(strip)
    if not known.any():
        return np.empty((0, 2)), np.empty(0)
    filled = np.where(known, strip, np.median(strip[known]))
    sharp = gaussian_filter(filled, width_px) - gaussian_filter(filled, _AROUND * width_px)
    scatter = 1.4826 * float(np.median(np.abs(sharp[known] - np.median(sharp[known]))))
    stands = (sharp if bright else np.abs(sharp)) / max(scatter, 1e-12)
    top = (
        known
        & (stands > STANDS)
        & (stands == maximum_filter(stands, size=2 * int(np.ceil(2.0 * width_px)) + 1))
    )
    row, column = np.nonzero(top)
    return np.stack([column, row], axis=-1).astype(np.float64), stands[top]
