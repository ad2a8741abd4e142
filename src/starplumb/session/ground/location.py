"""From a pixel to the ground: one place with its covariance, or a grid of a whole image."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...documents.numbers import numbers
from ...ground.geolocation import beside_gaps, block_count, positions, terrain_below
from ...ground.locate import Location, ground
from ...ground.terrain import ground_height, slopes
from ...io.campaign.marks.markers import bounds_px, meant
from ...io.gis.heights import HEIGHTS_M, Heights, Surface
from ...io.gis.heights import surface as dem_surface
from ...io.text.files import composed
from ...io.text.numbers import SIGMA_WORDS, is_sigma
from ...physics.errors import ArgumentError, InputError
from ...physics.units import DEG
from ...table.coverage import covered, why_not
from ..arguments import NotNegative, checked
from ..campaign import Campaign
from ..mounting import Mounting, alone, mounting_of
from ..result import Result
from ..show import Shown

Array = NDArray[np.float64]
Blocks = Callable[[Iterable[Any], int], Iterable[Any]]
"""Passes blocks of a grid on as they come, and shows how many of how many there are."""


@dataclass(frozen=True)
class View:
    """An image of a campaign seen through a mounting, and the ground below it: a DEM, or one height."""

    campaign: Campaign
    image: int
    mounting: Mounting
    surface: Surface | None
    height_m: float

    @property
    def sources(self) -> tuple[Path, ...]:
        """The files that are read: those of the campaign, and the rasters of the ground."""
        return (*self.campaign.loaded.sources, *(() if self.surface is None else self.surface.paths))

    @property
    def image_id(self) -> str:
        return self.campaign.images[self.image]


@dataclass(frozen=True, repr=False, eq=False)
class Place(Shown):
    """The ground position of a pixel: what :func:`starplumb.locate` returns.  ``document`` is what --json prints."""

    document: dict[str, Any]

    @property
    def latitude_deg(self) -> float:
        return float(self.document["latitude_deg"])

    @property
    def longitude_deg(self) -> float:
        return float(self.document["longitude_deg"])

    @property
    def height_m(self) -> float:
        """The height above the WGS 84 ellipsoid."""
        return float(self.document["height_m"])

    @property
    def covariance_east_north_up_m2(self) -> Array | None:
        """The covariance (3, 3) of the position's error; None where a part of it is nowhere stated."""
        stated = self.document["covariance_east_north_up_m2"]
        return None if stated is None else np.array(stated)

    @property
    def notices(self) -> Sequence[str]:
        """What should be known of the mounting."""
        return tuple(self.document["notices"])

    @property
    def answer(self) -> Sequence[str]:
        """The place and its sigmas."""
        d = self.document
        if d["sigma_east_north_up_m"] is None:
            sigma = f"sigma not stated: {d['no_sigma']} (mounting: {d['mounting']})"
        else:
            east, north, up = d["sigma_east_north_up_m"]
            ground = (
                f"ground height +- {d['sigma_height_m']:g} m"
                if d["sigma_height_m"]
                else "ground height as exact"
            )
            sigma = f"sigma {east:.2f} m east, {north:.2f} m north, {up:.2f} m up (mounting: {d['mounting']}; {ground})"
        return (
            f"latitude {d['latitude_deg']:.7f} deg, longitude {d['longitude_deg']:.7f} deg, "
            f"height {d['height_m']:.2f} m above the ellipsoid",
            sigma,
        )

    @property
    def sentences(self) -> Sequence[str]:
        return (*self.answer, *(f"note: {notice}" for notice in self.notices))

    @property
    def details(self) -> Sequence[str]:
        """Numbers for whoever goes on computing."""
        x, y, z = self.document["itrf_m"]
        rows = self.document["covariance_east_north_up_m2"]
        where = f"ITRF {x:.3f} {y:.3f} {z:.3f} m"
        if rows is None:
            return (where,)
        covariance = "; ".join(" ".join(f"{v:.4f}" for v in row) for row in rows)
        return (where, f"covariance east, north, up, m^2: {covariance}")


@checked
def locate(
    campaign: Campaign,
    result: Result | str | Path | None = None,
    *,
    image: str,
    column: float,
    row: float,
    height_m: float | None = None,
    dem: str | Path | None = None,
    heights: Heights | None = None,
    geoid: str | Path | None = None,
    sigma_px: NotNegative = 0.0,
    sigma_height_m: NotNegative = 0.0,
) -> Place:
    """The ground position of a pixel with its covariance.

    ``result`` is a Result, the path of a ``result.json``, or ``"model"`` for the campaign's model mounting; left out,
    it is the ``result/result.json`` beside the campaign where that is there, may be used and is of these very
    inputs, else the model.  The ground is at ``height_m`` above the ellipsoid (default 0), or where the line of sight
    first meets a ``dem``, whose ``heights`` are "ellipsoidal" or above the "geoid"; ``sigma_height_m`` is the sigma of
    either.  The covariance is None where the mounting's error is nowhere stated or the line of sight grazes the slope.

    Raises InputError where a pixel, an image, a result or the ground is unknown.
    """
    view = view_of(campaign, result, image, height_m, dem, heights, geoid)
    return place(view, (column, row), sigma_px, sigma_height_m)


