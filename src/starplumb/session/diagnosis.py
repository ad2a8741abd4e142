"""Which of the usual mistakes would explain the residuals of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ..documents.numbers import numbers
from ..io.campaign.fixed_frames import CAMERA
from ..judge.conventions.mistake import Mistake, Written
from ..judge.diagnose import Diagnosis as Findings
from ..judge.diagnose import diagnose as run
from ..judge.diagnosis_text import sentences
from ..judge.trials import Trial
from ..physics.units import DEG
from ..report.page import Table
from .arguments import checked
from .campaign import Campaign
from .show import Shown

SCHEMA = "starplumb-diagnosis/1"
SHOWN = 8
"""Trials in the short table."""


@dataclass(frozen=True, repr=False, eq=False)
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
            "shown": [_mistake(mistake) for mistake in found.shown],
            "trials": [_trial(trial) for trial in found.trials],
        }

    @property
    def tables(self) -> Sequence[Table]:
        return (self.table(),)

    @checked
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
        """The verdict with its figures, what to do, what explains it as well, and what the files show besides."""
        return sentences(self.findings)


@checked
def diagnose(campaign: Campaign) -> Diagnosis:
    """Undo the usual mistakes one by one, and in pairs, and say which would explain the residuals.

    Mistakes in rotations, frames, times, pixels, cameras and landmarks, and single culprits.  Nothing is changed.
    Raises InputError where there is nothing to use.
    """
    campaign.require_observations()
    campaign.require_one_camera("the search for mistakes")
    return Diagnosis(campaign, run(campaign.loaded.campaign, _written(campaign)))


def _written(campaign: Campaign) -> Written:
    """How the campaign's files say what they hold."""
    config = campaign.loaded.config
    attitude = next(iter(config.attitudes.values()))
    return Written(
        time_scale=config.campaign.time_scale,
        attitude_to_tracker=attitude.target == attitude.tracker,
        mounting_from_camera=config.first[2].source in (CAMERA, config.first[0]),
    )


def _mistake(mistake: Mistake) -> dict[str, str]:
    return {"key": mistake.key, "what": mistake.what, "remedy": mistake.remedy, "evidence": mistake.evidence}


def _trial(trial: Trial) -> dict[str, Any]:
    return {
        "undone": [_mistake(mistake) for mistake in trial.undone],
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
