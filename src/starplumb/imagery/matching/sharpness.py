"""How much blurrier a window is than the reference: the width of a Gaussian, found at a place that is held."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .template import Template

Array = NDArray[np.float64]

WIDTHS_PX = (0.0, 0.35, 0.5, 0.65, 0.8, 1.0, 1.25, 1.5, 1.8, 2.2)
"""Widths that are tried, until what is left grows again."""
_CLEARLY = 0.99
"""A blur must leave less than this part of what none leaves."""


def blur_between(template: Template, window: Array, places: tuple[Array, Array], weight: Array) -> float:
    """Width (raw pixels) of the Gaussian that makes a template most like a window (n, m) whose pixels lie at ``places``
    in it; 0 where none helps.  What is left is ``1 - rho^2``, whatever the contrast."""
    left = []
    for k, width in enumerate(WIDTHS_PX):
        left.append(_left(_at(_spectrum_blurred(template, width), template.step_px, places), window, weight))
        if k > 1 and left[-1] > 1.02 * min(left):
            break
    best = int(np.argmin(left))
    if best == 0 or left[best] > _CLEARLY * left[0]:
        return 0.0
    if best == len(left) - 1:
        return WIDTHS_PX[best]
    return float(
        np.sqrt(_vertex(np.square(WIDTHS_PX[best - 1 : best + 2]), np.array(left[best - 1 : best + 2])))
    )


def _spectrum_blurred(template: Template, width_px: float) -> Array:
    """The template under a Gaussian, by its spectrum: what comes round at the border stays outside the window."""
    from scipy.fft import fftfreq, irfft2, rfft2, rfftfreq

    if width_px == 0.0:
        return template.samples
    h, w = template.samples.shape
    along = np.exp(-2.0 * (np.pi * width_px / template.step_px) ** 2 * np.square(fftfreq(h)))
    across = np.exp(-2.0 * (np.pi * width_px / template.step_px) ** 2 * np.square(rfftfreq(w)))
    return np.asarray(irfft2(rfft2(template.samples) * along[:, None] * across, (h, w)))


def _at(samples: Array, step_px: float, places: tuple[Array, Array]) -> Array:
    from scipy.ndimage import map_coordinates

    x, y = places
    return np.asarray(map_coordinates(samples, [y / step_px, x / step_px], order=1, mode="nearest"))


def _left(T: Array, z: Array, w: Array) -> float:
    total = max(float(w.sum()), 1e-9)
    a, b = T - np.sum(w * T) / total, z - np.sum(w * z) / total
    power = float(np.sum(w * a * a) * np.sum(w * b * b))
    return 1.0 - float(np.sum(w * a * b)) ** 2 / power if power > 0.0 else 1.0


def _vertex(x: Array, y: Array) -> float:
    """Where the parabola through three points is least."""
    bend, slope, _ = np.polyfit(x - x[1], y, 2)
    return float(np.clip(x[1] - 0.5 * slope / bend, x[0], x[2])) if bend > 0.0 else float(x[1])
