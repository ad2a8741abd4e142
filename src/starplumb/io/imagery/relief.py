"""Heights for measuring: a raster by GDAL, or an Esri ASCII grid in degrees, which needs no extra."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...ground.grid import Terrain
from ...physics.errors import InputError
from ...physics.units import DEG
from ..gis.heights import HEIGHTS_M, Raster, surface
from ..text.files import read_text, show
from ..text.numbers import LEAST, number, numbers
from .ortho import DEGREES, METRES_A_DEGREE

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Relief:
    """Heights (n,) above the ellipsoid at places (n,) rad, NaN where unknown, and the size of a cell, m."""

    at: Callable[[Array, Array], Array]
    step_m: float


def read_relief(
    dem: Path, crs: str | None, heights: Literal["ellipsoidal", "geoid"], geoid: Path | None
) -> Relief:
    """The heights of a DEM.  Raises InputError where it cannot be read or does not say where it lies."""
    if dem.suffix.lower() != ".asc":
        found = surface(dem, heights, geoid)
        return Relief(found.at, found.dem.step_m)
    if crs is None or crs.strip().upper() not in DEGREES:
        given = "no reference.crs" if crs is None else f"reference.crs = {crs}"
        raise InputError(
            f"{dem}: found {given} beside an Esri ASCII grid, wanted EPSG:4326 for a grid in degrees, or a GeoTIFF"
        )
    terrain = read_ascii_grid(dem)
    step_m = METRES_A_DEGREE / DEG * min(-terrain.step[0], terrain.step[1] * np.cos(terrain.latitude))
    if geoid is None:
        return Relief(terrain.at, float(step_m))
    above = Raster.open(geoid)
    return Relief(
        lambda latitude, longitude: terrain.at(latitude, longitude) + above.at(latitude, longitude), step_m
    )


MOST_CELLS = 1_000_000
"""Along a side of a grid that is text."""
_KEYS = {
    "ncols",
    "nrows",
    "xllcorner",
    "yllcorner",
    "xllcenter",
    "yllcenter",
    "cellsize",
    "dx",
    "dy",
    "nodata_value",
}


def read_ascii_grid(path: Path) -> Terrain:
    """An Esri ASCII grid of heights in degrees, the northernmost row first; raises InputError where it is none."""
    words = read_text(path).split()
    head = _head(path, words)
    (columns, rows), (west, south), (dx, dy) = _layout(path, head)
    height = numbers(words[2 * len(head) :])
    if height.size != columns * rows:
        raise InputError(f"{path}: found {height.size} heights, wanted {columns * rows} (ncols times nrows)")
    _require_heights(path, words[2 * len(head) :], height, head.get("nodata_value", np.nan))
    height = np.where(height == head.get("nodata_value", np.nan), np.nan, height).reshape(rows, columns)
    return Terrain(height, (south + (rows - 1) * dy) * DEG, west * DEG, (-dy * DEG, dx * DEG))


def _head(path: Path, words: Sequence[str]) -> dict[str, float]:
    """The keys with their numbers; raises InputError for one that stands twice or has none."""
    head: dict[str, float] = {}
    for key, word in zip(words[::2], words[1::2], strict=False):
        name = key.lower()
        if name not in _KEYS:
            break
        if name in head:
            raise InputError(f"{path}: found {name} twice, wanted it once")
        head[name] = number(word)
        if np.isnan(head[name]):
            raise InputError(f"{path}: {name}: found {show(word)}, wanted a number")
    return head


def _layout(
    path: Path, head: Mapping[str, float]
) -> tuple[tuple[int, int], tuple[float, float], tuple[float, float]]:
    """Columns and rows, longitude and latitude of the south-westernmost cell's centre and the steps, degrees."""
    try:
        dx, dy = (head[key] if key in head else head["cellsize"] for key in ("dx", "dy"))
        columns, rows = head["ncols"], head["nrows"]
        west = head["xllcenter"] if "xllcenter" in head else head["xllcorner"] + 0.5 * dx
        south = head["yllcenter"] if "yllcenter" in head else head["yllcorner"] + 0.5 * dy
    except KeyError as error:
        raise InputError(
            f"{path}: found an Esri ASCII grid without {error.args[0]}, wanted ncols, nrows, xllcorner, yllcorner and "
            "cellsize"
        ) from None
    if not all(2 <= n <= MOST_CELLS and n == int(n) for n in (columns, rows)):
        raise InputError(f"{path}: found {columns:.9g} x {rows:.9g} cells, wanted whole numbers of 2 or more")
    north, east = south + (rows - 1.0) * dy, west + (columns - 1.0) * dx
    if not (
        min(dx, dy) >= LEAST
        and -90.0 <= south < north <= 90.0
        and -360.0 <= west < east <= west + 360.0 <= 720.0
    ):
        found = f"found cells from longitude {west:.9g}, latitude {south:.9g} to {east:.9g}, {north:.9g}"
        raise InputError(f"{path}: {found}, wanted places on the Earth in degrees")
    return (int(columns), int(rows)), (west, south), (dx, dy)


def _require_heights(path: Path, words: Sequence[str], height: Array, nodata: float) -> None:
    """Raise InputError for a word that is no number, and for a height that no ground has."""
    low, high = HEIGHTS_M
    bad = ~((height >= low) & (height <= high)) & (height != nodata)
    if bad.any():
        at = int(np.argmax(bad))
        raise InputError(
            f"{path}: found the height {show(words[at])}, wanted a number from {low:g} to {high:g} m, or NODATA_value"
        )
