"""What is asked of a scenario of several cameras: the first one's mounting, and each other one against it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..estimators.gls import Gls
from ..estimators.protocol import AlignmentEstimate, Estimator
from ..physics import so3
from ..physics.errors import ArgumentError
from ..plan.scenario import Scenario
from ..table.observations import Observations

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OfCamera:
    """Least squares of all cameras together, and of it the mounting of ``camera``: of the first (0) as it is, of
    another one its error against that of the first, about E, as a turn of the true mounting ``C_EK`` (3, 3).

    ``C_EC`` (k, 3, 3) are the true mountings.
    """

    gls: Gls
    camera: int
    C_EK: Array = field(repr=False)
    C_EC: Array = field(repr=False)

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        found = self.gls(observations, C_EK)
        p = found.parameters
        assert p is not None
        if self.camera == 0:
            return found
        at = slice(3 * self.camera - 3, 3 * self.camera)
        own = so3.exp(p.values[..., at])
        # exp(theta_C) C_EC = C_EK C_KC exp(e), and the difference from the first one's theta
        C_KC = self.C_EC[0].mT @ self.C_EC[self.camera]
        theta_C = so3.log(found.C_EK @ C_KC @ own @ self.C_EC[self.camera].mT)
        theta = theta_C - so3.log(found.C_EK @ self.C_EK.mT)
        T = found.C_EK @ C_KC @ own @ so3.left_jacobian(-p.values[..., at])
        P = p.covariance[..., 3 * self.camera : 3 * self.camera + 3, 3 * self.camera : 3 * self.camera + 3]
        return replace(found, C_EK=so3.exp(theta) @ self.C_EK, covariance_E=T @ P @ T.mT, parameters=None)

    def of(self, turns: Array) -> Array:
        """Its rows (3, ...) of what is said of the turns of all mountings about E (3 k, ...)."""
        mine = turns[3 * self.camera : 3 * self.camera + 3]
        return mine if self.camera == 0 else mine - turns[:3]


def asked_of(scenario: Scenario, methods: Mapping[str, Estimator]) -> Mapping[str, Estimator]:
    """The methods as a scenario takes them: of several cameras the least squares of all of them, of which the first
    one's mounting is asked by the name of the method, and each other one against it, ``gls B against A``.

    Raises ArgumentError for another method then.
    """
    rig = scenario.campaign.rig
    if rig is None:
        return methods
    other = next((name for name, method in methods.items() if not isinstance(method, Gls)), None)
    if other is not None:
        raise ArgumentError(
            "methods", f"found {other!r}, wanted gls: a scenario of several cameras is solved by it alone"
        )
    gls, asked = Gls(scenario.unknowns.parameters), dict[str, Estimator]()
    for name in methods:
        for k, camera in enumerate(rig.names):
            against = "" if k == 0 else f" {camera} against {rig.names[0]}"
            asked[f"{name}{against}"] = OfCamera(gls, k, scenario.C_EK_true, scenario.C_EC_true)
    return asked
