"""Least squares of the runs of a study together, from one inverse of their scene's covariance."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import State, mounting_prior
from ..estimators.gls import Gls, step_length
from ..estimators.protocol import AlignmentEstimate, Estimator
from ..estimators.wahba import rotation
from ..physics import so3
from ..plan.scenario import Scenario
from ..solve.adjustment import Adjustment
from ..solve.refinement import Scene, seen_of
from ..table.equation import residual_px
from ..table.observations import Observations

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_STEPS = 3
"""Further steps of runs that the first does not settle."""
SETTLED = 1e-3
"""Length of a step, in sigmas, of which a run near the scene leaves no more than 1e-6."""


NEAR = 0.1
"""Length of the third step from the model, in sigmas, from which the model is too far off: they shrink as squares."""
FAR = 0.1
"""Angle, rad, by which these steps may turn it."""


@dataclass(frozen=True)
class _Solved:
    """Mountings (b, 3, 3) after a step, the step, in which runs it is exact, and in which it is the last."""

    C_EK: Array
    adjustment: Adjustment
    exact: Mask
    settled: Mask

    def put(self, runs: NDArray[np.int64], other: _Solved) -> None:
        """Bring runs (r,) in from elsewhere."""
        for field in fields(Adjustment):
            getattr(self.adjustment, field.name)[runs] = getattr(other.adjustment, field.name)
        for name in ("C_EK", "exact", "settled"):
            getattr(self, name)[runs] = getattr(other, name)


@dataclass(frozen=True)
class Refined:
    """:class:`Gls` of runs of a scene, exact to 1e-6 of a sigma (:mod:`starplumb.solve.refinement`).

    From the model mounting, or the closed form where that is far off, a few steps with the gain of the scene itself,
    then steps of Gauss-Newton with each run's own design and covariance.  Runs of which these are not exact, or do not
    settle, are left to :class:`Gls`.
    """

    gls: Gls
    scene: Scene

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        if C_EK.ndim != 3 or not self._of_scene(observations):
            return self.gls(observations, C_EK)
        solved = self._solved(seen_of(self.scene, observations), C_EK)
        one = np.ones(len(C_EK), dtype=np.int64)
        state = State(solved.C_EK, np.zeros((len(C_EK), 0)))
        found = self.gls.report(observations, C_EK, state, solved.adjustment, solved.settled, one)
        if np.all(solved.settled):
            return found
        return self._completed(observations, C_EK, found, np.flatnonzero(~solved.settled))

    def _of_scene(self, o: Observations) -> bool:
        """Whether a table holds runs of the scene: as many sightings, of the same weight."""
        return len(o.batch) == 1 and np.array_equal(o.weight, self.scene.table.weight)

    def _solved(self, o: Observations, C_model: Array) -> _Solved:
        C = self._started(o, C_model)
        solved = self._step(o, C, C_model)
        for _ in range(MOST_STEPS):
            left = np.flatnonzero(solved.exact & ~solved.settled)
            if left.size == 0:
                break
            solved.put(left, self._step(o.run((left,)), solved.C_EK[left], C_model[left]))
        return solved

    def _started(self, o: Observations, C_model: Array) -> Array:
        """Mountings (b, 3, 3) after steps with the gain of the scene: from the model, and from the closed form where
        that was too far."""
        C, arrived = self._gained(o, C_model, 3)
        far = np.flatnonzero(~arrived)
        if far.size:
            part = o.run((far,))
            closed, known = rotation(part)
            C[far] = self._gained(part, np.where(known[:, None, None], closed, C_model[far]), 2)[0]
        return C

    def _gained(self, o: Observations, C: Array, steps: int) -> tuple[Array, Mask]:
        """After some steps with the gain of the scene, and where (b,) they have arrived near by."""
        angle = np.zeros(len(C))
        for _ in range(steps):
            d_E = -residual_px(o, C).reshape(len(C), -1) @ self.scene.gain.T
            C, angle = so3.exp(d_E) @ C, angle + np.linalg.norm(d_E, axis=-1)
        last = np.linalg.norm(np.linalg.solve(self.scene.scale, d_E.T), axis=0)
        return C, (last < NEAR) & (angle < FAR)

    def _step(self, o: Observations, C: Array, C_model: Array) -> _Solved:
        squares, exact = self.scene.squares(o, C)
        adjustment = Adjustment.of(squares, mounting_prior(o, C, C_model))
        settled = exact & (step_length(adjustment, 3) < SETTLED)
        return _Solved(so3.exp(adjustment.x) @ C, adjustment, exact, settled)

    def _completed(
        self, o: Observations, C_EK: Array, found: AlignmentEstimate, left: NDArray[np.int64]
    ) -> AlignmentEstimate:
        """An estimate with the runs ``left`` (r,) by the method itself."""
        alone = self.gls(o.run((left,)), C_EK[left])
        changed: dict[str, Any] = {}
        for name in ("C_EK", "covariance_E", "status", "iterations", "chi2"):
            changed[name] = np.array(getattr(found, name))
            changed[name][left] = getattr(alone, name)
        return replace(found, **changed)


def of_scene(estimator: Estimator, scenario: Scenario) -> Estimator:
    """An estimator for the runs of a scenario: least squares of the alignment alone by :class:`Refined`, where that
    is a way to solve it; any other as it is."""
    if not isinstance(estimator, Gls) or estimator.parameters:
        return estimator
    scene = Scene.of(scenario.stated, scenario.C_EK_true)
    return estimator if scene is None else Refined(estimator, scene)
