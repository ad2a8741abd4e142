"""What the published linear methods share: normal equations, their sums, and the errors of the answer.

A method writes its equations in the letters of its source, ``q = G theta``.  To first order in the error of
the mounting and of the data, every such q is a combination ``q = S F`` of the tangents' residual F of
:mod:`starplumb.table.equation`, so that a method's answer is a linear gain upon F, whatever the method::

    theta = N^-1 y,   N = sum G_k^T G_k,   y = sum G_k^T q_k,   d_E = T theta,   gain = T N^-1 G_k^T S_k
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.errors import InputError
from ...physics.units import ARCMIN, ARCSEC
from ...table.equation import linearise
from ...table.observations import Observations
from ..protocol import AlignmentEstimate, Status, without_prior
from ..usable import determined, settled, status_of

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]
CovarianceKind = Literal["stated", "naive", "none"]
"""``stated``: every stated error through the method's own gain, and beside it as ``naive_covariance_E`` what the
textbook gives, the equations independent and as noisy as their residuals.  ``naive``: the latter in its place.
``none``: not computed (twice as fast)."""

SOURCE_AXES = np.array([1.0, -1.0, -1.0])
"""Diagonal of the turn by pi about x from our K (z ahead) to the sources' camera, ``s = [x, y, -F]``."""
STEP_LIMIT = 0.5
"""Beyond a last step of this size, rad, the linearisation does not hold."""


@dataclass(frozen=True, kw_only=True)
class LinearEstimate(AlignmentEstimate):
    """An estimate by linear steps from ``C_EK_model`` (..., 3, 3)."""

    C_EK_model: Array

    def describe(self, C_EK_best: Array) -> tuple[str, ...]:
        """What the initial error does to the answer, then the notes."""
        status = Status(int(self.status))
        if status is Status.SINGULAR:
            return super().describe(C_EK_best)
        theta_E = so3.log(self.C_EK_model @ C_EK_best.mT)
        theta = float(np.linalg.norm(theta_E)) / ARCMIN
        steps = int(self.iterations)
        if steps > 1:
            step = f"{steps} linear steps: re-linearised, no bias at this initial error ({theta:.3g} arcmin)"
        else:
            bias = f"{linear_bias(C_EK_best[:, 2], theta_E) / ARCSEC:.2g} arcsec"
            step = f"one linear step: biased by up to {bias} at this initial error ({theta:.3g} arcmin)"
        return (step, *self.notes) if status.usable else (status.text, step)


def linear_bias(z_E: Array, theta_E: Array) -> float:
    """Size of ``1/2 theta_z (z x theta)``, rad: how far one linear step in a narrow field misses the answer."""
    return float(np.linalg.norm(0.5 * (z_E @ theta_E) * np.cross(z_E, theta_E)))


@dataclass(frozen=True)
class Equations:
    """Linear equations of n sightings, r scalar ones each: ``q = G theta``.

    ``q`` (..., n, r), ``G`` (..., n, r, 3); ``S`` (..., n, r, 2) = dq / dF with F the predicted less the
    measured tangents in K; ``T`` (..., 3, 3) turns theta, in its method's axes and sign, into the
    correction d_E.
    """

    q: Array
    G: Array
    S: Array
    T: Array

    def sighting(self, k: int) -> Equations:
        """Those of one sighting."""
        one = slice(k, k + 1)
        return Equations(self.q[..., one, :], self.G[..., one, :, :], self.S[..., one, :, :], self.T)


Method = Callable[[Observations, Array], Equations]
"""Equations of an observation table at a mounting C_EK (..., 3, 3)."""


@dataclass(frozen=True)
class Normal:
    """Normal equations ``N theta = y``: (..., 3, 3) and (..., 3); they add as sightings come in."""

    N: Array
    y: Array

    @classmethod
    def of(cls, equations: Equations, weight: Array) -> Normal:
        """All at once: ``sum w_k G_k^T G_k`` and ``sum w_k G_k^T q_k``, weights (..., n)."""
        G = equations.G
        rows = (*np.broadcast_shapes(G.shape[:-3], weight.shape[:-1]), G.shape[-3] * G.shape[-2])
        weighted = (weight[..., None, None] * G).reshape(*rows, 3)
        G, q = (
            G.reshape(*G.shape[:-3], rows[-1], 3),
            equations.q.reshape(*equations.q.shape[:-2], rows[-1], 1),
        )
        return cls(weighted.mT @ G, (weighted.mT @ q)[..., 0])

    def __add__(self, other: Normal) -> Normal:
        return Normal(self.N + other.N, self.y + other.y)

    def solve(self) -> tuple[Array, Array, Bool]:
        """theta (..., 3), N^-1 and where N is singular; there both are zero."""
        inverse, singular = invert_symmetric(self.N)
        return (inverse @ self.y[..., None])[..., 0], inverse, singular


