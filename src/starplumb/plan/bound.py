"""The scenario to first order: gain and covariance of generalised least squares, and the bound.

With dense matrices, which share nothing with :mod:`starplumb.solve.adjustment`, up to MOST_SIGHTINGS; beyond by its
elimination, whose work grows with the number of sightings.  Residuals are ``z = H theta + sum_s E_s xi_s`` with the
effects E_s of the sources, their covariance ``V = sum_s E_s E_s^T`` is formed and factorised whole, and::

    gain = -(H^T V^-1 H + prior^-1)^-1 H^T V^-1,     covariance (H^T V^-1 H + prior^-1)^-1

With the true sources the covariance is the Cramer-Rao bound of Gaussian errors, and for any other distribution that of
the best linear estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import State
from ..table.error_sources import Effect, Source
from .scenario import Scenario

Array = NDArray[np.float64]

MOST_SIGHTINGS = 4000
"""Largest scene whose dense covariance (0.5 GB) is formed; the elimination takes over."""


@dataclass(frozen=True)
class Linear:
    """The least-squares estimate that knows of ``sources``."""

    scenario: Scenario
    sources: tuple[Source, ...]

    @cached_property
    def _solution(self) -> tuple[Array, Array]:
        return self._dense() if self.scenario.truth.n <= MOST_SIGHTINGS else self._eliminated()

    def _eliminated(self) -> tuple[Array, Array]:
        C_EK = self.scenario.C_EK_true
        known = self.scenario.with_stated(self.sources)
        unknowns = self.scenario.unknowns
        problem = unknowns.problem(known, State(C_EK, np.zeros(len(unknowns.names))), C_EK)
        own = 3 * len(self.scenario.C_EC_true)
        covariance = problem.solution.covariance[:own]
        inverse = problem.through_inverse()
        T = _turns(self.scenario)
        return T @ covariance[:, :own] @ T.T, -T @ covariance @ inverse.reshape(-1, inverse.shape[-1]).T

    def _dense(self) -> tuple[Array, Array]:
        H = self._design
        V = residual_covariance(effects(self.scenario, self.sources))
        # V^-1 H through the factor: y = L^-1 H, V^-1 H = L^-T y
        L = np.linalg.cholesky(V)
        y = np.linalg.solve(L, H)
        information = y.mT @ y
        if self.scenario.prior_E is not None:
            information[:3, :3] += np.linalg.inv(self.scenario.prior_E)
        covariance = np.linalg.inv(information)
        return covariance, -covariance @ np.linalg.solve(L.mT, y).mT

    @property
    def _design(self) -> Array:
        """Residuals by turns about E of the mounting of each of k cameras, (2 n, 3 k)."""
        H, k = self.scenario.model.H, len(self.scenario.C_EC_true)
        of = self.scenario.truth.camera
        if of is None:
            return H.reshape(-1, 3)
        return np.stack([np.where((of == c)[:, None, None], H, 0.0) for c in range(k)], axis=2).reshape(
            -1, 3 * k
        )

    @property
    def covariance_E(self) -> Array:
        """(3, 3) rad^2 about E, as it follows from the stated sources; of several cameras the first one's."""
        return self._solution[0][:3, :3]

    @property
    def covariance_all_E(self) -> Array:
        """(3 k, 3 k) rad^2, of the mountings of k cameras."""
        return self._solution[0]

    @property
    def gain(self) -> Array:
        """(3 k, 2 n) rad per px: the errors of the estimates of k mountings are ``gain`` times the residuals at the
        truth."""
        return self._solution[1]


def _turns(scenario: Scenario) -> Array:
    """Turns about E (3 k, 3 k) of k mountings by the unknowns, that of the first and e of each further one,
    ``theta_C = theta + C_EC e``."""
    C_EC = scenario.C_EC_true
    T = np.eye(3 * len(C_EC))
    for k in range(1, len(C_EC)):
        T[3 * k : 3 * k + 3, :3], T[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = np.eye(3), C_EC[k]
    return T


def effects(scenario: Scenario, sources: Sequence[Source]) -> list[Effect]:
    """What each source does to the residuals at the truth."""
    return [Effect.of(source, scenario.truth, scenario.model) for source in sources]


def residual_covariance(parts: Sequence[Effect]) -> Array:
    """V (2 n, 2 n) px^2 of independent sources."""
    V = parts[0].covariance()
    for part in parts[1:]:
        V += part.covariance()
    return V


def bound_E(scenario: Scenario) -> Array:
    """Cramer-Rao bound (3 k, 3 k) rad^2 of the mountings of k cameras about E under the true errors, blunders left
    aside."""
    return Linear(
        scenario, tuple(source for source in scenario.sources if not source.is_blunder)
    ).covariance_all_E
