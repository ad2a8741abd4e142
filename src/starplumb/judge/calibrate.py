"""The main job: a campaign in, the corrected mounting out, with everything that is known about how good it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..estimators.cameras.ties import with_ties, without_ties
from ..estimators.campaign_table import table_of
from ..estimators.fit import Fit, Unknowns
from ..estimators.gls import Gls
from ..estimators.protocol import AlignmentEstimate, Estimator, Status, Verdict
from ..estimators.usable import EXACT, answer
from ..physics import so3
from ..physics.errors import InputError
from ..table.campaign import Campaign
from ..table.observations import Observations
from .accuracy.check_points import compared, of_check_points
from .consistency import chi2_p, findings
from .contradictions import (
    Support,
    culprit,
    rejected_images,
    rejected_sightings,
    rival,
    worse_on_the_ground,
)
from .conventions.rests_on import RestsOn, finding_of_rests_on, rests_on
from .files.evidence import Evidence
from .files.findings import findings_of_files
from .motion.found import Moves, finding_of, moves
from .parameters.separability import (
    Combination,
    combinations,
    of_combinations,
    ruins_alignment,
    without_gain,
)
from .parameters.single_image import rest_on_one
from .reference import Reference
from .residuals import Accuracy, Residuals, residuals
from .scatter.from_data import FromData
from .scatter.of_campaign import scatter_of
from .scatter.sessions import finding_of_session, with_session
from .scatter.sources import findings_of_sources
from .snooping import Rejection, Snooping, fit_at, recognised, rejections, snoop
from .trust import Finding, interval_95, judged, said
from .unmodelled import unmodelled

Array = NDArray[np.float64]

IMPROBABLE_P = 0.01
"""Probability of chi-square below which the message says what fits worst."""
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
    interval_95_E: Array | None = None
    """Half-widths (3,) rad of the 95 % intervals about E's axes, widened by what was found."""
    from_data: FromData | None = None
    """What the scatter of the images says of the answer and of each source of error."""
    moves: Moves | None = None
    """Whether and how the mounting moves."""
    rests_on: tuple[RestsOn, ...] = ()
    """What the answer rests on that was not estimated, the most urgent first."""

    @property
    def C_EK(self) -> Array:
        """The mounting (3, 3) to use: the estimate, or the model where the data refute the estimate."""
        return self.campaign.C_EK if self.status is Status.REFUTED else self.estimate.C_EK

    @property
    def covariance_E(self) -> Array | None:
        """Covariance (3, 3) rad^2 of the answer; None where the method has none or the data refute it."""
        return None if self.status is Status.REFUTED else self.estimate.covariance_E

    @property
    def sigma_E(self) -> Array | None:
        """Standard deviations (3,) rad about E's axes; None likewise."""
        return None if self.status is Status.REFUTED else self.estimate.sigma_E

    @property
    def leading_sigma_E(self) -> Array | None:
        """The larger (3,) rad of the stated sigmas and those from the data, axis by axis; None likewise."""
        data = None if self.from_data is None else self.from_data.sigma_E
        return self.sigma_E if data is None or self.sigma_E is None else np.maximum(self.sigma_E, data)

    @property
    def next_session_95_E(self) -> Array | None:
        """Half-widths (3,) rad of the 95 % intervals of the mounting at a further session or pass; None where the data
        tell of none."""
        further = None if self.from_data is None else self.from_data.next_session
        if further is None or self.interval_95_E is None:
            return None
        return np.maximum(self.interval_95_E, further.half_95_E)

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
        return _chi2_p(self.estimate)

    @property
    def check(self) -> NDArray[np.bool_]:
        """The check points (n,) among the sightings, without those of images that the answer leaves out."""
        return compared(self.campaign, self.residuals.used)

    def accuracy(self, after: bool, check: bool = False) -> Accuracy | None:
        """Geolocation accuracy of the control or check points, before or after; None where it cannot be said."""
        surveyed = self.campaign.landmarks.surveyed[self.campaign.sightings.landmark]
        chosen = self.check if check else surveyed & self.residuals.used
        errors = self.residuals.after_m if after else self.residuals.before_m
        return Accuracy.of(errors[chosen])


