"""Generalised least squares, with every stated error where it belongs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..solve.adjustment import Adjustment
from ..solve.chunks import sample, sampled
from ..table.observations import Observations
from ..table.parameters import Parameter
from .bent import bent
from .fit import Fit, State, Unknowns
from .protocol import AlignmentEstimate, ParameterVector, Status
from .usable import determined, status_of
from .wahba import Wahba

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SAMPLE_TOLERANCE = 0.02
"""Error left, in sigmas, at which a sample is good enough to start a large table from."""
FIRST_RATE = 0.5
"""Rate at which the first step is taken to shrink, as it has nothing to be compared with."""
SLOWEST = 0.2
"""Rate of long steps from which they settle on no fit.  They shrink by what the residuals bend the
normal equations: 1e-5 in sound campaigns, 0.3 where one image of six is half a turn off.  The covariance is wrong by as
much.  Shorter steps may be slow: along what the data hardly separate they are."""
LONG = 10.0
"""Length of a long step, in sigmas: a parameter started far off moves by a few while the model bends."""


MIXED, MOST_MIXED = 4, 5.0
"""Steps that are mixed, and the largest share of one."""


@dataclass(frozen=True)
class Gls:
    """Minimise the residual of the measurement equation weighted by the covariance of ALL its stated errors.

    Attitude and position errors are shared by the markers of an image, a marker's place error by its images, pixel
    noise by nobody (:mod:`starplumb.solve.adjustment`); any other pattern (``observations.common_px``) is solved for
    beside the alignment.  Gauss-Newton on the rotation group from the closed form (:class:`Wahba`), so the size of
    the initial error does not matter::

        C_EK <- exp(x) C_EK,    x = -(A^T V^-1 A)^-1 A^T V^-1 z,    covariance (A^T V^-1 A)^-1

    For N images of M markers, r the rms field angle of the centred markers, H the range, s in radians::

        s_xy^2 = [s_st^2   + (s_gps/H)^2]/N + [(s_gcp/H)^2 + s_pix^2]/(N M)
        s_z^2  =  s_st,z^2             /N + [(s_gcp/H)^2 + s_pix^2]/(N M r^2)

    A prior on the mounting (``observations.prior_E``) enters as a measurement of theta_E = 0.

    ``parameters`` (optics, clocks, trackers) are estimated beside the alignment: their design stands beside that of
    the mounting, ``A = [H, dz/dp]``, and they move by ``p <- p + x_p``.  A parameter with a prior is pulled to zero by
    it; a free one is held by its whole plausible range only, so that the equations can be solved even where the data
    say nothing of it (:mod:`starplumb.judge.parameters.separability` then refuses to call it known).
    """

    parameters: tuple[Parameter, ...] = ()
    tolerance: float = 1e-3
    """Error left in units of the estimate's own sigma at which to stop, as judged by how fast the steps shrink."""
    max_iterations: int = 20

    @property
    def unknowns(self) -> Unknowns:
        return Unknowns(self.parameters)

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        return self.settled(observations, C_EK, self.start(observations, C_EK))

    def settled(self, observations: Observations, C_EK: Array, state: State) -> AlignmentEstimate:
        """The estimate from a state; of a single run with the covariance that it has beside a lens that is mostly
        noise (:mod:`starplumb.estimators.bent`)."""
        found = self.estimate(observations, C_EK, state)
        p = found.parameters
        if p is None or found.C_EK.ndim > 2 or not Status(int(found.status)).usable:
            return found
        here = Fit(self.unknowns, observations, State(found.C_EK, p.values), C_EK)
        covariance = bent(here, p.covariance)
        if covariance is None:
            return found
        vector = replace(p, covariance=covariance, straight=p.covariance)
        return replace(found, covariance_E=covariance[:3, :3], parameters=vector)

    def start(self, observations: Observations, C_EK: Array) -> State:
        """The closed form, all parameters at zero; of a large table the estimate from a sample of its images."""
        if C_EK.ndim == 2 and sampled(observations):
            part = sample(observations)
            first = replace(self, tolerance=SAMPLE_TOLERANCE).estimate(part, C_EK, self._closed(part, C_EK))
            if int(first.status) == Status.OK:
                vector = first.parameters
                return State(first.C_EK, np.zeros(0) if vector is None else vector.values)
        return self._closed(observations, C_EK)

    def _closed(self, observations: Observations, C_EK: Array) -> State:
        start = Wahba()(observations, C_EK)
        closed = (start.status != int(Status.SINGULAR))[..., None, None]
        C = np.where(closed, start.C_EK, C_EK)
        return State(C, np.zeros((*C.shape[:-2], len(self.unknowns.names))))

    def estimate(self, observations: Observations, C_EK: Array, state: State) -> AlignmentEstimate:
        """Iterate from a state to convergence.

        Steps that shrink by q leave q / (1 - q) of the last one.  A run of a batch that has settled stands still, so
        that it is what it would be alone.
        """
        shape = state.C_EK.shape[:-2]
        settled, iterations = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=np.int64)
        before, fits = np.full(shape, np.nan), np.ones(shape, dtype=bool)
        problem, steps = Fit(self.unknowns, observations, state, C_EK).whole, Steps()
        for _ in range(self.max_iterations):
            solution = problem.solution
            x, steps = steps.next(solution, 3 + state.values.shape[-1] if self.parameters else 0)
            x = np.where(settled[..., None], 0.0, x)
            state = state.moved(x, problem.image_errors(x, settled))
            iterations += ~settled
            length = step_length(solution, 3 + state.values.shape[-1])
            q = np.where(np.isnan(before), FIRST_RATE, length / np.maximum(before, 1e-300))
            fits = fits & (settled | np.isnan(before) | (length < LONG) | (q < SLOWEST))
            settled, before = settled | ((q < 1.0) & (length * q < self.tolerance * (1.0 - q))), length
            if np.all(settled):
                break
            problem = Fit(self.unknowns, observations, state, C_EK).whole
        else:
            solution = problem.solution
        return self.report(observations, C_EK, state, solution, settled & fits, iterations)

    def report(
        self,
        o: Observations,
        C_EK_model: Array,
        state: State,
        solution: Adjustment,
        converged: Mask,
        iterations: NDArray[np.int64],
    ) -> AlignmentEstimate:
        covariance_E = solution.covariance[..., :3, :3]
        status = status_of(
            o, state.C_EK, determined=determined(covariance_E), converged=converged, chi2=solution.chi2
        )
        seen = np.broadcast_to(np.sum(o.weight > 0.0, axis=-1), status.shape)
        free = 3 * (o.prior_E is None) + int(np.sum(~np.isfinite(self.unknowns.sigma)))
        free -= 0 if o.rig_known is None else len(self.unknowns.of_mountings) - 3
        return AlignmentEstimate(
            state.C_EK,
            covariance_E,
            status,
            iterations,
            solution.chi2,
            2 * seen - free,
            parameters=self._vector(o, C_EK_model, state, solution) if self.parameters else None,
            unknowns=self.unknowns,
            notes=("weighs every stated error where it belongs, shared ones included",),
        )

    def _vector(
        self, o: Observations, C_EK_model: Array, state: State, solution: Adjustment
    ) -> ParameterVector:
        """The named parameters with what the data alone say of them, other common errors marginalised."""
        unknowns, own = self.unknowns, 3 + state.values.shape[-1]
        prior = unknowns.prior(o, state, C_EK_model)[0]
        return ParameterVector(
            unknowns.names,
            state.values,
            unknowns.sigma,
            unknowns.range,
            solution.covariance[..., :own, :own],
            marginal(solution.information, own) - prior[..., :own, :own],
        )


