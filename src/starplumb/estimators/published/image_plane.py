"""Algorithm 3 of Lebedev and Tkachenko (2012), equations (19)-(22): linear least squares in the image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...table.equation import predict
from ...table.observations import Observations
from .linear_steps import SOURCE_AXES, Equations, LinearMethod

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ImagePlane(LinearMethod):
    """Predicted less measured image coordinates, ``q = (x - x', y - y') = G theta``, in focal lengths.

    ``(x, y)`` of (20) are predicted through the model mounting, ``(x', y')`` measured.  From (19),
    ``s = (E - Phi(theta)) s'``, follows to first order (F = 1)::

        G = [[-x'y',      1 + x'^2,  y'],        narrow field:  G = [[ 0, 1,  y'],
             [-(1 + y'^2),  x'y',   -x']]                            [-1, 0, -x']]

    (21) prints the third column as ``(-x', y')``; that loses the angle about the boresight.

    Mapping: the source's camera is ours turned by pi about x, ``(x', y') = (x_K, -y_K)``, and its theta
    takes the camera back, ``d_E = -C_EK D theta`` with ``D = diag(1, -1, -1)``.

    Weights know nothing of errors that an image shares; the stated covariance does.
    """

    field: Literal["full", "narrow"] = "full"

    def equations(self, observations: Observations, C_EK: Array) -> Equations:
        """(20), (21) at a mounting."""
        xy = observations.xy_K * SOURCE_AXES[:2]
        q = predict(C_EK, observations.e_E) * SOURCE_AXES[:2] - xy
        x, y = xy[..., 0], xy[..., 1]
        G = np.zeros((*x.shape, 2, 3))
        G[..., 0, 1], G[..., 1, 0] = 1.0, -1.0
        G[..., 0, 2], G[..., 1, 2] = y, -x
        if self.field == "full":
            G[..., 0, 0], G[..., 1, 1] = -x * y, x * y
            G[..., 0, 1] += x * x
            G[..., 1, 0] -= y * y
        S = np.broadcast_to(np.diag(SOURCE_AXES[:2]), (*x.shape, 2, 2))
        return Equations(q, G, S, -C_EK * SOURCE_AXES)
