"""Which of the usual mistakes would explain the residuals of a campaign.

Each mistake is undone in turn and the campaign calibrated again.  What is compared is the whole misfit::

    S = chi^2 + d_E^T (P + C)^-1 d_E

chi^2 of the full model, in which the errors that images and landmarks share have their places, and the size of the
correction d_E against the prior P of the model mounting and the covariance C of the estimate: a mistake that a turned
mounting can absorb shows in d alone.  Minus half the difference of two S is the logarithm of the odds between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..estimators.gls import Gls
from ..estimators.protocol import Status
from ..estimators.wahba import Wahba
from ..physics import so3
from ..physics.errors import InputError
from ..physics.units import DEG
from ..table.campaign import Campaign
from ..table.equation import linearise
from ..table.geometry import observe
from ..table.observations import Observations
from .consistency import DECISIVE, IMPLAUSIBLE_P, chi2_p
from .conventions import Mistake, Written, usual_mistakes
from .residuals import rms

Array = NDArray[np.float64]

ROUGH_MOUNTING = 1.0 * DEG
"""How well a model mounting is known where no sigma is stated; a quarter turn is then very improbable."""
ENOUGH = 600
"""So many sightings tell mistakes apart; of more an even choice is used."""

MANY_TIMES = 10.0
"""Fall of the misfit that counts where what is left is still implausible."""


@dataclass(frozen=True)
class Trial:
    """A campaign calibrated with some mistakes undone (none: as it stands).

    ``score`` is S; where there is no solution ``obstacle`` has the reason, and ``score`` is a rough misfit or, where
    there are not even directions to compare, infinite.  ``rms_px`` are the residuals per axis at the estimate,
    ``correction`` is the angle of d_E, rad.
    """

    undone: tuple[Mistake, ...]
    score: float
    chi2: float = np.inf
    degrees_of_freedom: int = 0
    rms_px: float = np.inf
    correction: float = np.nan
    obstacle: str = ""

    @property
    def solved(self) -> bool:
        """Whether there is a mounting that comes out of it."""
        return not self.obstacle

    @property
    def p(self) -> float:
        """Probability of a chi-square at least this large; 0 where there is none."""
        return chi2_p(self.chi2, self.degrees_of_freedom) if np.isfinite(self.chi2) else 0.0

    @property
    def scale(self) -> float:
        """Unit in which scores differ by chance: 1, or the variance factor where the sigmas are too small."""
        if not np.isfinite(self.chi2) or self.degrees_of_freedom <= 0:
            return 1.0
        return max(1.0, self.chi2 / self.degrees_of_freedom)

    def better_than(self, other: Trial) -> bool:
        """Whether this explains the data decisively better: by more than DECISIVE where it fits them, and many times
        where something else is wrong too, since one piece of nonsense may well be half as bad as another."""
        if self.p < IMPLAUSIBLE_P:
            return self.score < other.score / MANY_TIMES
        return other.score - self.score > DECISIVE * self.scale


@dataclass(frozen=True)
class Diagnosis:
    """What was found: the campaign as it stands, all trials (the best first), and the one that explains it, if any.

    ``rivals`` explain it about as well as ``best`` does.
    """

    stated: Trial
    trials: tuple[Trial, ...]
    best: Trial | None
    rivals: tuple[Trial, ...]

    @property
    def verdict(self) -> str:
        """``named``: a mistake explains the residuals; ``partly``: it explains much, not all; ``unexplained``: the
        residuals are implausible and no mistake explains them; ``none``: nothing is indicated."""
        if self.best is not None:
            return "named" if self.best.p >= IMPLAUSIBLE_P else "partly"
        return "none" if self.stated.p >= IMPLAUSIBLE_P else "unexplained"


def diagnose(campaign: Campaign, written: Written | None = None) -> Diagnosis:
    """Try the usual mistakes on a campaign, and pairs of them where one alone does not explain it.

    Raises InputError where there is nothing to use.
    """
    sparse = _thinned(campaign)
    if not sparse.sightings.image.size:
        raise InputError(f"campaign {campaign.name!r} has no control points, wanted some to diagnose")
    stated = _calibrated(sparse, ())
    mistakes = usual_mistakes(sparse, written or Written())
    trials = [_undo(sparse, (mistake,)) for mistake in mistakes]
    best = _best(trials, stated)
    if best is not None and best.p < IMPLAUSIBLE_P:
        first = best.undone[0]
        trials += [_undo(sparse, (first, m)) for m in mistakes if _kind(m) != _kind(first)]
        best = _best(trials, best) or best
    best = best if best is not None and best.solved else None
    trials.sort(key=lambda trial: (not trial.solved, trial.score))
    rivals = [
        t for t in trials if best is not None and t is not best and t.solved and not best.better_than(t)
    ]
    return Diagnosis(stated, tuple(trials), best, tuple(rivals))


def _kind(mistake: Mistake) -> str:
    return mistake.key.split(".")[0]


def _best(trials: list[Trial], standard: Trial) -> Trial | None:
    """The best trial if it is decisively better than a standard; the simplest, which stands first, of equals."""
    best = min(trials, key=lambda trial: trial.score)
    return best if best.better_than(standard) else None


def _thinned(campaign: Campaign) -> Campaign:
    """The campaign with its control points only, an even choice of at most ENOUGH."""
    rows = np.flatnonzero(~campaign.sightings.check)
    if rows.size > ENOUGH:
        rows = rows[np.argsort(campaign.sightings.image[rows], kind="stable")]
        rows = rows[np.linspace(0, rows.size - 1, ENOUGH).astype(np.int64)]
    s = campaign.sightings
    kept = {name: getattr(s, name)[rows] for name in s.__dataclass_fields__}
    return replace(campaign, sightings=replace(s, **kept))


def _undo(campaign: Campaign, mistakes: tuple[Mistake, ...]) -> Trial:
    """The trial of a campaign with mistakes undone, the obstacle where that is not possible."""
    try:
        for mistake in mistakes:
            campaign = mistake.undo(campaign)
    except InputError as error:
        return Trial(mistakes, np.inf, obstacle=str(error))
    return _calibrated(campaign, mistakes)


def _calibrated(campaign: Campaign, undone: tuple[Mistake, ...]) -> Trial:
    # most trials are nonsense on purpose, so that overflow and division by zero are to be expected
    with np.errstate(all="ignore"):
        try:
            observations = replace(observe(campaign), prior_E=None)
            estimate = Gls()(observations, campaign.C_EK)
        except (InputError, np.linalg.LinAlgError) as error:
            return Trial(undone, np.inf, obstacle=str(error))
        if estimate.chi2 is None or estimate.covariance_E is None or estimate.degrees_of_freedom is None:
            raise TypeError("gls gives a covariance and a chi-square")
        fit = linearise(observations, estimate.C_EK)
        if not Status(int(estimate.status)).usable or not np.isfinite(estimate.chi2):
            return Trial(undone, _rough_misfit(observations), obstacle=Status(int(estimate.status)).text)
        if not np.all(fit.in_front):
            return Trial(undone, _rough_misfit(observations), obstacle="markers would lie behind the camera")
        d_E = so3.log(estimate.C_EK @ campaign.C_EK.mT)
        expected = _prior(campaign) + estimate.covariance_E
        score = float(estimate.chi2) + float(d_E @ np.linalg.solve(expected, d_E))
    return Trial(
        undone,
        score,
        float(estimate.chi2),
        int(estimate.degrees_of_freedom),
        rms(fit.z_px),
        float(np.linalg.norm(d_E)),
    )


def _rough_misfit(observations: Observations) -> float:
    """Squared angles between measured and apparent directions in units of the pixel's sigma, turned together as closely
    as they go: what orders the trials that no mounting fits."""
    closest = Wahba()(observations, np.eye(3))
    apart = np.linalg.norm(observations.e_K @ closest.C_EK.mT - observations.e_E, axis=-1)
    pixel = np.linalg.norm(observations.slope_K[..., 0], axis=-1)
    misfit = float(np.sum((apart / (pixel * observations.sigma_px)) ** 2))
    return misfit if np.isfinite(misfit) else np.inf


def _prior(campaign: Campaign) -> Array:
    """Covariance of the model mounting's error: as stated, else that of a rough one."""
    sigma = campaign.sigma_mounting
    return np.diag(np.full(3, ROUGH_MOUNTING) ** 2 if sigma is None else sigma**2)