@dataclass(frozen=True)
class Steps:
    """Steps (..., k) of Gauss-Newton, ``proposed`` and ``taken``, the last few.

    Where the data hardly separate the unknowns the residuals bend the normal equations, and steps shrink slowly or
    swing about the answer.  The next one is then taken from the last ones (Anderson's mixing, in units of sigma)::

        x <- f - sum_j g_j (x_j + f_j+1 - f_j),    g = argmin |f - sum_j g_j (f_j+1 - f_j)|

    Source: H. F. Walker, P. Ni, SIAM Journal on Numerical Analysis 49 (2011).
    """

    proposed: tuple[Array, ...] = ()
    taken: tuple[Array, ...] = ()

    def next(self, solution: Adjustment, k: int) -> tuple[Array, Steps]:
        """The step to take, mixed by its first k unknowns; the solution's own where there is nothing to mix."""
        f, depth = solution.x, len(self.taken)
        proposed = (*self.proposed, f)
        x = f
        if depth and k:
            changes = np.stack([b - a for a, b in pairwise(proposed)], axis=-1)
            scaled = marginal(solution.information, k) @ changes[..., :k, :]
            square, right = changes[..., :k, :].mT @ scaled, scaled.mT @ f[..., :k, None]
            ridge = 1e-9 * np.trace(square, axis1=-2, axis2=-1)[..., None, None] + 1e-300
            g = np.linalg.solve(square + ridge * np.eye(depth), right)
            mixed = f - ((np.stack(self.taken, axis=-1) + changes) @ g)[..., 0]
            x = np.where(np.max(np.abs(g), axis=-2) < MOST_MIXED, mixed, f)
        return x, Steps(proposed[-MIXED:], (*self.taken, x)[-MIXED:])


def marginal(information: Array, k: int) -> Array:
    """Information (..., k, k) of the first k unknowns, the others being unknown: the Schur complement."""
    if information.shape[-1] == k:
        return information
    N = information
    return np.asarray(N[..., :k, :k] - N[..., :k, k:] @ np.linalg.solve(N[..., k:, k:], N[..., k:, :k]))


def step_length(solution: Adjustment, k: int) -> Array:
    """Length (...) of a step of the first k unknowns in units of their own sigma.

    Errors in common (the unknowns behind them) are solved for anew in each step, from zero: they do not shrink.
    """
    x = solution.x[..., :k, None]
    return np.asarray(np.sqrt((x.mT @ marginal(solution.information, k) @ x)[..., 0, 0]))


def covariance_at(observations: Observations, C_EK: Array, unknowns: Unknowns | None = None) -> Array:
    """Covariance (..., 3, 3) rad^2 about E of the alignment by generalised least squares that has arrived at C_EK, by
    default without further unknowns."""
    unknowns = Unknowns() if unknowns is None else unknowns
    state = State(C_EK, np.zeros((*C_EK.shape[:-2], len(unknowns.names))))
    return Fit(unknowns, observations, state, C_EK).solve().covariance[..., :3, :3]
