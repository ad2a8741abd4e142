"""Arguments that the verbs of ``starplumb archive`` share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

File = Annotated[Path, typer.Argument(help="The archive.", metavar="FILE.db")]
OfSatellite = Annotated[
    str | None,
    typer.Option("--satellite", metavar="NAME", help="Of this satellite, where there are several."),
]
OfCamera = Annotated[
    str | None,
    typer.Option(
        "--camera", metavar="FRAME", help="Of the mounting from this frame, where there are several."
    ),
]
