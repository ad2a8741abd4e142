"""What ``starplumb locate`` makes of its options: the place of one pixel, or a grid of a whole image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .output import Output

if TYPE_CHECKING:
    from ..ground.locate import Location
    from ..io.campaign.read import LoadedCampaign
    from ..io.gis.heights import Surface
    from ..physics.so3 import Array

Told = tuple[dict[str, Any], list[str], list[str]]
"""A document for programs, and lines and details for people."""


@dataclass(frozen=True)
class View:
    """An image of a campaign, seen through a mounting (C_EK, its covariance, a word on it), and the ground below it."""

    file: Path
    loaded: LoadedCampaign
    image: int
    mounting: tuple[Array, Array, str]
    surface: Surface | None
    height_m: float

    @classmethod
    def of(
        cls,
        file: Path,
        loaded: LoadedCampaign,
        image_id: str,
        result: Path | None,
        surface: Surface | None,
        height_m: float,
    ) -> View:
        """Raises InputError for an unknown image, or a result that is of no use here."""
        from ..io.results.result import read_mounting
        from ..physics.errors import InputError

        ids = loaded.campaign.images.ids
        if image_id not in ids:
            some = f"{', '.join(ids[:8])}{' ...' if len(ids) > 8 else ''}"
            raise InputError(f"--image: found {image_id!r}, wanted one of {some}")
        mounting = read_mounting(result, loaded) if result else _model(loaded)
        return cls(file, loaded, ids.index(image_id), mounting, surface, height_m)

    @property
    def image_id(self) -> str:
        return self.loaded.campaign.images.ids[self.image]


def single_pixel(view: View, pixel: tuple[float, float], sigma_px: float, sigma_height_m: float) -> Told:
    """The ground position of a pixel, counted as the user does, with its covariance."""
    import numpy as np

    from ..ground.locate import ground
    from ..physics.errors import InputError

    _require_inside(view.loaded, *pixel)
    C_EK, covariance_E, known = view.mounting
    ours = np.array([pixel]) - view.loaded.shift_px
    height_m = _ground_height(view, ours[0], pixel)
    image = np.array([view.image])
    where = ground(view.loaded.campaign, C_EK, covariance_E, image, ours, height_m, sigma_px, sigma_height_m)
    if not np.all(np.isfinite(where.p_J)):
        raise InputError(
            f"{view.file}: the line of sight of pixel ({pixel[0]:g}, {pixel[1]:g}) of {view.image_id} "
            "misses the Earth"
        )
    document = _document(where, view.image_id, pixel, known)
    return document, _lines(document), _details(document)


def _ground_height(view: View, ours: Array, pixel: tuple[float, float]) -> float:
    """Height that a pixel sees; raises InputError where the DEM has none."""
    import numpy as np

    from ..ground.terrain import ground_height
    from ..physics.errors import InputError

    if view.surface is None:
        return view.height_m
    found = ground_height(
        view.loaded.campaign, view.mounting[0], view.image, ours, view.surface.at, view.surface.dem.step_m
    )
    if not np.isfinite(found):
        raise InputError(
            f"{view.surface.dem.path}: found no ground under pixel ({pixel[0]:g}, {pixel[1]:g}) of {view.image_id}, "
            "wanted it covered"
        )
    return found


def whole_image(view: View, path: Path, every: int, rows: int | None, speak: Output) -> Told:
    """Write the ground positions of every pixel, or of every few, with a progress bar on a terminal."""
    import numpy as np

    from ..ground.geolocation import block_count, positions, terrain_below
    from ..io.gis.geolocation import require_ending, write_grid
    from ..physics.errors import InputError

    require_ending(path)
    campaign, C_EK = view.loaded.campaign, view.mounting[0]
    columns, stated = campaign.camera.size_px
    if np.isfinite(stated) and rows is not None:
        raise InputError(
            f"--rows: found beside the {stated:g} rows that {view.file} states, wanted only these"
        )
    if rows is None and not np.isfinite(stated):
        raise InputError(f"{view.file}: found no number of rows in the camera, wanted it told (--rows)")
    height = stated if rows is None else float(rows)
    column_px, row_px = np.arange(0.0, columns, every), np.arange(0.0, height, every)
    below: Any = view.height_m
    if view.surface is not None:
        step_m = view.surface.dem.step_m
        below = terrain_below(campaign, C_EK, view.image, row_px, column_px, view.surface.at, step_m)
    blocks = positions(campaign, C_EK, view.image, row_px, column_px, below)
    watched = speak.watched(blocks, "Locating", block_count(row_px, column_px))
    shape, first = (row_px.size, column_px.size), view.loaded.shift_px
    missing = write_grid(path, watched, shape, every)
    document = {
        "image_id": view.image_id,
        "mounting": view.mounting[2],
        "file": str(path),
        "rows": shape[0],
        "columns": shape[1],
        "first_pixel_px": [first, first],
        "step_px": every,
        "bands": ["longitude_deg", "latitude_deg", "height_m"],
        "pixels_without_ground": missing,
    }
    lines = [
        f"{path}: longitude, latitude, height of {shape[0]} x {shape[1]} pixels (mounting: {view.mounting[2]})"
    ]
    if missing:
        lines.append(f"{missing} of them have no ground in the DEM and are NaN")
    return document, lines, []


def _require_inside(loaded: LoadedCampaign, column: float, row: float) -> None:
    """Raise InputError for a pixel, counted as the user does, that the image does not have."""
    from ..io.campaign.markers import bounds_px
    from ..physics.errors import InputError

    for name, value, count in zip(
        ("COLUMN", "ROW"), (column, row), loaded.campaign.camera.size_px, strict=True
    ):
        low, high = bounds_px(count, loaded.shift_px)
        if not low <= value <= high:
            raise InputError(f"{name}: found {value:g}, wanted {low:.12g} to {high:.12g}, the image")


def _model(loaded: LoadedCampaign) -> tuple[Array, Array, str]:
    """The model mounting with its prior, where one is stated."""
    import numpy as np

    sigma = loaded.campaign.sigma_mounting
    if sigma is None:
        return loaded.campaign.C_EK, np.zeros((3, 3)), "model, its own error not stated and not included"
    return loaded.campaign.C_EK, np.diag(sigma**2), "model with its stated sigma"


def _document(where: Location, image: str, pixel: tuple[float, float], known: str) -> dict[str, Any]:
    from ..io.results.result import numbers
    from ..physics.units import DEG

    return {
        "image_id": image,
        "column_px": pixel[0],
        "row_px": pixel[1],
        "mounting": known,
        "latitude_deg": float(where.latitude[0] / DEG),
        "longitude_deg": float(where.longitude[0] / DEG),
        "height_m": float(where.height[0]),
        "itrf_m": numbers(where.p_J[0]),
        "covariance_east_north_up_m2": numbers(where.covariance_T[0]),
        "sigma_east_north_up_m": numbers(where.sigma_T[0]),
    }


def _lines(d: dict[str, Any]) -> list[str]:
    east, north, up = d["sigma_east_north_up_m"]
    return [
        f"latitude {d['latitude_deg']:.7f} deg, longitude {d['longitude_deg']:.7f} deg, "
        f"height {d['height_m']:.2f} m above the ellipsoid",
        f"sigma {east:.2f} m east, {north:.2f} m north, {up:.2f} m up (mounting: {d['mounting']})",
    ]


def _details(d: dict[str, Any]) -> list[str]:
    """Numbers for whoever goes on computing."""
    x, y, z = d["itrf_m"]
    covariance = "; ".join(" ".join(f"{v:.4f}" for v in row) for row in d["covariance_east_north_up_m2"])
    return [f"ITRF {x:.3f} {y:.3f} {z:.3f} m", f"covariance east, north, up, m^2: {covariance}"]
