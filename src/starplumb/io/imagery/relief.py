"""Heights for measuring: a raster by GDAL, or an Esri ASCII grid in degrees, which needs no extra."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...ground.grid import Terrain
from ...physics.errors import InputError
from ...physics.units import DEG
from ..gis.heights import Raster, surface
from ..text.files import read_text
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
    head: dict[str, float] = {}
    while len(words) > 2 * len(head) + 1 and words[2 * len(head)].lower() in _KEYS:
        key, value = words[2 * len(head)].lower(), words[2 * len(head) + 1]
        try:
            head[key] = float(value)
        except ValueError:
            raise InputError(f"{path}: {key}: found {value!r}, wanted a number") from None
    try:
        columns, rows = int(head["ncols"]), int(head["nrows"])
        dx, dy = head.get("dx", head.get("cellsize")), head.get("dy", head.get("cellsize"))
        if dx is None or dy is None or not (dx > 0.0 and dy > 0.0) or columns < 2 or rows < 2:
            raise KeyError("cellsize")
        west = head["xllcenter"] if "xllcenter" in head else head["xllcorner"] + 0.5 * dx
        south = head["yllcenter"] if "yllcenter" in head else head["yllcorner"] + 0.5 * dy
    except KeyError as error:
        raise InputError(
            f"{path}: found an Esri ASCII grid without a good {error.args[0]}, wanted ncols, nrows, xllcorner, "
            "yllcorner and cellsize"
        ) from None
    try:
        height = np.array(words[2 * len(head) :], dtype=np.float64)
    except ValueError:
        raise InputError(f"{path}: found heights that are not numbers, wanted numbers only") from None
    if height.size != columns * rows:
        raise InputError(f"{path}: found {height.size} heights, wanted {columns * rows} (ncols times nrows)")
    height = np.where(height == head.get("nodata_value", np.nan), np.nan, height).reshape(rows, columns)
    return Terrain(height, (south + (rows - 1) * dy) * DEG, west * DEG, (-dy * DEG, dx * DEG))
