"""Windows of rasters: PNG without any extra, everything else by GDAL."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ..gis.drivers import cells_of, open_raster, parts_of, reading
from ..text.files import read_text, trouble
from ..text.numbers import numbers

Array = NDArray[np.float64]
Affine = tuple[float, float, float, float, float, float]
"""x = a c + b r + c0, y = d c + e r + f0 of the centre of the cell in column c and row r: (a, b, c0, d, e, f0)."""

MOST_PNG = 1_000_000_000
"""Bytes of a PNG's pixels."""
_GREY = {"1", "L", "I;16", "I;16B", "I", "LA", "RGB", "RGBA"}


class Pixels(Protocol):
    """One band of a raster; ``affine`` and ``wkt`` say where it lies, where the file does."""

    @property
    def path(self) -> Path: ...

    @property
    def size(self) -> tuple[int, int]:
        """Columns, rows."""
        ...

    @property
    def affine(self) -> Affine | None: ...

    @property
    def wkt(self) -> str | None: ...

    def cells(self, column: int, row: int, columns: int, rows: int) -> Array:
        """Values (rows, columns) of a window inside the raster; NaN where the file says that there are none."""
        ...


@dataclass(frozen=True)
class PngPixels:
    """A PNG, which cannot be read in parts; with the world file beside it, if any."""

    path: Path
    band: int

    @cached_property
    def _values(self) -> NDArray[Any]:
        from PIL import Image, UnidentifiedImageError

        largest = Image.MAX_IMAGE_PIXELS
        try:
            # a satellite's image is larger than what Pillow takes for an attack
            Image.MAX_IMAGE_PIXELS = None
            with Image.open(self.path, formats=["PNG"]) as image:
                if image.mode not in _GREY:
                    found = f"found a PNG of mode {image.mode}"
                    raise InputError(f"{self.path}: {found}, wanted grey values of 8 or 16 bit")
                _require_room(self.path, image)
                values = np.asarray(image)
        except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
            said = " ".join(str(error).split())
            raise InputError(
                f"{self.path}: found a file that is not a whole PNG ({said}), wanted one"
            ) from None
        finally:
            Image.MAX_IMAGE_PIXELS = largest
        bands = values[..., None] if values.ndim == 2 else values
        _require_band(self.path, self.band, bands.shape[-1])
        return bands[..., self.band - 1]

    @property
    def size(self) -> tuple[int, int]:
        rows, columns = self._values.shape
        return columns, rows

    @property
    def affine(self) -> Affine | None:
        """From a world file: six lines A, D, B, E, C, F of the centre of the first cell."""
        place = _world_file(self.path)
        return None if place is None else _world(place)

    @property
    def wkt(self) -> str | None:
        return None

    def cells(self, column: int, row: int, columns: int, rows: int) -> Array:
        return self._values[row : row + rows, column : column + columns].astype(np.float64)


@dataclass(frozen=True)
class GdalPixels:
    """A raster that GDAL opens, of which windows are read."""

    path: Path
    band: int
    dataset: Any

    @property
    def size(self) -> tuple[int, int]:
        return int(self.dataset.width), int(self.dataset.height)

    @property
    def affine(self) -> Affine | None:
        t = self.dataset.transform
        if t.is_identity:
            return None
        return t.a, t.b, t.c + 0.5 * (t.a + t.b), t.d, t.e, t.f + 0.5 * (t.d + t.e)

    @property
    def wkt(self) -> str | None:
        with reading(self.path):
            return None if self.dataset.crs is None else str(self.dataset.crs.to_wkt())

    def cells(self, column: int, row: int, columns: int, rows: int) -> Array:
        return cells_of(self.path, self.dataset, self.band, (column, row, columns, rows))


def open_pixels(path: Path, band: int) -> Pixels:
    """A band of a raster, the first is 1.  Raises InputError where the file is none, or has no such band."""
    if (found := trouble(path)) is not None:
        raise InputError(f"{path}: {found}")
    if _is_png(path):
        return PngPixels(path, band)
    dataset = open_raster(path)
    _require_band(path, band, int(dataset.count))
    if str(dataset.dtypes[band - 1]).startswith("complex"):
        raise InputError(
            f"{path}: found complex values, wanted real ones, such as the amplitudes of a radar image"
        )
    return GdalPixels(path, band, dataset)


def _require_room(path: Path, image: Any) -> None:
    """Raise InputError for a PNG that would take too much memory: it cannot be read in parts."""
    columns, rows = image.size
    if columns * rows * (4 if image.mode in ("I", "RGBA", "RGB") else 2) > MOST_PNG:
        found = f"found a PNG of {columns} x {rows} pixels, which cannot be read in parts"
        raise InputError(f"{path}: {found}, wanted a GeoTIFF or the like (extra gis) of this size")


def files_of(path: Path) -> list[Path]:
    """The files that are read of a raster that lies somewhere: it, and what beside it says where.

    Raises InputError where it is none.
    """
    if path.suffix.lower() == ".asc":  # read without GDAL, and without what may lie beside it
        return [path]
    if not _is_png(path):
        return parts_of(path)
    world = _world_file(path)
    return [path] if world is None else [path, world]


def _is_png(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(8) == b"\x89PNG\r\n\x1a\n"


def _world_file(path: Path) -> Path | None:
    places = (path.with_suffix(ending) for ending in (".pgw", ".pngw", ".wld"))
    return next((place for place in places if place.is_file()), None)


def _require_band(path: Path, band: int, count: int) -> None:
    if band > count:
        held = f"{count} band" + ("s" if count > 1 else "")
        raise InputError(f"{path}: found {held}, wanted band {band} (the key band)")


def _world(place: Path) -> Affine:
    words = read_text(place).split()
    values = numbers(words)
    if len(words) != 6 or not np.isfinite(values).all():
        raise InputError(f"{place}: found text that is not a world file, wanted six lines of a number")
    a, d, b, e, c, f = values.tolist()
    return a, b, c, d, e, f


@dataclass(frozen=True)
class RawImage:
    """A raw image of which windows are read, with NaN for ``nodata`` and beyond its border."""

    pixels: Pixels
    nodata: float | None = None

    @property
    def size_px(self) -> tuple[int, int]:
        return self.pixels.size

    def window(self, column: int, row: int, columns: int, rows: int) -> Array:
        """Values (rows, columns); NaN beyond the image and where there is no data."""
        cut = np.full((rows, columns), np.nan)
        width, height = self.pixels.size
        left, top = max(column, 0), max(row, 0)
        right, bottom = min(column + columns, width), min(row + rows, height)
        if right > left and bottom > top:
            values = self.pixels.cells(left, top, right - left, bottom - top)
            if self.nodata is not None:
                values[values == self.nodata] = np.nan
            cut[top - row : bottom - row, left - column : right - column] = values
        return cut
