"""Drawn relief: heights of the ground below a drawn plane, and errors that a reference shares over a distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...ground.grid import Terrain
from .noise import octaves
from .plane import Plane

Array = NDArray[np.float64]

ROUGHNESS = 1.1
"""Each octave of the relief is 2^1.1 times as high as the next finer one: slopes grow only slowly with finer scales."""
FINEST_POSTS, WIDEST_POSTS = 6.0, 200.0
"""Posts to the finest octave, so that heights that are bilinear between posts are still smooth, and to the widest."""
NODES_A_LENGTH = 4.0
MOST_NODES = 40
"""Nodes of an error field to its correlation length, and at most along a side: its covariance is a dense matrix."""


def relief(
    seed: int,
    plane: Plane,
    x: tuple[float, float],
    y: tuple[float, float],
    post_m: float,
    low: float,
    rms: float,
) -> Terrain:
    """Heights (m) on a grid of posts ``post_m`` apart that covers ``x`` and ``y`` (first, last, m) of the plane.

    Hills from 6 to 200 posts wide, their standard deviation ``rms`` and their mean ``low + 3 rms`` over a wide ground;
    the same posts have the same heights whatever the grid covers.
    """
    columns, rows = (post_m * np.arange(np.floor(a / post_m), np.ceil(b / post_m) + 1.0) for a, b in (x, y))
    hills = octaves(seed, FINEST_POSTS * post_m, WIDEST_POSTS * post_m, ROUGHNESS, columns, rows)
    latitude, longitude = plane.geodetic(columns, rows[::-1])
    step = (float(latitude[1] - latitude[0]), float(longitude[1] - longitude[0]))
    height = np.ascontiguousarray((low + 3.0 * rms + rms * hills)[::-1])
    return Terrain(height, float(latitude[0]), float(longitude[0]), step)


@dataclass(frozen=True)
class ErrorField:
    """A draw of an error that is shared over a distance: values (j, i) at nodes ``x`` (i,) and ``y`` (j,) m."""

    x: Array
    y: Array
    values: Array

    @classmethod
    def draw(
        cls,
        rng: np.random.Generator,
        sigma: float,
        length: float,
        x: tuple[float, float],
        y: tuple[float, float],
    ) -> ErrorField:
        """Normal, with the covariance ``sigma^2 exp(-distance / length)`` at the nodes, smooth between them."""
        nodes = [_nodes(side, length) for side in (x, y)]
        at = np.stack(np.meshgrid(*nodes), axis=-1).reshape(-1, 2)
        apart = np.linalg.norm(at[:, None] - at, axis=-1)
        root = np.linalg.cholesky(np.exp(-apart / length))
        values = sigma * (root @ rng.standard_normal(len(at)))
        return cls(nodes[0], nodes[1], values.reshape(nodes[1].size, nodes[0].size))

    def at(self, x: Array, y: Array) -> Array:
        """The error (r, c) at columns ``x`` (c,) and rows ``y`` (r,), both growing."""
        from scipy.interpolate import RectBivariateSpline

        return np.asarray(RectBivariateSpline(self.y, self.x, self.values)(y, x))


def _nodes(side: tuple[float, float], length: float) -> Array:
    count = int(np.clip(np.ceil(NODES_A_LENGTH * (side[1] - side[0]) / length), 4, MOST_NODES))
    return np.linspace(side[0], side[1], count)
