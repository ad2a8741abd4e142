"""The shared errors of a large table, eliminated as the sparse matter they are.

With ``v = z + A x + G a + D b`` in units of the stated errors (:mod:`starplumb.whitening`), a those of images and b
those of landmarks seen more than once, the equations for C = argmin ``|[A, z] - [G, D] C|^2 + |C|^2`` have a block of
their own for every image (6 x 6) and landmark (3 x 3), and one (6 x 3) for every pair that meets.  One side is
eliminated node by node (:mod:`starplumb.covisibility` says which), what is left of the other is block tridiagonal.  The
normal equations of x then follow as a sum of squares::

    information = R^T R + C^T C,    R = [A, z] - [G, D] C

which keeps its digits where stated errors many times the noise would make a difference of sums lose them (an error of C
enters squared).  Sightings are read in chunks; what stays is one 6 x 3 block and k + 1 residuals of each.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .conjugate import conjugate_gradients
from .covisibility import Plan, plans
from .model import Linearised
from .observations import Observations
from .tridiagonal import BlockTridiagonal
from .whitening import Design, Roots, groups, sums

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CHUNK = 16_384
"""Sightings of a chunk."""
WINDOW = 1 << 19
"""Doubles of eliminated rows that are spread out at a time."""
STORED = 1 << 27
"""Doubles (1 GB) up to which the kept side's matrix is factored..."""
CUBES, CUBES_PER_PAIR = 5e10, 1e5
"""...and sum of the cubes of its blocks' widths: in all a few seconds, or a few hundred iterations instead."""
SPARSE = 0.03
"""Share of a window's entries below which its rows are multiplied as sparse ones."""


