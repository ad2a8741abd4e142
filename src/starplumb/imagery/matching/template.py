"""A piece of the reference, seen as the camera should see it, between its samples.

Coordinates (x, y) are columns and rows in raw pixels, (0, 0) the first sample; samples lie closer than raw pixels, so
that interpolating between them adds no error of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Template:
    """Samples (h, w) every ``step_px`` raw pixels, a cubic spline between them; all finite."""

    samples: Array
    step_px: float

    @cached_property
    def coefficients(self) -> Array:
        """Those of the spline (h, w)."""
        from scipy.ndimage import spline_filter

        return np.asarray(spline_filter(self.samples, order=3, mode="mirror"))

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """The spline's derivatives d/dx, d/dy (h, w) per raw pixel at the samples."""
        from scipy.ndimage import correlate1d

        rise, level = np.array([-0.5, 0.0, 0.5]) / self.step_px, np.array([1.0, 4.0, 1.0]) / 6.0
        x = correlate1d(correlate1d(self.coefficients, rise, axis=1), level, axis=0)
        y = correlate1d(correlate1d(self.coefficients, rise, axis=0), level, axis=1)
        return np.asarray(x), np.asarray(y)

    @property
    def centre(self) -> Array:
        """Its middle (2,), x and y."""
        h, w = self.samples.shape
        return 0.5 * self.step_px * np.array([w - 1.0, h - 1.0])

    def at(self, x: Array, y: Array) -> Array:
        """Values at places (...)."""
        from scipy.ndimage import map_coordinates

        place = [y / self.step_px, x / self.step_px]
        return np.asarray(map_coordinates(self.coefficients, place, order=3, mode="mirror", prefilter=False))

    def slopes_at(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Slopes along x and y at places (...), per raw pixel."""
        from scipy.ndimage import map_coordinates

        place = [y / self.step_px, x / self.step_px]
        along_x, along_y = (
            np.asarray(map_coordinates(slope, place, order=1, mode="nearest")) for slope in self._slopes
        )
        return along_x, along_y

    def blurred(self, sigma_px: float) -> Template:
        """The same under a Gaussian of this width, in raw pixels."""
        from scipy.ndimage import gaussian_filter

        if sigma_px == 0.0:
            return self
        return Template(gaussian_filter(self.samples, sigma_px / self.step_px, mode="nearest"), self.step_px)
