"""A library of chips: small orthoimages with surveyed centres and the heights around them; read without any extra.

A folder holds ``chips.csv``, a table of landmarks with further columns, and the PNGs that it names.  A chip's cells lie
to the east and south of one another, ``gsd_m`` apart at the height of its centre, which is the middle of its PNG; 0 is
no data.  The PNG of heights has the same middle, values ``heights_low_m + value * heights_step_m``, and cells
``heights_gsd_m`` apart; without one the ground of a chip is level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...ground.grid import Terrain
from ...physics.earth import C_JT, geodetic_to_itrf, itrf_to_geodetic
from ...physics.errors import InputError
from ...physics.units import DEG
from ..gis.heights import HEIGHTS_M
from ..tables.columns import GEODETIC
from ..tables.read import Table, read_table
from ..text.files import fingerprint, show, trouble
from .ortho import DEGREES, Tile
from .rasters import PngPixels, RawImage, open_pixels

Array = NDArray[np.float64]

TABLE = "chips.csv"
TEXTS = ("landmark_id", "crs", "file", "sha256")
HEIGHTS = ("heights_file", "heights_sha256")
HEIGHT_NUMBERS = ("heights_gsd_m", "heights_low_m", "heights_step_m")
GSD_M = (1e-3, 1e4)
LEAST_PX, MOST_PX = 24, 4096
MOST_PIXELS = 400_000_000
"""Of a library, with those of its heights: ten thousand chips of 128 pixels have 330 million bytes."""
MOST_LATITUDE_DEG = 89.0
"""Cells to the east are none at the poles."""
_PROBE_M = 100.0


@dataclass(frozen=True)
class LibraryChip:
    """A chip: its ``name``, cells, and heights around its centre; ``half_m`` is how far it reaches to each side."""

    name: str
    tile: Tile
    height_m: float
    half_m: float
    pixels: PngPixels | None
    low_m: float
    step_m: float
    spacing_m: float
    degrees_a_metre: tuple[float, float]
    centre_deg: tuple[float, float]

    @property
    def cells(self) -> int:
        """How many pixels it has, with those of its heights."""
        each = (self.tile.image.pixels, *([] if self.pixels is None else [self.pixels]))
        return sum(columns * rows for columns, rows in (one.size for one in each))

    @cached_property
    def _terrain(self) -> Terrain | None:
        if self.pixels is None:
            return None
        columns, rows = self.pixels.size
        height = self.low_m + self.step_m * self.pixels.cells(0, 0, columns, rows)
        north, east = (DEG * self.spacing_m * each for each in self.degrees_a_metre)
        latitude, longitude = (DEG * each for each in self.centre_deg)
        corner = latitude + 0.5 * (rows - 1) * north, longitude - 0.5 * (columns - 1) * east
        return Terrain(height, *corner, (-north, east))

    def height_at(self, latitude: Array, longitude: Array) -> Array:
        """Heights (n,) m above the ellipsoid at places (n,) rad; beyond what the chip knows, that of its centre."""
        if self._terrain is None:
            return np.full(latitude.shape, self.height_m)
        height = self._terrain.at(latitude, longitude)
        return np.where(np.isfinite(height), height, self.height_m)


@dataclass(frozen=True)
class Library:
    """Chips, each the reference of its own surroundings."""

    chips: Sequence[LibraryChip]

    @property
    def half_m(self) -> float:
        """How far the smallest chip reaches to each side."""
        return min(chip.half_m for chip in self.chips)

    @property
    def step_m(self) -> float:
        """The finest spacing of heights; of level chips their size."""
        return min(chip.half_m if chip.pixels is None else chip.spacing_m for chip in self.chips)

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        latitude, longitude = (
            DEG * np.array(each) for each in zip(*(c.centre_deg for c in self.chips), strict=True)
        )
        return cKDTree(geodetic_to_itrf(latitude, longitude, np.zeros(latitude.size)))

    def nearest(self, latitude: Array, longitude: Array) -> NDArray[np.int64]:
        """The chips (n,) whose centres are nearest to places (n,) rad."""
        _, which = self._tree.query(geodetic_to_itrf(latitude, longitude, np.zeros(latitude.shape)))
        return np.asarray(which, dtype=np.int64)

    def sample(self, latitude: Array, longitude: Array, spacing_m: float) -> Array:
        """Brightness (h, w) at places (h, w) rad by the chip nearest to their middle; NaN beyond it."""
        middle = latitude.shape[0] // 2, latitude.shape[1] // 2
        which = self.nearest(latitude[middle][None], longitude[middle][None])
        return self.chips[int(which[0])].tile.sample(latitude, longitude, spacing_m)

    def height_at(self, latitude: Array, longitude: Array) -> Array:
        """Heights (n,) m above the ellipsoid at places (n,) rad by the chip nearest to each; NaN where a place is."""
        height = np.full(latitude.shape, np.nan)
        known = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
        which = self.nearest(latitude[known], longitude[known])
        for k in np.unique(which).tolist():
            mine = known[which == k]
            height[mine] = self.chips[k].height_at(latitude[mine], longitude[mine])
        return height


def read_library(table: Path) -> list[LibraryChip]:
    """The chips that a table names.  Raises InputError, with file, row and column, for the first that cannot be used,
    or whose digest is not that of its file."""
    read = read_table(
        table,
        texts=TEXTS,
        numbers=(*GEODETIC, "gsd_m"),
        optional_texts=HEIGHTS,
        optional_numbers=HEIGHT_NUMBERS,
        unknown=HEIGHT_NUMBERS,
    )
    latitude, gsd, height = (read.numbers[name] for name in (GEODETIC[0], "gsd_m", GEODETIC[2]))
    read.require(np.abs(latitude) <= MOST_LATITUDE_DEG, GEODETIC[0], "-89 to 89")
    read.require(
        (height >= HEIGHTS_M[0]) & (height <= HEIGHTS_M[1]), GEODETIC[2], "{:g} to {:g}".format(*HEIGHTS_M)
    )
    read.require((gsd >= GSD_M[0]) & (gsd <= GSD_M[1]), "gsd_m", "metres, 0.001 to 10000")
    chips, pixels = list[LibraryChip](), 0
    for row in range(len(read)):
        chips.append(_chip(read, row))
        pixels += chips[-1].cells
        if pixels > MOST_PIXELS:
            raise InputError(
                f"{table}: found chips of more than {MOST_PIXELS:,} pixels, wanted fewer or smaller ones"
            )
    return chips


def _chip(table: Table, row: int) -> LibraryChip:
    crs = table.texts["crs"][row]
    if crs.upper() not in DEGREES:
        raise table.error(row, "crs", crs, "EPSG:4326: chips lie along the meridian of their centre")
    latitude, longitude, height, gsd = (float(table.numbers[name][row]) for name in (*GEODETIC, "gsd_m"))
    pixels = _picture(table, row, "file", "sha256")
    columns, rows = pixels.size
    if not (columns == rows and LEAST_PX <= columns <= MOST_PX):
        raise table.error(
            row, "file", f"{columns} x {rows} pixels", f"a square of {LEAST_PX} to {MOST_PX} pixels"
        )
    north, east = degrees_a_metre(latitude, longitude, height)
    half = 0.5 * (columns - 1) * gsd
    affine = (gsd * east, 0.0, longitude - half * east, 0.0, -gsd * north, latitude + half * north)
    name, place = table.texts["landmark_id"][row], (latitude, longitude)
    tile = Tile(RawImage(pixels, 0.0), affine, None)
    return LibraryChip(name, tile, height, half, *_heights(table, row), (north, east), place)


def _heights(table: Table, row: int) -> tuple[PngPixels | None, float, float, float]:
    """The picture of a chip's heights, None for level ground, the lowest, their step and their spacing, m."""
    if not table.texts.get(HEIGHTS[0], [""] * len(table))[row]:
        return None, 0.0, 0.0, 0.0
    for name in HEIGHTS[1:]:
        if name not in table.texts:
            raise table.error(row, HEIGHTS[0], table.texts[HEIGHTS[0]][row], f"the column {name} beside it")
    spacing, low, step = (
        float(table.numbers[name][row]) if name in table.numbers else np.nan for name in HEIGHT_NUMBERS
    )
    for name, value, good in zip(
        HEIGHT_NUMBERS, (spacing, low, step), (spacing > 0.0, True, step >= 0.0), strict=True
    ):
        if not (np.isfinite(value) and good):
            raise table.error(row, name, value, "a number of metres beside heights_file")
    pixels = _picture(table, row, *HEIGHTS)
    columns, rows = pixels.size
    if min(columns, rows) < 2:
        raise table.error(row, HEIGHTS[0], f"{columns} x {rows} heights", "two or more along each side")
    values = pixels.cells(0, 0, columns, rows)
    if not HEIGHTS_M[0] <= low + step * values.min() <= low + step * values.max() <= HEIGHTS_M[1]:
        found = f"heights from {low + step * values.min():.6g} to {low + step * values.max():.6g} m"
        raise table.error(row, HEIGHTS[0], found, "{:g} to {:g} m".format(*HEIGHTS_M))
    return pixels, low, step, spacing


