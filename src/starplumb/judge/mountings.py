"""The mountings of several cameras, and of each against the first, with their joint covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..estimators.protocol import ParameterVector, Status
from ..physics import so3
from ..table.cameras.mounting import CameraMounting
from .calibrate import Calibration
from .parameters.separability import known
from .trust import NORMAL_95

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mountings:
    """Mountings of k cameras by ``names``: ``C_EC`` (k, 3, 3) and the models ``C_EC_model`` (k, 3, 3).

    ``covariance_E`` (3 k, 3 k) rad^2 is that of their errors about E's axes, each turn ``exp(theta) C_EC``; None where
    the data refute them.  ``known`` (k,) says which the data determine, and ``widened`` how many times 1.96 sigmas the
    half-width of a 95 % interval is.
    """

    names: tuple[str, ...]
    C_EC: Array
    C_EC_model: Array
    covariance_E: Array | None
    known: NDArray[np.bool_]
    widened: float

    @property
    def correction_E(self) -> Array:
        """d (k, 3) of ``C_EC = exp(d) C_EC_model``, rad."""
        return so3.log(self.C_EC @ self.C_EC_model.mT)

    def covariance_of(self, k: int) -> Array | None:
        """That of a camera's own error (3, 3); None where it is not known."""
        return self._part(np.eye(3 * len(self.names))[3 * k : 3 * k + 3], k)

    def C_against_first(self, k: int) -> Array:
        """``C_KC`` (3, 3), from the camera's frame to the first one's."""
        return np.asarray(self.C_EC[0].mT @ self.C_EC[k])

    def covariance_against_first(self, k: int) -> Array | None:
        """Covariance (3, 3) rad^2 about E's axes of the difference of the errors of a camera and the first."""
        G = np.zeros((3, 3 * len(self.names)))
        G[:, :3], G[:, 3 * k : 3 * k + 3] = -np.eye(3), np.eye(3)
        return self._part(G, k)

    def _part(self, G: Array, k: int) -> Array | None:
        if self.covariance_E is None or not self.known[k]:
            return None
        return np.asarray(G @ self.covariance_E @ G.T)


def mountings(c: Calibration) -> Mountings | None:
    """Those of a calibration whose cameras have names; None where there is one camera without a name."""
    rig, p = c.campaign.rig, c.estimate.parameters
    if rig is None:
        return None
    refuted = c.status is Status.REFUTED
    model = c.campaign.C_EK @ rig.C_KC
    C_EC, T, good = (
        model,
        np.eye(3, 3 + (0 if p is None else len(p.names))),
        np.ones(len(model), dtype=np.bool_),
    )
    if p is not None and rig.several:
        C_EC, T, good = _estimated(c, p)
    elif not refuted:
        C_EC = c.estimate.C_EK[None]
    P = c.estimate.covariance_E if p is None else p.covariance
    usable = P is not None and c.status.usable
    return Mountings(
        rig.names,
        model if refuted else C_EC,
        model,
        T @ P @ T.T if usable and P is not None else None,
        good,
        _widened(c),
    )


def _estimated(c: Calibration, p: ParameterVector) -> tuple[Array, Array, NDArray[np.bool_]]:
    """``C_EC`` (k, 3, 3), what errors about E the unknowns make, (3 k, 3 + p), and which cameras are known.

    ``C_EC = C_EK C_KC exp(e)`` turns by ``theta + C_EC J(-e) d`` about E's axes, d being the error of e.
    """
    rig = c.campaign.rig
    assert rig is not None
    C_EC = c.estimate.C_EK @ rig.C_KC
    T = np.zeros((3 * len(C_EC), 3 + len(p.names)))
    T[:, :3] = np.tile(np.eye(3), (len(C_EC), 1))
    good, told = np.ones(len(C_EC), dtype=np.bool_), known(p, list(c.combinations))
    for k in range(1, len(C_EC)):
        at = [p.names.index(name) for name in CameraMounting(k, rig.names[k]).names]
        value = p.values[at]
        C_EC[k] = C_EC[k] @ so3.exp(value)
        T[3 * k : 3 * k + 3, 3 + at[0] : 6 + at[0]] = C_EC[k] @ so3.left_jacobian(-value)
        good[k] = bool(np.all(told[at]))
    return C_EC, T, good


def _widened(c: Calibration) -> float:
    """How many times its sigma allows the first camera's interval is wide, about the axis where it is most."""
    if c.interval_95_E is None or c.sigma_E is None:
        return 1.0
    return float(np.max(c.interval_95_E / (NORMAL_95 * np.maximum(c.sigma_E, 1e-300)), initial=1.0))
