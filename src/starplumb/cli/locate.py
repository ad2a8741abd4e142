"""``starplumb locate``: from a pixel to the ground."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .ground import Dem, Geoid, HeightsOption
from .output import Json, Output, Quiet, Verbose

if TYPE_CHECKING:
    from ..io.campaign import LoadedCampaign
    from ..location import Location
    from ..so3 import Array


def locate(
    campaign: Annotated[Path, typer.Argument(help="The campaign.toml.", metavar="CAMPAIGN.toml")],
    column: Annotated[
        float, typer.Argument(metavar="COLUMN", help="Column, in the campaign's pixel origin.")
    ],
    row: Annotated[float, typer.Argument(metavar="ROW", help="Row, in the same.")],
    image: Annotated[str, typer.Option("--image", "-i", help="The image's id.")],
    result: Annotated[
        Path | None,
        typer.Option("--result", "-r", help="result.json to take the mounting from [default: the model]."),
    ] = None,
    height_m: Annotated[
        float | None, typer.Option("--height-m", help="Ground height above the ellipsoid [default: 0].")
    ] = None,
    dem: Dem = None,
    heights: HeightsOption = None,
    geoid: Geoid = None,
    sigma_height_m: Annotated[float, typer.Option("--sigma-height-m", min=0.0, help="Its sigma.")] = 0.0,
    sigma_px: Annotated[
        float, typer.Option("--sigma-px", min=0.0, help="Sigma of the pixel's coordinates.")
    ] = 0.0,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Ground position of a pixel with its covariance.

    The ground is at one height, or that of a DEM where the line of sight meets it first; what the DEM's heights are
    above must be said.

    Examples:

      \b
      starplumb locate demo/campaign.toml --image image01 6000 6000 \\
        --result demo/result/result.json

      \b
      starplumb locate campaign.toml --image scene 512 40 \\
        --dem dem.tif --heights geoid --geoid egm2008.tif
    """
    import numpy as np

    from ..errors import InputError
    from ..io.campaign import load_campaign
    from ..io.result import read_mounting
    from ..location import ground

    if height_m is not None and not np.isfinite(height_m):
        raise InputError(f"--height-m: found {height_m}, wanted a finite number")
    if height_m is not None and dem is not None:
        raise InputError("--height-m: found beside --dem, wanted only one of the two")
    speak = Output(json, quiet, verbose)
    loaded = load_campaign(campaign, with_detections=True)
    ids = loaded.campaign.images.ids
    if image not in ids:
        raise InputError(
            f"--image: found {image!r}, wanted one of {', '.join(ids[:8])}{' ...' if len(ids) > 8 else ''}"
        )
    _require_inside(loaded, column, row)
    C_EK, covariance_E, known = read_mounting(result, loaded) if result else _model(loaded)
    pixel = np.array([[column, row]]) - loaded.shift_px
    if dem is not None:
        from ..io.heights import surface
        from ..terrain import ground_height

        ground_at = surface(dem, None if heights is None else heights.value, geoid)
        height_m = ground_height(
            loaded.campaign, C_EK, ids.index(image), pixel[0], ground_at.at, ground_at.dem.step_m
        )
        if not np.isfinite(height_m):
            raise InputError(
                f"{dem}: found no ground under pixel ({column:g}, {row:g}) of {image}, wanted it covered"
            )
    where = ground(
        loaded.campaign,
        C_EK,
        covariance_E,
        np.array([ids.index(image)]),
        pixel,
        height_m or 0.0,
        sigma_px,
        sigma_height_m,
    )
    if not np.all(np.isfinite(where.p_J)):
        raise InputError(
            f"{campaign}: the line of sight of pixel ({column:g}, {row:g}) of {image} misses the Earth"
        )
    document = _document(where, image, (column, row), known)
    speak.notices(loaded.notices)
    speak.document(document)
    speak.show(*_lines(document))
    speak.detail(*_details(document))


def _require_inside(loaded: LoadedCampaign, column: float, row: float) -> None:
    """Raise InputError for a pixel, counted as the user does, that the image does not have."""
    from ..errors import InputError
    from ..io.markers import bounds_px

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
    from ..io.result import numbers
    from ..units import DEG

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
