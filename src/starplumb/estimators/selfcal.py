"""Generalised least squares that estimates more than the alignment: optics, clocks, trackers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..solve.adjustment import Adjustment, is_large, solve, solve_large
from ..solve.portions import reader
from ..solve.streaming import Stream, Sum, sample, sampled, streams
from ..table.equation import Linearised, linearise
from ..table.observations import Observations
from ..table.parameters import Parameter, split
from .gls import SINGULAR_SIGMA, mounting_prior
from .protocol import AlignmentEstimate, ParameterVector, Status
from .wahba import Wahba

Array = NDArray[np.float64]


SAMPLE_TOLERANCE = 0.02
"""Error left, in sigmas, at which a sample is good enough to start a large table from."""


@dataclass(frozen=True)
class State:
    """Where an estimate stands: ``C_EK`` (..., 3, 3) and the parameters' ``values`` (..., p)."""

    C_EK: Array
    values: Array

    def moved(self, x: Array) -> State:
        """After a step of the alignment and the parameters, x (..., 3 + p or more)."""
        p = self.values.shape[-1]
        return State(so3.exp(x[..., :3]) @ self.C_EK, self.values + x[..., 3 : 3 + p])


@dataclass(frozen=True)
class Problem:
    """The adjustment at a state: the table with the parameters applied, its linearisation, the design of all common
    unknowns (..., n, 2, 3 + p + c) and their prior (information, step); c is the number of errors in ``common_px``."""

    observations: Observations
    model: Linearised
    A: Array
    prior: tuple[Array, Array]

    def solve(self) -> Adjustment:
        return solve(self.observations, self.model, self.A, *self.prior)


