"""``starplumb init``: an example to begin with."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..output import Json, Output, Quiet, Verbose


class Kind(StrEnum):
    """Cameras of the example."""

    FRAME = "frame"
    LINE_SCAN = "line-scan"


def init(
    folder: Annotated[Path, typer.Argument(help="Folder to make; it must be new or empty.", metavar="DIR")],
    camera: Annotated[Kind, typer.Option("--camera", help="Camera of the example.")] = Kind.FRAME,
    images: Annotated[int, typer.Option("--images", min=1, max=40, help="Number of images.")] = 8,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the simulated errors.")] = 1,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Write a ready campaign of simulated data whose true alignment is known.

    Example:

      starplumb init demo && starplumb calibrate demo/campaign.toml
    """
    from ...physics.errors import InputError
    from ...session.campaign import write_demo

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: found something there already, wanted a new or empty folder")
    path, data = write_demo(folder, camera.value, images, seed)
    speak = Output(json, quiet, verbose)
    speak.document({"campaign": str(path), "images": images, "observations": int(data.sightings.image.size)})
    speak.detail(*(f"wrote {file}" for file in sorted(folder.iterdir())))
    speak.show(
        f"wrote {path}: {images} images of {len(data.landmarks.ids)} markers, the true mounting known",
        f"next: starplumb calibrate {path}",
    )
