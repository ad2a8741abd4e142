"""Algorithm 2 of Lebedev and Tkachenko (2012), equations (14)-(18): linear least squares on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.earth import C_JT, WGS84_F
from ...table.observations import Observations
from .linear_steps import SOURCE_AXES, Equations, LinearMethod

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GroundPlane(LinearMethod):
    """Where the line of sight passes the marker's level, ``q = G theta`` (17), a pair for each marker.

    With ``c_i`` the columns of the matrix from the level frame T of the marker (east, north, up) to the
    model camera, ``s' = [x', y', -1]`` the measured direction (F = 1) and ``rho = ((X_n - X)/(Z_n - Z),
    (Y_n - Y)/(Z_n - Z))``, (14) with ``s = (E - Phi(theta)) s'`` of (15) reads ``c_i . s = rho_i c_3 . s``;
    (16) names its parts ``D_i = c_i . s'``,  ``(A_i, -B_i, C_i) = s' x c_i``, so that ::

        q_i = D_i - rho_i D_3,     G_i = (A_i, -B_i, C_i) - rho_i (A_3, -B_3, C_3),     i = 1, 2

    In (18) ``y_n`` is the sum of ``G_k^T q_k``, not of ``G_k^T y_k``.  The frame must be level: in one
    whose Z is far from the line of sight the angle about it is up to three times worse.

    Mapping: the source's camera is ours turned by pi about x, ``s' = D (x_K, y_K, 1)``, and its theta takes
    the camera back, ``d_E = -C_EK D theta`` with ``D = diag(1, -1, -1)``; rho comes from the marker's
    apparent direction, so that light time and aberration are in it.
    """

    def equations(self, observations: Observations, C_EK: Array) -> Equations:
        """(16), (17) at a mounting."""
        o = observations
        C_ET = o.C_EJ @ _level(o.p_J)
        seen_T = (o.e_E[..., None, :] @ C_ET)[..., 0, :]
        rho = seen_T[..., :2] / seen_T[..., 2:]
        # rows c_1 - rho_1 c_3 and c_2 - rho_2 c_3, first along E, then in the source's camera
        level_E = np.swapaxes(C_ET, -1, -2)
        c_E = level_E[..., :2, :] - rho[..., None] * level_E[..., 2:, :]
        c = c_E @ (C_EK * SOURCE_AXES)[..., None, :, :]
        s = np.concatenate([o.xy_K, np.ones((*o.xy_K.shape[:-1], 1))], axis=-1) * SOURCE_AXES
        # q = c . s' moves with the measured tangents, F, predicted less measured, against them
        S = -c[..., :2] * SOURCE_AXES[:2]
        q = np.vecdot(c, s[..., None, :])
        return Equations(q, -(c @ so3.skew(s)), S, -C_EK * SOURCE_AXES)


def _level(p_J: Array) -> Array:
    """C_JT (..., 3, 3) of the level frame at markers p_J (..., 3).

    ``tan latitude = z / ((1 - f)^2 hypot(x, y))`` holds on the ellipsoid; 9 km above it it is 1 arcsec off,
    which levels a frame well enough.
    """
    x, y, z = p_J[..., 0], p_J[..., 1], p_J[..., 2]
    return C_JT(np.arctan2(z, (1.0 - WGS84_F) ** 2 * np.hypot(x, y)), np.arctan2(y, x))
