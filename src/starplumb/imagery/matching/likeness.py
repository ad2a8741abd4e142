"""The reference made like the window it is laid on: as sharp, as strong and as bright.

``F = a + b_0 T_2 + b_1 (T_1 - T_2) + b_2 (T - T_1)``: T is the template, T_1 and T_2 the same under a narrow and a wide
Gaussian.  The three gains blur, sharpen, fade or reverse what is broad and what is fine; they are found by weighted
regression on the window while the place is held.  As every layer is an even filter of the template, none of it moves
the place to first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .template import Template
from .weights import WIDTH, spread, tukey

Array = NDArray[np.float64]

WIDTHS_PX = (0.7, 1.6)
"""Sigmas of the narrow and the wide Gaussian."""
_FIRST, _ALL = 2, 4
"""Rounds of the regression under Huber's weights, and all with those under Tukey's."""
_HUBER = 1.5
_LEAST = 24
"""So many pixels are needed."""
_FLAT = 1e-9
"""A window that varies by less than this part of its values is flat."""


@dataclass(frozen=True)
class Look:
    """How a window shows the template: the ``offset`` and the ``gains`` (3,) of its layers, the broadest first; of
    each pixel (n, m) the ``weight`` it had and what was left, ``residual``."""

    offset: float
    gains: Array
    weight: Array
    residual: Array

    @property
    def blur_px(self) -> float:
        """Width of the Gaussian that the gains come to, by their second moment; 0 where they do not blur."""
        if not self.gains[0] > 0.0:
            return 0.0
        middle, fine = self.gains[1:] / self.gains[0]
        narrow, wide = np.square(WIDTHS_PX)
        return float(np.sqrt(max(wide + middle * (narrow - wide) - fine * narrow, 0.0)))


@dataclass(frozen=True)
class Layers:
    """A template and the same under two Gaussians."""

    template: Template

    @cached_property
    def _blurred(self) -> tuple[Array, Array]:
        narrow, wide = (self.template.blurred(width).samples for width in WIDTHS_PX)
        return narrow, wide

    def at(self, x: Array, y: Array) -> Array:
        """The broad, the middle and the fine layer at places (n, m), last axis (3,); their sum is the template."""
        from scipy.ndimage import map_coordinates

        place = [y / self.template.step_px, x / self.template.step_px]
        narrow, wide = (map_coordinates(a, place, order=1, mode="nearest") for a in self._blurred)
        return np.stack([wide, narrow - wide, self.template.at(x, y) - narrow], axis=-1)

    def like(self, look: Look) -> Template:
        """The template as the window shows it."""
        narrow, wide = self._blurred
        broad, middle, fine = look.gains.tolist()
        samples = (
            look.offset + fine * self.template.samples + (middle - fine) * narrow + (broad - middle) * wide
        )
        return Template(samples, self.template.step_px)


def look_of(layers: Array, window: Array, use: Array) -> Look:
    """The look of a window (n, m), of the pixels in ``use`` (n, m), that shows layers (n, m, 3).

    Raises LinAlgError where there is nothing to see.
    """
    if np.count_nonzero(use) < _LEAST:
        raise np.linalg.LinAlgError("too few pixels are left")
    level = float(np.median(window[use > 0.0]))
    if spread(window - level, use) < _FLAT * (1.0 + abs(level)):
        raise np.linalg.LinAlgError("the window is flat")
    columns = np.concatenate([np.ones((window.size, 1)), layers.reshape(-1, 3)], axis=-1)
    # layers that are hardly there take the gain 0 rather than any
    ridge = np.diag([0.0, *1e-8 * np.var(columns[:, 1:], axis=0).sum() * use.sum() * np.ones(3)])
    w = use
    for k in range(_ALL):
        weighted = columns * w.reshape(-1, 1)
        found = np.linalg.solve(weighted.mT @ columns + ridge, weighted.mT @ window.ravel())
        left = window - (columns @ found).reshape(window.shape)
        scale = spread(left, use)
        if k < _FIRST:
            w = use * np.minimum(1.0, _HUBER * scale / np.maximum(np.abs(left), scale))
        else:
            w = tukey(left / (WIDTH * scale), use)[0]
    return Look(float(found[0]), found[1:], w, left)
