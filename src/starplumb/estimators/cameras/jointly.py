"""The mountings of several cameras in one adjustment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.units import ARCSEC
from ...table.cameras.known import RANGE
from ...table.cameras.mounting import CameraMounting
from ...table.observations import Observations
from ..fit import State
from ..gls import Gls
from ..protocol import AlignmentEstimate, Estimator, Status, Verdict

Array = NDArray[np.float64]

NEAR = 600.0 * ARCSEC
"""Error of a camera's mounting against the first that is expected at most once each has been calibrated alone."""


@dataclass(frozen=True)
class Jointly:
    """Several cameras that share the errors of attitude and orbit of the moments at which they image together.

    The first camera's mounting and, for each further one, its mounting against the first
    (:class:`starplumb.table.cameras.mounting.CameraMounting`) are unknowns of one least squares, so that what the
    cameras have in common cancels in what they differ by.  Each camera is first calibrated alone, so that the errors of
    their model mountings do not matter; ``method`` then makes an estimator of the joint least squares, such as
    :class:`starplumb.estimators.default.Default`, and what it keeps is adjusted once more.  ``names`` are those of all
    cameras, ``gls`` holds further parameters.
    """

    names: tuple[str, ...]
    method: Callable[[Gls], Estimator]
    gls: Gls

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        o, alone = observations, self._alone(observations, C_EK)
        if o.C_KC is None or not alone:
            return self._wide(o)(o, C_EK)
        start = replace(o, C_KC=_started(o, C_EK, alone))
        near = self._least_squares(o, [NEAR if {0, k} <= set(alone) else RANGE for k in self._further])
        found = self.method(near)(start, C_EK)
        return self._again(o, start, C_EK, found)

    @property
    def _further(self) -> range:
        return range(1, len(self.names))

    def _least_squares(self, o: Observations, widest: list[float]) -> Gls:
        """The joint least squares, the mountings after the other parameters."""
        own = (CameraMounting(k, self.names[k], wide) for k, wide in zip(self._further, widest, strict=True))
        return replace(self.gls, parameters=(*self.gls.parameters, *own))

    def _wide(self, o: Observations) -> Gls:
        return self._least_squares(o, [RANGE] * len(self._further))

    def _alone(self, o: Observations, C_EK: Array) -> dict[int, Array]:
        """The mountings that cameras have when each is calibrated alone, of those that can be."""
        found = {}
        for k in range(len(self.names)):
            own = _of_camera(o, k)
            if own.n:
                answer = self.method(Gls())(own, o.mountings(C_EK)[np.argmax(o.camera == k)])
                if Status(int(answer.status)).usable:
                    found[k] = answer.C_EK
        return found

    def _again(
        self, o: Observations, start: Observations, C_EK: Array, found: AlignmentEstimate
    ) -> AlignmentEstimate:
        """The answer about the model mountings: the least squares of what it uses, from where it stands."""
        assert found.parameters is not None
        assert o.C_KC is not None
        assert start.C_KC is not None
        values, first = found.parameters.values.copy(), -3 * len(self._further)
        for k, own in zip(self._further, values[first:].reshape(-1, 3), strict=True):
            own[:] = so3.log(o.C_KC[k].mT @ start.C_KC[k] @ so3.exp(own))
        kept = o
        if found.verdict is not None:
            kept = replace(o, weight=np.where(found.verdict == int(Verdict.USED), o.weight, 0.0))
        gls = self._wide(o)
        answer = gls.estimate(kept, C_EK, State(found.C_EK, values))
        status = found.status if int(found.status) > int(Status.WEAK) else answer.status
        return replace(answer, status=status, verdict=found.verdict, notes=found.notes, rival=found.rival)


def _of_camera(o: Observations, k: int) -> Observations:
    """The table of one camera."""
    mine = o.select(np.flatnonzero(o.camera == k))
    return replace(mine, camera=None, C_KC=None, rig_known=None, prior_E=o.prior_E if k == 0 else None)


def _started(o: Observations, C_EK: Array, alone: dict[int, Array]) -> Array:
    """C_KC (k, 3, 3) of cameras calibrated alone; of one that could not be, as the model has it."""
    assert o.C_KC is not None
    any_of = min(alone)
    C_first = alone[any_of] @ o.C_KC[any_of].mT
    mounted = [alone.get(k, C_first @ C_KC) for k, C_KC in enumerate(o.C_KC)]
    return np.stack([np.eye(3), *(mounted[0].mT @ C for C in mounted[1:])])
