"""Options of the commands that take ground heights from a raster."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Heights(StrEnum):
    """What heights are above."""

    ELLIPSOIDAL = "ellipsoidal"
    GEOID = "geoid"


HeightsOption = Annotated[
    Heights | None,
    typer.Option(
        "--heights", help="What the heights are above: the ellipsoid, or a geoid (then --geoid too)."
    ),
]
Dem = Annotated[
    Path | None,
    typer.Option("--dem", metavar="FILE", help="Raster of ground heights, its kind stated by --heights."),
]
Geoid = Annotated[
    Path | None,
    typer.Option("--geoid", metavar="FILE", help="Raster of the geoid's heights above the ellipsoid."),
]
ResultOption = Annotated[
    Path | None,
    typer.Option(
        "--result",
        "-r",
        metavar="RESULT.json|model",
        help="result.json to take the mounting from, or `model` [default: result/result.json beside the campaign, "
        "else the model].",
    ),
]
