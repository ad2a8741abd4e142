"""Additive normal equations, image by image: what a later joint solution needs of a campaign.

For one image with the design A of the unknowns that it shares with others (the mounting, further parameters, errors in
common, the places of landmarks seen again) and the errors that are its own eliminated (attitude, position, landmarks
seen once, pixels; W the inverse of what a sighting has for itself, G the image's unit errors)::

    z + A x:    N = A^T V^-1 A,   b = A^T V^-1 z,   c = z^T V^-1 z,   V^-1 = W - W G (1 + G^T W G)^-1 G^T W

Sums of images, and of campaigns, are the normal equations of all of them; what is known beforehand is added once, and
the solution is ``x = -N^-1 b`` with the covariance ``N^-1`` and chi-square ``c + b^T x``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..physics.covariance import square_root
from .problem import Linear, Problem

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class ImageNormals:
    """Those of one image: ``information`` (k, k), ``vector`` (k,) and ``constant`` of ``count`` numbers, about the
    common unknowns of the problem and then three of each of the ``landmarks``."""

    image: int
    landmarks: Index
    information: Array
    vector: Array
    constant: float
    count: int

    def moved(self, x: Array) -> ImageNormals:
        """The same about a mounting ``exp(-x)`` times the one that they are about, x (3,) rad."""
        Nx = self.information[:, :3] @ x
        constant = self.constant - 2.0 * float(x @ self.vector[:3]) + float(x @ Nx[:3])
        return replace(self, vector=self.vector - Nx, constant=constant)


def image_normals(problem: Problem, shared: Index) -> Iterator[ImageNormals]:
    """Of every image with a sighting in the solution, the landmarks ``shared`` (q,) among the unknowns."""
    among = np.zeros(problem.table.n_landmarks, dtype=np.bool_)
    among[shared] = True
    for _, linear in problem.parts():
        yield from _of_part(linear, among)


def _of_part(linear: Linear, among: NDArray[np.bool_]) -> Iterator[ImageNormals]:
    o = linear[0]
    rows = np.flatnonzero(o.weight > 0.0)
    rows = rows[np.argsort(o.image[rows], kind="stable")]
    starts = np.flatnonzero(np.diff(o.image[rows], prepend=-1))
    if rows.size == 0:
        return
    X, D = _whitened(linear, rows, ~among[o.landmark[rows]])
    for start, end in zip(starts.tolist(), [*starts[1:].tolist(), rows.size], strict=True):
        # one product an image: those of single sightings are too many numbers where much is in common
        mine = X[start:end].reshape(-1, X.shape[-1])
        own = mine.T @ mine
        seen = start + np.flatnonzero(among[o.landmark[rows[start:end]]])
        seen = seen[np.argsort(o.landmark[rows[seen]])]
        # cameras of one moment may see a landmark each
        landmarks, first = np.unique(o.landmark[rows[seen]], return_index=True)
        N = own if seen.size == 0 else _with_places(own, X[seen], D[seen], first)
        G = N[-6:]
        N = N[:-6, :-6] - G[:, :-6].T @ np.linalg.solve(np.eye(6) + G[:, -6:], G[:, :-6])
        # the places of landmarks stand between the other unknowns and the residuals
        yield ImageNormals(
            int(o.image[rows[start]]),
            landmarks,
            N[:-1, :-1],
            N[:-1, -1],
            float(N[-1, -1]),
            2 * (end - start),
        )


def _whitened(linear: Linear, rows: Index, once: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Rows of the design of the common unknowns, the residuals and the image's unit errors (n, 2, k + 7), and those of
    the landmarks (n, 2, 3), in units of what a sighting has for itself; a landmark seen ``once`` (n,) is part of it."""
    o, model, A = linear
    image, R = o.image[rows], model.R[rows]
    noise = o.noise_px[rows]
    noise[once] += R[once] @ o.cov_landmark_J[o.landmark[rows[once]]] @ R[once].mT
    inverse_root = np.linalg.inv(np.linalg.cholesky(noise))
    attitude = -model.H[rows] @ square_root(o.cov_attitude_E)[image]
    position = R @ square_root(o.cov_position_J)[image]
    parts = [A[rows], model.z_px[rows][..., None], attitude, position]
    return inverse_root @ np.concatenate(parts, axis=-1), inverse_root @ R


def _with_places(squares: Array, X: Array, D: Array, first: Index) -> Array:
    """Normal equations of an image with three unknowns of each of the landmarks seen in rows (n, 2, ...), before the
    residuals; ``first`` (q,) are the rows at which those of the next landmark begin."""
    q, k = first.size, squares.shape[0] - 7
    N = np.zeros((k + 3 * q + 7, k + 3 * q + 7))
    others = np.concatenate([np.arange(k), np.arange(k + 3 * q, len(N))])
    N[np.ix_(others, others)] = squares
    own = k + np.arange(3 * q).reshape(q, 3)
    N[np.ix_(own.reshape(-1), others)] = np.add.reduceat(D.mT @ X, first).reshape(3 * q, -1)
    N[own[:, :, None], own[:, None, :]] = np.add.reduceat(D.mT @ D, first)
    N[:, k : k + 3 * q] = N[k : k + 3 * q].T
    return N
