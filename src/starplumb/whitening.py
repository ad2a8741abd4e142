"""Observations and unknowns in units of their stated errors: the design that least squares works with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .model import Linearised
from .observations import Observations

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Rows = slice | Index


def square_root(covariance: Array) -> Array:
    """Symmetric S with S S = covariance (..., 3, 3); works for singular ones, zeros included."""
    if not np.any(
        covariance[..., [0, 0, 1], [1, 2, 2]]
    ):  # a diagonal, as most are: no need of its eigenvectors
        return np.asarray(np.sqrt(np.maximum(covariance, 0.0)))
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]) @ vectors.mT)


def _inverse_root_2x2(V: Array, smallest: Array) -> Array:
    """Lower triangular W with W V W^T = I for symmetric V (..., 2, 2) with no eigenvalue below ``smallest`` (...)."""
    a, b, c = V[..., 0, 0], V[..., 0, 1], V[..., 1, 1]
    l00 = np.sqrt(a)
    l10 = b / l00
    # rounding may take the difference below what it can be
    l11 = np.sqrt(np.maximum(c - l10 * l10, smallest))
    W = np.zeros_like(V)
    W[..., 0, 0], W[..., 1, 1], W[..., 1, 0] = 1.0 / l00, 1.0 / l11, -l10 / (l00 * l11)
    return W


@dataclass(frozen=True)
class Design:
    """Whitened observations ``v = z + A x + G a + D b`` in the unknowns' own units (unit prior on a and b).

    ``P`` (..., n, 2, 6 + k + 1) holds ``[G, A, z]``; ``D`` (..., n, 2, 3) is zero for a landmark seen once.
    ``repeated`` (q,) are the landmarks seen more than once, ``place`` (n,) that of each sighting's (-1: not there).
    ``W`` (..., n, 2, 2) is what whitened them: units of sigma per pixel of column and row.  ``S_attitude``,
    ``S_position`` (..., m, 3, 3) and ``S_landmark`` (..., q, 3, 3) turn a, a and b back into their own units.
    """

    P: Array
    D: Array
    W: Array
    S_attitude: Array
    S_position: Array
    S_landmark: Array
    repeated: Index
    place: Index


@dataclass(frozen=True)
class Roots:
    """Square roots of the stated covariances of a table and who shares them: see :class:`Design`."""

    S_attitude: Array
    S_position: Array
    S_landmark: Array
    repeated: Index
    place: Index

    @classmethod
    def of(cls, o: Observations) -> Roots:
        times_seen = np.bincount(o.landmark, minlength=o.n_landmarks)
        repeated = np.flatnonzero(times_seen > 1)
        place = np.full(o.n_landmarks, -1)
        place[repeated] = np.arange(repeated.size)
        return cls(
            square_root(o.cov_attitude_E),
            square_root(o.cov_position_J),
            square_root(o.cov_landmark_J[..., repeated, :, :]),
            repeated,
            place[o.landmark],
        )

    def rows(self, o: Observations, model: Linearised, A: Array, rows: Rows = slice(None)) -> Design:
        """The design of some rows of the table they were taken from; rows of weight zero vanish."""
        place, image, sigma_px = self.place[rows], o.image[rows], o.sigma_px[..., rows]
        R, again = model.R[..., rows, :, :], np.flatnonzero(self.place[rows] >= 0)
        V = (sigma_px**2)[..., None, None] * np.eye(2)
        if again.size < place.size:
            own = R @ o.cov_landmark_J[..., o.landmark[rows], :, :] @ R.mT
            V = np.where((place < 0)[:, None, None], own, 0.0) + V
        W = _inverse_root_2x2(V, sigma_px**2) * np.sqrt(o.weight[..., rows])[..., None, None]
        attitude = model.H[..., rows, :, :] @ self.S_attitude[..., image, :, :]
        position = -R @ self.S_position[..., image, :, :]
        blocks = [attitude, position, A[..., rows, :, :], model.z_px[..., rows, :, None]]
        batch = np.broadcast_shapes(W.shape[:-3], *(block.shape[:-3] for block in blocks))
        P = W @ np.concatenate([np.broadcast_to(b, (*batch, *b.shape[-3:])) for b in blocks], axis=-1)
        D = np.zeros((*batch, place.size, 2, 3))
        if again.size:
            D[..., again, :, :] = (W @ R)[..., again, :, :] @ self.S_landmark[..., place[again], :, :]
        return Design(P, D, W, self.S_attitude, self.S_position, self.S_landmark, self.repeated, place)


def whiten(o: Observations, model: Linearised, A: Array) -> Design:
    """The design in units of the stated errors."""
    return Roots.of(o).rows(o, model, A)


def sums(values: Array, index: Index, count: int) -> Array:
    """Sums (..., count, a, b) of the values (..., n, a, b) with the same index (n,)."""
    total = np.zeros((*values.shape[:-3], count, *values.shape[-2:]))
    if index.size:
        order = np.argsort(index, kind="stable")
        present, starts = np.unique(index[order], return_index=True)
        total[..., present, :, :] = np.add.reduceat(values[..., order, :, :], starts, axis=-3)
    return total


def groups(image: Index, count: int) -> Iterator[tuple[Index, Index]]:
    """Images (g,) with equally many sightings, and those sightings (g, M)."""
    order = np.argsort(image, kind="stable")
    counts = np.bincount(image, minlength=count)
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    for size in np.unique(counts[counts > 0]):
        group = np.flatnonzero(counts == size)
        yield group, order[starts[group, None] + np.arange(size)]
