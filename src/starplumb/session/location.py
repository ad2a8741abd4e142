"""From a pixel to the ground: one place with its covariance, or a grid of a whole image."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..documents.numbers import numbers
from ..ground.geolocation import block_count, positions, terrain_below
from ..ground.locate import Location, ground
from ..ground.terrain import ground_height
from ..io.campaign.markers import bounds_px
from ..io.gis.heights import Heights, Surface
from ..io.gis.heights import surface as dem_surface
from ..io.text.files import read_text
from ..physics.errors import ArgumentError, InputError
from ..physics.units import DEG
from .arguments import NotNegative, checked
from .campaign import Campaign
from .result import Result
from .show import Shown

Array = NDArray[np.float64]
Blocks = Callable[[Iterable[Any], int], Iterable[Any]]
"""Passes blocks of a grid on as they come, and shows how many of how many there are."""


@dataclass(frozen=True)
class Mounting:
    """A mounting to locate with: ``C_EK`` (3, 3), the covariance (3, 3) rad^2 of its error about E, and where it is
    from."""

    C_EK: Array
    covariance_E: Array
    origin: str


@dataclass(frozen=True)
class View:
    """An image of a campaign seen through a mounting, and the ground below it: a DEM, or one height."""

    campaign: Campaign
    image: int
    mounting: Mounting
    surface: Surface | None
    height_m: float

    @property
    def image_id(self) -> str:
        return self.campaign.images[self.image]


@dataclass(frozen=True, repr=False)
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
    def covariance_east_north_up_m2(self) -> Array:
        """The covariance (3, 3) of the position's error."""
        return np.array(self.document["covariance_east_north_up_m2"])

    @property
    def sentences(self) -> Sequence[str]:
        d = self.document
        east, north, up = d["sigma_east_north_up_m"]
        return (
            f"latitude {d['latitude_deg']:.7f} deg, longitude {d['longitude_deg']:.7f} deg, "
            f"height {d['height_m']:.2f} m above the ellipsoid",
            f"sigma {east:.2f} m east, {north:.2f} m north, {up:.2f} m up (mounting: {d['mounting']})",
        )

    @property
    def details(self) -> Sequence[str]:
        """Numbers for whoever goes on computing."""
        x, y, z = self.document["itrf_m"]
        rows = self.document["covariance_east_north_up_m2"]
        covariance = "; ".join(" ".join(f"{v:.4f}" for v in row) for row in rows)
        return (f"ITRF {x:.3f} {y:.3f} {z:.3f} m", f"covariance east, north, up, m^2: {covariance}")


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

    ``result`` is a Result or the path of a ``result.json``; left out, the model mounting is used.  The ground is at
    ``height_m`` above the ellipsoid (default 0), or where the line of sight first meets a ``dem``, whose ``heights``
    are "ellipsoidal" or above the "geoid".  Raises InputError where a pixel, an image, a result or the
    ground is unknown.
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
    if height_m is not None and not np.isfinite(height_m):
        raise ArgumentError("height_m", f"found {height_m}, wanted a finite number")
    if height_m is not None and dem is not None:
        raise ArgumentError("height_m", "found beside a DEM, wanted only one of the two")
    ids = campaign.images
    if image not in ids:
        some = f"{', '.join(ids[:8])}{' ...' if len(ids) > 8 else ''}"
        raise ArgumentError("image", f"found {image!r}, wanted one of {some}")
    below = None if dem is None else dem_surface(Path(dem), heights, None if geoid is None else Path(geoid))
    return View(campaign, ids.index(image), mounting_of(campaign, result), below, height_m or 0.0)


def mounting_of(campaign: Campaign, result: Result | str | Path | None) -> Mounting:
    """The mounting of a result, of a ``result.json``, or the campaign's model with its prior where one is stated."""
    if isinstance(result, Result):
        result.raise_if_unusable()
        covariance = result.calibration.estimate.covariance_E
        stated = "" if covariance is not None else ", no sigma stated"
        zero = np.zeros((3, 3)) if covariance is None else covariance
        return Mounting(result.C_EK, zero, f"result, {result.method}{stated}")
    if result is not None:
        return _read_mounting(campaign, Path(result))
    sigma = campaign.loaded.campaign.sigma_mounting
    if sigma is None:
        return Mounting(campaign.C_EK, np.zeros((3, 3)), "model, its own error not stated and not included")
    return Mounting(campaign.C_EK, np.diag(sigma**2), "model with its stated sigma")


