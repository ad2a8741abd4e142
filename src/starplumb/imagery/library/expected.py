"""Where the chips of a library are expected in an image, and how well the image agrees with them at every shift."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...table.appearance import Seen, appearance, row_span
from ..matching.orientation import RIM_PX, correlation, orientation
from ..prediction import pieces
from ..scene import Scene

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SOUGHT = 6
"""So many chips along each side of an image are looked for while it is not known where it lies, at most."""
LEAST_CELLS = 28
"""Binned pixels that a chip keeps along each side, to be told by."""


@dataclass(frozen=True)
class Expected:
    """n chips by their ``landmark`` (n,), and the ``pixel`` (n, 2) at which the centre of each is expected."""

    landmark: Index
    pixel: Array

    def only(self, some: Index) -> Expected:
        return Expected(self.landmark[some], self.pixel[some])


def half_px(scene: Scene, C_EK: Array, image: int) -> float:
    """Half the side of the library's chips in pixels of an image, 0 for a scene without a library."""
    columns, rows = scene.raws[image].size_px
    return (scene.chip_half_m or 0.0) / scene.pixel_m(
        C_EK, image, 0.5 * np.array([columns - 1.0, rows - 1.0])
    )


def most_binned(scene: Scene) -> int:
    """How many pixels may be binned, so that a chip is still told."""
    return max(1, int(2.0 * half_px(scene, scene.campaign.C_EK, 0) / LEAST_CELLS))


def expected(scene: Scene, C_EK: Array, image: int, beyond_px: float) -> Expected:
    """Chips whose centres lie in an image, or at most so far beyond its border (negative: so far inside it).

    The rows of a scanner end where its attitude does.
    """
    columns, rows = scene.raws[image].size_px
    found = appearance(scene.campaign, C_EK, image, scene.campaign.landmarks.r_J, skip=True)
    low, high = np.full(2, -beyond_px), np.array([columns, rows]) - 1.0 + beyond_px
    if scene.campaign.camera.scans:
        first, last = row_span(scene.campaign, image) or (0.0, -1.0)
        reach = min(half_px(scene, C_EK, image), 0.25 * (last - first))
        low[1], high[1] = max(low[1], first + reach), min(high[1], last - reach)
    with np.errstate(invalid="ignore"):
        near = np.all((found.pixel >= low) & (found.pixel <= high), axis=-1)
        inside = np.all((found.pixel >= -0.5) & (found.pixel <= np.array([columns, rows]) - 0.5), axis=-1)
    # what lies beside the image has a place beside it, or none that means anything
    there = (found.seen == Seen.YES) | ((found.seen == Seen.BESIDE) & ~inside)
    which = np.flatnonzero(near & there)
    return Expected(which, found.pixel[which])


def one_a_cell(pixel: Array, worth: Array, grid: tuple[int, int]) -> Index:
    """Of places (n, 2) that worth (n,) in each cell of a grid laid over them, in ascending order."""
    if not len(pixel):
        return np.zeros(0, dtype=np.int64)
    low, extent = pixel.min(axis=0), np.maximum(np.ptp(pixel, axis=0), 1e-9)
    across = np.minimum((pixel - low) / extent * grid, np.array(grid) - 1.0).astype(np.int64)
    cell = across[:, 1] * grid[0] + across[:, 0]
    order = np.lexsort((-worth, cell))
    _, first = np.unique(cell[order], return_index=True)
    return np.sort(order[first])


def summed_surface(
    scene: Scene, C_EK: Array, image: int, seen: NDArray[np.complex128], factor: int, k: int
) -> Array:
    """How well an image, whose orientations binned by ``factor`` are ``seen`` (h, w), agrees with the chips expected in
    it or around it, (2 k + 1, 2 k + 1), for every shift of k binned pixels to each side: that by which what it shows is
    expected farther on."""
    there = expected(scene, C_EK, image, float(k * factor))
    there = there.only(one_a_cell(there.pixel, np.zeros(len(there.pixel)), (SOUGHT, SOUGHT)))
    cell = np.rint((there.pixel + 0.5) / factor - 0.5)
    below = pieces(
        scene, C_EK, image, (cell + 0.5) * factor - 0.5, half_px(scene, C_EK, image), float(factor)
    )
    total = np.zeros((2 * k + 1, 2 * k + 1))
    for (column, row), piece in zip(cell.astype(int).tolist(), below, strict=True):
        if piece is None:
            continue
        chip = orientation(piece.samples)[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX]
        reach = k + chip.shape[0] // 2
        around = _cut(seen, column - reach, row - reach, 2 * reach + 1)
        if np.any(around):
            total += correlation(around, chip)
    # a chip found farther on is what was expected less far
    return total[::-1, ::-1]


def _cut(image: NDArray[np.complex128], column: int, row: int, size: int) -> NDArray[np.complex128]:
    """A square of an image from a first column and row on, 0 beyond its border."""
    cut = np.zeros((size, size), dtype=np.complex128)
    height, width = image.shape
    left, top = max(column, 0), max(row, 0)
    right, bottom = min(column + size, width), min(row + size, height)
    if right > left and bottom > top:
        cut[top - row : bottom - row, left - column : right - column] = image[top:bottom, left:right]
    return cut
