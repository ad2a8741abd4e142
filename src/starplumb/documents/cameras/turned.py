"""Mountings of several cameras in normal equations: each a turn about E of its own, in which campaigns can be summed.

The adjustment has the first camera's turn theta and, for each further one, e of ``C_EC = C_EK C_KC exp(e)``; with
errors d of e its own turn is ``theta_C = theta + C_EC J(-e) d``, so that::

    (theta, d) = T (theta, theta_C),    d = J(-e)^-1 C_EC^T (theta_C - theta),    N <- T^T N T,   b <- T^T b
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...judge.calibrate import Calibration
from ...mission.cameras import block_of
from ...mission.joint import MOUNTING
from ...physics import so3
from ...physics.units import ARCSEC
from ...solve.normals import ImageNormals
from ...table.cameras.mounting import CameraMounting

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Turned:
    """The mountings ``C_EC`` (k, 3, 3) of all cameras by ``names``; the unknowns of the further ones stand at ``at``
    (k - 1, 3) among the first of the adjustment, which are ``T`` (w, w) times turns about E."""

    names: tuple[str, ...]
    C_EC: Array
    at: NDArray[np.int64]
    T: Array

    @property
    def blocks(self) -> tuple[str, ...]:
        """Names of the blocks of all cameras."""
        return (MOUNTING, *map(block_of, self.names[1:]))

    def references(self) -> Array:
        """Rotation vectors (k - 1, 3) arcsec of the mountings of the further cameras."""
        return np.asarray(so3.log(self.C_EC[1:]) / ARCSEC)

    def of_moment(self, one: ImageNormals, there: Mask) -> tuple[ImageNormals, Mask]:
        """The equations of a moment over turns of the cameras that are ``there`` (k,), and which unknowns stay."""
        w = len(self.T)
        S = np.eye(len(one.vector))
        S[:w, :w] = self.T
        stays = np.ones(len(S), dtype=np.bool_)
        stays[:3] = there[0]
        for at, is_there in zip(self.at, there[1:], strict=True):
            stays[at] = is_there
        S = S[:, stays]
        return replace(one, information=S.T @ one.information @ S, vector=S.T @ one.vector), stays


def turned_of(c: Calibration) -> Turned | None:
    """Of a calibration of several cameras; None of one."""
    rig, p = c.campaign.rig, c.estimate.parameters
    if rig is None or not rig.several or p is None:
        return None
    C_EC = c.estimate.C_EK @ rig.C_KC
    T, every = np.eye(3 + len(p.names)), []
    for k in range(1, len(C_EC)):
        at = 3 + np.array([p.names.index(name) for name in CameraMounting(k, rig.names[k]).names])
        value = p.values[at - 3]
        C_EC[k] = C_EC[k] @ so3.exp(value)
        M = np.linalg.solve(so3.left_jacobian(-value), C_EC[k].T)
        T[np.ix_(at, np.arange(3))], T[np.ix_(at, at)] = -M, M
        every.append(at)
    return Turned(rig.names, C_EC, np.array(every), T)
