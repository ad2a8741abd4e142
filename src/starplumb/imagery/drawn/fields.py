"""Ground divided into fields: cells about scattered seeds, their borders, and numbers that belong to each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .noise import hashed, smooth_step

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SCATTER = 0.6
"""Part of its lattice cell in which a seed may lie: the two nearest seeds are then among the nine cells around."""


@dataclass(frozen=True)
class Cells:
    """At each of n places: the cell it lies in and the one next to it, as indices (n,) into the lattice ``i, j`` (k,),
    and the distance ``gap`` (n,) m from the border between them."""

    i: Index
    j: Index
    own: Index
    other: Index
    gap: Array

    def number(self, seed: int) -> Array:
        """A number (k,) between 0 and 1 for each cell."""
        return hashed(seed, self.i, self.j)

    def blended(self, values: Array, width: float) -> Array:
        """Values (k,) of the cells at the places (n,), running into one another over ``width`` m on either side."""
        other = values[self.other]
        return np.asarray(other + smooth_step(self.gap / width) * (values[self.own] - other))


def cells(seed: int, size: float, x: Array, y: Array) -> Cells:
    """The cells at columns ``x`` (c,) and rows ``y`` (r,) of a plane, flat (r c,): those of the nearest of seeds that
    are scattered one to each square of ``size`` m.

    ``gap = (|p - s_2|^2 - |p - s_1|^2) / (2 |s_2 - s_1|)``, s_1 and s_2 the nearest and the second nearest seed.
    """
    i, j = (np.floor(values / size).astype(np.int64) for values in (x, y))
    columns, rows = np.arange(i.min() - 1, i.max() + 2), np.arange(j.min() - 1, j.max() + 2)
    down, right = np.meshgrid(rows, columns, indexing="ij")
    seeds = [
        size * (k + 0.5 + SCATTER * (hashed(seed + s, right, down) - 0.5)) for s, k in ((1, right), (2, down))
    ]
    near = _two_nearest(seeds, i - columns[0], j - rows[0], x, y)
    sx, sy = (values.ravel() for values in seeds)
    own, other, first, second = near
    apart = np.hypot(sx[other] - sx[own], sy[other] - sy[own])
    return Cells(right.ravel(), down.ravel(), own, other, 0.5 * (second - first) / apart)


def _two_nearest(
    seeds: list[Array], i: Index, j: Index, x: Array, y: Array
) -> tuple[Index, Index, Array, Array]:
    """Indices of the nearest and the second nearest seed of each place, flat, and the squared distances to them."""
    shape = (j.size, i.size)
    first, second = np.full(shape, np.inf), np.full(shape, np.inf)
    own, other = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)
    width = seeds[0].shape[1]
    for dj in (-1, 0, 1):
        for di in (-1, 0, 1):
            at = (j + dj)[:, None] * width + (i + di)
            sx, sy = (values.take(at) for values in seeds)
            distance = (sx - x) ** 2 + (sy - y[:, None]) ** 2
            nearest, next_to_it = distance < first, distance < second
            other = np.where(nearest, own, np.where(next_to_it, at, other))
            second = np.where(nearest, first, np.where(next_to_it, distance, second))
            own, first = np.where(nearest, at, own), np.where(nearest, distance, first)
    return own.ravel(), other.ravel(), first.ravel(), second.ravel()
