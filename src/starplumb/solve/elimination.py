"""One side of a co-visibility graph eliminated, the other solved for: see :mod:`starplumb.solve.arrow`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .conjugate import conjugate_gradients
from .covisibility import Plan
from .tridiagonal import BlockTridiagonal
from .whitening import accumulate, sums

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CHUNK = 16_384
"""Pairs of an image and a landmark that are worked on at a time."""
WINDOW = 1 << 19
"""Doubles of eliminated rows that are spread out at a time."""
STORED = 1 << 27
"""Doubles (1 GB) up to which the kept side's matrix is factored..."""
CUBES, CUBES_PER_PAIR = 5e10, 1e5
"""...and sum of the cubes of its blocks' widths: in all a few seconds, or a few hundred iterations instead."""
SPARSE = 0.03
"""Share of a window's entries below which its rows are multiplied as sparse ones."""


@dataclass(frozen=True)
class Normal:
    """Normal equations of the shared errors: ``II`` (m, 6, 6) and ``LL`` (q, 3, 3), unit prior included, ``IL``
    (E, 6, 3) of the pairs that meet, right-hand sides ``IF`` (m, 6, s) and ``LF`` (q, 3, s); or what of their inverse
    has the same places."""

    II: Array
    LL: Array
    IL: Array
    IF: Array
    LF: Array


@dataclass(frozen=True)
class Elimination:
    """One side of a part of the graph eliminated: ``root`` (g, e, e) the inverse Cholesky factors of its own blocks,
    ``M`` (E, e, s) = root times coupling, ``kept`` what solves for the other side."""

    plan: Plan
    root: Array
    M: Array
    kept: BlockTridiagonal | Woven

    @classmethod
    def of(cls, plan: Plan, n: Normal, patience: float) -> Elimination:
        """Factored where that costs no more than ``patience`` times what a few hundred iterations would."""
        own, other = (n.II, n.LL) if plan.images_go else (n.LL, n.II)
        root = np.linalg.inv(np.linalg.cholesky(own[plan.gone]))
        M = np.empty((plan.edges.size, *plan.sizes))
        for part in _parts(plan.edges.size):
            W = n.IL[plan.edges[part]]
            M[part] = root[plan.row[part]] @ (W if plan.images_go else W.mT)
        most = patience * max(CUBES, CUBES_PER_PAIR * plan.edges.size)
        if plan.width_squares > STORED or plan.width_cubes > most:
            return cls(plan, root, M, Woven.of(plan, M, other[plan.kept]))
        return cls(plan, root, M, BlockTridiagonal.factor(*_reduced(plan, M, other[plan.kept])))

    def cofactors(self, z: Normal) -> None:
        """Write the blocks of the inverse for this part's nodes and pairs into ``z``; the kept side must be factored.

        With Z the inverse on the kept side, that of a node gone is ``root^T (1 + M Z M^T) root``, and that of it with a
        kept neighbour a block of ``-root^T M Z``.
        """
        assert isinstance(self.kept, BlockTridiagonal)
        p, (e, s) = self.plan, self.plan.sizes
        own, other = (z.II, z.LL) if p.images_go else (z.LL, z.II)
        own[p.gone] = self.root.mT @ self.root
        diagonal, above = self.kept.inverse_blocks()
        starts = np.searchsorted(p.window, np.arange(len(diagonal) + 1)).tolist()
        for k, (begin, end) in enumerate(pairwise(starts)):
            first, last = int(p.blocks[k]), int(p.blocks[k + 1])
            nodes = np.arange(last - first)
            blocks = diagonal[k].reshape(last - first, s, last - first, s)
            other[p.kept[first:last]] = blocks[nodes, :, nodes, :]
            Z = np.ascontiguousarray(diagonal[k])
            if k < len(above):
                Z = np.block([[Z, above[k]], [above[k].mT, diagonal[k + 1]]])
            for gone, edges, rows in _spread(p, self.M, slice(begin, end), (first, first + Z.shape[0] // s)):
                through = (rows @ Z).reshape(gone.stop - gone.start, e, -1, s)
                node, place = p.row[edges] - gone.start, p.column[edges] - first
                met = through[node, :, place, :]
                inside = sums(met @ self.M[edges].mT, node, gone.stop - gone.start)
                root = self.root[gone]
                own[p.gone[gone]] += root.mT @ inside @ root
                pair = -(root[node].mT @ met)
                z.IL[p.edges[edges]] = pair if p.images_go else pair.mT

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
            accumulate(left, -(M[part].mT @ M[part]), plan.column[part])
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
        accumulate(total, M[part].mT @ right[plan.row[part]], plan.column[part])
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
    width = plan.sizes[1] * (kept[1] - kept[0])
    total = np.zeros((width, width))
    for _, _, rows in _spread(plan, M, gone, kept):
        square = rows.T @ rows
        if isinstance(square, np.ndarray):
            total += square
        else:
            few = square.tocoo()
            total[few.row, few.col] += few.data
    return total


def _spread(plan: Plan, M: Array, gone: slice, kept: tuple[int, int]) -> Iterator[tuple[slice, slice, Any]]:
    """Some eliminated nodes at a time with their edges and their rows of M over a range of the kept nodes, dense or,
    where there is little in them, sparse."""
    (e, s), (first, last) = plan.sizes, kept
    begin = np.searchsorted(plan.row, np.arange(gone.start, gone.stop + 1))
    sparse = begin[-1] - begin[0] < SPARSE * (gone.stop - gone.start) * (last - first)
    size = max(1, WINDOW // (e * s * (last - first)))
    for at in range(0, gone.stop - gone.start, size):
        count = min(size, gone.stop - gone.start - at)
        part, edges = (
            slice(gone.start + at, gone.start + at + count),
            slice(int(begin[at]), int(begin[at + count])),
        )
        if sparse:
            yield part, edges, _sparse(plan, M, part, first, last).tocsr()
            continue
        rows = np.zeros((count, last - first, e, s))
        rows[plan.row[edges] - part.start, plan.column[edges] - first] = M[edges]
        yield part, edges, rows.transpose(0, 2, 1, 3).reshape(count * e, -1)
