"""The shared errors of a large table, eliminated as the sparse matter they are.

With ``v = z + A x + G a + D b`` in units of the stated errors (:mod:`starplumb.solve.whitening`), a those of images
and b those of landmarks seen more than once, the equations for C = argmin ``|[A, z] - [G, D] C|^2 + |C|^2`` have a
block of their own for every image (6 x 6) and landmark (3 x 3), and one (6 x 3) for every pair that meets.  One side
is eliminated node by node (:mod:`starplumb.solve.covisibility` says which), what is left of the other is block
tridiagonal.  The normal equations of x then follow as a sum of squares::

    information = R^T R + C^T C,    R = [A, z] - [G, D] C

which keeps its digits where stated errors many times the noise would make a difference of sums lose them (an error of C
enters squared).  Sightings are read in chunks; what stays is one 6 x 3 block and k + 1 residuals of each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..table.observations import Observations
from .covisibility import plans
from .elimination import Elimination, Normal, Woven
from .whitening import Design, Roots, Rows, accumulate, groups

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Read = Callable[[Roots, Rows], Design]
"""The design of rows of a table without batch axes, given the roots of its covariances."""

CHUNK = 16_384
"""Sightings of a chunk."""


@dataclass(frozen=True)
class Table:
    """A table, how its rows are read, the number k of its common parameters, the roots of its covariances, and the
    pairs of an image and a landmark that meet: ``pair`` (n,) of each sighting (-1: none), ``image`` and ``landmark``
    (E,) of each pair."""

    o: Observations
    read: Read
    k: int
    roots: Roots
    pair: Index
    image: Index
    landmark: Index

    @classmethod
    def of(cls, o: Observations, read: Read) -> Table:
        roots = Roots.of(o)
        again = np.flatnonzero(roots.place >= 0)
        q = max(1, roots.repeated.size)
        keys, pairs = np.unique(o.image[again] * q + roots.place[again], return_inverse=True)
        pair = np.full(o.n, -1)
        pair[again] = pairs
        k = read(roots, slice(0, 1)).P.shape[-1] - 7
        return cls(o, read, k, roots, pair, keys // q, keys % q)

    def rows(self) -> Iterator[Rows]:
        """Rows of whole images, chunk by chunk."""
        image = self.o.image
        ordered = bool(np.all(image[:-1] <= image[1:]))
        order = None if ordered else np.argsort(image, kind="stable")
        ends = np.cumsum(np.bincount(image, minlength=self.o.n_images))
        start = 0
        while start < image.size:
            stop = int(ends[min(int(np.searchsorted(ends, start + CHUNK)), ends.size - 1)])
            yield slice(start, stop) if order is None else order[start:stop]
            start = stop

    def chunks(self) -> Iterator[tuple[Rows, Design]]:
        """The same with their design."""
        return ((rows, self.read(self.roots, rows)) for rows in self.rows())

    def normal(self) -> Normal:
        """Normal equations of the shared errors, with [A, z] on the right-hand side."""
        m, q, s = self.o.n_images, self.roots.repeated.size, self.k + 1
        images, landmarks = np.zeros((m, 6, 6 + s)), np.zeros((q, 3, 3 + s))
        IL = np.zeros((self.image.size, 6, 3))
        for rows, d in self.chunks():
            image = self.o.image[rows]
            first = int(image.min())
            for group, sightings in groups(image - first, int(image.max()) - first + 1):
                of_image = d.P[sightings].reshape(group.size, -1, 6 + s)
                images[first + group] = of_image[..., :6].mT @ of_image
            again = np.flatnonzero(d.place >= 0)
            if again.size:
                D, P = d.D[again], d.P[again]
                right = np.concatenate([D, P[..., 6:]], axis=-1)
                accumulate(landmarks, D.mT @ right, d.place[again])
                accumulate(IL, P[..., :6].mT @ D, self.pair[rows][again])
        images[..., :6] += np.eye(6)
        landmarks[..., :3] += np.eye(3)
        return Normal(images[..., :6], landmarks[..., :3], IL, images[..., 6:], landmarks[..., 3:])


@dataclass(frozen=True)
class Shared:
    """The shared errors of a table eliminated: ``parts`` of the graph; ``C_image`` (m, 6, k + 1) and ``C_landmark``
    (q, 3, k + 1) by column of [A, z]; ``left`` (n, 2, k + 1) what they leave of it, and ``squares`` (k + 1, k + 1) its
    normal equations."""

    table: Table
    parts: list[Elimination]
    C_image: Array
    C_landmark: Array
    left: Array
    squares: Array

    @classmethod
    def of(cls, o: Observations, read: Read, patience: float = 1.0) -> Shared:
        """``patience`` is how much longer than iterations a factor may take, for :meth:`cofactors` need one.

        Raises LinAlgError where the numbers are not finite, or their solution does not converge.
        """
        t = Table.of(o, read)
        n = t.normal()
        C_image, C_landmark = np.zeros_like(n.IF), np.zeros_like(n.LF)
        parts = []
        for plan in plans(t.image, t.landmark, o.n_images, t.roots.repeated.size):
            if plan.gone.size or plan.kept.size:
                part = Elimination.of(plan, n, patience)
                gone, kept = (C_image, C_landmark) if plan.images_go else (C_landmark, C_image)
                gone[plan.gone], kept[plan.kept] = part.solve(n)
                parts.append(part)
        del n
        left = np.empty((o.n, 2, t.k + 1))
        squares = _square(C_image) + _square(C_landmark)
        for rows, d in t.chunks():
            R = left_over(d, C_image[o.image[rows]], C_landmark)
            left[rows] = R
            squares += _square(R)
        return cls(t, parts, C_image, C_landmark, left, squares)

    @property
    def factored(self) -> bool:
        """Whether the inverse can be had: no part is too closely woven."""
        return not any(isinstance(part.kept, Woven) for part in self.parts)

    def cofactors(self) -> Normal:
        """The blocks of the shared errors' inverse normal equations where these have any (and no right-hand side)."""
        t = self.table
        m, q, E = t.o.n_images, t.roots.repeated.size, t.image.size
        II = np.tile(np.eye(6), (m, 1, 1))
        none = np.zeros((0, 6, 0)), np.zeros((0, 3, 0))
        z = Normal(II, np.zeros((q, 3, 3)), np.zeros((E, 6, 3)), *none)
        for part in self.parts:
            part.cofactors(z)
        return z


def left_over(d: Design, C_image: Array, C_landmark: Array) -> Array:
    """[A, z] (n, 2, k + 1) of a design less the shared errors: C (n, 6, k + 1) of each sighting's image, and C
    (q, 3, k + 1) of landmarks."""
    R = d.P[..., 6:] - d.P[..., :6] @ C_image
    again = np.flatnonzero(d.place >= 0)
    if again.size:
        R[again] -= d.D[again] @ C_landmark[d.place[again]]
    return np.asarray(R)


def _square(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[-1])
    return np.asarray(flat.mT @ flat)
