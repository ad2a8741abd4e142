"""A campaign calibrated with some mistakes undone, and its score: how well that explains the residuals.

What is compared is the whole misfit::

    S = chi^2 + d_E^T (P + C)^-1 d_E + cost

chi^2 of the full model, in which the errors that images and landmarks share have their places; the size of the
correction d_E against the prior P of the model mounting and the covariance C of the estimate, since a mistake that a
turned mounting can absorb shows in d alone; and what the freedom of the explanation costs: ``log(det prior / det
posterior)`` of the numbers it estimates, twice the logarithm of how many of its kind are tried, REJECTED for each
sighting it leaves out.  Minus half the difference of two S is the logarithm of the odds between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..estimators.campaign_table import table_of
from ..estimators.gls import Gls
from ..estimators.protocol import AlignmentEstimate, Status, Verdict
from ..estimators.robust import Robust
from ..estimators.wahba import Wahba
from ..physics import so3
from ..physics.errors import InputError
from ..physics.units import DEG
from ..table.campaign import Campaign, some_of
from ..table.equation import linearise
from ..table.observations import Observations
from .consistency import ABSURD, DECISIVE, chi2_p
from .conventions.mistake import Mistake, image_text
from .residuals import rms
from .trust import IMPLAUSIBLE_P

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUGH_MOUNTING = 1.0 * DEG
"""How well a model mounting is known where no sigma is stated; a quarter turn is then very improbable."""
MANY_TIMES = 10.0
"""Fall of the misfit that counts where what is left is still implausible."""
REJECTED = 20.0
"""Cost of a sighting left out: about twice the logarithm of the odds against a blunder, and of the choice of it."""
MOST_REJECTED = 0.4
"""Share of the sightings beyond which leaving them out is no explanation."""
ITERATIONS = 8
"""What fits converges in 3 or 4 steps from the closed form; what does not is not worth more."""
ROUGH = 2
"""Steps after which what fits is told from what does not."""


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
    def fits(self) -> bool:
        """Whether the stated errors allow what is left."""
        return self.solved and self.p >= IMPLAUSIBLE_P

    @property
    def evident(self) -> bool:
        """Whether the files show by themselves all that is undone."""
        return bool(self.undone) and all(mistake.evidence for mistake in self.undone)

    @property
    def absurd(self) -> bool:
        """Whether what is left is so large that nothing is explained."""
        return not self.solved or self.chi2 > ABSURD * max(self.degrees_of_freedom, 1)

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


def thinned(campaign: Campaign, most: int) -> Campaign:
    """The campaign with its control points only, an even choice of at most so many."""
    rows = np.flatnonzero(~campaign.sightings.check)
    if rows.size > most:
        rows = rows[np.argsort(campaign.sightings.image[rows], kind="stable")]
        rows = rows[np.linspace(0, rows.size - 1, most).astype(np.int64)]
    return _kept(campaign, rows)


def _kept(campaign: Campaign, rows: NDArray[np.int64] | Mask) -> Campaign:
    return replace(campaign, sightings=some_of(campaign.sightings, rows))


def mended(campaign: Campaign, mistakes: tuple[Mistake, ...]) -> Campaign:
    for mistake in mistakes:
        campaign = mistake.undo(campaign)
    return campaign


def tried(campaign: Campaign, mistakes: tuple[Mistake, ...], roughly: bool = False) -> Trial:
    """The trial of a campaign with mistakes undone, the obstacle where that is not possible."""
    try:
        return calibrated(mended(campaign, mistakes), mistakes, roughly)
    except InputError as error:
        return Trial(mistakes, np.inf, obstacle=str(error))


def calibrated(campaign: Campaign, undone: tuple[Mistake, ...], roughly: bool = False) -> Trial:
    """The trial of a campaign as it stands; ``roughly`` is enough to order it among others."""
    # most trials are nonsense on purpose, so that overflow and division by zero are to be expected
    free = tuple(parameter for mistake in undone for parameter in mistake.free)
    with np.errstate(all="ignore"):
        try:
            observations = replace(table_of(campaign), prior_E=None)
            estimate = Gls(free, max_iterations=ROUGH if roughly else ITERATIONS)(observations, campaign.C_EK)
            if roughly and int(estimate.status) == Status.NOT_CONVERGED:
                estimate = replace(estimate, status=np.asarray(int(Status.WEAK)))
            return _judged(campaign, observations, estimate, undone)
        except (InputError, np.linalg.LinAlgError) as error:
            return Trial(undone, np.inf, obstacle=str(error))


def _judged(
    campaign: Campaign, observations: Observations, estimate: AlignmentEstimate, undone: tuple[Mistake, ...]
) -> Trial:
    """The trial of an estimate: its score if it has one, else a rough misfit and the obstacle."""
    if estimate.chi2 is None or estimate.covariance_E is None or estimate.degrees_of_freedom is None:
        raise TypeError("the estimator gives a covariance and a chi-square")
    fit = linearise(observations, estimate.C_EK)
    if not Status(int(estimate.status)).usable or not np.isfinite(estimate.chi2):
        return Trial(undone, _rough_misfit(observations), obstacle=Status(int(estimate.status)).text)
    if not np.all(fit.in_front):
        return Trial(undone, _rough_misfit(observations), obstacle="markers would lie behind the camera")
    d_E = so3.log(estimate.C_EK @ campaign.C_EK.mT)
    expected = _prior(campaign) + estimate.covariance_E
    cost = sum(mistake.cost for mistake in undone) + occam(estimate)
    return Trial(
        _measured(undone, estimate),
        float(estimate.chi2) + float(d_E @ np.linalg.solve(expected, d_E)) + cost,
        float(estimate.chi2),
        int(estimate.degrees_of_freedom),
        rms(fit.z_px),
        float(np.linalg.norm(d_E)),
    )


def occam(estimate: AlignmentEstimate) -> float:
    """``log(det prior / det posterior)`` of the parameters: what their freedom costs, in units of chi-square."""
    vector = estimate.parameters
    if vector is None:
        return 0.0
    _, posterior = np.linalg.slogdet(
        vector.covariance[3:, 3:] / np.outer(vector.prior_sigma, vector.prior_sigma)
    )
    return max(0.0, -float(posterior))


def _measured(undone: tuple[Mistake, ...], estimate: AlignmentEstimate) -> tuple[Mistake, ...]:
    """The mistakes with the size that was estimated in their words."""
    vector, start, said = estimate.parameters, 0, []
    for mistake in undone:
        stop = start + sum(len(parameter.names) for parameter in mistake.free)
        if vector is not None and mistake.measured is not None:
            sigma = np.sqrt(np.diagonal(vector.covariance)[3:])
            mistake = replace(mistake, what=mistake.measured(vector.values[start:stop], sigma[start:stop]))
        said.append(mistake)
        start = stop
    return tuple(said)


def by_directions(campaign: Campaign, mistakes: tuple[Mistake, ...]) -> Trial:
    """A trial by directions alone, without an adjustment."""
    with np.errstate(all="ignore"):
        try:
            observations = table_of(mended(campaign, mistakes))
            return Trial(mistakes, _rough_misfit(observations), obstacle="not adjusted")
        except (InputError, np.linalg.LinAlgError) as error:
            return Trial(mistakes, np.inf, obstacle=str(error))


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
    stated = campaign.prior_E
    return np.diag(np.full(3, ROUGH_MOUNTING) ** 2) if stated is None else stated


def misfit_of_images(campaign: Campaign) -> Array:
    """Median distance of each image's sightings from the closest common mounting (m,), rad; 0 without any."""
    found = np.zeros(len(campaign.images.ids))
    with np.errstate(all="ignore"):
        try:
            o = table_of(campaign)
            closest = Wahba()(o, np.eye(3))
        except (InputError, np.linalg.LinAlgError):
            return found
        apart = np.linalg.norm(o.e_K @ closest.C_EK.mT - o.e_E, axis=-1)
    for image in np.unique(o.image):
        found[image] = np.median(apart[o.image == image])
    return np.nan_to_num(found)


