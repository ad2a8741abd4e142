"""THE measurement equation.  Estimators, simulator and planner all call it; there is no second copy.

A marker at p_J is seen from r_J in the apparent direction e_J; by the measured attitude that is ``e_E = C_EJ e_J``, in
the camera ``s_K = C_KE e_E``, and the tangents ``h = (s_x/s_z, s_y/s_z)`` should be those of the measured pixel::

    F(pixel, C_EK) = h(C_EK^T e_E) - xy_K = 0

F is turned into pixels by ``B = -dF/d(column, row)`` (the camera's slope less the motion of the scene during a row),
so that the residual ``z = B^-1 F`` is "predicted minus measured pixel" for frame and line-scan cameras alike and its
noise is the pixel noise.  To first order::

    z = H (theta_E - alpha_E) + R (rho_J - pi_J) + noise

with theta_E the error of the model mounting, alpha_E that of the measured attitude, rho_J that of the measured
position and pi_J that of the surveyed marker.  (A mounting turned by theta turns the camera against the scene as a
measured attitude turned by -theta does: only their difference is seen.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .observations import Observations
from .small import solve2

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Linearised:
    """The measurement equation at a mounting.

    ``z_px`` (..., n, 2) predicted minus measured pixel; ``H`` (..., n, 2, 3) px per rad about E's axes;
    ``R`` (..., n, 2, 3) px per metre of the camera's position in J; ``in_front`` (..., n) False where the marker lies
    behind the camera, so that its tangents mean nothing; ``B`` (..., n, 2, 2) rad per pixel turns a residual in pixels
    into one in tangents, ``F = B z``.
    """

    z_px: Array
    H: Array
    R: Array
    in_front: NDArray[np.bool_]
    B: Array


def _project(C_EK: Array, e_E: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Tangents h (..., n, 2), their derivative by s_K turned into E: P C_KE (..., n, 2, 3), and s_z > 0."""
    s = e_E @ C_EK  # rows are (C_EK^T e)^T
    z = s[..., 2]
    h = s[..., :2] / z[..., None]
    # P = (1/z) [[1, 0, -h_x], [0, 1, -h_y]]; P C_KE has rows (k_x - h_x k_z) / z with k_i the columns of C_EK
    k = np.swapaxes(C_EK, -1, -2)[..., None, :, :]
    P_E = (k[..., :2, :] - h[..., None] * k[..., 2:, :]) / z[..., None, None]
    return h, P_E, z > 0.0


def _tangents_per_pixel(slope_K: Array, P_E: Array, row_rate_E: Array) -> Array:
    """B (..., n, 2, 2): the camera's slope less the motion of the scene during a row."""
    B = np.array(np.broadcast_to(slope_K, np.broadcast_shapes(slope_K.shape, (*P_E.shape[:-2], 2, 2))))
    B[..., :, 1] -= (P_E @ row_rate_E[..., None])[..., 0]
    return B


def in_front(C_EK: Array, e_E: Array) -> NDArray[np.bool_]:
    """Where directions e_E (..., n, 3) lie before a camera mounted at C_EK (..., 3, 3) and not behind it, (..., n)."""
    return _project(C_EK, e_E)[2]


def predict(C_EK: Array, e_E: Array) -> Array:
    """Tangents (..., n, 2) at which directions e_E (..., n, 3) appear in a camera mounted at C_EK (..., 3, 3)."""
    return _project(C_EK, e_E)[0]


def pixel_residual(C_EK: Array, e_E: Array, xy_K: Array, slope_K: Array, row_rate_E: Array) -> Array:
    """z = B^-1 F: predicted minus measured pixel (column, row), (..., n, 2)."""
    h, P_E, _ = _project(C_EK, e_E)
    B = _tangents_per_pixel(slope_K, P_E, row_rate_E)
    return np.asarray(solve2(B, (h - xy_K)[..., None])[..., 0])


def residual_px(observations: Observations, C_EK: Array) -> Array:
    """Predicted minus measured pixel (column, row), (..., n, 2), at the mounting C_EK (..., 3, 3)."""
    o = observations
    return pixel_residual(C_EK, o.e_E, o.xy_K, o.slope_K, o.row_rate_E)


def linearise(observations: Observations, C_EK: Array) -> Linearised:
    """Residual and Jacobians at the mounting C_EK (..., 3, 3).

    ``H = B^-1 P C_KE [e_E]``: turning the mounting by d_E moves ``s_K`` by ``C_KE (e_E x d_E)``; ``R = -B^-1 P C_KE
    C_EJ / range``, where the part of the displacement along the line of sight needs no removal since P s_K = 0.
    """
    h, P_E, in_front = _project(C_EK, observations.e_E)
    B = _tangents_per_pixel(observations.slope_K, P_E, observations.row_rate_E)
    G = solve2(B, P_E)
    z = solve2(B, (h - observations.xy_K)[..., None])[..., 0]
    H = _times_skew(G, observations.e_E)
    R = G @ observations.C_EJ
    R /= -observations.range_m[..., None, None]
    return Linearised(z, H, R, in_front, B)


def _times_skew(G: Array, e: Array) -> Array:
    """G [e] (..., n, 2, 3): its rows are g x e."""
    product = np.empty(np.broadcast_shapes(G.shape, (*e.shape[:-1], 1, 3)))
    x, y, z = (e[..., None, i] for i in range(3))
    product[..., 0] = G[..., 1] * z - G[..., 2] * y
    product[..., 1] = G[..., 2] * x - G[..., 0] * z
    product[..., 2] = G[..., 0] * y - G[..., 1] * x
    return product
