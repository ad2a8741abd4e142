"""Random numbers that stand at places: the same seed gives the same ground wherever and however finely it is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_VARIANCE = (151.0 / 315.0) ** 2
"""Variance of what cubic B-splines make of white values of variance 1: the mean over all phases of
``(sum_i B(x - i)^2)^2``."""


def hashed(seed: int, i: Index, j: Index) -> Array:
    """Numbers between 0 and 1 that belong to places (i, j) of a lattice, broadcast, and to nothing else.

    The mixer is splitmix64: G. L. Steele, D. Lea, C. H. Flood, Fast splittable pseudorandom number generators,
    OOPSLA 2014.
    """
    mixed = np.asarray(seed, dtype=np.uint64)
    with np.errstate(over="ignore"):
        for part in (i, j):
            mixed = _mix(mixed ^ np.asarray(part, dtype=np.int64).astype(np.uint64))
    return np.asarray((mixed >> np.uint64(11)) * 2.0**-53)


def _mix(z: NDArray[np.uint64]) -> NDArray[np.uint64]:
    z = z + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(z ^ (z >> np.uint64(31)))


def waves(seed: int, step: float, x: Array, y: Array) -> Array:
    """Smooth noise (r, c) of mean 0 and variance 1 at columns ``x`` (c,) and rows ``y`` (r,) of a plane.

    ``n(x, y) = sum_ij v_ij B(x / step - i) B(y / step - j)`` with the cubic B-spline B and independent uniform v_ij:
    bumps about two steps wide, twice continuously differentiable.
    """
    (along, i), (across, j) = (_bumps(values / step) for values in (x, y))
    v = np.sqrt(12.0 / _VARIANCE) * (hashed(seed, i[None, :], j[:, None]) - 0.5)
    return np.asarray((across @ v) @ along.T)


def _bumps(at: Array) -> tuple[Any, Index]:
    """Weights (n, k), sparse, of the lattice's values at places (n,), and the lattice's own indices (k,)."""
    from scipy import sparse

    left = np.floor(at).astype(np.int64) - 1
    index = np.arange(left.min(), left.max() + 4)
    u = at - np.floor(at)
    taps = (
        np.stack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3], axis=-1)
        / 6.0
    )
    columns = (left - index[0])[:, None] + np.arange(4)
    starts = 4 * np.arange(at.size + 1)
    return sparse.csr_array((taps.ravel(), columns.ravel(), starts), shape=(at.size, index.size)), index


def octaves(seed: int, finest: float, coarsest: float, growth: float, x: Array, y: Array) -> Array:
    """Noise (r, c) of variance 1 in octaves from ``finest`` to ``coarsest``, each ``2^growth`` times as strong as the
    next finer one."""
    count = max(int(np.round(np.log2(coarsest / finest))) + 1, 1)
    strength = 2.0 ** (growth * np.arange(count))
    strength /= np.sqrt(np.sum(strength**2))
    total = np.zeros((y.size, x.size))
    for k in range(count):
        total += strength[k] * waves(seed + 7919 * k, finest * 2.0**k, x, y)
    return total


def smooth_step(t: Array) -> Array:
    """From 0 at t = -1 to 1 at t = 1, level at both: the blurred edge between two surfaces."""
    t = np.clip(0.5 * t + 0.5, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def in_blocks(count: int, most: int) -> list[Index]:
    """Indices from 0 to ``count`` in runs of much the same length, at most ``most``."""
    return np.array_split(np.arange(count), -(-count // most))
