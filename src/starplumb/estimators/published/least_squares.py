"""The least squares of Tkachenko (2019), equations (1), (2) and the rows MNK of its tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...table.observations import Observations
from .linear_steps import Equations, LinearMethod, direction_slope

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LeastSquares(LinearMethod):
    """Model less true direction of every marker, ``e_J* - e_J = G theta_E`` (2), all weighted alike.

    ``e_J* = C_JE C_EK* e_K`` and ``G = -C_JE Phi(e_E*)``.  Turning all three equations of a marker by C_EJ
    changes no least squares, so they are written in E: ``C_EK* e_K - e_E = -Phi(C_EK* e_K) theta_E``.

    Mapping: theta_E is ours, ``C_EK* = (E + Phi(theta_E)) C_EK`` (1); the correction is ``d_E = -theta_E``,
    applied as an exact rotation.  Two iterations, as published.
    """

    iterations: int = 2

    def equations(self, observations: Observations, C_EK: Array) -> Equations:
        """(2) at a mounting, along the axes of E."""
        e_K = observations.e_K
        e_model = e_K @ C_EK.mT
        S = -C_EK[..., None, :, :] @ direction_slope(observations.xy_K, e_K)
        T = np.broadcast_to(-np.eye(3), C_EK.shape)
        return Equations(e_model - observations.e_E, -so3.skew(e_model), S, T)
