"""``starplumb measure``: from raw images to sightings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .output import Json, Output, Quiet, Verbose


def measure(
    campaign: Annotated[Path, typer.Argument(help="The campaign.toml.", metavar="CAMPAIGN.toml")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder of the tables [default: `measured` beside the campaign].",
        ),
    ] = None,
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="Calibrate with what was measured, into the same folder.")
    ] = False,
    report: Annotated[bool, typer.Option(help="Write measure.html, the page of all chips.")] = True,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Find pieces of a reference in raw images, and write where as landmarks and observations.

    The campaign names raw images ([imagery]) and an orthoimage with heights ([reference]); how far to search follows
    from mounting.sigma_arcsec. Writes measure.json, the page measure.html, landmarks.csv,
    observations.csv and a campaign.toml that names these.

    Examples:

      starplumb measure campaign.toml --calibrate

      starplumb measure campaign.toml --out measured
    """
    from ..physics.errors import AlignmentFailed
    from ..session.imagery.measurement import measure_watched, require_place

    speak = Output(json, quiet, verbose)
    out = out or campaign.parent / "measured"
    require_place(out, campaign)
    found = measure_watched(campaign, lambda images, total: speak.watched(images, "measuring", total))
    speak.notices(found.loaded.notices)
    found.save(out, report)
    if not calibrate or not found.acquired:
        speak.document(found.document)
    speak.shown(found, f"written: {out}")
    speak.detail(*(f"{name}: {digest}" for name, digest in found.loaded.inputs.items()))
    if calibrate and found.acquired:
        from .calibrate import calibrate as run

        run([out / "campaign.toml"], out=out, report=report, json=json, quiet=quiet, verbose=verbose)
    if not found.usable:
        raise AlignmentFailed(f"{campaign}: {found.message}")
