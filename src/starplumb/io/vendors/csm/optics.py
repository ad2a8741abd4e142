"""The optics of a USGS community sensor model: from pixels to look directions, exactly as the model computes them.

Pixels of the CSM have (0.5, 0.5) at the centre of the first one. The focal plane (x, y), mm, and the detector (line,
sample) are joined by ``line = L0 + L1 x + L2 y + line_origin`` and the same for samples; lens distortion is taken off;
the look direction is (x, y, f) or its opposite, whichever meets the ground. Source: DOI-USGS/usgscsm, Utilities.cpp,
Distortion.cpp, UsgsAstroLsSensorModel.cpp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....physics.camera import Distortion

Array = NDArray[np.float64]

RADIAL, TRANSVERSE, RADTAN = "radial", "transverse", "radtan"


@dataclass(frozen=True)
class CsmOptics:
    """``lines`` and ``samples`` (3,) are the focal plane to pixel transformations, ``origin`` line and sample of the
    detector's centre, ``start`` its first line and sample, ``summing`` of lines and samples; ``coefficients`` are those
    of a distortion of the ``kind``. ``focal_length`` in mm."""

    focal_length: float
    lines: Array
    samples: Array
    origin: tuple[float, float]
    coefficients: Array
    start: tuple[float, float] = (0.0, 0.0)
    summing: tuple[float, float] = (1.0, 1.0)
    kind: str = RADIAL
    z_direction: float = 1.0

    def tangents(self, line: Array, sample: Array) -> Array:
        """x/z and y/z (n, 2) in the camera's axes of CSM pixels (n,); a line scanner has the one line 0."""
        t = np.stack(
            [
                line * self.summing[0] + self.start[0] - self.origin[0] - self.lines[0],
                sample * self.summing[1] + self.start[1] - self.origin[1] - self.samples[0],
            ],
            axis=-1,
        )
        x, y = (t @ np.linalg.inv(np.array([self.lines[1:], self.samples[1:]])).mT).mT
        x, y = self._undistorted(x, y)
        return self.z_direction * np.stack([x, y], axis=-1) / self.focal_length

    def _undistorted(self, x: Array, y: Array) -> tuple[Array, Array]:
        if not np.any(self.coefficients):
            return x, y
        if self.kind == RADIAL:
            return _radial(x, y, self.coefficients)
        k1, k2, p1, p2, k3 = self.coefficients.tolist()
        ideal, _ = Distortion((k1, k2, k3), (p1, p2)).remove(np.stack([x, y], axis=-1) / self.focal_length)
        return self.focal_length * ideal[..., 0], self.focal_length * ideal[..., 1]


def _radial(x: Array, y: Array, k: Array) -> tuple[Array, Array]:
    """Ideal places of distorted ones, ``u = d - d (k0 + k1 r^2 + k2 r^4)``; the model leaves places near the axis."""
    r2 = x**2 + y**2
    powers = np.stack([r2**i for i in range(len(k))], axis=-1)
    shrink = np.where(r2 > 1e-6, powers @ k, 0.0)
    return x - x * shrink, y - y * shrink
