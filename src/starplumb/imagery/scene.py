"""What measuring needs of the world: raw images, a reference, the ground's heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..ground.terrain import HeightAt, ground_heights
from ..physics.earth import itrf_to_geodetic
from ..table.campaign import Campaign
from ..table.geometry import locate

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Raw(Protocol):
    """A raw image, of which windows are read."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns, rows."""
        ...

    def window(self, column: int, row: int, columns: int, rows: int) -> Array:
        """Values (rows, columns) from a first column and row on; NaN beyond the image and where there is no data."""
        ...


class Reference(Protocol):
    """Ground whose place is known, as it looks from above."""

    def sample(self, latitude: Array, longitude: Array, spacing_m: float) -> Array:
        """Brightness (h, w) at places (h, w) rad that lie so far apart, without what is finer; NaN where unknown."""
        ...


@dataclass(frozen=True)
class Scene:
    """The images of a campaign with their pixels, the reference, and heights above the ellipsoid with their ``step_m``;
    ``saturation_dn`` is the value of a pixel that is full, None where that is not stated.

    With ``chip_half_m`` the reference is a library: it shows what is around the campaign's landmarks only, so far to
    each side."""

    campaign: Campaign
    raws: Sequence[Raw]
    reference: Reference
    height_at: HeightAt
    step_m: float
    saturation_dn: float | None = None
    chip_half_m: float | None = None

    def ground(self, C_EK: Array, image: int, pixel: Array) -> Array:
        """Points p_J (n, 3) of the terrain that pixels (n, 2) see; NaN where the ground is not known."""
        index = np.full(len(pixel), image)
        height = ground_heights(self.campaign, C_EK, index, pixel, self.height_at, self.step_m)
        known = np.isfinite(height)
        p_J = np.full((len(pixel), 3), np.nan)
        p_J[known] = locate(
            self.campaign, C_EK, index[known], pixel[known, 0], pixel[known, 1], height[known]
        )
        return p_J

    def pixel_m(self, C_EK: Array, image: int, pixel: Array) -> float:
        """Size of a pixel (2,) on the ground, m."""
        ends = pixel + 8.0 * np.array([[-1.0, -1.0], [1.0, 1.0]])
        a, b = locate(self.campaign, C_EK, np.full(2, image), ends[:, 0], ends[:, 1], 0.0)
        return float(np.linalg.norm(a - b) / (16.0 * np.sqrt(2.0)))


def geodetic(p_J: Array) -> tuple[Array, Array]:
    """Latitude and longitude (...) rad of points (..., 3)."""
    latitude, longitude, _ = itrf_to_geodetic(p_J)
    return latitude, longitude


def binned(values: Array, factor: int) -> Array:
    """Means (h, w) of squares of so many pixels; NaN where half of one is missing, a rest at the border is left off."""
    if factor == 1:
        return values
    h, w = values.shape[0] // factor, values.shape[1] // factor
    squares = values[: h * factor, : w * factor].reshape(h, factor, w, factor)
    known = np.isfinite(squares)
    if known.all():
        return np.asarray(squares.mean(axis=(1, 3)))
    count = known.sum(axis=(1, 3))
    mean = np.where(known, squares, 0.0).sum(axis=(1, 3)) / np.maximum(count, 1)
    return np.where(2 * count > factor**2, mean, np.nan)


def reduced(raw: Raw, factor: int) -> Array:
    """A whole image binned, read some rows at a time."""
    columns, rows = raw.size_px
    strip = max(factor, (1 << 21) // max(columns, 1) // factor * factor)
    parts = [
        binned(raw.window(0, first, columns, min(strip, rows - first)), factor)
        for first in range(0, rows // factor * factor, strip)
    ]
    return np.concatenate(parts)
