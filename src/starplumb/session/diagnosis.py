"""Which of the usual mistakes would explain the residuals of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ..documents.document import numbers
from ..io.campaign.attitude_config import CAMERA
from ..io.campaign.read import LoadedCampaign
from ..judge.conventions import Written
from ..judge.diagnose import Diagnosis as Findings
from ..judge.diagnose import Trial
from ..judge.diagnose import diagnose as run
from ..physics.units import DEG
from ..report.page import Table
from .campaign import Campaign
from .show import Shown

SCHEMA = "starplumb-diagnosis/1"
SHOWN = 8
"""Trials in the short table."""


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """What was tried and found: what :func:`starplumb.diagnose` returns."""

    campaign: Campaign
    findings: Findings

    @property
    def verdict(self) -> str:
        """``named``: a mistake explains the residuals; ``partly``: it explains much, not all; ``unexplained``: the
        residuals are implausible and no mistake explains them; ``none``: nothing is indicated."""
        return self.findings.verdict

    @cached_property
    def document(self) -> dict[str, Any]:
        """The diagnosis as a dictionary."""
        found = self.findings
        return {
            "schema": SCHEMA,
            "verdict": found.verdict,
            "message": " ".join(self.sentences),
            "stated": _trial(found.stated),
            "best": None if found.best is None else _trial(found.best),
            "rivals": [_trial(trial) for trial in found.rivals],
            "trials": [_trial(trial) for trial in found.trials],
        }

    @property
    def tables(self) -> Sequence[Table]:
        return (self.table(),)

    def table(self, every: bool = False) -> Table:
        """The best trials, or ``every`` one."""
        found = self.findings
        shown = found.trials if every else [trial for trial in found.trials if trial.solved][:SHOWN]
        rows = [("nothing: as the campaign stands", *_cells(found.stated))]
        rows += [("; ".join(m.what for m in trial.undone), *_cells(trial)) for trial in shown]
        left = len(found.trials) - len(shown)
        if left:
            rows.append((f"{left} other changes: {'worse, or ' if shown else ''}no solution", "", "", ""))
        head = ("this is undone", "chi-square", "rms, px", "correction, deg")
        return Table("What if ... (the best first)", head, rows)

    @property
    def sentences(self) -> Sequence[str]:
        """The verdict with its figures, what to do, and what explains it as well."""
        found = self.findings
        return _without_culprit(found) if found.best is None else _named(found, found.best)


def diagnose(campaign: Campaign) -> Diagnosis:
    """Undo the usual mistakes one by one, and in pairs, and say which would explain the residuals.

    Quaternion order and direction, frames, time scales, swapped or mirrored pixels, pixel origin, light effects, axes a
    quarter turn off.  Nothing is changed.  Raises InputError where there is nothing to use.
    """
    campaign.require_observations()
    return Diagnosis(campaign, run(campaign.loaded.campaign, _written(campaign.loaded)))


def _written(loaded: LoadedCampaign) -> Written:
    """How the campaign's files say what they hold."""
    config = loaded.config
    attitude = next(iter(config.attitudes.values()))
    return Written(
        time_scale=config.campaign.time_scale,
        attitude_to_tracker=attitude.target == attitude.tracker,
        mounting_from_camera=config.mounting.source == CAMERA,
    )


def _trial(trial: Trial) -> dict[str, Any]:
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


def _cells(trial: Trial) -> tuple[str, str, str]:
    if not trial.solved:
        return "no solution", "", ""
    return f"{trial.chi2:.4g}", f"{trial.rms_px:.3g}", f"{trial.correction / DEG:.3g}"


def _without_culprit(found: Findings) -> tuple[str, ...]:
    stated = _figures(found.stated)
    if found.verdict == "none":
        return (f"No usual mistake is indicated: as it stands the campaign has {stated}.",)
    return (
        f"The residuals are implausible ({stated}), and none of the usual mistakes explains them: look for "
        "blunders, sigmas that are too small, or several mistakes at once.",
    )


def _named(found: Findings, best: Trial) -> tuple[str, ...]:
    what = " and ".join(m.what for m in best.undone)
    much = "the residuals" if found.verdict == "named" else "much of the residuals, but not all"
    lines = [
        f"It looks as if {what}: this explains {much}.",
        f"Once undone: {_figures(best)}.",
        f"As it stands: {_figures(found.stated)}.",
        "Remedy: " + "; ".join(m.remedy for m in best.undone) + ".",
    ]
    if found.rivals:
        others = "; ".join(" and ".join(m.what for m in trial.undone) for trial in found.rivals[:4])
        lines.append(f"These data cannot tell it from: {others}.")
    return tuple(lines)


def _figures(trial: Trial) -> str:
    if not trial.solved:
        return f"no solution ({trial.obstacle})"
    return (
        f"chi-square {trial.chi2:.4g} for {trial.degrees_of_freedom} degrees of freedom, {trial.rms_px:.3g} px rms, "
        f"a correction of {trial.correction / DEG:.3g} deg"
    )