def accumulate(equations: Equations, weight: Array) -> Iterator[Normal]:
    """The sums after each sighting, (18): ``B_n = B_{n-1} + G_n^T G_n``, ``y_n = y_{n-1} + G_n^T q_n``."""
    total = Normal.of(equations.sighting(0), weight[..., :1])
    yield total
    for k in range(1, equations.q.shape[-2]):
        total = total + Normal.of(equations.sighting(k), weight[..., k : k + 1])
        yield total


def invert_symmetric(N: Array) -> tuple[Array, Bool]:
    """Inverse of symmetric N >= 0 (..., 3, 3) by cofactors, and where N is singular (inverse zero).

    With e1, e2, e3 the symmetric functions of the eigenvalues the smallest lies within e3/e2 .. 3 e3/e2: N
    is singular where that is lost in the rounding of the largest, e1 (two sightings closer than 0.06
    arcsec).
    """
    a, b, c, d, e, f = N[..., 0, 0], N[..., 0, 1], N[..., 0, 2], N[..., 1, 1], N[..., 1, 2], N[..., 2, 2]
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
    e1, e2, e3 = a + d + f, A + D + F, a * A + b * B + c * C
    singular = ~(e3 > 1e-14 * e1 * e2)
    scale = np.divide(1.0, e3, out=np.zeros_like(e3), where=~singular)
    inverse = np.empty_like(N)
    inverse[..., 0, 0], inverse[..., 1, 1], inverse[..., 2, 2] = A * scale, D * scale, F * scale
    inverse[..., 0, 1] = inverse[..., 1, 0] = B * scale
    inverse[..., 0, 2] = inverse[..., 2, 0] = C * scale
    inverse[..., 1, 2] = inverse[..., 2, 1] = E * scale
    return inverse, singular


def direction_slope(xy_K: Array, e_K: Array) -> Array:
    """d e_K / d xy_K (..., 3, 2) of the unit vector along ``s = (x, y, 1)``: ``(I - e e^T)[:, :2] / |s|``."""
    slope = -e_K[..., :, None] * e_K[..., None, :2]
    slope[..., 0, 0] += 1.0
    slope[..., 1, 1] += 1.0
    # e_z = 1 / |s|
    return np.asarray(slope * e_K[..., 2, None, None])


def estimate(
    method: Method, observations: Observations, C_EK: Array, iterations: int, covariance: CovarianceKind
) -> LinearEstimate:
    """Linear steps of a method, each about the mounting that the last corrected, ``C <- exp(d_E) C``.

    The covariance belongs to the last step, to first order in it.  A last step beyond linearising counts as one that
    has not converged, and so does an answer that one more step would move by its sigma; without a covariance that is
    not looked at.
    """
    if iterations < 1:
        raise InputError(f"iterations: found {iterations}, wanted 1 or more")
    C = np.broadcast_to(C_EK, (*np.broadcast_shapes(observations.batch, C_EK.shape[:-2]), 3, 3))
    for _ in range(iterations):
        C_before, equations = C, method(observations, C)
        theta, inverse, singular = Normal.of(equations, observations.weight).solve()
        d_E = (equations.T @ theta[..., None])[..., 0]
        C = so3.exp(d_E) @ C_before
    P, naive, known = None, None, ~singular
    if covariance == "stated":
        P = propagate(observations, C_before, gains(equations, inverse, observations.weight))
    if covariance != "none":
        naive = _naive(equations, theta, inverse, observations.weight)
        P = naive if P is None else P
        known = known & determined(P)
        P = np.where(known[..., None, None], P, np.inf)
    converged = np.sum(d_E * d_E, axis=-1) < STEP_LIMIT**2
    if P is not None:
        converged = converged & settled(_step(method(observations, C), observations.weight), P)
    status = status_of(observations, C, determined=known, converged=converged, covariance_E=P)
    return LinearEstimate(
        C_EK=C,
        covariance_E=P,
        status=status,
        iterations=np.full(status.shape, iterations),
        naive_covariance_E=naive,
        notes=without_prior(observations, "its weights ignore that an image's markers share errors"),
        C_EK_model=np.broadcast_to(C_EK, C.shape),
    )


