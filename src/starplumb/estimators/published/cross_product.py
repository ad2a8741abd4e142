"""Algorithm 4 of Lebedev and Tkachenko (2012), equations (29)-(31): normal equations of cross products."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...table.observations import Observations
from .linear_steps import Equations, LinearMethod, direction_slope

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CrossProduct(LinearMethod):
    """Measured less predicted unit vectors, ``e_K - e_K* = Phi(e_K) theta`` (30), for each marker.

    ``Gamma theta = g`` (31) with ``Gamma = sum Phi^2(e_K)``, ``g = -sum Phi(e_K) e_K*``.  Gamma is negative
    semidefinite (``Phi^2 = -Phi^T Phi``): both signs are turned, ``sum Phi^T Phi theta = sum Phi^T (e_K -
    e_K*)``, before it is solved. (30) is printed without theta behind ``Phi(e_K)``.

    Mapping: by (24) its theta has our sign, ``Q = (E - Phi(theta)) Q*`` gives ``d_E = C_EK theta``; cross
    products do not ask which way the camera looks, so K's own axes serve.
    """

    def equations(self, observations: Observations, C_EK: Array) -> Equations:
        """(30) at a mounting."""
        e_K = observations.e_K
        q = e_K - observations.e_E @ C_EK
        return Equations(q, so3.skew(e_K), -direction_slope(observations.xy_K, e_K), C_EK)
