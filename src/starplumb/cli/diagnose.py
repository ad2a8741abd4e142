"""``starplumb diagnose``: which of the usual mistakes would explain the residuals."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .output import Json, Output, Quiet, Verbose

if TYPE_CHECKING:
    from rich.table import Table

    from ..io.campaign.read import LoadedCampaign
    from ..judge.conventions import Written
    from ..judge.diagnose import Diagnosis, Trial

SHOWN = 8
"""Trials in the table; --verbose and --json show all."""


def diagnose(
    campaign: Annotated[Path, typer.Argument(help="The campaign.toml.", metavar="CAMPAIGN.toml")],
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Try the usual mistakes and say which one would explain the residuals.

    Quaternion order and direction, frames, time scales, swapped or mirrored pixels, pixel origin, light effects, axes
    a quarter turn off: each is undone in turn, alone and, where one does not suffice, in pairs, and the campaign
    calibrated again with all its shared errors. Nothing is written or changed.

    Examples:

      \b
      starplumb diagnose campaign.toml

      \b
      starplumb diagnose campaign.toml --json
    """
    from ..io.campaign.read import load_campaign
    from ..judge.diagnose import diagnose as run

    speak = Output(json, quiet, verbose)
    loaded = load_campaign(campaign)
    speak.notices(loaded.notices)
    found = run(loaded.campaign, _written(loaded))
    speak.document(_document(found))
    speak.show(_table(found, None if verbose else SHOWN), *_sentences(found))


def _written(loaded: LoadedCampaign) -> Written:
    """How the campaign's files say what they hold."""
    from ..io.campaign.attitude_config import CAMERA
    from ..judge.conventions import Written

    config = loaded.config
    attitude = next(iter(config.attitudes.values()))
    return Written(
        time_scale=config.campaign.time_scale,
        attitude_to_tracker=attitude.target == attitude.tracker,
        mounting_from_camera=config.mounting.source == CAMERA,
    )


def _trial(trial: Trial) -> dict[str, Any]:
    from ..io.results.result import numbers
    from ..physics.units import DEG

    return {
        "undone": [{"key": m.key, "what": m.what, "remedy": m.remedy} for m in trial.undone],
        "score": numbers(trial.score),
        "chi2": numbers(trial.chi2),
        "degrees_of_freedom": trial.degrees_of_freedom,
        "chi2_p": trial.p,
        "rms_px": numbers(trial.rms_px),
        "correction_deg": numbers(trial.correction / DEG),
        "obstacle": trial.obstacle,
    }


def _document(found: Diagnosis) -> dict[str, Any]:
    return {
        "schema": "starplumb-diagnosis/1",
        "verdict": found.verdict,
        "message": " ".join(_sentences(found)),
        "stated": _trial(found.stated),
        "best": None if found.best is None else _trial(found.best),
        "rivals": [_trial(trial) for trial in found.rivals],
        "trials": [_trial(trial) for trial in found.trials],
    }


def _table(found: Diagnosis, shown: int | None) -> Table:
    from rich.table import Table

    table = Table(title="What if ... (the best first)", title_justify="left")
    table.add_column("this is undone", overflow="fold")
    for heading in ("chi-square", "rms, px", "correction, deg"):
        table.add_column(heading, justify="right")
    table.add_row("nothing: as the campaign stands", *_cells(found.stated))
    trials = found.trials if shown is None else [trial for trial in found.trials if trial.solved][:shown]
    for trial in trials:
        table.add_row("; ".join(m.what for m in trial.undone), *_cells(trial))
    left = len(found.trials) - len(trials)
    if left:
        table.add_row(f"{left} other changes: {'worse, or ' if trials else ''}no solution", "", "", "")
    return table


def _cells(trial: Trial) -> tuple[str, str, str]:
    from ..physics.units import DEG

    if not trial.solved:
        return "no solution", "", ""
    return f"{trial.chi2:.4g}", f"{trial.rms_px:.3g}", f"{trial.correction / DEG:.3g}"


def _sentences(found: Diagnosis) -> list[str]:
    """The verdict with its figures, what to do, and what explains it as well."""
    if found.best is None:
        stated = _figures(found.stated)
        if found.verdict == "none":
            return [f"No usual mistake is indicated: as it stands the campaign has {stated}."]
        return [
            f"The residuals are implausible ({stated}), and none of the usual mistakes explains them: look for "
            "blunders, sigmas that are too small, or several mistakes at once."
        ]
    what = " and ".join(m.what for m in found.best.undone)
    much = (
        "explains the residuals"
        if found.verdict == "named"
        else "explains much of the residuals, but not all"
    )
    lines = [
        f"It looks as if {what}: this {much}.",
        f"Once undone: {_figures(found.best)}.",
        f"As it stands: {_figures(found.stated)}.",
        "Remedy: " + "; ".join(m.remedy for m in found.best.undone) + ".",
    ]
    if found.rivals:
        others = "; ".join(" and ".join(m.what for m in trial.undone) for trial in found.rivals[:4])
        lines.append(f"These data cannot tell it from: {others}.")
    return lines


def _figures(trial: Trial) -> str:
    from ..physics.units import DEG

    if not trial.solved:
        return f"no solution ({trial.obstacle})"
    return (
        f"chi-square {trial.chi2:.4g} for {trial.degrees_of_freedom} degrees of freedom, {trial.rms_px:.3g} px rms, "
        f"a correction of {trial.correction / DEG:.3g} deg"
    )