def without_rejected(campaign: Campaign, undone: tuple[Mistake, ...]) -> Trial | None:
    """The trial with the sightings left out that `robust` rejects; None where there is no such solution."""
    if any(mistake.free for mistake in undone):
        return None
    with np.errstate(all="ignore"):
        try:
            right = mended(campaign, undone)
            observations = replace(table_of(right), prior_E=None)
            estimate = Robust()(observations, right.C_EK)
        except (InputError, np.linalg.LinAlgError):
            return None
        out = np.zeros(observations.n, dtype=bool)
        if estimate.verdict is not None:
            out = estimate.verdict != int(Verdict.USED)
        if not np.any(out) or np.mean(out) > MOST_REJECTED:
            return None
        trial = calibrated(_kept(right, ~out), (*undone, _blunders(right, out)))
    return trial if trial.solved else None


def _blunders(campaign: Campaign, out: Mask) -> Mistake:
    """Sightings left out, as a mistake: of one image, of one landmark, or anywhere."""
    s = campaign.sightings
    images, landmarks = np.unique(s.image[out]), np.unique(s.landmark[out])
    count, cost = int(np.sum(out)), REJECTED * float(np.sum(out))
    of = f"{count} of the {out.size} sightings"
    remedy = "check them; calibrate leaves them out unless told --method gls"
    if images.size == 1 and count > 1:
        name = campaign.images.ids[images[0]]
        members = int(np.sum(s.image == images[0]))
        what = (
            f"{count} of the {members} sightings in {image_text(campaign, int(images[0]))} are wrong: its labels, time "
            "or attitude"
        )
        return Mistake(
            f"image.{name}",
            what,
            f"check {name!r}; calibrate leaves it out unless told --method gls",
            cost=cost,
        )
    if landmarks.size == 1 and count > 1:
        name = campaign.landmarks.ids[landmarks[0]]
        return Mistake(
            f"landmark.{name}", f"the landmark {name!r} is wrong in {count} images", remedy, cost=cost
        )
    first = int(np.flatnonzero(out)[0])
    example = f"landmark {campaign.landmarks.ids[s.landmark[first]]!r} in {image_text(campaign, int(s.image[first]))}"
    words = f"{of} are wrong, among them the" if count > 1 else "one sighting is wrong, that of"
    return Mistake("sightings", f"{words} {example}", remedy, cost=cost)
