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
from dataclasses import dataclass

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


def image_normals(problem: Problem, shared: Index) -> Iterator[ImageNormals]:
    """Of every image with a sighting in the solution, the landmarks ``shared`` (q,) among the unknowns."""
    place = np.zeros(problem.table.n_landmarks, dtype=np.bool_)
    place[shared] = True
    for _, linear in problem.parts():
        o = linear[0]
        rows = np.flatnonzero(o.weight > 0.0)
        rows = rows[np.argsort(o.image[rows], kind="stable")]
        starts = np.flatnonzero(np.diff(o.image[rows], prepend=-1))
        for own in np.split(rows, starts[1:]) if rows.size else ():
            yield _of_image(linear, own, place)


def _of_image(linear: Linear, rows: Index, shared: NDArray[np.bool_]) -> ImageNormals:
    o, model, A = linear
    image, landmark, R = int(o.image[rows[0]]), o.landmark[rows], model.R[rows]
    noise = (o.sigma_px[rows] ** 2)[:, None, None] * np.eye(2)
    once = ~shared[landmark]
    noise[once] += R[once] @ o.cov_landmark_J[landmark[once]] @ R[once].mT
    named, column = np.unique(landmark[~once], return_inverse=True)
    places = np.zeros((rows.size, 2, named.size, 3))
    places[np.flatnonzero(~once), :, column] = R[~once]
    own = [-model.H[rows] @ square_root(o.cov_attitude_E[image]), R @ square_root(o.cov_position_J[image])]
    parts = [A[rows], places.reshape(rows.size, 2, -1), model.z_px[rows][..., None], *own]
    # L^-1 of the noise whitens every row
    X = np.linalg.solve(np.linalg.cholesky(noise), np.concatenate(parts, axis=-1)).reshape(2 * rows.size, -1)
    X, G = X[:, :-6], X[:, -6:]
    GX = G.T @ X
    squares = X.T @ X - GX.T @ np.linalg.solve(np.eye(6) + G.T @ G, GX)
    return ImageNormals(
        image, named, squares[:-1, :-1], squares[:-1, -1], float(squares[-1, -1]), 2 * rows.size
    )
