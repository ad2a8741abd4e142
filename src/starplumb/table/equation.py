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

The formulas are written once, on component rows (:mod:`starplumb.physics.components`): the functions on arrays below
call them, and so does the adjustment of large tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ..physics.components import Row, Triple, cross, dot
from .observations import Observations

Array = NDArray[np.float64]
Pair = tuple[Row, Row]
Four = tuple[Row, Row, Row, Row]
Nine = tuple[Row, Row, Row, Row, Row, Row, Row, Row, Row]


def project(C: Nine, e: Triple) -> tuple[Pair, Row, Triple, Triple]:
    """Tangents h of a direction e_E in a camera mounted at C_EK (row by row), s_z, and the rows of ``P C_KE``.

    ``P = dh/ds_K = (1/s_z) [[1, 0, -h_x], [0, 1, -h_y]]``.
    """
    s_z = e[0] * C[2] + e[1] * C[5] + e[2] * C[8]
    i = 1.0 / s_z
    x = (e[0] * C[0] + e[1] * C[3] + e[2] * C[6]) * i
    y = (e[0] * C[1] + e[1] * C[4] + e[2] * C[7]) * i
    P_x = ((C[0] - x * C[2]) * i, (C[3] - x * C[5]) * i, (C[6] - x * C[8]) * i)
    P_y = ((C[1] - y * C[2]) * i, (C[4] - y * C[5]) * i, (C[7] - y * C[8]) * i)
    return (x, y), s_z, P_x, P_y


def per_pixel(slope: Four, rate: Triple, P_x: Triple, P_y: Triple) -> Four:
    """B, rad per pixel: the camera's slope less the motion of the scene during a row."""
    return slope[0], slope[1] - dot(P_x, rate), slope[2], slope[3] - dot(P_y, rate)


def inverse(B: Four) -> Four:
    """B^-1, pixels per rad."""
    i = 1.0 / (B[0] * B[3] - B[1] * B[2])
    return i * B[3], -i * B[1], -i * B[2], i * B[0]


def through(T: Four, a: Row, b: Row) -> Pair:
    """T times the pair (a, b)."""
    return T[0] * a + T[1] * b, T[2] * a + T[3] * b


def gradient(T: Row, U: Row, P_x: Triple, P_y: Triple) -> Triple:
    """A row of ``B^-1 P C_KE``, whose row of B^-1 is (T, U)."""
    return T * P_x[0] + U * P_y[0], T * P_x[1] + U * P_y[1], T * P_x[2] + U * P_y[2]


def by_attitude(g: Triple, e: Triple) -> Triple:
    """A row of H: ``g [e]``, since turning the mounting by d_E moves ``s_K`` by ``C_KE (e_E x d_E)``."""
    return cross(g, e)


def by_position(g: Triple, C: Nine, closeness: Row) -> Triple:
    """A row of R: ``-g C_EJ / range``; displacements along the line of sight need no removal since ``P s_K = 0``."""
    a, b, c = -closeness * g[0], -closeness * g[1], -closeness * g[2]
    return a * C[0] + b * C[3] + c * C[6], a * C[1] + b * C[4] + c * C[7], a * C[2] + b * C[5] + c * C[8]


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


def in_front(C_EK: Array, e_E: Array) -> NDArray[np.bool_]:
    """Where directions e_E (..., n, 3) lie before a camera mounted at C_EK (..., 3, 3) and not behind it, (..., n)."""
    return np.asarray(e_E @ C_EK[..., :, 2:])[..., 0] > 0.0


def ahead(observations: Observations, C_EK: Array) -> NDArray[np.bool_]:
    """Where markers lie before their camera and not behind it, (..., n), the first mounted at C_EK (..., 3, 3)."""
    o = observations
    if o.C_KC is None:
        return in_front(C_EK, o.e_E)
    return np.asarray(np.vecdot(o.mountings(C_EK)[..., 2], o.e_E) > 0.0)


