"""Algorithm 2 of Lebedev and Tkachenko (2012), equations (14)-(18): linear least squares in ground coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import so3
from ..earth import C_JT, itrf_to_geodetic
from ..observations import Observations
from .linear import SOURCE_AXES, CovarianceKind, Equations, estimate
from .protocol import AlignmentEstimate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GroundPlane:
    """Where the line of sight passes the marker's level, ``q = G theta`` (17), a pair for each marker.

    With ``c_i`` the columns of the matrix from the level frame T of the marker (east, north, up) to the model camera,
    ``s' = [x', y', -1]`` the measured direction (F = 1) and ``rho = ((X_n - X)/(Z_n - Z), (Y_n - Y)/(Z_n - Z))``, (14) with
    ``s = (E - Phi(theta)) s'`` of (15) reads ``c_i . s = rho_i c_3 . s``; (16) names its parts
    ``D_i = c_i . s'``,  ``(A_i, -B_i, C_i) = s' x c_i``, so that ::

        q_i = D_i - rho_i D_3,     G_i = (A_i, -B_i, C_i) - rho_i (A_3, -B_3, C_3),     i = 1, 2

    In (18) ``y_n`` is the sum of ``G_k^T q_k``, not of ``G_k^T y_k``.  The frame must be level: in one whose Z is far from
    the line of sight the angle about it is up to three times worse.

    Mapping: the source's camera is ours turned by pi about x, ``s' = D (x_K, y_K, 1)``, and its theta takes the camera
    back, ``d_E = -C_EK D theta`` with ``D = diag(1, -1, -1)``; rho comes from the marker's apparent direction, so that
    light time and aberration are in it.

    One linear step as published, biased by ``1/2 theta_z (z x theta)``; ``iterations`` re-linearise and remove that.
    """

    iterations: int = 1
    covariance: CovarianceKind = "stated"

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        return estimate(self.equations, observations, C_EK, self.iterations, self.covariance)

    def equations(self, observations: Observations, C_EK: Array) -> Equations:
        """(16), (17) at a mounting."""
        o = observations
        latitude, longitude, _ = itrf_to_geodetic(o.p_J)
        C_ET = o.C_EJ @ C_JT(latitude, longitude)
        seen_T = (o.e_E[..., None, :] @ C_ET)[..., 0, :]
        rho = seen_T[..., :2] / seen_T[..., 2:]
        # rows of axes are c_i: the axes of T in the source's camera
        axes = C_ET.mT @ (C_EK * SOURCE_AXES)[..., None, :, :]
        s = np.concatenate([o.xy_K, np.ones((*o.xy_K.shape[:-1], 1))], axis=-1) * SOURCE_AXES
        c = axes[..., :2, :] - rho[..., None] * axes[..., 2:, :]
        q = (c @ s[..., None])[..., 0]
        # s' x c_i = Phi(s') c_i; q moves by c . d(x', y') and F = (predicted less measured tangents) moves against the measured ones
        S = -c[..., :2] * SOURCE_AXES[:2]
        return Equations(q, c @ so3.skew(s).mT, S, -C_EK * SOURCE_AXES)
