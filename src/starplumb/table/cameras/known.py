"""What was known of the mountings of several cameras beforehand, all of them with one covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.units import DEG

Array = NDArray[np.float64]

RANGE = 10.0 * DEG
"""Largest error of a model mounting that makes sense."""


@dataclass(frozen=True)
class RigKnown:
    """The mountings of k cameras were ``C_EK C_KC``, C_KC (k, 3, 3), with the ``covariance_E`` (3 k, 3 k) rad^2 of
    their errors about E, each ``exp(theta) C_EC``, the first camera's before the others'."""

    C_KC: Array
    covariance_E: Array

    def of_unknowns(self, C_EK: Array) -> Array:
        """The same covariance of the unknowns (3 k, 3 k): theta of the first camera, and e of each further one,
        ``theta_C = theta + C_EC e``."""
        inverse = np.linalg.inv(self._turns(C_EK))
        return np.asarray(inverse @ self.covariance_E @ inverse.T)

    def prior(self, c: Array, C_EK: Array, C_KC: Array, values: Array) -> tuple[Array, Array]:
        """Information (3 k, 3 k) and step (3 k,) of what was known, at the turn c (3,) from ``C_EK`` and at ``values``
        (k - 1, 3) of the further cameras' mountings against ``C_KC`` (k, 3, 3).

        It says ``(c + J(c)^-1 x, eps + J(-eps)^-1 J(-v) d) ~ N(0, P)`` with ``exp(eps) = C_KC_known^T C_KC exp(v)``.
        """
        eps = so3.log(self.C_KC[1:].mT @ C_KC[1:] @ so3.exp(values))
        D = np.zeros(self.covariance_E.shape)
        D[:3, :3] = np.linalg.inv(so3.left_jacobian(c))
        turns = np.linalg.solve(so3.left_jacobian(-eps), so3.left_jacobian(-values))
        for k, turn in enumerate(turns, start=1):
            D[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = turn
        q = np.concatenate([c, eps.reshape(-1)])
        W = np.linalg.inv(self.of_unknowns(C_EK))
        return D.T @ W @ D, -np.linalg.solve(D, q)

    def _turns(self, C_EK: Array) -> Array:
        """What turns about E the unknowns make, (3 k, 3 k)."""
        T = np.eye(len(self.covariance_E))
        for k, C in enumerate((C_EK @ self.C_KC)[1:], start=1):
            T[3 * k : 3 * k + 3, :3] = np.eye(3)
            T[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = C
        return T