@dataclass(frozen=True)
class Table:
    """A table without batch axes, its linearisation and design A (n, 2, k), roots of its covariances, and the pairs of
    an image and a landmark that meet: ``pair`` (n,) of each sighting (-1: none), ``image`` and ``landmark`` (E,)."""

    o: Observations
    model: Linearised
    A: Array
    roots: Roots
    pair: Index
    image: Index
    landmark: Index

    @classmethod
    def of(cls, o: Observations, model: Linearised, A: Array) -> Table:
        roots = Roots.of(o)
        again = np.flatnonzero(roots.place >= 0)
        q = max(1, roots.repeated.size)
        keys, pairs = np.unique(o.image[again] * q + roots.place[again], return_inverse=True)
        pair = np.full(o.n, -1)
        pair[again] = pairs
        return cls(o, model, A, roots, pair, keys // q, keys % q)

    @property
    def k(self) -> int:
        return int(self.A.shape[-1])

    def chunks(self) -> Iterator[tuple[slice | Index, Design]]:
        """Rows of whole images and their design."""
        image = self.o.image
        ordered = bool(np.all(image[:-1] <= image[1:]))
        order = None if ordered else np.argsort(image, kind="stable")
        ends = np.cumsum(np.bincount(image, minlength=self.o.n_images))
        start = 0
        while start < image.size:
            stop = int(ends[min(int(np.searchsorted(ends, start + CHUNK)), ends.size - 1)])
            rows = slice(start, stop) if order is None else order[start:stop]
            yield rows, self.roots.rows(self.o, self.model, self.A, rows)
            start = stop


@dataclass(frozen=True)
class Normal:
    """Normal equations of the shared errors: ``II`` (m, 6, 6) and ``LL`` (q, 3, 3), unit prior included, ``IL``
    (E, 6, 3) of the pairs that meet, right-hand sides ``IF`` (m, 6, k + 1) and ``LF`` (q, 3, k + 1) for [A, z]."""

    II: Array
    LL: Array
    IL: Array
    IF: Array
    LF: Array

    @classmethod
    def of(cls, t: Table) -> Normal:
        m, q, s = t.o.n_images, t.roots.repeated.size, t.k + 1
        images, landmarks = np.zeros((m, 6, 6 + s)), np.zeros((q, 3, 3 + s))
        IL = np.zeros((t.image.size, 6, 3))
        for rows, d in t.chunks():
            image = t.o.image[rows]
            first = int(image.min())
            for group, sightings in groups(image - first, int(image.max()) - first + 1):
                of_image = d.P[sightings].reshape(group.size, -1, 6 + s)
                images[first + group] = of_image[..., :6].mT @ of_image
            again = np.flatnonzero(d.place >= 0)
            if again.size:
                D, P = d.D[again], d.P[again]
                right = np.concatenate([D, P[..., 6:]], axis=-1)
                _add(landmarks, D.mT @ right, d.place[again])
                _add(IL, P[..., :6].mT @ D, t.pair[rows][again])
        images[..., :6] += np.eye(6)
        landmarks[..., :3] += np.eye(3)
        return cls(images[..., :6], landmarks[..., :3], IL, images[..., 6:], landmarks[..., 3:])


def _add(total: Array, values: Array, index: Index) -> None:
    """Add values (n, a, b) to total (N, a, b) at index (n,), which may name a place more than once."""
    present, place = np.unique(index, return_inverse=True)
    total[present] += sums(values, place, present.size)


@dataclass(frozen=True)
class Elimination:
    """One side of a part of the graph eliminated: ``root`` (g, e, e) the inverse Cholesky factors of its own blocks,
    ``M`` (E, e, s) = root times coupling, ``kept`` what solves for the other side."""

    plan: Plan
    root: Array
    M: Array
    kept: BlockTridiagonal | Woven

    @classmethod
    def of(cls, plan: Plan, n: Normal) -> Elimination:
        own, other = (n.II, n.LL) if plan.images_go else (n.LL, n.II)
        root = np.linalg.inv(np.linalg.cholesky(own[plan.gone]))
        M = np.empty((plan.edges.size, *plan.sizes))
        for part in _parts(plan.edges.size):
            W = n.IL[plan.edges[part]]
            M[part] = root[plan.row[part]] @ (W if plan.images_go else W.mT)
        if plan.width_squares > STORED or plan.width_cubes > max(CUBES, CUBES_PER_PAIR * plan.edges.size):
            return cls(plan, root, M, Woven.of(plan, M, other[plan.kept]))
        return cls(plan, root, M, BlockTridiagonal.factor(*_reduced(plan, M, other[plan.kept])))

    def solve(self, n: Normal) -> tuple[Array, Array]:
        """C of the nodes that are gone (g, e, k + 1) and of those kept (h, s, k + 1)."""
        p, (e, s), width = self.plan, self.plan.sizes, n.IF.shape[-1]
        gone, kept = (n.IF, n.LF) if p.images_go else (n.LF, n.IF)
        right = (self.root @ gone[p.gone]).reshape(e * p.gone.size, width)
        taken = _transposed(p, self.M, right.reshape(p.gone.size, e, width))
        C_kept = self.kept.solve((kept[p.kept] - taken).reshape(s * p.kept.size, width))
        right -= _sparse(p, self.M, slice(0, p.gone.size)) @ C_kept
        return self.root.mT @ right.reshape(p.gone.size, e, width), C_kept.reshape(p.kept.size, s, width)


@dataclass(frozen=True)
class Woven:
    """What is left of the kept side where all of it hangs together too closely to be factored: ``own`` (h, s, s) blocks
    and the eliminated rows M, taken for what they are; conjugate gradients with the diagonal blocks' inverse."""

    own: Array
    M: Any
    M_transposed: Any
    inverse: Array

    @classmethod
    def of(cls, plan: Plan, M: Array, own: Array) -> Woven:
        rows = _sparse(plan, M, slice(0, plan.gone.size))
        left = own.copy()
        for part in _parts(plan.edges.size):
            _add(left, -(M[part].mT @ M[part]), plan.column[part])
        return cls(own, rows, rows.T, np.asarray(np.linalg.inv(left), dtype=np.float64))

    def solve(self, right: Array) -> Array:
        def blocks(B: Array, y: Array) -> Array:
            return np.asarray((B @ y.reshape(*B.shape[:2], -1)).reshape(y.shape))

        return conjugate_gradients(
            lambda y: blocks(self.own, y) - self.M_transposed @ (self.M @ y),
            lambda r: blocks(self.inverse, r),
            right,
        )


def _parts(count: int) -> Iterator[slice]:
    return (slice(at, min(at + CHUNK, count)) for at in range(0, count, CHUNK))


def _transposed(plan: Plan, M: Array, right: Array) -> Array:
    """M^T right, (h, s, c), of right (g, e, c)."""
    total = np.zeros((plan.kept.size, plan.sizes[1], right.shape[-1]))
    for part in _parts(plan.edges.size):
        _add(total, M[part].mT @ right[plan.row[part]], plan.column[part])
    return total


def _sparse(plan: Plan, M: Array, gone: slice, first: int = 0, last: int | None = None) -> Any:
    """Rows of M of some nodes, columns from kept node ``first`` to ``last``, as a sparse matrix of blocks."""
    from scipy.sparse import bsr_array

    (e, s), last = plan.sizes, plan.kept.size if last is None else last
    begin = np.searchsorted(plan.row, np.arange(gone.start, gone.stop + 1))
    part = slice(int(begin[0]), int(begin[-1]))
    shape = (e * (gone.stop - gone.start), s * (last - first))
    return bsr_array((M[part], plan.column[part] - first, begin - begin[0]), shape=shape)


def _reduced(plan: Plan, M: Array, own: Array) -> tuple[list[Array], list[Array]]:
    """What the elimination leaves of the kept side's matrix, own blocks (h, s, s): its blocks, and those below them."""
    s, diagonal, below = plan.sizes[1], [], []
    for first, last in pairwise(plan.blocks.tolist()):
        block = np.zeros((last - first, s, last - first, s))
        block[np.arange(last - first), :, np.arange(last - first), :] = own[first:last]
        diagonal.append(block.reshape(s * (last - first), -1))
    for D, E in pairwise(diagonal):
        below.append(np.zeros((E.shape[0], D.shape[0])))
    starts = np.searchsorted(plan.window, np.arange(len(diagonal) + 1))
    for k, (begin, end) in enumerate(pairwise(starts.tolist())):
        if begin == end:
            continue
        first, last = int(plan.blocks[k]), int(plan.blocks[min(k + 2, len(diagonal))])
        S, w = _squares(plan, M, slice(begin, end), (first, last)), diagonal[k].shape[0]
        diagonal[k] -= S[:w, :w]
        if k < len(below):
            below[k] -= S[w:, :w]
            diagonal[k + 1] -= S[w:, w:]
    return diagonal, below


def _squares(plan: Plan, M: Array, gone: slice, kept: tuple[int, int]) -> Array:
    """M^T M over some eliminated nodes, all of whose neighbours lie in a range of the kept ones."""
    (e, s), (first, last) = plan.sizes, kept
    begin = np.searchsorted(plan.row, np.arange(gone.start, gone.stop + 1))
    if begin[-1] - begin[0] < SPARSE * (gone.stop - gone.start) * (last - first):
        rows = _sparse(plan, M, gone, first, last).tocsr()
        return np.asarray((rows.T @ rows).toarray())
    total = np.zeros((s * (last - first), s * (last - first)))
    size = max(1, WINDOW // (e * s * (last - first)))
    for at in range(0, gone.stop - gone.start, size):
        count = min(size, gone.stop - gone.start - at)
        part = slice(int(begin[at]), int(begin[at + count]))
        rows = np.zeros((count, last - first, e, s))
        rows[plan.row[part] - gone.start - at, plan.column[part] - first] = M[part]
        flat = rows.transpose(0, 2, 1, 3).reshape(count * e, -1)
        total += flat.T @ flat
    return total


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
    def of(cls, o: Observations, model: Linearised, A: Array) -> Shared:
        """Raises LinAlgError where the numbers are not finite, or their solution does not converge."""
        t = Table.of(o, model, A)
        n = Normal.of(t)
        C_image, C_landmark = np.zeros_like(n.IF), np.zeros_like(n.LF)
        parts = []
        for plan in plans(t.image, t.landmark, o.n_images, t.roots.repeated.size):
            if plan.gone.size or plan.kept.size:
                part = Elimination.of(plan, n)
                gone, kept = (C_image, C_landmark) if plan.images_go else (C_landmark, C_image)
                gone[plan.gone], kept[plan.kept] = part.solve(n)
                parts.append(part)
        del n
        left = np.empty((o.n, 2, t.k + 1))
        squares = _square(C_image) + _square(C_landmark)
        for rows, d in t.chunks():
            R = d.P[..., 6:] - d.P[..., :6] @ C_image[o.image[rows]]
            again = np.flatnonzero(d.place >= 0)
            if again.size:
                R[again] -= d.D[again] @ C_landmark[d.place[again]]
            left[rows] = R
            squares += _square(R)
        return cls(t, parts, C_image, C_landmark, left, squares)


def _square(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[-1])
    return np.asarray(flat.T @ flat)
