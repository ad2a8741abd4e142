"""``starplumb measure``: from raw images to sightings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from .channels import complain
from .options.progress import counted
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
    chips: Annotated[
        Path | None,
        typer.Option(
            "--chips",
            metavar="FOLDER",
            help='Cut the chips used out of the orthoimage into a new folder: a library for kind = "chips".',
        ),
    ] = None,
    report: Annotated[bool, typer.Option(help="Write measure.html, the page of all chips.")] = True,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Find pieces of a reference in raw images, and write where as landmarks and observations.

    The campaign names raw images ([imagery]) and an orthoimage with heights, a library of chips or surveyed targets
    ([reference]); how far to search follows
    from mounting.sigma_arcsec. Writes measure.json, the page measure.html, landmarks.csv,
    observations.csv and a campaign.toml that names these. Finished images are kept beside the output
    until it is written: interrupted, the same command goes on where it stopped.

    Examples:

      starplumb measure campaign.toml --calibrate

      starplumb measure campaign.toml --out measured

      starplumb measure campaign.toml --chips library
    """
    from ..physics.errors import AlignmentFailed
    from ..session.imagery.measurement import require_place
    from ..session.imagery.measuring import measure_watched, require_library

    speak = Output(json, quiet, verbose)
    out = out or campaign.parent / "measured"
    require_place(out, campaign)
    if chips is not None:
        require_library(chips, campaign)
    with _kept(out, quiet), counted("searching and measuring chips", quiet) as tell:
        found = measure_watched(campaign, tell, out)
    speak.notices(found.loaded.notices)
    found.save(out, report)
    cut = 0 if chips is None or not found.acquired else found.save_chips(chips)
    if not calibrate or not found.acquired:
        speak.document(found.document)
    speak.shown(found, f"written: {out}" + (f"; {cut} chips: {chips}" if cut else ""))
    speak.detail(*(f"{name}: {digest}" for name, digest in found.loaded.inputs.items()))
    if calibrate and found.acquired:
        from .calibrate import calibrate as run

        run([out / "campaign.toml"], out=out, report=report, json=json, quiet=quiet, verbose=verbose)
    if not found.usable:
        raise AlignmentFailed(f"{campaign}: {found.message}")


@contextmanager
def _kept(out: Path, quiet: bool) -> Iterator[None]:
    """Where the work ends before it is done, say what is kept of it."""
    from ..io.imagery.kept import finished
    from ..physics.errors import InputError

    try:
        yield
    except (KeyboardInterrupt, InputError):
        folder, count = finished(out)
        if count and not quiet:
            complain(
                f"{count} image{'s' if count > 1 else ''} finished and kept in {folder}; the same command goes on "
                "from there"
            )
        raise