def view_of(
    campaign: Campaign,
    result: Result | str | Path | None,
    image: str,
    height_m: float | None = None,
    dem: str | Path | None = None,
    heights: Heights | None = None,
    geoid: str | Path | None = None,
) -> View:
    """The image and what is needed to locate its pixels, checked."""
    low, high = HEIGHTS_M
    if height_m is not None and not low <= height_m <= high:
        raise ArgumentError("height_m", f"found {height_m:g}, wanted a finite number, {low:g} to {high:g}")
    if height_m is not None and dem is not None:
        raise ArgumentError("height_m", "found beside a DEM, wanted only one of the two")
    below = None if dem is None else dem_surface(Path(dem), heights, None if geoid is None else Path(geoid))
    number = image_of(campaign, image)
    campaign = alone(campaign, number)
    return View(campaign, number, mounting_of(campaign, result, number), below, height_m or 0.0)


def image_of(campaign: Campaign, image: str) -> int:
    """The place of an image among those of the campaign; InputError for one that it does not have."""
    ids, image = campaign.images, composed(image)
    if image not in ids:
        some = f"{', '.join(ids[:8])}{' ...' if len(ids) > 8 else ''}"
        raise ArgumentError("image", f"found {image!r}, wanted one of {some}{meant(image, ids)}")
    return ids.index(image)


def place(view: View, pixel: tuple[float, float], sigma_px: float, sigma_height_m: float) -> Place:
    """The ground position of a pixel, counted as the user does, with its covariance."""
    loaded = view.campaign.loaded
    for name, sigma in (("sigma_px", sigma_px), ("sigma_height_m", sigma_height_m)):
        if not is_sigma(sigma):
            raise ArgumentError(name, f"found {sigma:g}, wanted 0 or a number from {SIGMA_WORDS}")
    _require_inside(view.campaign, *pixel)
    ours = np.array([pixel]) - loaded.shift_px
    height_m = _ground_height(view, ours[0], pixel)
    mounting, image = view.mounting, np.array([view.image])
    spread = np.zeros((3, 3)) if mounting.covariance_E is None else mounting.covariance_E
    surface = view.surface
    rise = None if surface is None else lambda p_J: slopes(surface.at, p_J, surface.dem.step_m)
    where = ground(
        loaded.campaign, mounting.C_EK, spread, image, ours, height_m, sigma_px, sigma_height_m, rise
    )
    if not np.all(np.isfinite(where.p_J)):
        raise InputError(
            f"{view.campaign.source}: the line of sight of pixel ({pixel[0]:g}, {pixel[1]:g}) of {view.image_id} "
            "misses the Earth"
        )
    return Place(_document(where, view, pixel, sigma_height_m))


def _ground_height(view: View, ours: Array, pixel: tuple[float, float]) -> float:
    """Height that a pixel sees; raises InputError where the DEM has none."""
    if view.surface is None:
        return view.height_m
    data, dem = view.campaign.loaded.campaign, view.surface.dem
    found = ground_height(data, view.mounting.C_EK, view.image, ours, view.surface.at, dem.step_m)
    if not np.isfinite(found):
        raise InputError(
            f"{dem.path}: found no ground under pixel ({pixel[0]:g}, {pixel[1]:g}) of {view.image_id}, "
            "wanted a DEM that covers it"
        )
    return found


def _document(
    where: Location, view: View, pixel: tuple[float, float], sigma_height_m: float
) -> dict[str, Any]:
    lacks = None
    if view.mounting.covariance_E is None:
        lacks = "the error of the model mounting is not stated (mounting.sigma_arcsec)"
    elif not np.all(np.isfinite(where.covariance_T)):
        lacks = "the line of sight grazes the slope"
    return {
        "image_id": view.image_id,
        "column_px": pixel[0],
        "row_px": pixel[1],
        "mounting": view.mounting.origin,
        "latitude_deg": float(where.latitude[0] / DEG),
        "longitude_deg": float(where.longitude[0] / DEG),
        "height_m": float(where.height[0]),
        "itrf_m": numbers(where.p_J[0]),
        "covariance_east_north_up_m2": numbers(where.covariance_T[0]) if lacks is None else None,
        "sigma_east_north_up_m": numbers(where.sigma_T[0]) if lacks is None else None,
        "sigma_height_m": sigma_height_m,
        **({} if lacks is None else {"no_sigma": lacks}),
        "notices": list(view.mounting.notices),
    }


