"""Error budget without sampling: which source contributes what, what that depends on, and what a target asks of each.

An estimator that is linear in the errors answers a unit draw of a source s with the response ``R_s = gain E_s``; the
covariance that it really has is ``sum_s R_s R_s^T`` over the true sources, whatever it states.  With sigma_j one sigma
of one source and c_j the rms response to a unit of it::

    sigma_theta^2 = sum_j (c_j sigma_j)^2,     d sigma_theta / d sigma_j = c_j^2 sigma_j / sigma_theta

and c_j itself is the sensitivity where the source stands alone, as (28) of Lebedev and Tkachenko (2012) lists them.
For ``gls`` with the true sigmas the derivative holds although its gain depends on them: an optimal gain adds nothing
to first order.

What is stated of the mounting beforehand is off by an error of its own: a source too, that no measurement has.  A prior
with the covariance P_0, off by xi, moves least squares by ``P P_0^-1 xi``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import Unknowns
from ..estimators.gls import covariance_at
from ..estimators.protocol import Estimator
from ..physics import so3
from ..plan.bound import Linear, effects
from ..plan.scenario import Scenario
from ..table.error_sources import UNIT_ARCSEC, Source, combine
from ..table.observations import Observations
from ..table.simulate import measure
from .cameras import OfCamera
from .monte_carlo import SIGHTINGS_AT_ONCE

Array = NDArray[np.float64]

STEP = 1.0
"""Draw, in sigmas, by which the response of an estimator is found: second-order terms are 1e-4 of it."""
SMALLEST_FACTOR = 1e-4
"""A source that must shrink by more than this must vanish."""
PRECISION = 1e-4
"""Relative precision of the factor by which it must shrink."""
PRIOR = "[initial]"
"""Name of the prior among the sources; no source of a scenario can have it."""


@dataclass(frozen=True)
class Share:
    """One sigma of one source in the budget of one estimator.

    ``covariance_E`` (3, 3) rad^2 its part; ``response_E`` (3,) rad per SI unit: error about E's axes by a unit of
    sigma, alone; ``derivative_E`` (3,) the same as a derivative, beside all the others.
    """

    source: Source
    component: int
    covariance_E: Array
    response_E: Array
    derivative_E: Array

    @property
    def label(self) -> str:
        own = self.source.labels[self.component]
        return f"{self.source.name} {own}".strip()

    @property
    def sigma(self) -> float:
        return float(self.source.sigma[self.component])


@dataclass(frozen=True)
class Budget:
    """Budget of one estimator: ``true_E`` (3, 3) rad^2 the covariance it has, ``stated_E`` what it states or None."""

    true_E: Array
    stated_E: Array | None
    shares: tuple[Share, ...]

    @property
    def sigma_E(self) -> Array:
        return np.asarray(np.sqrt(np.diagonal(self.true_E)))


def budget(scenario: Scenario, estimator: Estimator) -> Budget:
    """The budget of an estimator at the truth; blunders are left out, they are not noise.

    An answer that is that of generalised least squares is taken from its gain, any other from the estimator's
    response to a unit draw of each source.  A stated prior is the last of the sources.
    """
    sources = [source for source in scenario.sources if not source.is_blunder]
    prior = prior_source(scenario)
    known = [] if prior is None else [prior]
    at_the_truth = estimator(scenario.stated, scenario.C_EK_true)
    if at_the_truth.unknowns == Unknowns() or isinstance(estimator, OfCamera):
        linear = Linear(scenario, scenario.stated_sources)
        gain, by_prior = linear.gain, linear.covariance_all_E[:, :3]
        if isinstance(estimator, OfCamera):
            gain, by_prior = estimator.of(gain), estimator.of(by_prior)
        responses = [effect.through(gain) for effect in effects(scenario, sources)]
        pulled = [] if prior is None else [(by_prior / prior.sigma)[:, None]]
        responses, sources = [*responses, *pulled], [*sources, *known]
    else:
        sources = [*sources, *known]
        responses = [response(scenario, estimator, source) for source in sources]
    parts = [
        (source, component, R[..., source.component == component])
        for source, R in zip(sources, responses, strict=True)
        for component in range(source.sigma.size)
    ]
    covariances = [np.einsum("agq,bgq->ab", R, R) for _, _, R in parts]
    total = np.sum(covariances, axis=0)
    shares = (_share(s, k, part, total) for (s, k, _), part in zip(parts, covariances, strict=True))
    return Budget(total, at_the_truth.covariance_E, tuple(shares))


def prior_source(scenario: Scenario) -> Source | None:
    """The error of the mounting that is stated beforehand; None where none is stated."""
    initial = scenario.initial
    if not initial.stated:
        return None
    nothing, axes = np.zeros(1, dtype=np.int64), np.arange(3)
    words = "the mounting that is stated beforehand"
    labels = ("x", "y", "z")
    return Source(PRIOR, words, "turn_E", np.eye(3)[None], nothing, axes, initial.sigma, labels, UNIT_ARCSEC)


def _started(scenario: Scenario, estimator: Estimator, prior: Source) -> Array:
    """Response (3, 3) rad of an estimator to a mounting stated beforehand that is off by a sigma about each axis."""
    C_EK = so3.exp(STEP * np.diag(prior.sigma)) @ scenario.C_EK_true
    found = [estimator(scenario.stated, C).C_EK for C in (scenario.C_EK_true, *C_EK)]
    theta = so3.log(np.stack(found) @ scenario.C_EK_true.mT)
    return np.asarray(((theta[1:] - theta[0]) / STEP).mT)


def _share(source: Source, component: int, part: Array, total: Array) -> Share:
    sigma = source.sigma[component]
    spread, whole = np.sqrt(np.diagonal(part)), np.sqrt(np.diagonal(total))
    alone = spread / sigma if sigma > 0.0 else np.zeros(3)
    beside = np.divide(alone**2 * sigma, whole, out=np.zeros(3), where=whole > 0.0)
    return Share(source, component, part, alone, beside)


def response(scenario: Scenario, estimator: Estimator, source: Source) -> Array:
    """Response R (3, groups, q) rad of an estimator to a unit draw of each group and coordinate of a source, or of the
    mounting that is stated beforehand."""
    if source.name == PRIOR:
        return _started(scenario, estimator, source)[:, None]
    groups, q = source.groups, source.component.size
    zero = _theta(scenario, estimator, source, np.zeros((1, groups, q)))
    batch = max(1, SIGHTINGS_AT_ONCE // scenario.truth.n)
    answers = []
    for start in range(0, groups * q, batch):
        rows = np.arange(start, min(start + batch, groups * q))
        xi = np.zeros((rows.size, groups * q))
        xi[np.arange(rows.size), rows] = STEP
        answers.append(_theta(scenario, estimator, source, xi.reshape(-1, groups, q)))
    return np.asarray(((np.concatenate(answers) - zero) / STEP).mT.reshape(3, groups, q))


def _theta(scenario: Scenario, estimator: Estimator, source: Source, xi: Array) -> Array:
    """Errors (b, 3) of the estimates by draws (b, groups, q) of one source, started at the truth."""
    errors = combine(scenario.truth, [(source.field, source.error(xi))])
    estimate = estimator(measure(scenario.stated, scenario.C_EK_true, errors), scenario.C_EK_true)
    return so3.log(estimate.C_EK @ scenario.C_EK_true.mT)


@dataclass(frozen=True)
class Requirement:
    """What one source, all others as they are, must shrink to for a target about each axis.

    ``factor`` (3,): 1 where the target is met as it is, NaN where it is not met even without the source; ``without_E``
    (3,) rad the sigmas without it.
    """

    source: Source
    factor: Array
    without_E: Array


def requirements(scenario: Scenario, target: float) -> tuple[Requirement, ...]:
    """What each source must shrink to so that the best estimate's sigma about each axis is ``target`` rad or less.

    The estimate is that of generalised least squares with the true sigmas, its weights following them.  A stated prior
    is the last of the sources.
    """
    sources = tuple(source for source in scenario.sources if not source.is_blunder)
    prior, C_EK, unknowns = prior_source(scenario), scenario.C_EK_true, scenario.unknowns

    def sigma(table: Observations) -> Array:
        return np.asarray(np.sqrt(np.diagonal(covariance_at(table, C_EK, unknowns))))

    def with_one(i: int, factor: float) -> Array:
        scaled = (*sources[:i], sources[i].scaled(factor), *sources[i + 1 :])
        return sigma(scenario.with_stated(scaled))

    def with_prior(factor: float) -> Array:
        table = scenario.with_stated(sources)
        assert table.prior_E is not None
        return sigma(replace(table, prior_E=factor**2 * table.prior_E))

    asked = [_requirement(source, partial(with_one, i), target) for i, source in enumerate(sources)]
    return (*asked, *([] if prior is None else [_requirement(prior, with_prior, target)]))


def _requirement(source: Source, sigma: Callable[[float], Array], target: float) -> Requirement:
    """Of one source, by the ``sigma`` (3,) about the axes after a factor on its own."""
    now, least = sigma(1.0), sigma(SMALLEST_FACTOR)
    factor = np.where(now <= target, 1.0, np.nan)
    for axis in np.flatnonzero((now > target) & (least <= target)):
        low, high = SMALLEST_FACTOR, 1.0
        while high / low > 1.0 + PRECISION:
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if sigma(middle)[axis] <= target else (low, middle)
        factor[axis] = low
    return Requirement(source, factor, least)


@dataclass(frozen=True)
class Direction:
    """A rotation by a unit vector ``axis_E`` (3,), known to ``sigma`` rad."""

    axis_E: Array
    sigma: float


def directions(covariance_E: Array) -> tuple[Direction, ...]:
    """Principal axes of a covariance, the best known first."""
    values, vectors = np.linalg.eigh(covariance_E)
    return tuple(Direction(vectors[:, i], float(np.sqrt(max(values[i], 0.0)))) for i in range(3))
