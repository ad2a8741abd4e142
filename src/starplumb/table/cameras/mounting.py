"""The mounting of a further camera as three parameters of the adjustment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ..observations import Observations
from ..parameters import Moves
from .known import RANGE

Array = NDArray[np.float64]

CAMERA_MOUNTING = "camera_"
"""How the names of its parameters begin."""


@dataclass(frozen=True)
class CameraMounting:
    """Mounting of the camera of number ``camera`` against that of the first, rad about its own axes.

    ``C_KC <- C_KC exp(epsilon_C)``: directions in it turn by ``s_C <- s_C + s_C x d_C``, so that with the tangents
    x, y where a mark is predicted::

        d xy_C = [[-x y, 1 + x^2, -y], [-(1 + y^2), x y, x]] d_C

    is how far the marks would have had to be measured elsewhere.  The tangents are those of its own frame: it may look
    in any direction from the first.
    """

    camera: int
    name: str
    widest: float = RANGE
    reach: float = 0.02
    """How far from a mark (rad) the derivative is taken at most."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"{CAMERA_MOUNTING}{self.name}_{axis}" for axis in "xyz")

    @property
    def sigma(self) -> tuple[float, ...]:
        return (np.inf,) * 3

    @property
    def range(self) -> tuple[float, ...]:
        return (self.widest,) * 3

    def apply(self, observations: Observations, value: Array) -> Observations:
        stated = observations.C_KC
        if stated is None:
            raise ValueError("the table is of one camera")
        C_KC = np.array(np.broadcast_to(stated, (*value.shape[:-1], *stated.shape[-3:])))
        C_KC[..., self.camera, :, :] = stated[..., self.camera, :, :] @ so3.exp(value)
        return replace(observations, C_KC=C_KC)

    def moves(self, observations: Observations, value: Array) -> Moves:
        x, y = observations.xy_K[..., 0], observations.xy_K[..., 1]
        one = np.ones_like(x)
        across = np.stack([-x * y, one + x * x, -y], axis=-1)
        down = np.stack([-one - y * y, x * y, x], axis=-1)
        # exp(e + d) = exp(e) exp(J(-e) d)
        d_xy = np.stack([across, down], axis=-2) @ so3.left_jacobian(-value)[..., None, :, :]
        mine = np.asarray(observations.camera) == self.camera
        return Moves(xy_K=np.where(mine[:, None, None], d_xy, 0.0))
