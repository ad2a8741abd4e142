"""What a turn of the mounting does on the ground: the weight by which axes count."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...physics.camera import Camera

Array = NDArray[np.float64]

FIELD = (0.0, 0.5, 1.0)
"""Columns and rows, as parts of the image, at which the error on the ground is looked at."""


def ground_weight(camera: Camera, C_EK: Array, height_m: float) -> Array:
    """W (3, 3) m^2/rad^2: ``theta^T W theta`` is the mean square displacement on the ground by a turn theta_E.

    Straight down from a height over flat ground, over nine points of the field.  The direction ``s = (x, y, 1)`` meets
    the ground at ``h (x, y)``; a turn moves it by ``theta x s``, the point by ``h (ds_xy - s_xy ds_z)``.
    """
    size = np.array([value if np.isfinite(value) else 1.0 for value in camera.size_px])
    column, row = (axis.ravel() for axis in np.meshgrid(*(np.array(FIELD) * (n - 1.0) for n in size)))
    xy, _ = camera.tan_from_px(column, row)
    x, y = xy.T
    one = np.ones(x.size)
    by_x = height_m * np.stack([-x * y, one + x * x, -y], axis=-1)
    by_y = height_m * np.stack([-one - y * y, x * y, x], axis=-1)
    by_K = np.stack([by_x, by_y], axis=1)
    by_E = by_K @ C_EK.T
    return np.asarray(np.mean(by_E.mT @ by_E, axis=0))