@dataclass(frozen=True)
class LinearMethod(ABC):
    """A published method: linear steps with the equations of a sighting.

    One step as published is biased by ``1/2 theta_z (z x theta)``; more ``iterations`` re-linearise and remove that.
    """

    iterations: int = 1
    covariance: CovarianceKind = "stated"

    @abstractmethod
    def equations(self, observations: Observations, C_EK: Array) -> Equations:
        """The method's equations at a mounting."""

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        return estimate(self.equations, observations, C_EK, self.iterations, self.covariance)


def _step(equations: Equations, weight: Array) -> Array:
    """The correction d_E (..., 3) that equations ask for."""
    return np.asarray((equations.T @ Normal.of(equations, weight).solve()[0][..., None])[..., 0])


def gains(equations: Equations, inverse: Array, weight: Array) -> Array:
    """d d_E / dF of every sighting, (..., n, 3, 2): ``w T N^-1 G^T S``."""
    TN = equations.T @ inverse
    return np.asarray(weight[..., None, None] * (TN[..., None, :, :] @ (equations.G.mT @ equations.S)))


def propagate(observations: Observations, C_EK: Array, gain: Array) -> Array:
    """Covariance (..., 3, 3) that the stated errors give an answer with this gain upon the residual F.

    With ``F = B z`` and ``z = H (theta_E - alpha_E) + R (rho_J - pi_J) + noise`` the error of the answer is
    a sum over images and landmarks of what each of them adds through ALL its sightings, K = gain B::

        sum_i [A_i Cov(alpha_i) A_i^T + U_i Cov(rho_i) U_i^T] + sum_l U_l Cov(pi_l) U_l^T
            + sum_k K_k Cov(pixel_k) K_k^T,   A = sum K_k H_k,   U = sum K_k R_k,

    sums over the sightings of image i or landmark l; errors ``common_px`` likewise over all sightings.
    """
    o, model = observations, linearise(observations, C_EK)
    K = gain @ model.B
    KR = K @ model.R
    total = _sandwich(_sum_by(K @ model.H, o.image, o.n_images), o.cov_attitude_E)
    total = total + _sandwich(_sum_by(KR, o.image, o.n_images), o.cov_position_J)
    total = total + _sandwich(_sum_by(KR, o.landmark, o.n_landmarks), o.cov_landmark_J)
    if o.common_px is not None:
        common = np.sum(K @ o.common_px, axis=-3)
        total = total + common @ common.mT
    noise = (K @ o.noise_root_px).swapaxes(-3, -2)
    noise = noise.reshape(*noise.shape[:-2], -1)
    return np.asarray(total + noise @ noise.mT)


def _sum_by(blocks: Array, owner: NDArray[np.int64], count: int) -> Array:
    """Sums (..., count, 3, 3) of the blocks (..., n, 3, 3) of each owner; zero for one without any."""
    order = np.argsort(owner, kind="stable")
    if not np.array_equal(order, np.arange(order.size)):
        blocks = blocks[..., order, :, :]
    present, starts = np.unique(owner[order], return_index=True)
    if starts.size == blocks.shape[-3] == count:
        return blocks
    total = np.zeros((*blocks.shape[:-3], count, 3, 3))
    total[..., present, :, :] = np.add.reduceat(blocks, starts, axis=-3)
    return total


def _sandwich(A: Array, covariance: Array) -> Array:
    """``sum_i A_i Cov_i A_i^T`` over the last axis but two."""
    return np.asarray(np.sum(A @ covariance @ A.mT, axis=-3))


def _naive(equations: Equations, theta: Array, inverse: Array, weight: Array) -> Array:
    """``s^2 T N^-1 T^T``, ``s^2 = sum w |q - G theta|^2 / (2 n - 3)``: as if no error were shared."""
    v = equations.q - (equations.G @ theta[..., None, :, None])[..., 0]
    dof = 2.0 * np.sum(weight > 0.0, axis=-1) - 3.0
    variance = np.sum(weight * np.sum(v * v, axis=-1), axis=-1) / np.where(dof > 0.0, dof, np.nan)
    return np.asarray(variance[..., None, None] * (equations.T @ inverse @ equations.T.mT))