def predict(C_EK: Array, e_E: Array) -> Array:
    """Tangents (..., n, 2) at which directions e_E (..., n, 3) appear in a camera mounted at C_EK (..., 3, 3)."""
    return _stacked(project(_mounting(C_EK), _triple(e_E))[0])


def predicted(observations: Observations, C_EK: Array, e_E: Array) -> Array:
    """Tangents (..., n, 2) at which directions e_E (..., n, 3) appear in the camera of each sighting."""
    return _stacked(project(_nine(observations.mountings(C_EK)), _triple(e_E))[0])


def pixel_residual(C_EK: Array, e_E: Array, xy_K: Array, slope_K: Array, row_rate_E: Array) -> Array:
    """z = B^-1 F: predicted minus measured pixel (column, row), (..., n, 2)."""
    return _residual(_mounting(C_EK), e_E, xy_K, slope_K, row_rate_E)


def _residual(C: Nine, e_E: Array, xy_K: Array, slope_K: Array, row_rate_E: Array) -> Array:
    h, _, P_x, P_y = project(C, _triple(e_E))
    T = inverse(per_pixel(_four(slope_K), _triple(row_rate_E), P_x, P_y))
    return _stacked(through(T, h[0] - xy_K[..., 0], h[1] - xy_K[..., 1]))


def residual_px(observations: Observations, C_EK: Array) -> Array:
    """Predicted minus measured pixel (column, row), (..., n, 2), at the mounting C_EK (..., 3, 3)."""
    o = observations
    return _residual(_nine(o.mountings(C_EK)), o.e_E, o.xy_K, o.slope_K, o.row_rate_E)


def linearise(observations: Observations, C_EK: Array) -> Linearised:
    """Residual and Jacobians at the mounting C_EK (..., 3, 3)."""
    o, e = observations, _triple(observations.e_E)
    h, s_z, P_x, P_y = project(_nine(o.mountings(C_EK)), e)
    B = per_pixel(_four(o.slope_K), _triple(o.row_rate_E), P_x, P_y)
    T = inverse(B)
    g = gradient(T[0], T[1], P_x, P_y), gradient(T[2], T[3], P_x, P_y)
    C_EJ, closeness = _nine(o.C_EJ), 1.0 / o.range_m
    return Linearised(
        z_px=_stacked(through(T, h[0] - o.xy_K[..., 0], h[1] - o.xy_K[..., 1])),
        H=_stacked((*by_attitude(g[0], e), *by_attitude(g[1], e)), 2, 3),
        R=_stacked((*by_position(g[0], C_EJ, closeness), *by_position(g[1], C_EJ, closeness)), 2, 3),
        in_front=s_z > 0.0,
        B=_stacked(B, 2, 2),
    )


def by_tangents(model: Linearised, d_xy: Array) -> Array:
    """Changes of z_px (..., n, 2, s) by those of the measured tangents (..., n, 2, s): ``-B^-1 d_xy``."""
    T = inverse(cast("Four", tuple(row[..., None] for row in _four(model.B))))
    return -np.stack(through(T, d_xy[..., 0, :], d_xy[..., 1, :]), axis=-2)


def _triple(v: Array) -> Triple:
    return v[..., 0], v[..., 1], v[..., 2]


def _four(M: Array) -> Four:
    return M[..., 0, 0], M[..., 0, 1], M[..., 1, 0], M[..., 1, 1]


def _nine(C: Array) -> Nine:
    return cast("Nine", tuple(C[..., i, j] for i in range(3) for j in range(3)))


def _mounting(C_EK: Array) -> Nine:
    """C_EK (..., 3, 3) entry by entry, each (..., 1) to stand beside the sightings of its run."""
    return _nine(C_EK[..., None, :, :])


def _stacked(rows: Sequence[Row], *shape: int) -> Array:
    """Rows (..., n) as one array (..., n, *shape), by default (..., n, how many they are)."""
    out = np.empty((*np.broadcast_shapes(*(np.shape(row) for row in rows)), len(rows)))
    for i, row in enumerate(rows):
        out[..., i] = row
    return out.reshape(*out.shape[:-1], *(shape or (len(rows),)))
