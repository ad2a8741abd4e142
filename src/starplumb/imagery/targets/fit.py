"""A target's place by least squares: its form, blurred and gathered by pixels, with the camera's noise.

``minimise sum (z - b - a g(x, y, s))^2 / v`` over place, strength a, background b and width s, with the variance
``v = floor + dn_per_electron max(b + a g - level, 0)`` of the model itself.  The covariance is the inverse of the
information, the Cramer-Rao bound of such noise, and is enlarged where the residuals are larger than the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .profile import picture

Array = NDArray[np.float64]

WIDTHS = (0.25, 4.0)
"""Widths of the blur, px, that are believed."""
ROUNDS = 25
STILL_PX = 1e-4
AWAY_PX = 2.0
"""A target is not that one where its fit comes to rest farther than this from where it was seen."""


@dataclass(frozen=True)
class Noise:
    """Variance of a pixel's value: ``floor + dn_per_electron max(value - level, 0)``, in numbers squared."""

    floor: float
    dn_per_electron: float = 0.0
    level: float = 0.0

    def variance(self, value: Array) -> Array:
        return self.floor + self.dn_per_electron * np.maximum(value - self.level, 0.0)


@dataclass(frozen=True)
class Fit:
    """A target in a window: its place (2,) from the first pixel, the place's covariance (2, 2), strength, background
    and width; what the model is (n, n), which part of each residual's variance the fit leaves, ``left`` (n, n), and the
    mean of squared residuals over their variances, about 1."""

    place_px: Array
    covariance_px2: Array
    strength: float
    strength_sigma: float
    background: float
    width_px: float
    model: Array
    left: Array
    chi2: float


def fitted(
    window: Array,
    start: Array,
    offset_px: Array,
    part: Array,
    noise: Noise,
    width_px: float,
    width_free: bool = True,
) -> Fit | None:
    """The target near ``start`` (2,) of a window (n, n) without gaps; None where the fit comes to no rest there."""
    size = len(window)
    free = [0, 1, 2, 3, 4] if width_free else [0, 1, 2, 3]
    background = float(np.median(_border(window)))
    p = np.array([*start, 0.0, background, width_px])
    p[2] = _strength(window - background, *picture(start, offset_px, part, width_px, size)[:1])
    for _ in range(ROUNDS):
        model, J = _model(p, offset_px, part, size)
        weight = 1.0 / noise.variance(model)
        J = J[:, free]
        N, left = J.mT @ (weight.ravel()[:, None] * J), (window - model).ravel()
        try:
            step: Array = np.asarray(np.linalg.solve(N, J.mT @ (weight.ravel() * left)))
        except np.linalg.LinAlgError:
            return None
        p[free] = p[free] + _held(step)
        if not (np.all(np.isfinite(p)) and np.abs(p[:2] - start).max() < AWAY_PX and _within(p[4])):
            return None
        if np.abs(step[:2]).max() < STILL_PX:
            break
    else:
        return None
    model, J = _model(p, offset_px, part, size)
    weight = 1.0 / noise.variance(model)
    J = J[:, free]
    covariance: Array = np.asarray(np.linalg.inv(J.mT @ (weight.ravel()[:, None] * J)))
    freedom = window.size - len(free)
    chi2 = float(np.sum(weight * (window - model) ** 2)) / freedom
    # by chance they exceed 1 by so much once in a thousand
    scale = chi2 if chi2 > 1.0 + 3.1 * np.sqrt(2.0 / freedom) else 1.0
    return Fit(
        p[:2].copy(),
        scale * covariance[:2, :2],
        float(p[2]),
        float(np.sqrt(scale * covariance[2, 2])),
        float(p[3]),
        float(p[4]),
        model,
        1.0 - (weight.ravel() * np.einsum("ni,ij,nj->n", J, covariance, J)).reshape(size, size),
        chi2,
    )


def _model(p: Array, offset_px: Array, part: Array, size: int) -> tuple[Array, Array]:
    """The window (n, n) of parameters x, y, strength, background and width, and its derivatives (n n, 5)."""
    light, (by_x, by_y, by_width) = picture(p[:2], offset_px, part, float(p[4]), size)
    columns = [p[2] * by_x, p[2] * by_y, light, np.ones_like(light), p[2] * by_width]
    return p[3] + p[2] * light, np.stack([column.ravel() for column in columns], axis=-1)


def _strength(above: Array, light: Array) -> float:
    return float(np.sum(above * light) / np.sum(light**2))


def _held(step: Array) -> Array:
    """A step of which place and width move by half a pixel at most."""
    longest = float(np.abs(step[[0, 1, *range(4, len(step))]]).max())
    return step * min(1.0, 0.5 / max(longest, 1e-30))


def _within(width: float) -> bool:
    return WIDTHS[0] < width < WIDTHS[1]


def _border(window: Array) -> Array:
    inner = np.zeros(window.shape, dtype=np.bool_)
    inner[2:-2, 2:-2] = True
    return window[~inner]