@dataclass(frozen=True)
class SelfCalibration:
    """:class:`Gls <starplumb.estimators.gls.Gls>` with further common parameters; without any it is the same.

    The state (C_EK, p) moves by ``C_EK <- exp(x_theta) C_EK, p <- p + x_p`` with the x of the adjustment whose design
    is ``[H, dz/dp]``.  A parameter with a prior is pulled to zero by it; a free one is held by its whole plausible
    range only, so that the equations can be solved even where the data say nothing of it
    (:mod:`starplumb.judge.separability` then refuses to call it known).
    """

    parameters: tuple[Parameter, ...] = ()
    tolerance: float = 1e-3
    """Error left in units of the estimate's own sigma at which to stop, as judged by how fast the steps shrink."""
    max_iterations: int = 20
    compiled: bool = False
    """Take large tables through the same formulas compiled by numba (the extra ``fast``): worth its start of some
    seconds from ten million sightings on."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for parameter in self.parameters for name in parameter.names)

    @property
    def sigma(self) -> Array:
        """Prior standard deviations (p,), infinite for free parameters."""
        return np.array([s for parameter in self.parameters for s in parameter.sigma])

    @property
    def range(self) -> Array:
        """Largest errors that make sense (p,)."""
        return np.array([r for parameter in self.parameters for r in parameter.range])

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        return self.estimate(observations, C_EK, self.start(observations, C_EK))

    def start(self, observations: Observations, C_EK: Array) -> State:
        """The closed form, all parameters at zero; of a large table the estimate from a sample of its images."""
        if C_EK.ndim == 2 and sampled(observations):
            part = sample(observations)
            first = self._closed(part, C_EK)
            estimate = replace(self, tolerance=SAMPLE_TOLERANCE).estimate(part, C_EK, first)
            if int(estimate.status) == Status.OK:
                vector = estimate.parameters
                return State(estimate.C_EK, first.values if vector is None else vector.values)
        return self._closed(observations, C_EK)

    def _closed(self, observations: Observations, C_EK: Array) -> State:
        start = Wahba()(observations, C_EK)
        closed = (start.status == int(Status.OK))[..., None, None]
        C = np.where(closed, start.C_EK, C_EK)
        return State(C, np.zeros((*C.shape[:-2], len(self.names))))

    def problem(self, observations: Observations, state: State, C_EK_model: Array) -> Problem:
        """The linear problem at a state."""
        o, own = observations, split(self.parameters, state.values)
        for parameter, value in own:
            o = parameter.apply(o, value)
        model = linearise(o, state.C_EK)
        parts = [parameter.moves(o, value).design(model) for parameter, value in own]
        parts += [] if o.common_px is None else [o.common_px]
        batch = np.broadcast_shapes(*(part.shape[:-3] for part in (model.H, *parts)))
        A = np.concatenate([np.broadcast_to(p, (*batch, *p.shape[-3:])) for p in (model.H, *parts)], axis=-1)
        return Problem(o, model, A, self._prior(o, state, C_EK_model))

    def _prior(self, o: Observations, state: State, C_EK_model: Array) -> tuple[Array, Array]:
        """Information and step of the prior on all common parameters."""
        p, common = len(self.names), 0 if o.common_px is None else o.common_px.shape[-1]
        batch, width = state.C_EK.shape[:-2], 3 + p + common
        information, step = np.zeros((*batch, width, width)), np.zeros((*batch, width))
        of_mounting = mounting_prior(o, state.C_EK, C_EK_model)
        if of_mounting is not None:
            information[..., :3, :3], step[..., :3] = of_mounting
        held = np.where(np.isfinite(self.sigma), self.sigma, self.range)
        diagonal = np.arange(3, width)
        information[..., diagonal, diagonal] = np.concatenate([held**-2.0, np.ones(common)])
        step[..., 3 : 3 + p] = -state.values
        return information, step

    def estimate(self, observations: Observations, C_EK: Array, state: State) -> AlignmentEstimate:
        """Iterate from a state to convergence."""
        shape = state.C_EK.shape[:-2]
        converged, iterations = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=np.int64)
        before, step = np.full(shape, np.inf), self._stepper(observations, C_EK, shape)
        solution = step(state)
        for _ in range(self.max_iterations):
            state = state.moved(solution.x)
            iterations += ~converged
            x = solution.x[..., None]
            length = np.sqrt((x.mT @ solution.information @ x)[..., 0, 0])
            # steps that shrink by q leave q / (1 - q) of the last one; the first has nothing to be compared with
            q = np.where(np.isfinite(before), np.minimum(length / np.maximum(before, 1e-300), 0.5), 0.5)
            converged, before = converged | (length * q / (1.0 - q) < self.tolerance), length
            if np.all(converged):
                break
            solution = step(state)
        prior = self._prior(observations, state, C_EK)[0]
        vector = self._vector(prior, state, solution) if self.parameters else None
        return replace(
            self._report(observations, state, solution, (converged, iterations)), parameters=vector
        )

    def _stepper(
        self, o: Observations, C_EK_model: Array, batch: tuple[int, ...]
    ) -> Callable[[State], Adjustment | Sum]:
        """The linear step at states with these batch axes; at a single one of a large table in chunks."""
        if batch or not (streams(o) or is_large(o)):
            return lambda state: self.problem(o, state, C_EK_model).solve()
        if not streams(o):
            return lambda state: self._large_step(o, state, C_EK_model)
        stream = Stream.of(o, self.parameters, self.compiled)
        return lambda state: stream.step(state.C_EK, state.values, self._prior(o, state, C_EK_model))

    def _large_step(self, o: Observations, state: State, C_EK_model: Array) -> Adjustment:
        """The linear step of a large table of landmarks seen again and again."""

        def linear(part: Observations) -> tuple[Observations, Linearised, Array]:
            problem = self.problem(part, state, C_EK_model)
            return problem.observations, problem.model, problem.A

        return solve_large(o, reader(o, linear), self._prior(o, state, C_EK_model))

    def _report(
        self,
        o: Observations,
        state: State,
        solution: Adjustment | Sum,
        ended: tuple[NDArray[np.bool_], NDArray[np.int64]],
    ) -> AlignmentEstimate:
        converged, iterations = ended
        covariance_E = solution.covariance[..., :3, :3]
        finite = np.all(np.isfinite(covariance_E), axis=(-2, -1))
        worst = np.linalg.eigvalsh(np.where(finite[..., None, None], covariance_E, np.eye(3)))[..., -1]
        status = np.full(state.C_EK.shape[:-2], int(Status.OK))
        status[~converged | ~np.isfinite(solution.chi2)] = int(Status.NOT_CONVERGED)
        status[~(worst < SINGULAR_SIGMA**2)] = int(Status.SINGULAR)
        seen = np.broadcast_to(np.sum(o.weight > 0.0, axis=-1), status.shape)
        free = 3 * (o.prior_E is None) + int(np.sum(~np.isfinite(self.sigma)))
        return AlignmentEstimate(state.C_EK, covariance_E, status, iterations, solution.chi2, 2 * seen - free)

    def _vector(self, prior: Array, state: State, solution: Adjustment | Sum) -> ParameterVector:
        """The named parameters with what the data alone say of them, other common errors marginalised."""
        own = 3 + len(self.names)
        N = solution.information
        marginal = N[..., :own, :own] - N[..., :own, own:] @ np.linalg.solve(
            N[..., own:, own:], N[..., own:, :own]
        )
        return ParameterVector(
            self.names,
            state.values,
            self.sigma,
            self.range,
            solution.covariance[..., :own, :own],
            marginal - prior[..., :own, :own],
        )
