"""``starplumb locate``: from a pixel to the ground."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options.common import CampaignArgument
from .options.complete import images
from .options.ground import Dem, Geoid, HeightsOption, ResultOption
from .options.outside import Choice, OutsideOption
from .options.places import require_place
from .output import Json, Output, Quiet, Verbose

ASKED_ABOVE = 1e9
"""Bytes of a grid that nobody writes by mistake."""


def locate(
    campaign: CampaignArgument,
    image: Annotated[
        str, typer.Option("--image", "-i", metavar="ID", autocompletion=images, help="The image's id.")
    ],
    column: Annotated[
        float | None, typer.Argument(metavar="COLUMN", help="Column, in the campaign's pixel origin.")
    ] = None,
    row: Annotated[float | None, typer.Argument(metavar="ROW", help="Row, in the same.")] = None,
    result: ResultOption = None,
    height_m: Annotated[
        float | None,
        typer.Option("--height-m", metavar="METRES", help="Ground height above the ellipsoid [default: 0]."),
    ] = None,
    dem: Dem = None,
    heights: HeightsOption = None,
    geoid: Geoid = None,
    sigma_height_m: Annotated[
        float, typer.Option("--sigma-height-m", metavar="METRES", min=0.0, help="Its sigma.")
    ] = 0.0,
    sigma_px: Annotated[
        float, typer.Option("--sigma-px", metavar="PIXELS", min=0.0, help="Sigma of the pixel's coordinates.")
    ] = 0.0,
    grid: Annotated[
        Path | None,
        typer.Option(
            "--grid",
            metavar="FILE",
            help="Instead of one pixel the whole image, into this .tif or .npy file.",
        ),
    ] = None,
    every: Annotated[
        int, typer.Option("--every", metavar="COUNT", min=1, help="With --grid: pixels from one to the next.")
    ] = 1,
    rows: Annotated[
        int | None,
        typer.Option(
            "--rows",
            metavar="COUNT",
            min=1,
            help="With --grid: how many rows, for a camera that does not say.",
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Write a grid of more than 1 GB without asking.")
    ] = False,
    outside: OutsideOption = Choice.REFUSE,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Ground position of a pixel with its covariance, or of every pixel of an image.

    The ground is at one height, or that of a DEM where the line of sight meets it first; what the DEM's heights are
    above must be said. The mounting is that of the last calibration where its inputs are still the same.

    Examples:

      \b
      starplumb locate demo/campaign.toml --image image01 6000 6000

      \b
      starplumb locate campaign.toml --image scene 512 40 \\
        --dem dem.tif --heights geoid --geoid egm2008.tif

      \b
      starplumb locate demo/campaign.toml --image image01 \\
        --grid ground.npy --every 100
    """
    from ..physics.errors import InputError
    from ..session.campaign import read_campaign
    from ..session.ground.location import grid_shape, place, view_of, write_grid

    if column is not None and row is None:
        raise InputError("COLUMN ROW: found a COLUMN alone, wanted its ROW too")
    pixel = None if column is None or row is None else (column, row)
    if (pixel is None) == (grid is None):
        raise InputError(
            "COLUMN ROW: found "
            + ("neither them nor" if grid is None else "them and")
            + " --grid, wanted one"
        )
    speak = Output(json, quiet, verbose)
    found = read_campaign(campaign, outside.value)
    view = view_of(found, result, image, height_m, dem, None if heights is None else heights.value, geoid)
    if grid is not None:
        require_place(grid.parent, [grid.name], [found.loaded.sources, dem, geoid, result])
        _agreed(speak, grid, grid_shape(view, grid, every, rows), view.surface is None, yes)
        written = write_grid(
            view, grid, every, rows, lambda blocks, total: speak.watched(blocks, "Locating", total)
        )
        speak.notices([*found.notices, *written.notices])
        speak.document(written.document)
        speak.show(*written.answer)
    elif pixel is not None:
        where = place(view, pixel, sigma_px, sigma_height_m)
        speak.notices([*found.notices, *where.notices])
        speak.document(where.document)
        speak.show(*where.answer)
        speak.detail(*where.details)


def _agreed(speak: Output, grid: Path, shape: tuple[int, int], flat: bool, yes: bool) -> None:
    """Say how large the file becomes; above 1 GB ask on a terminal.  Raises InputError where the answer is not yes."""
    import sys

    from ..io.gis.geolocation import bytes_on_disk
    from ..physics.errors import InputError
    from ..report.text import amount_of_bytes

    size = bytes_on_disk(grid, shape, flat)
    about = "" if grid.suffix.lower() == ".npy" else "about "
    said = f"{shape[0]} x {shape[1]} pixels, {about}{amount_of_bytes(size)}"
    if size <= ASKED_ABOVE or yes:
        speak.notices([f"{grid}: {said}"])
    elif not (sys.stdin.isatty() and typer.confirm(f"{grid}: {said}; write it?", err=True)):
        raise InputError(
            f"{grid}: found a grid of {said}, wanted --yes for more than 1 GB, or fewer pixels (--every)"
            + (", or a .tif, which is compressed" if not about else "")
        )
