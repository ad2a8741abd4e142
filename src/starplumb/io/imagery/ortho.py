"""An orthoimage of any number of tiles, each in its own reference system, sampled at geographic places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...imagery.scene import binned
from ...physics.errors import InputError
from ...physics.units import DEG
from ..gis.heights import is_of_this_earth
from ..gis.reference_system import Grid
from ..text.files import show
from .rasters import Affine, Pixels, RawImage

Array = NDArray[np.float64]

DEGREES = ("EPSG:4326", "OGC:CRS84", "WGS84", "WGS 84")
"""Longitude and latitude on WGS 84 by names that need no library."""
METRES_A_DEGREE = 111_195.0
_PAD = 4
"""Cells around a window that the spline between them wants."""
_STRIP = 1 << 22
"""Cells that are read at a time where many are joined."""


@dataclass(frozen=True)
class Tile:
    """A tile: its cells, where they lie in x and y, and the way there from longitude and latitude, None for degrees."""

    image: RawImage
    affine: Affine
    grid: Grid | None

    @classmethod
    def of(cls, pixels: Pixels, crs: str | None, nodata: float | None) -> Tile:
        """Raises InputError where nothing says where the tile lies, or two things say it differently."""
        affine = pixels.affine
        if affine is None:
            found = "found nothing that says where it lies"
            raise InputError(
                f"{pixels.path}: {found}, wanted a georeferenced raster or a world file beside it"
            )
        if not is_of_this_earth(np.array(affine)):
            found = f"found a georeference that is none ({show(list(affine))})"
            raise InputError(f"{pixels.path}: {found}, wanted steps that are not 0 and a place on Earth")
        columns, rows = pixels.size
        a, b, c, d, e, f = affine
        middle = a * columns / 2 + b * rows / 2 + c, d * columns / 2 + e * rows / 2 + f
        if pixels.wkt is not None:
            return cls(RawImage(pixels, nodata), affine, Grid(pixels.path, pixels.wkt, middle))
        if crs is None:
            found = "found a raster that does not say its reference system"
            raise InputError(f"{pixels.path}: {found}, wanted the key reference.crs")
        if crs.strip().upper() in DEGREES:
            if not (abs(middle[0]) <= 360.0 and abs(middle[1]) <= 90.0):
                found = f"found its middle at x {middle[0]:.12g}, y {middle[1]:.12g}"
                raise InputError(f"{pixels.path}: {found}, wanted degrees as reference.crs says")
            return cls(RawImage(pixels, nodata), affine, None)
        return cls(RawImage(pixels, nodata), affine, Grid(pixels.path, _wkt(pixels.path, crs), middle))

    @property
    def cell_m(self) -> float:
        """Size of a cell on the ground, m, the larger of its sides."""
        a, b, _, d, e, f = self.affine
        if self.in_degrees:
            shrunk = np.cos(f * DEG)
            sides = np.hypot(a * shrunk, d), np.hypot(b * shrunk, e)
            return METRES_A_DEGREE * float(max(sides))
        return float(max(np.hypot(a, d), np.hypot(b, e)))

    @property
    def in_degrees(self) -> bool:
        return self.grid is None or self.grid.in_degrees

    def cells(self, latitude: Array, longitude: Array) -> tuple[Array, Array]:
        """Columns and rows (...) of places (...) rad, 0 at the centre of the first cell."""
        x, y = longitude / DEG, latitude / DEG
        a, b, c, d, e, f = self.affine
        if self.grid is not None:
            shape = x.shape
            x, y = (v.reshape(shape) for v in self.grid.of(x.ravel(), y.ravel()))
        if self.in_degrees:
            x = c + np.remainder(x - c + 180.0, 360.0) - 180.0
        det = a * e - b * d
        return (e * (x - c) - b * (y - f)) / det, (a * (y - f) - d * (x - c)) / det

    def places(self, column: Array, row: Array) -> tuple[Array, Array]:
        """Longitudes and latitudes (n,), deg, of columns and rows (n,)."""
        a, b, c, d, e, f = self.affine
        x, y = a * column + b * row + c, d * column + e * row + f
        return (x, y) if self.grid is None else self.grid.back(x, y)

    def sample(self, latitude: Array, longitude: Array, spacing_m: float) -> Array:
        """Brightness (h, w) at places (h, w); NaN beyond the tile and near cells without data."""
        from scipy.ndimage import binary_dilation, map_coordinates

        column, row = self.cells(latitude, longitude)
        joined = max(1, int(spacing_m / self.cell_m))
        width, height = self.image.size_px
        pad = _PAD * joined
        values = np.full(latitude.shape, np.nan)
        good = np.isfinite(column) & np.isfinite(row)
        if not good.any():
            return values
        # beyond its border a tile is continued by its mirror image
        left, top = (max(int(np.floor(v[good].min())) - pad, 0) for v in (column, row))
        right = min(int(np.ceil(column[good].max())) + pad + 1, width)
        bottom = min(int(np.ceil(row[good].max())) + pad + 1, height)
        if right - left < joined or bottom - top < joined:
            return values
        cells = self._joined(left, top, right, bottom, joined)
        missing = ~np.isfinite(cells)
        if missing.all():
            return values
        filled = np.where(missing, np.median(cells[~missing]), cells)
        at = [(v - first - 0.5 * (joined - 1)) / joined for v, first in ((row, top), (column, left))]
        at = [np.where(good, v, -10.0) for v in at]
        sampled = map_coordinates(filled, at, order=3, mode="mirror")
        bad = binary_dilation(missing, np.ones((5, 5), np.bool_)).astype(np.float32)
        near = map_coordinates(bad, at, order=0, mode="nearest") > 0.5
        inside = (column >= -0.5) & (column <= width - 0.5) & (row >= -0.5) & (row <= height - 0.5)
        return np.where(inside & ~near, sampled, np.nan)

    def _joined(self, left: int, top: int, right: int, bottom: int, joined: int) -> Array:
        """Means of so many cells along each side, read some rows at a time."""
        columns = right - left
        strip = max(joined, _STRIP // max(columns, 1) // joined * joined)
        rows = (bottom - top) // joined * joined
        parts = [
            binned(self.image.window(left, top + first, columns, min(strip, rows - first)), joined)
            for first in range(0, rows, strip)
        ]
        return np.concatenate(parts) if parts else np.full((1, 1), np.nan)


@dataclass(frozen=True)
class Ortho:
    """Tiles, the first that knows a place tells its brightness."""

    tiles: Sequence[Tile]

    def sample(self, latitude: Array, longitude: Array, spacing_m: float) -> Array:
        """Brightness (h, w) at places (h, w) rad; NaN where no tile knows it."""
        values = np.full(latitude.shape, np.nan)
        for tile in self.tiles:
            unknown = ~np.isfinite(values)
            if not unknown.any():
                break
            values[unknown] = tile.sample(latitude, longitude, spacing_m)[unknown]
        return values


def _wkt(path: Path, crs: str) -> str:
    from ..gis.reference_system import horizontal

    try:
        return str(horizontal(path, crs).to_wkt())
    except ImportError:
        raise InputError(f'{path}: reading it in {crs} needs pyproj: pip install "starplumb[gis]"') from None
