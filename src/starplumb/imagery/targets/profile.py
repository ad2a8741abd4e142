"""What the pixels see of points of light: a Gaussian blur gathered over each pixel's square, exactly.

``g(i) = Phi((i + 1/2 - c) / s) - Phi((i - 1/2 - c) / s)`` along each axis, c the place and s the width of the blur; the
picture is ``b + a sum_k part_k g_x(column) g_y(row)``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def picture(
    place_px: Array, offset_px: Array, part: Array, width_px: float, size: int
) -> tuple[Array, Array]:
    """Light of a form (size, size) whose whole is 1, and its derivatives (3, size, size) by x, y and the width.

    ``place_px`` (2,) counts from the first pixel; ``offset_px`` (k, 2) are the form's points from there.
    """
    centre = place_px + offset_px
    gx, dx, sx = _gathered(centre[:, 0], width_px, size)
    gy, dy, sy = _gathered(centre[:, 1], width_px, size)

    def laid(of_y: Array, of_x: Array) -> Array:
        return np.asarray((part[:, None] * of_y).mT @ of_x)

    return laid(gy, gx), np.stack([laid(gy, dx), laid(dy, gx), laid(sy, gx) + laid(gy, sx)])


def _gathered(centre: Array, width: float, size: int) -> tuple[Array, Array, Array]:
    """What each pixel (k, size) gathers along an axis, and that by the centre and by the width."""
    from ...solve.probability import ndtr

    edge = (np.arange(size + 1) - 0.5 - centre[:, None]) / width
    density = np.exp(-0.5 * edge**2) / np.sqrt(2.0 * np.pi)
    g = np.diff(ndtr(edge), axis=-1)
    return g, -np.diff(density, axis=-1) / width, -np.diff(edge * density, axis=-1) / width