def _picture(table: Table, row: int, file: str, digest: str) -> PngPixels:
    """A PNG beside the table that is the one that was cut: its name leads out of no folder, its digest is stated."""
    name = table.texts[file][row]
    pure = PurePath(name)
    if pure.is_absolute() or ".." in pure.parts or not pure.parts:
        raise table.error(row, file, name, "the name of a PNG in the folder of the table")
    path = Path(str(table.source)).parent / name
    if (found := trouble(path)) is not None:
        raise InputError(f"{table.where(row, file)}: {show(name)}: {found}")
    if fingerprint(path) != f"sha256:{table.texts[digest][row].removeprefix('sha256:').lower()}":
        found = f"found a digest that is not that of {name}"
        raise InputError(
            f"{table.where(row, digest)}: {found}, wanted the chip as it was cut; cut the library again"
        )
    pixels = open_pixels(path, 1)
    if not isinstance(pixels, PngPixels):
        raise table.error(row, file, name, "a PNG")
    return pixels


def degrees_a_metre(latitude: float, longitude: float, height: float) -> tuple[float, float]:
    """Degrees of latitude and of longitude by which a metre to the north and to the east changes a place in degrees."""
    place = latitude * DEG, longitude * DEG
    p_J, C = geodetic_to_itrf(*place, height), C_JT(*place)
    (north_to, _), (_, east_to) = (
        [float(each) for each in itrf_to_geodetic(p_J + _PROBE_M * C[:, axis])[:2]] for axis in (1, 0)
    )
    (north_from, _), (_, east_from) = (
        [float(each) for each in itrf_to_geodetic(p_J - _PROBE_M * C[:, axis])[:2]] for axis in (1, 0)
    )
    east = np.remainder(east_to - east_from, 2.0 * np.pi)
    return (north_to - north_from) / (2.0 * _PROBE_M * DEG), float(east) / (2.0 * _PROBE_M * DEG)
