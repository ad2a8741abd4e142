"""Contrast, brightness and noise that change within a window: shadows, haze, fields that another band sees reversed.

Around each pixel, under a Gaussian of :data:`WIDTH_PX`, the window is ``g T + o``: g is the local regression of the
window on the template, o the difference of local means, and what is left has a local spread.  Where the window shows
nothing of the template g is about 0, and the pixel says nothing about the place.

Source: P. Cachier, X. Pennec, 3D non-rigid registration by gradient descent on a Gaussian-windowed similarity measure
using convolutions, Mathematical Methods in Biomedical Image Analysis (2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WIDTH_PX = 7.0
"""Sigma of the Gaussian under which contrast and brightness are told: wide enough to leave a field its texture."""
_FLAT = 0.02
"""Local power of the template, in parts of its mean, that counts as none."""
_QUIET = 0.2
"""Least local power of what is left, in parts of its median: a spot that fits by chance must not bear all."""


@dataclass(frozen=True)
class Contrast:
    """Of the pixels in ``use`` (n, m): the ``gain`` (n, m) of the template there, and the spread ``scale`` (n, m) of
    what is left.  Called, it takes off local means and counts in local spreads."""

    use: Array
    total: Array
    gain: Array
    scale: Array

    @classmethod
    def of(cls, template: Array, window: Array, use: Array) -> Contrast:
        """That of a window (n, m) over the template at its pixels (n, m)."""
        even = cls(use, np.maximum(_smooth(use), 1e-6), np.ones_like(use), np.ones_like(use))
        T, z = even(template), even(window)
        power = even.mean(T * T)
        flat = _FLAT * float(np.sum(use * power)) / max(float(np.sum(use)), 1.0)
        rounding = 1e-12 * float(np.mean(template**2)) + 1e-300
        gain = even.mean(T * z) / (power + flat + rounding)
        left = np.maximum(even.mean((z - gain * T) ** 2), 0.0)
        least = _QUIET * float(np.median(left[use > 0.0])) + 1e-24
        return cls(use, even.total, gain, np.sqrt(np.maximum(left, least)))

    def mean(self, values: Array) -> Array:
        """Local means (n, m) or (n, m, p) of the pixels in use."""
        spread = (..., None) if values.ndim > 2 else ...
        return np.asarray(_smooth(values * self.use[spread]) / self.total[spread])

    def __call__(self, values: Array) -> Array:
        spread = (..., None) if values.ndim > 2 else ...
        return np.asarray((values - self.mean(values)) / self.scale[spread])


def _smooth(values: Array) -> Array:
    rows, columns = (_gaussian(n) for n in values.shape[:2])
    if values.ndim == 2:
        return np.asarray(rows @ values @ columns)
    return np.asarray(np.moveaxis(rows @ np.moveaxis(values, -1, 0) @ columns, 0, -1))


@cache
def _gaussian(n: int) -> Array:
    """Weights (n, n) of the pixels of a line around each of them: a product is quicker than a filter this wide."""
    away = np.arange(n)[:, None] - np.arange(n)
    weight = np.exp(-0.5 * (away / WIDTH_PX) ** 2)
    return np.asarray(weight / np.sum(np.exp(-0.5 * (np.arange(-n, n + 1.0) / WIDTH_PX) ** 2)))
