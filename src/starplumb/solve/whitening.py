"""Observations and unknowns in units of their stated errors: the design that least squares works with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.components import Row, Triple, larger, root
from ..physics.covariance import pixel_entries, square_root
from ..table.equation import Linearised
from ..table.observations import Observations
from .chunks import Rows, repeated_landmarks

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def least(a: Row, b: Row, c: Row) -> Row:
    """What is left of c by ``[[a, b], [b, c]]`` where the other number is known: the least that it can be, too, in a
    sum of this and other covariances."""
    return c - b * b / a


def inverse_root(a: Row, b: Row, c: Row, smallest: Row) -> Triple:
    """L^-1 (00, 10, 11) of ``L L^T = [[a, b], [b, c]]``; what is left of c is not below ``smallest``."""
    x = 1.0 / root(a)
    l10 = b * x
    # rounding may take the difference below what it can be
    y = 1.0 / root(larger(c - l10 * l10, smallest))
    return x, -l10 * x * y, y


def _whitened(W: Array, X: Array) -> Array:
    """W X in place of X (..., 2, s), W (..., 2, 2) lower triangular."""
    X[..., 1, :] *= W[..., 1, 1, None]
    X[..., 1, :] += W[..., 1, 0, None] * X[..., 0, :]
    X[..., 0, :] *= W[..., 0, 0, None]
    return X


@dataclass(frozen=True)
class Design:
    """Whitened observations ``v = z + A x + G a + D b`` in the unknowns' own units (unit prior on a and b).

    ``P`` (..., n, 2, 6 + k + 1) holds ``[G, A, z]``; ``D`` (..., n, 2, 3) is zero for a landmark seen once.
    ``repeated`` (q,) are the landmarks seen more than once, ``place`` (n,) that of each sighting's (-1: not there).
    ``W`` (..., n, 2, 2) is what whitened them: units of sigma per pixel of column and row.
    """

    P: Array
    D: Array
    W: Array
    repeated: Index
    place: Index


@dataclass(frozen=True)
class Roots:
    """Square roots of the stated covariances of a table and who shares them: ``S_attitude``, ``S_position``
    (..., m, 3, 3) and ``S_landmark`` (..., q, 3, 3) turn a, a and b of :class:`Design` into their own units."""

    S_attitude: Array
    S_position: Array
    S_landmark: Array
    repeated: Index
    place: Index

    @classmethod
    def of(cls, o: Observations) -> Roots:
        repeated = repeated_landmarks(o)
        return cls(
            square_root(o.cov_attitude_E),
            square_root(o.cov_position_J),
            square_root(o.cov_landmark_J[..., repeated, :, :]),
            repeated,
            _places(o, repeated),
        )

    def design(self, o: Observations, model: Linearised, A: Array, rows: Rows = slice(None)) -> Design:
        """The design of a table that is these rows of the one the roots are of; sightings of weight zero vanish."""
        place, image, R = self.place[rows], o.image, model.R
        again = np.flatnonzero(place >= 0)
        a, b, c = pixel_entries(o.sigma_px, o.ellipse)
        smallest = least(a, b, c)
        if again.size < place.size:
            once = place < 0
            spread = R @ o.cov_landmark_J[..., o.landmark, :, :]
            across, down = R[..., 0, :], R[..., 1, :]
            a = a + once * np.sum(spread[..., 0, :] * across, axis=-1)
            b = b + once * np.sum(spread[..., 1, :] * across, axis=-1)
            c = c + once * np.sum(spread[..., 1, :] * down, axis=-1)
        strength = np.sqrt(o.weight)
        entries = [strength * entry for entry in inverse_root(a, b, c, smallest)]
        W = np.zeros((*np.broadcast_shapes(*(entry.shape for entry in entries)), 2, 2))
        W[..., 0, 0], W[..., 1, 0], W[..., 1, 1] = entries
        blocks = [
            model.H @ self.S_attitude[..., image, :, :],
            -R @ self.S_position[..., image, :, :],
            A,
            model.z_px[..., None],
        ]
        batch = np.broadcast_shapes(W.shape[:-3], *(block.shape[:-3] for block in blocks))
        P = np.empty((*batch, place.size, 2, A.shape[-1] + 7))
        for at, block in zip((0, 3, 6, P.shape[-1] - 1), blocks, strict=True):
            P[..., at : at + block.shape[-1]] = block
        D = np.zeros((*batch, place.size, 2, 3))
        if again.size:
            D[..., again, :, :] = R[..., again, :, :] @ self.S_landmark[..., place[again], :, :]
            D = _whitened(W, D)
        return Design(_whitened(W, P), D, W, self.repeated, place)


def _places(o: Observations, repeated: Index) -> Index:
    """The place of each sighting's landmark among the repeated ones, (n,), -1 where it is not there."""
    if repeated.size == 0:
        return np.broadcast_to(np.int64(-1), o.n)  # of a large table as large as a column of it
    place = np.full(o.n_landmarks, -1)
    place[repeated] = np.arange(repeated.size)
    return place[o.landmark]


def sums(values: Array, index: Index, count: int) -> Array:
    """Sums (..., count, a, b) of the values (..., n, a, b) with the same index (n,)."""
    total = np.zeros((*values.shape[:-3], count, *values.shape[-2:]))
    if index.size:
        order = np.argsort(index, kind="stable")
        present, starts = np.unique(index[order], return_index=True)
        total[..., present, :, :] = np.add.reduceat(values[..., order, :, :], starts, axis=-3)
    return total


def accumulate(total: Array, values: Array, index: Index) -> None:
    """Add values (n, a, b) to total (N, a, b) at index (n,), which may name a place more than once."""
    present, place = np.unique(index, return_inverse=True)
    total[present] += sums(values, place, present.size)


def groups(image: Index, count: int) -> Iterator[tuple[Index, Index]]:
    """Images (g,) with equally many sightings, and those sightings (g, M)."""
    order = np.argsort(image, kind="stable")
    counts = np.bincount(image, minlength=count)
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    for size in np.unique(counts[counts > 0]):
        group = np.flatnonzero(counts == size)
        yield group, order[starts[group, None] + np.arange(size)]
