"""What a diagnosis says: what was found, what it means, what to do."""

from __future__ import annotations

from ..physics.units import DEG
from .conventions.mistake import Mistake
from .diagnose import Diagnosis
from .trials import Trial

MOST_RIVALS = 4


def sentences(found: Diagnosis) -> list[str]:
    """The verdict with its figures, what to do, what explains it as well, and what the files show besides."""
    return [
        *_verdict(found),
        *(f"The files show besides: {m.evidence}. Remedy: {m.remedy}." for m in found.shown),
    ]


def _verdict(found: Diagnosis) -> list[str]:
    if found.best is None:
        return _nothing(found)
    if found.best.evident and found.stated.fits and not found.best.better_than(found.stated):
        return _evident(found, found.best)
    explains = (
        "explains the residuals"
        if found.verdict == "named"
        else "explains much of the residuals, but not all"
    )
    return [
        f"It looks as if {_joined(found.best.undone)}: this {explains}.",
        *(f"The files show it: {m.evidence}." for m in found.best.undone if m.evidence),
        f"Once undone: {figures(found.best)}.",
        f"Without this change: {figures(found.stated)}.",
        f"Remedy: {'; '.join(m.remedy for m in found.best.undone)}.",
        *_rivals(found),
    ]


def _nothing(found: Diagnosis) -> list[str]:
    stated = figures(found.stated)
    if found.verdict == "none":
        return [f"No usual mistake is indicated: as it stands the campaign has {stated}."]
    return [
        f"The residuals are implausible ({stated}), and none of the usual mistakes, alone or in pairs, explains them: "
        "look for many blunders, sigmas that are too small, or three mistakes at once."
    ]


def _evident(found: Diagnosis, best: Trial) -> list[str]:
    """A mistake that the residuals do not show."""
    return [
        f"The residuals indicate no mistake, but the files show that {_joined(best.undone)}.",
        *(f"Evidence: {m.evidence}." for m in best.undone),
        f"Without this change: {figures(found.stated)}; residuals alone cannot show an error that every image absorbs.",
        f"Remedy: {'; '.join(m.remedy for m in best.undone)}.",
    ]


def _joined(undone: tuple[Mistake, ...]) -> str:
    return " and ".join(mistake.what for mistake in undone)


def _rivals(found: Diagnosis) -> list[str]:
    if not found.rivals:
        return []
    others = "; ".join(_joined(trial.undone) for trial in found.rivals[:MOST_RIVALS])
    more = len(found.rivals) - MOST_RIVALS
    return [f"These data do not distinguish it from: {others}{f'; and {more} more' if more > 0 else ''}."]


def figures(trial: Trial) -> str:
    """Chi-square, residuals and correction of a trial, or why it has none."""
    if not trial.solved:
        return f"no solution ({trial.obstacle})"
    return (
        f"chi-square {trial.chi2:.4g} for {trial.degrees_of_freedom} degrees of freedom, {trial.rms_px:.3g} px rms, "
        f"a correction of {trial.correction / DEG:.3g} deg"
    )
