"""``starplumb points``: ground points of other programs as tables of landmarks and observations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..options.ground import Dem, Geoid, HeightsOption
from ..options.places import paths
from ..output import Json, Output, Quiet, Verbose


def points(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="QGIS .points, Ames Stereo Pipeline .gcp, OpenDroneMap .txt, GeoJSON, CSV, or a tagged .tif.",
            metavar="FILE...",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for landmarks.csv and observations.csv."),
    ],
    sigma_m: Annotated[
        str | None,
        typer.Option(
            "--sigma-m",
            metavar="METRES",
            help="Sigma of the places where the file has none: one, or east,north,up.",
        ),
    ] = None,
    sigma_px: Annotated[
        float | None,
        typer.Option("--sigma-px", metavar="PIXELS", help="Sigma of the pixels where the file has none."),
    ] = None,
    dem: Dem = None,
    heights: HeightsOption = None,
    geoid: Geoid = None,
    crs: Annotated[
        str | None,
        typer.Option("--crs", metavar="CRS", help="Reference system of a file that does not state it."),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Turn ground points of other programs into landmarks.csv and observations.csv.

    Read are QGIS .points, Ames Stereo Pipeline .gcp, OpenDroneMap gcp_list.txt, GeoJSON of Orthority and rasterio, CSV
    with such names, and control points in the tags of a .tif. The pixels written have (0, 0) at the centre of the first
    pixel. A file that names no image is of the image that has its name; points at the very same place are one landmark.
    QGIS keeps no heights: give a DEM, and say what its heights are above; heights of the other files are taken as
    ellipsoidal unless --heights geoid says otherwise. Tables that are in --out already are not replaced.

    Examples:

      \b
      starplumb points scene1.points scene2.points --out . --sigma-m 2,2,4 --sigma-px 0.5 \\
        --dem dem.tif --heights geoid --geoid egm2008.tif

      \b
      starplumb points control.gcp --out campaign
    """
    from ...disk.publish import publish_beside
    from ...io.campaign.marks.ground_tables import Sigmas, tables
    from ...io.gis.heights import Ground
    from ...physics.errors import counted

    speak = Output(json, quiet, verbose)
    found, notices = tables(
        files,
        Ground(dem, None if heights is None else heights.value, geoid),
        Sigmas(_three("--sigma-m", sigma_m), sigma_px),
        crs,
    )
    publish_beside(out, found.files, list(paths([files, dem, geoid])))
    speak.notices(notices)
    speak.detail(*(f"read {path}" for path in files))
    speak.document({"landmarks": found.landmarks, "observations": found.observations, "images": found.images})
    speak.show(
        f"wrote {out / 'landmarks.csv'}: {counted(found.landmarks, 'landmark')}",
        f"wrote {out / 'observations.csv'}: {counted(found.observations, 'observation')} in {', '.join(found.images)}",
    )


def _three(option: str, text: str | None) -> tuple[float, float, float] | None:
    """One positive number, or three with commas between."""
    from math import isfinite

    from ...io.text.files import show
    from ...io.text.numbers import numbers
    from ...physics.errors import InputError

    if text is None:
        return None
    values = tuple(numbers(text.split(",")).tolist())
    if len(values) not in (1, 3) or not all(isfinite(value) and value >= 0.0 for value in values):
        raise InputError(
            f"{option}: found {show(text)}, wanted one number, or three with commas between, none negative"
        )
    return (values[0],) * 3 if len(values) == 1 else (values[0], values[1], values[2])