def calibrate(campaign: Campaign, estimator: Estimator, by_gls: Calibration | None = None) -> Calibration:
    """Estimate the mounting of a campaign from its control points and judge the answer.

    A method that is not least squares is held against it, ``by_gls`` where that is at hand; of the same campaign its
    table and what the model mounting leaves are taken from there.  Raises EpochError where an
    image lies outside the orbit or attitude, InputError where there is nothing to use.
    """
    campaign, estimator = with_ties(campaign, estimator)
    known = by_gls if by_gls is not None and by_gls.campaign is campaign else None
    fit, estimate, own, verdict, used = _solved(campaign, estimator, known)
    if campaign.attitude_errors.session_estimated and own.usable:
        campaign, known = with_session(campaign, fit), None
        fit, estimate, own, verdict, used = _solved(campaign, estimator)
    observations = replace(fit.table, weight=np.ones(used.size))
    if own.usable:
        estimate = recognised(fit, estimate)
    tested = own.usable and estimate.unknowns is not None
    tests = _Tests.of(campaign, fit, estimate) if tested else _Tests()
    traded = tuple(combinations(observations, estimate))
    left = residuals(fit, used, None if known is None else known.residuals)
    support = Support(campaign, observations, ~campaign.sightings.check, used)
    evidence = _evidence(campaign, observations, estimate, used)
    found = [
        *contradictions(support, estimate, left),
        *(findings_of_sources(tests.scatter, int(np.sum(support.counts[1] > 0))) if tested else ()),
        *_moving(campaign, tests.moving, estimate),
        *(Finding(e.text, e.weakens, refutes=e.refuses, covariance_E=e.covariance_E) for e in evidence),
        *of_combinations(traded, estimate),
        *_consistent(support, estimate, Gls(fit.unknowns.parameters), tests.snooping),
        *_unmodelled(campaign, fit, estimate),
        *(of_check_points(campaign, fit, estimate, tests.snooping) if tested else ()),
        *finding_of_rests_on(tests.rests),
        *rest_on_one(fit, estimate.parameters if tested else None, campaign.images.ids),
        *finding_of_session(campaign),
        *(Finding(text, False) for text in _remarks(estimate, untested=tested and tests.snooping is None)),
    ]
    if own.usable and not tested:
        found += _beside_least_squares(campaign, used, estimate, by_gls, found)
    ruined = ruins_alignment(list(traded))
    status = judged(Status(max(own, Status.SINGULAR)) if ruined else own, found)
    stands = tests if status.usable else _Tests()
    return Calibration(
        campaign=campaign,
        observations=observations,
        estimate=estimate,
        residuals=left,
        status=status,
        sentences=said(found) if own.usable else (_without_answer(own), *said(found)),
        rejected=tests.rejections(fit, verdict, campaign.sightings.image),
        snooping=tests.snooping,
        combinations=traded,
        notices=tuple(finding.sentence for finding in found if finding.informs),
        evidence=evidence,
        interval_95_E=_interval(estimate, tests.scatter, found) if status.usable else None,
        from_data=stands.scatter,
        rests_on=stands.rests,
        moves=stands.moving,
    )


@dataclass(frozen=True)
class _Tests:
    """What is asked of a usable answer whose equations are known; of any other nothing."""

    snooping: Snooping | None = None
    scatter: FromData | None = None
    moving: Moves | None = None
    rests: tuple[RestsOn, ...] = ()

    @classmethod
    def of(cls, campaign: Campaign, fit: Fit, estimate: AlignmentEstimate) -> _Tests:
        surveyed = without_ties(fit, campaign.landmarks.tie)
        return cls(
            snoop(fit, estimate),
            scatter_of(campaign, surveyed, estimate),
            moves(campaign, surveyed),
            () if estimate.sigma_E is None else rests_on(campaign, fit, estimate.sigma_E),
        )

    def rejections(
        self, fit: Fit, verdict: NDArray[np.int64], image: NDArray[np.intp]
    ) -> tuple[Rejection, ...]:
        """The sightings left out, each with what spoke against it."""
        return () if self.snooping is None else rejections(fit, self.snooping, verdict, image)


def _beside_least_squares(
    campaign: Campaign,
    used: NDArray[np.bool_],
    estimate: AlignmentEstimate,
    by_gls: Calibration | None,
    found: Sequence[Finding],
) -> list[Finding]:
    """What least squares of the sightings used says of an answer that is not its own."""
    reference = _reference(campaign, used, by_gls if estimate.verdict is None else None)
    weight = max((finding.weight for finding in found), default=0)
    return reference.findings(estimate.C_EK, _interval(estimate, None, found), weight)


def _reference(campaign: Campaign, used: NDArray[np.bool_], by_gls: Calibration | None) -> Reference:
    """What least squares makes of the sightings used."""
    sightings = replace(campaign.sightings, check=~used)
    c = by_gls or calibrate(replace(campaign, sightings=sightings), Gls())
    reason = c.sentences[0] if c.sentences else c.status.text
    return Reference(c.status, reason, c.estimate.C_EK, c.interval_95_E)


