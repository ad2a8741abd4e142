"""``starplumb calibrate``: the main job."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer

from .options.common import SchedulerOption, StartOption
from .options.complete import drifts, methods, parameters
from .options.outside import Choice, OutsideOption
from .options.places import require_place
from .output import Json, Output, Quiet, Verbose


def calibrate(
    campaigns: Annotated[
        list[Path],
        typer.Argument(help="The campaign.toml; of several each by itself.", metavar="CAMPAIGN.toml..."),
    ],
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
            help="What is known: an earlier result or its folder, with its whole covariance.",
        ),
    ] = None,
    drift: Annotated[
        str,
        typer.Option(
            metavar="none|auto|MODEL,...",
            autocompletion=drifts,
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
    report: Annotated[
        bool | None,
        typer.Option(
            "--report/--no-report",
            help="Write report.html [default: of a single campaign].",
            show_default=False,
        ),
    ] = None,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Write report.pdf too, by WeasyPrint or a browser.")
    ] = False,
    requirement: Annotated[
        str | None,
        typer.Option(
            metavar="LIMIT",
            help="What the accuracy must be: '5 m CE90', '3 m rms' or '2 arcsec'; said if met.",
        ),
    ] = None,
    gpkg: Annotated[bool, typer.Option("--gpkg", help="Write residuals.gpkg for QGIS too.")] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            "-j",
            metavar="COUNT",
            min=1,
            max=1000,
            help="Campaigns at a time [default: processors].",
        ),
    ] = None,
    archive: Annotated[
        Path | None,
        typer.Option(
            "--archive", metavar="FILE.db", help="Add the results to this archive, made if need be."
        ),
    ] = None,
    scheduler: SchedulerOption = None,
    outside: OutsideOption = Choice.REFUSE,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Estimate the mounting of the camera and say how well it is known.

    Writes result.json, residuals.csv, the page report.html and the SPICE frame kernel mounting.tf; with --gpkg also
    the residuals as a map, residuals.gpkg.

    Of several campaigns, or with --archive, each is calibrated by itself: none stops the rest, what is there already is
    not made again, and fleet.html and fleet.json (in DIR, else beside the archive, else here) say what came of each and
    how the satellites are. With --out each result is a folder of DIR.

    Examples:

      starplumb calibrate demo/campaign.toml

      starplumb calibrate campaign.toml --out results --json

      starplumb calibrate campaign.toml --robust --estimate focal_length,time_offset=10ms

      starplumb calibrate */campaign.toml --jobs 4 --archive mission.db
    """
    from ..physics.errors import AlignmentFailed
    from ..session.calibration import NotIdentified
    from ..session.calibration import calibrate as run
    from ..session.campaign import read_campaign
    from ..session.mounting import result_file
    from ..session.result import MARK, RESULT_FILES

    speak = Output(json, quiet, verbose)
    prior = None if prior is None else result_file(prior)
    chosen = "robust" if robust and method in ("default", "gls") else method
    if len(campaigns) > 1 or archive is not None:
        from ..session.mission.fleet import Asked
        from .archive.fleet import fleet

        _require_none({"--gpkg": gpkg, "--pdf": pdf, "--requirement": requirement})
        asked = Asked(
            *(chosen, tuple(estimate or ()), start, reach_deg, prior, drift),
            outside=outside.value,
            report=bool(report),
        )
        fleet(speak, campaigns, asked, out, jobs, scheduler, archive)
        return
    campaign = campaigns[0]
    out = out or campaign.parent / "result"
    _require_writers(out, gpkg, pdf)
    clock = [perf_counter()]
    with speak.doing("reading the campaign"):
        found = read_campaign(campaign, outside.value)
    require_place(out, [MARK[0], *RESULT_FILES], [found.loaded.sources, prior], MARK)
    clock.append(perf_counter())
    try:
        with speak.doing("solving and judging"):
            result = run(found, estimate or (), chosen, reach_deg, prior, start, drift, requirement)
    except NotIdentified as refused:
        speak.notices(found.notices)
        refused.save(out)
        raise
    speak.notices(found.notices)
    clock.append(perf_counter())
    with speak.doing("writing the result"):
        result.save(out, report is not False, gpkg, pdf)
    clock.append(perf_counter())
    speak.document(result.document)
    advice = [f"next: starplumb diagnose {campaign}"] if result.implausible else []
    speak.shown(result, f"written: {out}", *advice)
    speak.detail(_spent(clock))
    speak.detail(*(f"notice: {sentence}" for sentence in result.calibration.notices))
    speak.detail(*(f"{name}: {digest}" for name, digest in found.loaded.inputs.items()))
    if not result.usable:
        raise AlignmentFailed(f"{campaign}: {result.calibration.message}")


def _spent(clock: Sequence[float]) -> str:
    """How long each part took, from the readings before and after each."""
    read, solved, wrote = (after - before for before, after in pairwise(clock))
    return f"time: {read:.2f} s to read, {solved:.2f} s to solve and judge, {wrote:.2f} s to write"


def _require_writers(out: Path, gpkg: bool, pdf: bool) -> None:
    """Raise InputError, before anything is computed, where what writes a file that is asked for is not installed."""
    if gpkg:
        from ..io.gis.geopackage import require_pyogrio
        from ..session.result import MAP

        require_pyogrio(out / MAP)
    if pdf:
        from ..report.pdf import require_printer

        require_printer()


def _require_none(options: Mapping[str, object]) -> None:
    """Raise InputError for the first option given that only a single campaign takes."""
    from ..physics.errors import InputError

    for name, given in options.items():
        if given:
            raise InputError(
                f"{name}: found with several campaigns or --archive, wanted one campaign without"
            )
