"""Generalised least squares: the default estimator, with every stated error where it belongs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.units import DEG
from ..solve.adjustment import Adjustment, solve
from ..solve.streaming import Stream, Sum, streams
from ..table.equation import in_front, linearise
from ..table.observations import Observations
from .protocol import AlignmentEstimate, Status
from .wahba import Wahba

Array = NDArray[np.float64]

SINGULAR_SIGMA = 10.0 * DEG
"""An alignment worse known than this about any axis is not determined: the linear covariance means nothing there."""


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
    """

    tolerance: float = 1e-10
    """Step, rad, at which the quadratic convergence has passed rounding."""
    max_iterations: int = 20

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        start = Wahba()(observations, C_EK)
        closed = (start.status == int(Status.OK))[..., None, None]
        C = np.where(closed, start.C_EK, C_EK)
        converged = np.zeros(C.shape[:-2], dtype=bool)
        iterations = np.zeros(C.shape[:-2], dtype=np.int64)
        step = adjust(observations, C, C_EK)
        for _ in range(self.max_iterations):
            C = so3.exp(step.x) @ C
            iterations += ~converged
            converged = converged | (np.linalg.norm(step.x, axis=-1) < self.tolerance)
            if np.all(converged):
                break
            step = adjust(observations, C, C_EK)
        return self._estimate(observations, C, step, converged, iterations)

    def _estimate(
        self,
        observations: Observations,
        C: Array,
        final: Adjustment | Sum,
        converged: NDArray[np.bool_],
        iterations: NDArray[np.int64],
    ) -> AlignmentEstimate:
        weakest = np.linalg.eigvalsh(final.information)[..., 0]
        status = np.full(C.shape[:-2], int(Status.OK))
        behind = np.any(~in_front(C, observations.e_E) & (observations.weight > 0.0), axis=-1)
        status[~converged | ~np.isfinite(final.chi2) | behind] = int(Status.NOT_CONVERGED)
        status[~(weakest > SINGULAR_SIGMA**-2)] = int(Status.SINGULAR)
        seen = np.broadcast_to(np.sum(observations.weight > 0.0, axis=-1), status.shape)
        dof = 2 * seen - 3 + (3 if observations.prior_E is not None else 0)
        return AlignmentEstimate(C, final.covariance, status, iterations, final.chi2, dof)


def adjust(observations: Observations, C_EK: Array, C_EK_model: Array) -> Adjustment | Sum:
    """The linear step at C_EK, with the prior about the model mounting if there is one; of a large table
    at one mounting in chunks."""
    o = observations
    prior = mounting_prior(o, C_EK, C_EK_model)
    if C_EK.ndim == 2 and streams(o):
        full: Adjustment | Sum = Stream.of(o, (), compiled=False).step(
            C_EK, np.zeros(0), _beside(o, C_EK, prior)
        )
        return full if o.common_px is None else _without_common_errors(full)
    model = linearise(o, C_EK)
    if o.common_px is None:
        return solve(o, model, model.H, *(prior or ()))
    batch = np.broadcast_shapes(model.H.shape[:-3], o.common_px.shape[:-3])
    A = np.concatenate([np.broadcast_to(a, (*batch, *a.shape[-3:])) for a in (model.H, o.common_px)], axis=-1)
    return _without_common_errors(solve(o, model, A, *_beside(o, C_EK, prior)))


def mounting_prior(observations: Observations, C_EK: Array, C_EK_model: Array) -> tuple[Array, Array] | None:
    """Information and step of the prior about the model mounting.

    ``exp(x) C = exp(c + J^-1 x) C_model`` with ``c = log(C C_model^T)``: the prior says ``c + J^-1 x ~ N(0, prior)``.
    """
    if observations.prior_E is None:
        return None
    c = so3.log(C_EK @ C_EK_model.mT)
    J_inverse = np.linalg.inv(so3.left_jacobian(c))
    return J_inverse.mT @ np.linalg.inv(observations.prior_E) @ J_inverse, -c  # J c = c


def _beside(o: Observations, C_EK: Array, prior: tuple[Array, Array] | None) -> tuple[Array, Array]:
    """Information and step of the prior on the alignment and on the errors that many sightings have in common (unit
    prior)."""
    p = 0 if o.common_px is None else o.common_px.shape[-1]
    batch = (
        C_EK.shape[:-2]
        if o.common_px is None
        else np.broadcast_shapes(C_EK.shape[:-2], o.common_px.shape[:-3])
    )
    information, step = np.zeros((*batch, 3 + p, 3 + p)), np.zeros((*batch, 3 + p))
    information[..., 3:, 3:] = np.eye(p)
    if prior is not None:
        information[..., :3, :3], step[..., :3] = prior
    return information, step


def _without_common_errors(full: Adjustment | Sum) -> Adjustment | Sum:
    """The alignment of a solution that has unknowns beside it."""
    N = full.information
    own = N[..., :3, :3] - N[..., :3, 3:] @ np.linalg.solve(N[..., 3:, 3:], N[..., 3:, :3])
    return replace(full, x=full.x[..., :3], information=own, covariance=full.covariance[..., :3, :3])