@dataclass(frozen=True, repr=False, eq=False)
class Grid(Shown):
    """A file with the ground positions of an image's pixels; ``document`` is what --json prints."""

    document: dict[str, Any]

    @property
    def notices(self) -> Sequence[str]:
        """What should be known of the mounting."""
        return tuple(self.document["notices"])

    @property
    def answer(self) -> Sequence[str]:
        """What the file holds."""
        d = self.document
        size = f"{d['rows']} x {d['columns']}"
        lines = [f"{d['file']}: longitude, latitude, height of {size} pixels (mounting: {d['mounting']})"]
        if d["pixels_without_ground"]:
            lines.append(
                f"{d['pixels_without_ground']} of them have no ground (beside the DEM, or past the Earth) and are NaN"
            )
        if d["rows_left_out"]:
            rows = f"{d['rows_left_out']} of {d['rows']} rows"
            lines.append(f"{rows} lie outside attitude or orbit and are NaN")
        return tuple(lines)

    @property
    def sentences(self) -> Sequence[str]:
        return (*self.answer, *(f"note: {notice}" for notice in self.notices))


def grid_shape(view: View, path: str | Path, every: int = 1, rows: int | None = None) -> tuple[int, int]:
    """Rows and columns that ``write_grid`` will write.  Raises InputError for what it would refuse at once."""
    from ...io.gis.geolocation import require_ending

    require_ending(Path(path))
    row_px, column_px = _grid_pixels(view, every, rows)
    return row_px.size, column_px.size


def _grid_pixels(view: View, every: int, rows: int | None) -> tuple[Array, Array]:
    columns = view.campaign.loaded.campaign.camera.size_px[0]
    return np.arange(0.0, _row_count(view.campaign, rows), every), np.arange(0.0, columns, every)


def write_grid(
    view: View,
    path: str | Path,
    every: int = 1,
    rows: int | None = None,
    watch: Blocks = lambda blocks, _total: blocks,
) -> Grid:
    """Write the ground positions of every pixel, or of every few, into a ``.tif`` or ``.npy`` file.

    ``rows`` is needed for a camera that does not state how many it has.  Raises InputError where the file is one that
    is read, or one that holds something else.
    """
    from ...disk.owned import require_own
    from ...io.gis.geolocation import is_grid, require_ending
    from ...io.gis.geolocation import write_grid as write

    path = Path(path)
    require_ending(path)
    require_own(path, view.sources, is_grid)
    loaded, C_EK = view.campaign.loaded, view.mounting.C_EK
    row_px, column_px = _grid_pixels(view, every, rows)
    seen = _covered_rows(view, row_px)
    below: Any = view.height_m
    if view.surface is not None:
        step_m = view.surface.dem.step_m
        below = terrain_below(
            loaded.campaign, C_EK, view.image, row_px[seen], column_px, view.surface.at, step_m
        )
    blocks = beside_gaps(
        seen,
        column_px.size,
        lambda rows: positions(loaded.campaign, C_EK, view.image, row_px[rows], column_px, below),
    )
    shape = (row_px.size, column_px.size)
    missing = write(path, watch(blocks, block_count(row_px, column_px)), shape, every)
    return Grid(
        {
            "image_id": view.image_id,
            "mounting": view.mounting.origin,
            "file": str(path),
            "rows": shape[0],
            "columns": shape[1],
            "first_pixel_px": [loaded.shift_px, loaded.shift_px],
            "step_px": every,
            "bands": ["longitude_deg", "latitude_deg", "height_m"],
            "pixels_without_ground": missing - int(np.sum(~seen)) * column_px.size,
            "rows_left_out": int(np.sum(~seen)),
            "notices": list(view.mounting.notices),
        }
    )


def _covered_rows(view: View, row_px: Array) -> NDArray[np.bool_]:
    """Which rows (r,) to locate: those that attitude and orbit cover where the others are to be left out, else all.

    Raises InputError where none is.
    """
    if view.campaign.loaded.outside == "refuse":
        return np.ones(row_px.size, dtype=np.bool_)
    image = np.full(row_px.size, view.image)
    seen = covered(view.campaign.loaded.campaign, image, row_px)
    if not seen.any():
        why = why_not(view.campaign.loaded.campaign, view.image, float(row_px[0]))
        raise InputError(f"{view.campaign.source}: {why}; no row of {view.image_id} is covered")
    return seen


def _row_count(campaign: Campaign, rows: int | None) -> float:
    stated = campaign.loaded.campaign.camera.size_px[1]
    if np.isfinite(stated) and rows is not None:
        raise ArgumentError(
            "rows", f"found beside the {stated:g} rows that {campaign.source} states, wanted only these"
        )
    if rows is None and not np.isfinite(stated):
        raise InputError(f"{campaign.source}: found no number of rows in the camera, wanted --rows")
    return stated if rows is None else float(rows)


def _require_inside(campaign: Campaign, column: float, row: float) -> None:
    """Raise InputError for a pixel, counted as the user does, that the image does not have."""
    loaded = campaign.loaded
    for name, value, count in zip(
        ("COLUMN", "ROW"), (column, row), loaded.campaign.camera.size_px, strict=True
    ):
        low, high = bounds_px(count, loaded.shift_px)
        if not low <= value <= high:
            raise InputError(f"{name}: found {value:g}, wanted {low:.12g} to {high:.12g}, the image")
