"""Drawn clouds with their shadows, in the pixels of an image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .noise import octaves, smooth_step

Array = NDArray[np.float64]

EVERY = 16
"""Pixels between the places of the look by which a cloud's cover is set."""
SHADE = 0.6
"""Part of the light that a thick cloud's shadow lacks."""
BRIGHT = 4.0
"""Brightness of a cloud, in standard deviations of the ground's."""


@dataclass(frozen=True)
class Sky:
    """Clouds over the part ``cover`` of an image, ``size_px`` wide and finer, of their ``seed``; their shadows fall
    ``shadow_px`` (columns, rows) beside them."""

    cover: float = 0.0
    seed: int = 0
    size_px: float = 256.0
    shadow_px: tuple[float, float] = (60.0, 40.0)

    def over(self, size_px: tuple[int, int]) -> Clouds:
        """The clouds of an image of so many columns and rows: their level is the one that gives the cover there."""
        column, row = (np.arange(0.0, size, EVERY) for size in size_px)
        level = (
            float(np.quantile(self.thickness(column, row), 1.0 - self.cover)) if self.cover > 0.0 else np.inf
        )
        return Clouds(self, level)

    def thickness(self, column: Array, row: Array) -> Array:
        """Noise (r, c) that is cloud where it exceeds a level."""
        return octaves(self.seed, 8.0, self.size_px, 0.8, column, row)


@dataclass(frozen=True)
class Clouds:
    """The clouds over one image: where the thickness of its ``sky`` exceeds ``level``."""

    sky: Sky
    level: float

    def opacity(self, column: Array, row: Array) -> Array:
        """From 0 to 1 (r, c): the part of the ground's light that does not come through, half at the edge."""
        if not np.isfinite(self.level):
            return np.zeros((row.size, column.size))
        return smooth_step((self.sky.thickness(column, row) - self.level) / 0.25)

    def veil(self, ground: Array, column: Array, row: Array) -> Array:
        """Brightness (r, c) of ground (r, c) seen through the clouds and darkened by their shadows."""
        if not np.isfinite(self.level):
            return ground
        right, down = self.sky.shadow_px
        lit = 1.0 - SHADE * self.opacity(column - right, row - down)
        # brightness 0 is the ground's mean, not darkness
        dark = -BRIGHT
        cloud = self.opacity(column, row)
        top = BRIGHT + 0.5 * octaves(self.sky.seed + 3, 6.0, 96.0, 0.5, column, row)
        return np.asarray((1.0 - cloud) * (dark + lit * (ground - dark)) + cloud * top)
