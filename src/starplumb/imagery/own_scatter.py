"""What of the scatter of an image's chips is the reference's own error, stated with the landmarks, and what neither
that nor their own sigmas explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.earth import C_JT
from ..table.geometry import project
from .chain import MeasuredImage
from .scene import Scene, geodetic
from .targets.chain import TargetScene

Array = NDArray[np.float64]

_STEP_M = 1.0
_STEP_RAD = 1e-6
MOST_CHIPS = 300
"""Chips of one image whose scatter is looked at, evenly chosen among more: the work grows with their cube."""
_PARAMETERS = 3


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


def unexplained_px(
    scene: Scene | TargetScene, images: Sequence[MeasuredImage], sigma_m: Array, length_m: float
) -> float:
    """What the chips of all images scatter beyond their own sigmas and the reference's errors of ``sigma_m`` (3,),
    alike over ``length_m``, about the rotations that fit them best: the s of ``V + s^2``, V their covariance by both,
    with which their chi-square is its degrees of freedom; 0 where it is no larger without.

    One for all images: a few chips scatter more than they should as often as less, and the errors of neighbours, which
    look like scatter where they are taken as independent, are alike.
    """
    each = [_own_directions(scene, image, sigma_m, length_m) for image in images]
    variance, squared = (np.concatenate([part[k] for part in each]) if each else np.zeros(0) for k in (0, 1))

    def over(extra: float) -> bool:
        return float(np.sum(squared / (variance + extra))) > variance.size

    if not variance.size or not over(0.0):
        return 0.0
    low, high = 0.0, float(np.sum(squared)) / variance.size
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if over(middle) else (low, middle)
    return float(np.sqrt(high))


def _own_directions(
    scene: Scene | TargetScene, image: MeasuredImage, sigma_m: Array, length_m: float
) -> tuple[Array, Array]:
    """Variances (k,) px^2 of independent combinations of an image's residuals that no rotation changes, and their
    squares."""
    used = [chip for chip in image.used if chip.residual_px is not None]
    used = [used[k] for k in np.unique(np.linspace(0, len(used) - 1, MOST_CHIPS).astype(int))] if used else []
    if 2 * len(used) <= _PARAMETERS or any(chip.p_J is None for chip in used):
        return np.zeros(0), np.zeros(0)
    p_J, n = np.array([chip.p_J for chip in used]), len(used)
    moved = moved_px(scene, image, p_J) * np.asarray(sigma_m)
    apart = np.linalg.norm(p_J[:, None] - p_J, axis=-1)
    alike = np.exp(-apart / length_m) if length_m > 0.0 else np.eye(n)
    V = np.einsum("iak,jbk,ij->iajb", moved, moved, alike)
    V[np.arange(n), :, np.arange(n)] += np.array([chip.covariance for chip in used])
    turned = _turned_px(scene, image, p_J).reshape(2 * n, _PARAMETERS)
    N = np.linalg.qr(turned, mode="complete")[0][:, _PARAMETERS:]
    variance, U = np.linalg.eigh(N.T @ V.reshape(2 * n, 2 * n) @ N)
    residual = np.array([chip.residual_px for chip in used]).reshape(2 * n)
    return np.maximum(variance, np.finfo(float).tiny), (U.T @ (N.T @ residual)) ** 2


def _turned_px(scene: Scene | TargetScene, image: MeasuredImage, p_J: Array) -> Array:
    """How far points (n, 3) move in an image as it turns about E's axes, (n, 2, 3) px/rad."""
    index = np.full(len(p_J), image.image)
    pixel = project(scene.campaign, image.C_EK, index, p_J)
    turns = (so3.exp(_STEP_RAD * axis) @ image.C_EK for axis in np.eye(3))
    return (
        np.stack([project(scene.campaign, C, index, p_J, pixel) - pixel for C in turns], axis=-1) / _STEP_RAD
    )
