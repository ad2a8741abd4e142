"""The main job: a campaign in, the corrected mounting out, with everything that is known about how good it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import Unknowns
from ..estimators.gls import Gls
from ..estimators.protocol import AlignmentEstimate, Estimator, Status, Verdict
from ..estimators.wahba import Wahba
from ..physics import so3
from ..physics.errors import InputError
from ..table.campaign import Campaign
from ..table.geometry import observe
from ..table.observations import Observations
from .consistency import chi2_p, findings
from .files.evidence import Evidence
from .files.findings import findings_of_files
from .files.sharing import shared
from .residuals import Accuracy, Residuals, residuals
from .separability import UNKNOWN, Combination, combinations, ruins_alignment, without_gain
from .snooping import Rejection, Snooping, fit_at, recognised, rejections, snoop

Array = NDArray[np.float64]

PRIOR = "what was known before"
"""Name of what a prior contributes to a covariance."""
UNTESTED = (
    "sightings, images and landmarks are not tested one by one: too many images share too many landmarks for the "
    "covariances of their residuals to be computed in reasonable time"
)


@dataclass(frozen=True)
class Calibration:
    """One calibrated campaign.

    ``observations`` holds all sightings as measured; ``residuals.used`` those in the solution; ``snooping`` what each
    is worth, None where the method does not say; ``combinations`` of parameters that the data hardly separate.
    ``status`` and ``sentences`` join the estimator's own with what the consistency checks found.  ``correction_E`` (3,)
    rad is d of ``C_EK = exp(d) C_EK_model``.
    """

    campaign: Campaign
    observations: Observations
    estimate: AlignmentEstimate
    residuals: Residuals
    status: Status
    sentences: tuple[str, ...]
    rejected: tuple[Rejection, ...] = field(default=())
    snooping: Snooping | None = None
    combinations: tuple[Combination, ...] = field(default=())
    notices: tuple[str, ...] = field(default=())
    """What is worth recording but changes nothing."""
    evidence: tuple[Evidence, ...] = field(default=())

    @property
    def covariance_with_evidence_E(self) -> Array | None:
        """Covariance (3, 3) rad^2 of the answer widened by what the files tell; None where the method has none."""
        added = [found.covariance_E for found in self.evidence if found.covariance_E is not None]
        stated = self.estimate.covariance_E
        return None if stated is None else np.asarray(stated + np.sum(added, axis=0)) if added else stated

    @property
    def message(self) -> str:
        """What the status means for this estimate, in one line; empty where nothing need be said."""
        return "; ".join(self.sentences)

    @property
    def correction_E(self) -> Array:
        return so3.log(self.estimate.C_EK @ self.campaign.C_EK.mT)

    @property
    def chi2_p(self) -> float | None:
        """Probability of a chi-square at least this large; None where the method has none."""
        if self.estimate.chi2 is None or self.estimate.degrees_of_freedom is None:
            return None
        return chi2_p(float(self.estimate.chi2), int(self.estimate.degrees_of_freedom))

    def accuracy(self, after: bool, check: bool = False) -> Accuracy | None:
        """Geolocation accuracy of the control or check points, before or after; None where it cannot be said."""
        chosen = self.campaign.sightings.check if check else self.residuals.used
        errors = self.residuals.after_m if after else self.residuals.before_m
        return Accuracy.of(errors[chosen])


def calibrate(campaign: Campaign, estimator: Estimator) -> Calibration:
    """Estimate the mounting of a campaign from its control points and judge the answer.

    Raises EpochError where an image lies outside the orbit or attitude, InputError where there is nothing to use.
    """
    observations = observe(campaign)
    if campaign.shares_between_images:
        observations = shared(campaign, observations, Wahba()(observations, campaign.C_EK).C_EK)
    used = ~campaign.sightings.check
    if not np.any(used):
        raise InputError(
            f"campaign {campaign.name!r} has no observation with role control; wanted at least two markers"
        )
    estimate = estimator(_kept(observations, used), campaign.C_EK)
    verdict = np.zeros(observations.n, dtype=np.int64)
    if estimate.verdict is not None:
        verdict[used] = estimate.verdict
        used = used & (verdict == int(Verdict.USED))
    usable = Status(int(estimate.status)).usable
    unknowns = estimate.unknowns or Unknowns()
    fit = fit_at(unknowns, observations, campaign.C_EK, estimate, used)
    if usable:
        estimate = recognised(fit, estimate)
    tested = usable and estimate.unknowns is not None
    snooping = snoop(fit, estimate) if tested else None
    again = Gls(unknowns.parameters, compiled=unknowns.compiled)
    status, sentences, notices = _judge(_kept(observations, used), campaign.C_EK, estimate, again)
    traded = tuple(combinations(observations, estimate))
    status, sentences = _separated(status, sentences, traded)
    further = [] if estimate.parameters is None else without_gain(estimate.parameters)
    if tested and snooping is None:
        further = [*further, UNTESTED]
    sentences = (*sentences, *further, *estimate.remarks)
    evidence = _evidence(campaign, observations, estimate, used)
    if evidence and Status(int(status)).usable:
        weak = any(found.weakens or found.refuses for found in evidence)
        status = Status.WEAK if weak else status
        sentences = (*(found.text for found in evidence), *sentences)
    return Calibration(
        campaign=campaign,
        observations=observations,
        estimate=estimate,
        residuals=residuals(fit, used),
        status=status,
        sentences=sentences,
        rejected=() if snooping is None else rejections(fit, snooping, verdict),
        snooping=snooping,
        combinations=traded,
        notices=notices,
        evidence=evidence,
    )


def _evidence(
    campaign: Campaign, o: Observations, estimate: AlignmentEstimate, used: NDArray[np.bool_]
) -> tuple[Evidence, ...]:
    """What the campaign's own files tell of a usable answer."""
    if estimate.covariance_E is None or not Status(int(estimate.status)).usable:
        return ()
    weighted = o if np.all(used) else replace(o, weight=np.where(used, o.weight, 0.0))
    names = () if estimate.parameters is None else estimate.parameters.names
    return tuple(findings_of_files(campaign, weighted, estimate.C_EK, estimate.covariance_E, names))


