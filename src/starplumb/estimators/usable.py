"""Whether an answer may be used: one rule for every method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..physics.errors import InputError
from ..physics.units import DEG
from ..table.equation import ahead
from ..table.observations import Observations
from .protocol import AlignmentEstimate, Status

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

EXACT = 1.02
"""Residuals over what is stated up to which an improbable chi-square means nothing: 1e5 sightings show a factor that
changes nothing."""
SINGULAR_SIGMA = 10.0 * DEG
"""An alignment known no better than this is not determined: a covariance of linear errors means nothing there."""
SETTLED = 1.0
"""Length, in sigmas, of what one more step may move an answer."""
TIMES = 10.0
"""Misfit, in sigmas of single sightings, from which no stated error explains it."""
NEARLY = 0.5
"""Misfit, in sigmas of single sightings, that an answer may have beyond that of the closed form."""
REACH = 6.0
"""Sigmas of an answer within which it may lie from the closed form: beyond, once in 1e8."""
ROUNDING = 1e-6
"""What a rotation matrix and a covariance may lack of being one."""


def answer(found: object, method: str) -> AlignmentEstimate:
    """What an estimator of this name gives of one campaign (no batch axes), if it is an answer at all.

    A usable mounting that is not a number counts as not converged.  Raises InputError where what is found is no
    estimate, its mounting no rotation or its covariance none.
    """
    if not isinstance(found, AlignmentEstimate):
        raise InputError(f"the estimator {method} gives {type(found).__name__}, wanted an AlignmentEstimate")
    C, P = np.asarray(found.C_EK), found.covariance_E
    if C.shape != (3, 3) or (P is not None and np.shape(P) != (3, 3)):
        raise InputError(
            f"the estimator {method} gives C_EK of shape {C.shape}"
            + ("" if P is None else f" and a covariance of shape {np.shape(P)}")
            + ", wanted (3, 3)"
        )
    found = replace(found, status=np.asarray(found.status), iterations=np.asarray(found.iterations))
    if not Status(int(found.status)).usable:
        return found
    lost = not np.all(np.isfinite(C))
    if lost or (P is not None and not np.all(np.isfinite(P))):
        C = np.full((3, 3), np.nan) if lost else C
        return replace(found, C_EK=C, covariance_E=None, status=np.asarray(int(Status.NOT_CONVERGED)))
    if np.max(np.abs(C.T @ C - np.eye(3))) > ROUNDING or np.linalg.det(C) < 0.0:
        raise InputError(
            f"the estimator {method} gives a C_EK that is no rotation, wanted C^T C = 1 and det C = 1"
        )
    if P is not None and not _is_covariance(P):
        raise InputError(
            f"the estimator {method} gives a covariance_E that is none, wanted a symmetric matrix without negative "
            "eigenvalues"
        )
    return found


def _is_covariance(P: Array) -> bool:
    scale = float(np.max(np.abs(P)))
    symmetric = np.max(np.abs(P - P.T)) <= ROUNDING * scale
    return bool(symmetric and np.linalg.eigvalsh(P)[0] >= -ROUNDING * scale)


def determined(covariance_E: Array) -> Mask:
    """Where a covariance (..., 3, 3) says that the alignment is known: finite, root sum of squares below 10 deg."""
    return np.asarray(np.trace(covariance_E, axis1=-2, axis2=-1) < SINGULAR_SIGMA**2)


def settled(move_E: Array, covariance_E: Array) -> Mask:
    """Where one more step, move_E (..., 3) rad, is shorter than the sigma of its answer, covariance_E (..., 3, 3)."""
    known = determined(covariance_E)
    P = np.where(known[..., None, None], covariance_E, np.eye(3))
    length2 = np.sum(move_E * np.linalg.solve(P, move_E[..., None])[..., 0], axis=-1)
    return np.asarray(~known | (length2 < SETTLED**2))


def status_of(
    observations: Observations,
    C_EK: Array,
    *,
    determined: Mask,
    converged: Mask | bool = True,
    chi2: Array | None = None,
    covariance_E: Array | None = None,
) -> NDArray[np.int64]:
    """Status (...) of answers C_EK (..., 3, 3): OK, SINGULAR or NOT_CONVERGED.

    SINGULAR where the observations do not determine the alignment (``determined``, see :func:`determined`).
    NOT_CONVERGED where the iterations did not settle, where the mounting or chi-square is not a number, or where a
    sighting in the solution lies behind the camera: no camera sees that, so the answer cannot be the true one.  A
    method without chi-square is asked besides whether its answer :func:`fits <fits>`.
    """
    seen = ahead(observations, C_EK) | (observations.weight == 0.0)
    sound = converged & np.all(seen, axis=-1) & np.all(np.isfinite(C_EK), axis=(-2, -1))
    sound = sound & (fits(observations, C_EK, covariance_E) if chi2 is None else np.isfinite(chi2))
    answered = np.where(sound, int(Status.OK), int(Status.NOT_CONVERGED))
    return np.asarray(np.where(determined, answered, int(Status.SINGULAR)))


def fits(observations: Observations, C_EK: Array, covariance_E: Array | None = None) -> Mask:
    """Whether the misfit of answers C_EK (..., 3, 3) is one that the stated errors allow.

    The mean square ``m^2`` of ``|e_E - C_EK e_K|`` is held against that of what is stated for single sightings, s^2,
    shared errors included, and against the least that any rotation has, that of the closed form::

        m^2 < (10 s)^2 + 6^2 tr P   and   m^2 < m_least^2 + (s / 2)^2 + 6^2 tr P

    with P the covariance that the method states, if any.  ``m_least^2 = 2 (1 - (s_1 + s_2 + d s_3) / n)``, s_i the
    singular values of ``sum w e_E e_K^T / n`` and d the sign of its determinant.
    """
    o = observations
    w = o.weight / np.maximum(np.sum(o.weight, axis=-1, keepdims=True), 1e-300)
    apart = np.sum((o.e_K @ C_EK.mT - o.e_E) ** 2, axis=-1)
    m2 = np.sum(w * apart, axis=-1)
    stated = np.sum(w * _stated(o), axis=-1)
    room = NEARLY**2 * stated
    good = np.asarray(m2 <= room)
    if np.all(good):
        return good
    if covariance_E is not None:
        spread = np.trace(covariance_E, axis1=-2, axis2=-1)
        room = room + REACH**2 * np.where(np.isfinite(spread), spread, 0.0)
    B = (w[..., None] * o.e_E).mT @ o.e_K
    B = np.where(np.isfinite(B), B, 0.0)
    S = np.linalg.svd(B, compute_uv=False)
    least = 2.0 * (1.0 - S[..., 0] - S[..., 1] - np.sign(np.linalg.det(B)) * S[..., 2])
    return np.asarray(m2 < room + np.minimum(TIMES**2 * stated, np.maximum(least, 0.0)))


def _stated(o: Observations) -> Array:
    """Variance (..., n) rad^2 of all stated errors of a sighting, summed over its axes."""

    def trace(covariance: Array) -> Array:
        return np.asarray(np.trace(covariance, axis1=-2, axis2=-1))

    slope2 = np.sum(o.slope_K**2, axis=(-2, -1)) + np.sum(o.row_rate_E**2, axis=-1)
    places = trace(o.cov_position_J)[..., o.image] + trace(o.cov_landmark_J)[..., o.landmark]
    variance = trace(o.cov_attitude_E)[..., o.image] + places / o.range_m**2 + o.sigma_px**2 * slope2
    if o.common_px is not None:
        variance = variance + slope2 * np.sum(o.common_px**2, axis=(-2, -1))
    return np.asarray(variance)
