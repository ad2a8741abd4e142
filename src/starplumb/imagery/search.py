"""Places of an image on the reference, coarse to fine: windows found by orientation correlation a few pixels around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .acquisition import Peak, peak, standing
from .matching.orientation import RIM_PX, correlation, orientation
from .pointing import LEAST_CHIPS, Pointing, pointed
from .prediction import Piece, pieces
from .scene import Scene, binned

Array = NDArray[np.float64]

WINDOW_PX = 64
"""Pixels of a window along each side, at each level."""
PLACES = 5
"""Windows along each side of an image, at most."""
TOLERANCE_PX = 1.5
"""By how many pixels of its level a window that is found rightly may err."""
STANDS = 4.5
"""Robust standard deviations above which a peak is looked at."""
SHARE = 0.25
"""An image is acquired where this part of the windows with ground below them agree."""
NARROWER = 4
"""How much finer each level is than the one before."""


@dataclass(frozen=True)
class Found:
    """An image on the reference: ``C_EK`` (3, 3) by which its chips are predicted, and how many ``agree`` of how many
    ``tried``; ``reason`` says why not, where it is not acquired."""

    C_EK: Array
    agree: int
    tried: int
    reason: str = ""


def refine(scene: Scene, C_EK: Array, image: int, cell_px: int, prior_K: Array) -> Found:
    """The rotation of an image that is known to a few of ``cell_px`` pixels, to a part of one."""
    found = Found(C_EK, 0, 0)
    while True:
        level = max(cell_px // NARROWER, 1)
        found = _at_level(scene, found.C_EK, image, level, 3 * max(cell_px // level, 1) + 4, prior_K)
        if found.reason or level == 1:
            return found
        cell_px = level


def _at_level(scene: Scene, C_EK: Array, image: int, level: int, search: int, prior_K: Array) -> Found:
    """Windows of an image binned by ``level``, each looked for ``search`` binned pixels to each side."""
    centre, columns = _places(scene.raws[image].size_px, level)
    if columns < 24:
        return Found(C_EK, 0, 0, "the image is smaller than a window to look for")
    reach = level * (0.5 * columns + search + RIM_PX)
    below = pieces(scene, C_EK, image, centre, reach, float(level))
    pixel, p_J = [], []
    tried = 0
    for at, piece in zip(centre, below, strict=True):
        window = _binned_window(scene, image, at, level, columns)
        if piece is None or piece.known < 0.5 or np.mean(np.isfinite(window)) < 0.5:
            continue
        tried += 1
        best, _ = located(window, piece, search)
        if best.height > STANDS:
            pixel.append(at - level * best.shift)
            p_J.append(piece.p_J)
    if tried == 0:
        return Found(C_EK, 0, 0, "the reference shows none of its ground")
    there = np.array(pixel).reshape(-1, 2), np.array(p_J).reshape(-1, 3)
    fitted: Pointing = pointed(scene.campaign, C_EK, image, *there, TOLERANCE_PX * level, prior_K)
    agree = int(fitted.agrees.sum())
    if agree < max(min(LEAST_CHIPS, tried), SHARE * tried):
        where = f"{agree} of {tried} windows, binned by {level}, agree about where it lies"
        return Found(C_EK, agree, tried, f"{where}: cloud, water or changed ground, or another place")
    return Found(fitted.C_EK, agree, tried)


def _places(size_px: tuple[int, int], level: int) -> tuple[Array, int]:
    """Middles (n, 2) of windows over an image, and how many binned pixels each has along a side."""
    columns = min(WINDOW_PX, *(n // level - 2 * RIM_PX for n in size_px))
    half = 0.5 * level * (columns + 2 * RIM_PX) - 0.5
    axes = []
    for n in size_px:
        room = n - 1.0 - 2.0 * half
        count = int(np.clip(np.ceil(2.0 * room / (level * max(columns, 1))) + 1, 1, PLACES))
        axes.append(half + np.rint(np.linspace(0.0, room, count)) if count > 1 else np.array([half]))
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2), columns


def _binned_window(scene: Scene, image: int, centre: Array, level: int, columns: int) -> Array:
    """A window with a rim, binned, around a place in the middle of its binned pixels."""
    full = level * (columns + 2 * RIM_PX)
    first = np.rint(centre - 0.5 * (full - 1)).astype(int)
    return binned(scene.raws[image].window(int(first[0]), int(first[1]), full, full), level)


def located(
    window: Array, piece: Piece, search: int, use: NDArray[np.bool_] | None = None
) -> tuple[Peak, Array]:
    """Where the middle of a window (w, w), whose rim only feeds the filter, lies in a piece: its shift in pixels of the
    piece from the middle; and the surface of correlations (k, k) around it.  Inside the rim only ``use`` counts."""
    chip = orientation(window)[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX]
    chip = chip if use is None else chip * use
    size = chip.shape[0] + 2 * search
    around = orientation(piece.samples)
    rest = around.shape[0] - size
    cut = around[rest // 2 : rest // 2 + size, rest // 2 : rest // 2 + size]
    surface = correlation(cut, chip)
    best = peak(standing(surface))
    # where the chip's middle and the piece's do not fall on the same kind of place, the cut is half a pixel off
    return Peak(best.shift - 0.5 * (rest % 2), best.height, best.second), surface