def _solved(
    campaign: Campaign, estimator: Estimator, known: Calibration | None = None
) -> tuple[Fit, AlignmentEstimate, Status, NDArray[np.int64], NDArray[np.bool_]]:
    """The adjustment at the estimate, this with its own status, the verdict on every sighting, and those used; the
    table is that of what is ``known`` of the same campaign."""
    observations = table_of(campaign) if known is None else known.observations
    used = ~campaign.sightings.check
    if not np.any(used):
        raise InputError(
            f"campaign {campaign.name!r} has no observation with role control; wanted at least two markers"
        )
    estimate = answer(estimator(_kept(observations, used), campaign.C_EK), type(estimator).__name__)
    verdict = np.zeros(observations.n, dtype=np.int64)
    if estimate.verdict is not None:
        verdict[used] = estimate.verdict
        used = used & (verdict == int(Verdict.USED))
    estimate, own = _answered(estimate)
    fit = fit_at(estimate.unknowns or Unknowns(), observations, campaign.C_EK, estimate, used)
    return fit, estimate, own, verdict, used


def _chi2_p(estimate: AlignmentEstimate) -> float | None:
    """Probability of a chi-square at least as large as that of an estimate; None where it has none."""
    if estimate.chi2 is None or estimate.degrees_of_freedom is None:
        return None
    return chi2_p(float(estimate.chi2), int(estimate.degrees_of_freedom))


def _without_answer(own: Status) -> str:
    """Why there is no answer, and what to do where an input may be wrong."""
    return f"{own.text}; run starplumb diagnose" if own is Status.NOT_CONVERGED else own.text


def _answered(estimate: AlignmentEstimate) -> tuple[AlignmentEstimate, Status]:
    """The estimate with its own status; an answer that has a rival is judged like any other, by its findings."""
    own = Status(int(estimate.status))
    as_good = replace(estimate, status=np.asarray(int(Status.OK)))
    return (as_good, Status.OK) if own is Status.REFUTED else (estimate, own)


def contradictions(support: Support, estimate: AlignmentEstimate, left: Residuals) -> list[Finding]:
    """What of the data contradicts a usable answer."""
    if not Status(int(estimate.status)).usable:
        return []
    before, after = (Accuracy.of(errors[support.used]) for errors in (left.before_m, left.after_m))
    found = [rival(support, estimate.rival), worse_on_the_ground(before, after)]
    if estimate.verdict is not None:
        found += [rejected_images(support), rejected_sightings(support, _chi2_p(estimate))]
    return [finding for finding in found if finding is not None]


def _consistent(
    support: Support, estimate: AlignmentEstimate, again: Estimator, snooping: Snooping | None
) -> list[Finding]:
    """What the consistency checks say, and which part fits worst where chi-square is improbable."""
    kept, campaign = _kept(support.observations, support.used), support.campaign
    found = findings(kept, campaign.C_EK, estimate, again, campaign.known_from)
    p = _chi2_p(estimate)
    if snooping is None or p is None or p >= IMPROBABLE_P:
        return found
    worst = culprit(campaign, support.observations, snooping.tested, support.used)
    weakest = max((finding for finding in found), key=lambda finding: finding.weight, default=None)
    heavy = weakest is not None and weakest.weight > 0
    return [*found, Finding(worst, heavy, refutes=heavy and weakest is not None and weakest.refutes)]


def _unmodelled(campaign: Campaign, fit: Fit, estimate: AlignmentEstimate) -> list[Finding]:
    """What single number of the campaign's description looks wrong to a usable answer of known residuals."""
    if not Status(int(estimate.status)).usable or estimate.unknowns is None or estimate.chi2 is None:
        return []
    dof = 0 if estimate.degrees_of_freedom is None else int(estimate.degrees_of_freedom)
    found = unmodelled(campaign, fit, float(estimate.chi2) / max(dof, 1))
    return [] if found is None else [found]


def _moving(campaign: Campaign, moving: Moves | None, estimate: AlignmentEstimate) -> list[Finding]:
    """What is said of a mounting that moves."""
    found = finding_of(moving, estimate.covariance_E, taken_out=campaign.turn_E is not None)
    return [] if found is None else [found]


def _remarks(estimate: AlignmentEstimate, *, untested: bool) -> list[str]:
    """What should be known of a usable answer and changes nothing."""
    if not Status(int(estimate.status)).usable:
        return []
    gained = [] if estimate.parameters is None else without_gain(estimate.parameters)
    return [*gained, *([UNTESTED] if untested else []), *estimate.remarks]


def _interval(
    estimate: AlignmentEstimate, scatter: FromData | None, found: Sequence[Finding]
) -> Array | None:
    """Half-widths (3,) rad of the 95 % intervals; None where neither the method nor a finding states any."""
    covariance_E = estimate.covariance_E
    if covariance_E is None:
        return interval_95(None, None, found)
    if scatter is not None and scatter.half_95_E is not None:
        return interval_95(covariance_E, scatter.half_95_E, found)
    factor = 1.0
    if estimate.chi2 is not None and estimate.degrees_of_freedom is not None:
        factor = max(1.0, float(estimate.chi2) / max(int(estimate.degrees_of_freedom), 1))
    implausible = factor > EXACT**2 and any(finding.weakens for finding in found)
    return interval_95(covariance_E * (factor if implausible else 1.0), None, found)


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
