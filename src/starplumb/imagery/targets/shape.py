"""Targets of known form: a light, a disc or a cross, as points whose light is added.

Each point is blurred by the optics and gathered by the pixels exactly, so that only the sum over the points, a
quadrature of the form's area, is not exact: to a thousandth for forms up to :data:`WIDEST` widths of the blur.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WIDEST = 12.0
"""Size of a form, in widths (sigma) of the blur, up to which its points lie densely enough."""
_RADII, _ANGLES = 8, 40
_ALONG, _ACROSS = 24, 6


@dataclass(frozen=True)
class Shape:
    """Points (k, 2), m east and north of the centre, and the part of the light that each gives (k,), 1 together;
    ``reach_m`` is the farthest place of the form from its centre."""

    place_m: Array
    part: Array
    reach_m: float

    @classmethod
    def light(cls) -> Shape:
        return cls(np.zeros((1, 2)), np.ones(1), 0.0)

    @classmethod
    def disc(cls, diameter_m: float) -> Shape:
        """A disc that is evenly bright: rings of equal angles, their radii a Gauss rule of the area."""
        area, part = _gauss(_RADII)
        turn = 2.0 * np.pi * (np.arange(_ANGLES) + 0.5 * (np.arange(_RADII)[:, None] % 2)) / _ANGLES
        radius = 0.5 * diameter_m * np.sqrt(area)[:, None]
        place = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1).reshape(-1, 2)
        return cls(place, np.repeat(part / _ANGLES, _ANGLES), 0.5 * diameter_m)

    @classmethod
    def cross(cls, length_m: float, width_m: float) -> Shape:
        """Two bars of this length and width across each other, along east and north."""
        arm = 0.5 * (length_m - width_m)
        out = 0.5 * width_m + 0.5 * arm
        parts = [
            _bar(0.0, 0.0, length_m, width_m),
            _bar(0.0, out, width_m, arm),
            _bar(0.0, -out, width_m, arm),
        ]
        place, area = (np.concatenate(each) for each in zip(*parts, strict=True))
        return cls(place, area / area.sum(), float(np.hypot(0.5 * length_m, 0.5 * width_m)))


def _gauss(n: int) -> tuple[Array, Array]:
    """Places between 0 and 1 and weights, 1 together."""
    x, w = np.polynomial.legendre.leggauss(n)
    return 0.5 * (x + 1.0), 0.5 * w


def _bar(x: float, y: float, width: float, height: float) -> tuple[Array, Array]:
    """Points (k, 2) of a rectangle about a place, and their areas."""
    counts = [_ALONG if side > min(width, height) else _ACROSS for side in (width, height)]
    (u, wu), (v, wv) = (_gauss(n) for n in counts)
    place = np.stack(np.meshgrid(x + width * (u - 0.5), y + height * (v - 0.5), indexing="ij"), axis=-1)
    return place.reshape(-1, 2), width * height * (wu[:, None] * wv).ravel()
