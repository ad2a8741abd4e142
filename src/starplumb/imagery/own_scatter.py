"""What of the scatter of an image's chips is the reference's own error, stated with the landmarks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..physics.earth import C_JT
from ..table.geometry import project
from .chain import MeasuredImage
from .scene import Scene, geodetic
from .targets.chain import TargetScene

Array = NDArray[np.float64]

_STEP_M = 1.0


def seen_of_reference(
    scene: Scene | TargetScene, image: MeasuredImage, sigma_m: Array, length_m: float
) -> float:
    """Variance (px^2, mean of both axes) that errors of the reference of ``sigma_m`` (3,), east, north, up, give the
    chips of an image beside one another; an error of height moves them by its parallax.

    Errors that fall off as ``exp(-distance / length)`` are in part the same for all chips, and move the image instead
    of scattering them: of the variance ``1 - rho`` is seen, with rho the mean correlation of two chips.  0 where an
    image has no chips.
    """
    used = image.used
    if len(used) < 2:
        return 0.0
    p_J = np.array([c.p_J for c in used])
    variance = float(np.mean(np.sum((moved_px(scene, image, p_J) * np.asarray(sigma_m)) ** 2, axis=-1)))
    if not length_m > 0.0:
        return variance
    apart = np.linalg.norm(p_J[:, None] - p_J, axis=-1)[np.triu_indices(len(p_J), 1)]
    return variance * (1.0 - float(np.mean(np.exp(-apart / length_m))))


def moved_px(scene: Scene | TargetScene, image: MeasuredImage, p_J: Array) -> Array:
    """How far points p_J (n, 3) move in an image by a metre east, north and up, (n, 2, 3) px."""
    index = np.full(len(p_J), image.image)
    C = C_JT(*geodetic(p_J))
    pixel = project(scene.campaign, image.C_EK, index, p_J)
    steps = (p_J + _STEP_M * C[..., k] for k in range(3))
    moved = [project(scene.campaign, image.C_EK, index, at, pixel) - pixel for at in steps]
    return np.stack(moved, axis=-1) / _STEP_M