def _read_mounting(campaign: Campaign, path: Path) -> Mounting:
    """That of a ``result.json``.

    Raises InputError where the file is no such result, its frames are not the campaign's, or its status forbids it.
    """
    from ..documents.result import ResultDocument

    document = ResultDocument.from_json(read_text(path), str(path))
    if not document.usable:
        raise InputError(
            f"{path}: status: found {document.status!r}, wanted a result whose mounting may be used (ok or weak)"
        )
    found, wanted = (document.mounting.from_, document.mounting.to), campaign.frames
    if found != wanted:
        raise InputError(
            f"{path}: mounting: found {found[0]} to {found[1]}, wanted {wanted[0]} to {wanted[1]}"
        )
    covariance = document.covariance_E
    stated = "" if covariance is not None else ", no sigma stated"
    zero = np.zeros((3, 3)) if covariance is None else covariance
    return Mounting(document.C_EK, zero, f"{path.name}, {document.method}{stated}")


def place(view: View, pixel: tuple[float, float], sigma_px: float, sigma_height_m: float) -> Place:
    """The ground position of a pixel, counted as the user does, with its covariance."""
    loaded = view.campaign.loaded
    _require_inside(view.campaign, *pixel)
    ours = np.array([pixel]) - loaded.shift_px
    height_m = _ground_height(view, ours[0], pixel)
    mounting, image = view.mounting, np.array([view.image])
    where = ground(
        loaded.campaign, mounting.C_EK, mounting.covariance_E, image, ours, height_m, sigma_px, sigma_height_m
    )
    if not np.all(np.isfinite(where.p_J)):
        raise InputError(
            f"{view.campaign.source}: the line of sight of pixel ({pixel[0]:g}, {pixel[1]:g}) of {view.image_id} "
            "misses the Earth"
        )
    return Place(_document(where, view, pixel))


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


def _document(where: Location, view: View, pixel: tuple[float, float]) -> dict[str, Any]:
    return {
        "image_id": view.image_id,
        "column_px": pixel[0],
        "row_px": pixel[1],
        "mounting": view.mounting.origin,
        "latitude_deg": float(where.latitude[0] / DEG),
        "longitude_deg": float(where.longitude[0] / DEG),
        "height_m": float(where.height[0]),
        "itrf_m": numbers(where.p_J[0]),
        "covariance_east_north_up_m2": numbers(where.covariance_T[0]),
        "sigma_east_north_up_m": numbers(where.sigma_T[0]),
    }


@dataclass(frozen=True, repr=False)
class Grid(Shown):
    """A file with the ground positions of an image's pixels; ``document`` is what --json prints."""

    document: dict[str, Any]

    @property
    def sentences(self) -> Sequence[str]:
        d = self.document
        size = f"{d['rows']} x {d['columns']}"
        lines = [f"{d['file']}: longitude, latitude, height of {size} pixels (mounting: {d['mounting']})"]
        if d["pixels_without_ground"]:
            lines.append(f"{d['pixels_without_ground']} of them have no ground in the DEM and are NaN")
        return tuple(lines)


def write_grid(
    view: View,
    path: str | Path,
    every: int = 1,
    rows: int | None = None,
    watch: Blocks = lambda blocks, _total: blocks,
) -> Grid:
    """Write the ground positions of every pixel, or of every few, into a ``.tif`` or ``.npy`` file.

    ``rows`` is needed for a camera that does not state how many it has.
    """
    from ..io.gis.geolocation import require_ending
    from ..io.gis.geolocation import write_grid as write

    path = Path(path)
    require_ending(path)
    loaded, C_EK = view.campaign.loaded, view.mounting.C_EK
    columns = loaded.campaign.camera.size_px[0]
    row_px = np.arange(0.0, _row_count(view.campaign, rows), every)
    column_px = np.arange(0.0, columns, every)
    below: Any = view.height_m
    if view.surface is not None:
        step_m = view.surface.dem.step_m
        below = terrain_below(loaded.campaign, C_EK, view.image, row_px, column_px, view.surface.at, step_m)
    blocks = positions(loaded.campaign, C_EK, view.image, row_px, column_px, below)
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
            "pixels_without_ground": missing,
        }
    )


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
