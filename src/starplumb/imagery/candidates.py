"""Where in an image to look for chips: the place with most structure in both directions of each cell of a grid.

Chips of cells beside one another lie at least half a chip apart: two that show nearly the same pixels would count as
two sightings, and are one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .scene import Raw

Array = NDArray[np.float64]

TRIED = 3
"""Places along each side of a cell of which the best is taken."""


def candidate_places(raw: Raw, grid: tuple[int, int], chip_px: int, rim_px: int) -> Array:
    """Middles (n, 2) of chips of an image, a row of cells after the other; ``rim_px`` are kept free at its border.

    Chips have their middle between pixels where ``chip_px`` is even.  A cell all of whose places are taken has none,
    nor has an image that is smaller than a chip.
    """
    columns, rows = raw.size_px
    half = 0.5 * (chip_px - 1)
    edges = [
        np.linspace(rim_px + half, n - 1.0 - rim_px - half, count + 1)
        for n, count in zip((columns, rows), grid, strict=True)
    ]
    if edges[0][0] > edges[0][-1] or edges[1][0] > edges[1][-1]:
        return np.empty((0, 2))
    places = np.empty((0, 2))
    for i in range(grid[1]):
        for j in range(grid[0]):
            tried = _within(edges[0][j : j + 2], edges[1][i : i + 2], half)
            tried = tried[_apart(tried, places) >= 0.5 * chip_px]
            if len(tried):
                worth = [structure(_window(raw, place, chip_px)) for place in tried]
                places = np.concatenate([places, tried[[int(np.argmax(worth))]]])
    return places


def _apart(tried: Array, chosen: Array) -> Array:
    """How far places (t, 2) are from the nearest of those chosen (n, 2), along the axis along which that is farther."""
    between = np.abs(tried[:, None] - chosen).max(axis=-1)
    return np.asarray(between.min(axis=1, initial=np.inf))


def _within(x: Array, y: Array, half: float) -> Array:
    """Places (t^2, 2) spread over a cell, in the middle of pixels or between two as chips are."""
    along = (np.arange(TRIED) + 0.5) / TRIED
    grid = np.stack(np.meshgrid(x[0] + along * (x[1] - x[0]), y[0] + along * (y[1] - y[0])), axis=-1)
    return np.asarray(np.rint(grid.reshape(-1, 2) - half) + half)


def _window(raw: Raw, place: Array, chip_px: int) -> Array:
    first = np.rint(place - 0.5 * (chip_px - 1)).astype(int)
    return raw.window(int(first[0]), int(first[1]), chip_px, chip_px)


def structure(window: Array) -> float:
    """How well the less well determined direction of a chip can be told: the smaller eigenvalue of its mean tensor of
    limited gradients, so that the rim of a cloud counts no more than a field's; 0 where a quarter is missing."""
    from scipy.ndimage import gaussian_filter

    known = np.isfinite(window)
    if np.mean(known) < 0.75:
        return 0.0
    smooth = gaussian_filter(np.where(known, window, np.mean(window[known])), 1.0)
    gy, gx = np.gradient(smooth)
    limit = 3.0 * np.median(np.hypot(gx, gy)) + 1e-12
    short = np.minimum(1.0, limit / np.maximum(np.hypot(gx, gy), 1e-12))
    gx, gy = gx * short, gy * short
    a, b, c = float(np.mean(gx * gx)), float(np.mean(gx * gy)), float(np.mean(gy * gy))
    return 0.5 * (a + c) - float(np.hypot(0.5 * (a - c), b))