def _kept(o: Observations, used: NDArray[np.bool_]) -> Observations:
    """The sightings used: the table itself, and no copy of it, where these are all."""
    return o if np.all(used) else o.select(used)


def _separated(
    status: Status, sentences: tuple[str, ...], traded: tuple[Combination, ...]
) -> tuple[Status, tuple[str, ...]]:
    """Status and sentences once it is known which parameters trade against each other."""
    if ruins_alignment(list(traded)):
        status = Status(max(status, Status.SINGULAR))
    elif any(combination.growth >= UNKNOWN for combination in traded):
        status = Status(max(status, Status.WEAK))
    return status, (*(combination.sentence for combination in traded), *sentences)


def _judge(
    kept: Observations, C_EK_model: Array, estimate: AlignmentEstimate, again: Estimator
) -> tuple[Status, tuple[str, ...], tuple[str, ...]]:
    """Status, sentences and notices of an estimate once the consistency checks have spoken."""
    own = Status(int(estimate.status))
    if not own.usable:
        return own, (own.text,), ()
    found = findings(kept, C_EK_model, estimate, again)
    weak = own is Status.WEAK or any(finding.weakens for finding in found)
    said, recorded = (tuple(f.sentence for f in found if f.informs is informs) for informs in (False, True))
    return Status.WEAK if weak else Status.OK, said, recorded


def shares(calibration: Calibration) -> Mapping[str, Array]:
    """Covariance (3, 3) rad^2 about E by source; empty where the method does not say what a sighting does to it."""
    c = calibration
    if c.snooping is None or c.estimate.covariance_E is None:
        return {}
    parts = c.snooping.spread.parts
    if _has_prior(c):
        values, axes = np.linalg.eigh(c.estimate.covariance_E - np.sum(list(parts.values()), axis=0))
        parts[PRIOR] = (axes * np.maximum(values, 0.0)) @ axes.mT
    return parts


def _has_prior(c: Calibration) -> bool:
    """Whether something of the mounting or of the other parameters was known before."""
    parameters = c.estimate.parameters
    known = parameters is not None and bool(np.any(np.isfinite(parameters.prior_sigma)))
    return c.campaign.sigma_mounting is not None or known
