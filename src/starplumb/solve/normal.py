"""Normal equations of a table, and the errors that sightings share eliminated from them.

In units of the stated errors (:mod:`starplumb.solve.whitening`) a table says ``v = z + A x + G a + D b``, with a the
errors of images (six each) and b those of landmarks seen more than once (three each).  For the columns of
``Y = [A, z]`` the shared errors that explain most of them are::

    C = argmin |Y - [G, D] C|^2 + |C|^2

Only sightings of an image couple its errors to anything: images are eliminated 6 x 6 each, and what they leave of the
landmarks (the Schur complement) is solved, dense here and sparse in :mod:`starplumb.solve.schur`.  What is left of Y
are the normal equations of the common parameters x::

    [information, right; right^T, zz] = R^T R + C^T C,    R = Y - [G, D] C
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..table.observations import Observations
from .whitening import Design, Roots, groups, sums

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Pairs:
    """The E pairs of an image and a landmark seen more than once that meet: ``image`` and ``landmark`` (E,) of each,
    and the pair ``of`` each sighting, (n,), -1 for a landmark seen once."""

    image: Index
    landmark: Index
    of: Index

    @classmethod
    def among(cls, o: Observations, roots: Roots) -> Pairs:
        again, q = np.flatnonzero(roots.place >= 0), roots.repeated.size
        if q == 0:
            return cls(again, again, roots.place)
        of = np.full(o.n, -1)
        keys, of[again] = np.unique(o.image[again] * q + roots.place[again], return_inverse=True)
        return cls(keys // q, keys % q, of)


@dataclass(frozen=True)
class Normal:
    """Normal equations in the units of the stated errors, without the unit prior of a and b.

    ``image`` (..., m, 6, 6 + s) are G^T [G, Y] of each image, ``landmark`` (..., q, 3, 3 + s) D^T [D, Y] of each
    landmark seen more than once, ``pair`` (..., E, 6, 3) G^T D of each pair that meets, and ``common`` (..., s, s)
    Y^T Y.
    """

    image: Array
    landmark: Array
    pair: Array
    common: Array


@dataclass(frozen=True)
class Cofactors:
    """Blocks of the inverse normal equations of the shared errors: of images (m, 6, 6), of landmarks (q, 3, 3) and of
    the pairs that meet (E, 6, 3)."""

    image: Array
    landmark: Array
    pair: Array


@dataclass(frozen=True)
class Eliminated:
    """Shared errors by column of Y: ``C_image`` (..., m, 6, s) and ``C_landmark`` (..., q, 3, s).

    ``cofactors`` makes their :class:`Cofactors` (no batch axes), None where they take too long.
    """

    C_image: Array
    C_landmark: Array
    cofactors: Callable[[], Cofactors | None]

    def squares(self, n: Normal) -> Array:
        """The normal equations (..., s, s) of Y less the shared errors, as a difference of sums."""
        images, landmarks = n.image[..., 6:], n.landmark[..., 3:]
        return np.asarray(n.common - _products(images, self.C_image) - _products(landmarks, self.C_landmark))

    def left(self, d: Design, image: Index) -> Array:
        """What the shared errors leave of Y, (..., n, 2, s), in sightings of these images (n,)."""
        R = d.P[..., 6:] - d.P[..., :6] @ self.C_image[..., image, :, :]
        again = np.flatnonzero(d.place >= 0)
        if again.size:
            R[..., again, :, :] -= d.D[..., again, :, :] @ self.C_landmark[..., d.place[again], :, :]
        return np.asarray(R)

    def squares_of(self, d: Design, image: Index) -> Array:
        """The same normal equations as a sum of squares, from the design of the whole table: this keeps its digits
        where stated errors ten thousand times the noise let the difference lose half of them."""
        left, images, landmarks = self.left(d, image), self.C_image, self.C_landmark
        return np.asarray(sum(_products(part, part) for part in (left, images, landmarks)))


def _products(a: Array, b: Array) -> Array:
    """Sum of a^T b over members and their rows, (..., s, s), a and b (..., count, rows, s)."""
    a, b = (x.reshape(*x.shape[:-3], x.shape[-3] * x.shape[-2], x.shape[-1]) for x in (a, b))
    return np.asarray(a.mT @ b)


def normal_equations(o: Observations, d: Design, pairs: Pairs) -> Normal:
    """Of a design held as a whole, with any batch axes."""
    m, q, batch, width = o.n_images, d.repeated.size, d.P.shape[:-3], d.P.shape[-1]
    image = np.zeros((*batch, m, 6, width))
    for group, sightings in groups(o.image, m):
        rows = d.P[..., sightings, :, :].reshape(*batch, group.size, -1, width)
        image[..., group, :, :] = rows[..., :6].mT @ rows
    again = np.flatnonzero(d.place >= 0)
    D, P = d.D[..., again, :, :], d.P[..., again, :, :]
    landmark = sums(D.mT @ np.concatenate([D, P[..., 6:]], axis=-1), d.place[again], q)
    pair = sums(P[..., :6].mT @ D, pairs.of[again], pairs.image.size)
    return Normal(image, landmark, pair, _products(d.P[..., 6:], d.P[..., 6:]))


def eliminate(n: Normal, pairs: Pairs) -> Eliminated:
    """Images first, then the landmarks seen more than once as one dense system; any batch axes."""
    GG, GY = n.image[..., :6] + np.eye(6), n.image[..., 6:]
    q, batch, (m, s) = n.landmark.shape[-3], n.image.shape[:-3], (n.image.shape[-3], GY.shape[-1])
    if q == 0:
        C, none = np.linalg.solve(GG, GY), np.zeros((*batch, 0, 3, s))
        return Eliminated(np.asarray(C), none, lambda: _of_images(GG))
    landmark = 3 * np.arange(q)[:, None] + np.arange(3)
    GD = np.zeros((*batch, m, 6, q, 3))
    GD[..., pairs.image, :, pairs.landmark, :] = np.moveaxis(n.pair, -3, 0)
    GD = GD.reshape(*batch, m, 6, 3 * q)
    pull = np.asarray(np.linalg.solve(GG, GD), dtype=np.float64)
    N = np.zeros((*batch, 3 * q, 3 * q))
    N[..., landmark[:, :, None], landmark[:, None, :]] = n.landmark[..., :3] + np.eye(3)
    N -= _products(pull, GD)
    right = n.landmark[..., 3:].reshape(*batch, 3 * q, s) - _products(pull, GY)
    b = np.linalg.solve(N, right)

    def cofactors() -> Cofactors:
        Z = np.linalg.inv(N)
        through = pull @ Z
        met = through.reshape(m, 6, q, 3)[pairs.image, :, pairs.landmark]
        blocks = Z.reshape(q, 3, q, 3)[np.arange(q), :, np.arange(q)]
        return Cofactors(np.asarray(np.linalg.inv(GG) + through @ pull.mT), blocks, -met)

    a = np.linalg.solve(GG, GY) - pull @ b[..., None, :, :]
    return Eliminated(np.asarray(a), np.asarray(b.reshape(*batch, q, 3, s)), cofactors)


def _of_images(GG: Array) -> Cofactors:
    """Where every landmark is seen once."""
    return Cofactors(np.asarray(np.linalg.inv(GG)), np.zeros((0, 3, 3)), np.zeros((0, 6, 3)))
