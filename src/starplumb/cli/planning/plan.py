"""``starplumb plan``: what to take next."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..archive.options import OfCamera, OfSatellite
from ..options.common import ScenarioArgument
from ..options.places import require_place
from ..output import Json, Output, Quiet, Verbose


def plan(
    scenario: ScenarioArgument,
    images: Annotated[
        int, typer.Option("--images", "-n", metavar="COUNT", help="How many images at most.")
    ] = 20,
    target: Annotated[
        float | None,
        typer.Option(
            "--target",
            "-t",
            metavar="ARCSEC",
            min=1e-6,
            help="Stop where sigma about each axis is that, or say what limits.",
        ),
    ] = None,
    given: Annotated[
        Path | None,
        typer.Option(
            "--given", metavar="WHAT", help="What is known already: a result.json, its folder, or an archive."
        ),
    ] = None,
    sites: Annotated[
        Path | None,
        typer.Option(
            "--sites",
            metavar="FILE",
            help="Further places with markers: site, latitude_deg, longitude_deg, height_m, clear_probability.",
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option("--start", metavar="TIME", help="Begin of the span, UTC [default: the scenario's]."),
    ] = None,
    days: Annotated[
        float | None,
        typer.Option("--days", metavar="DAYS", help="Length of the span [default: plan.days, 30]."),
    ] = None,
    satellite: OfSatellite = None,
    camera: OfCamera = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for plan.json, plan.csv and plan.html."),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Say which images to take next, and how well the mounting is known after each.

    What is badly determined and which kind of view cures it (pitch, a turn, another site, another phase), then the
    images that are worth most, from the passes that there are, and how far from the best choice they can be at most.

    Examples:

      starplumb plan cubesat-6u --images 10

      starplumb plan scenario.toml --sites sites.csv --given mission.db --target 2 --out next
    """
    from ...session.planning.plan import MARK, PLAN_FILES, plan_images
    from ...session.scenario import scenario as read

    speak = Output(json, quiet, verbose)
    asked = read(scenario)
    if out is not None:
        require_place(out, PLAN_FILES, [scenario, given, sites], MARK)
    found = plan_images(asked, images, target, given, sites, start, days, satellite, camera)
    if out is not None:
        found.save(out)
    speak.notices(found.notices)
    speak.document(found.document)
    speak.shown(found, *([] if out is None else [f"written: {out}"]))
