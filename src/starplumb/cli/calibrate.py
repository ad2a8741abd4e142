"""``starplumb calibrate``: the main job."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options.common import CampaignArgument, StartOption
from .options.complete import methods, parameters
from .options.outside import Choice, OutsideOption
from .options.places import require_place
from .output import Json, Output, Quiet, Verbose


def calibrate(
    campaign: CampaignArgument,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            "-m",
            metavar="NAME",
            autocompletion=methods,
            help="Estimator; `starplumb compare` shows all. default is gls, without what is wrong where its tests "
            "object; gls leaves nothing out.",
        ),
    ] = "default",
    robust: Annotated[
        bool,
        typer.Option(
            "--robust", help="Find and leave out wrong labels, measurements and images (--method robust)."
        ),
    ] = False,
    estimate: Annotated[
        list[str] | None,
        typer.Option(
            "--estimate",
            "-e",
            metavar="NAME[=SIGMA],...",
            autocompletion=parameters,
            help="What else to estimate, free or with its sigma known beforehand and unit: focal_length, "
            "principal_point, distortion, look_angles, time_offset, time_offset_attitude, time_offset_orbit, trackers.",
        ),
    ] = None,
    start: StartOption = "closed-form",
    reach_deg: Annotated[
        float,
        typer.Option(
            metavar="DEGREES", help="With [detections]: the largest error the model mounting may have."
        ),
    ] = 2.0,
    prior: Annotated[
        Path | None,
        typer.Option(
            "--prior",
            metavar="RESULT.json",
            help="What is known: an earlier result, with its whole covariance.",
        ),
    ] = None,
    drift: Annotated[
        str,
        typer.Option(
            metavar="none|auto|MODEL,...",
            help="How the mounting moves: none (only tested), auto (models averaged by evidence), or some "
            "of orbit:K, linear, step:TIME, temperature:NAME.",
        ),
    ] = "none",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder of the results [default: `result` beside the campaign].",
        ),
    ] = None,
    report: Annotated[bool, typer.Option(help="Write report.html, which takes two seconds.")] = True,
    gpkg: Annotated[bool, typer.Option("--gpkg", help="Write residuals.gpkg for QGIS too.")] = False,
    outside: OutsideOption = Choice.REFUSE,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Estimate the mounting of the camera and say how well it is known.

    Writes result.json, residuals.csv, the page report.html and the SPICE frame kernel mounting.tf; with --gpkg also
    the residuals as a map, residuals.gpkg.

    Examples:

      starplumb calibrate demo/campaign.toml

      starplumb calibrate campaign.toml --out results --json

      starplumb calibrate campaign.toml --robust --estimate focal_length,time_offset=10ms
    """
    from ..physics.errors import AlignmentFailed
    from ..session.calibration import NotIdentified
    from ..session.calibration import calibrate as run
    from ..session.campaign import read_campaign
    from ..session.result import MAP, MARK, RESULT_FILES

    speak = Output(json, quiet, verbose)
    out = out or campaign.parent / "result"
    if gpkg:
        from ..io.gis.geopackage import require_pyogrio

        require_pyogrio(out / MAP)
    found = read_campaign(campaign, outside.value)
    require_place(out, [MARK[0], *RESULT_FILES], [found.loaded.sources, prior], MARK)
    try:
        chosen = "robust" if robust and method in ("default", "gls") else method
        result = run(found, estimate or (), chosen, reach_deg, prior, start, drift)
    except NotIdentified as refused:
        speak.notices(found.notices)
        refused.save(out)
        raise
    speak.notices(found.notices)
    result.save(out, report, gpkg)
    speak.document(result.document)
    advice = [f"next: starplumb diagnose {campaign}"] if result.implausible else []
    speak.shown(result, f"written: {out}", *advice)
    speak.detail(*(f"notice: {sentence}" for sentence in result.calibration.notices))
    speak.detail(*(f"{name}: {digest}" for name, digest in found.loaded.inputs.items()))
    if not result.usable:
        raise AlignmentFailed(f"{campaign}: {result.calibration.message}")
