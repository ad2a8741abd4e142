"""Landmarks seen again and again in a large table: one sparse Schur complement.

Images and the landmarks seen more than once form a graph with an edge for every pair that meets, and only such pairs
couple unknowns.  With the normal equations of the side to eliminate ``E = L L^T`` (a small block per node), of the
retained one F, and ``M = L^-1 (coupling)``, what the elimination leaves is the Schur complement ``S = F - M^T M``.

The side is eliminated that leaves less work.  The retained nodes are ordered by their distance from the far end of
their part of the graph, so that two nodes with a common neighbour lie close together and S is block tridiagonal
(:mod:`starplumb.solve.tridiagonal`); where even that is too wide, S is not formed and conjugate gradients solve.
``docs/design/solver.md`` has what was tried.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .normal import Cofactors, Eliminated, Normal, Pairs
from .tridiagonal import BlockTridiagonal
from .whitening import sums

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK = 96
"""Unknowns that a block should have at least: below, the calls cost more than the arithmetic."""
WINDOW = 1 << 19
"""Doubles of eliminated rows that are made dense at a time."""
SPARSE = 0.03
"""Share of entries below which eliminated rows are multiplied as sparse ones."""
MOST_STORED = 1 << 27
"""Doubles (1 GB) up to which S is factored..."""
MOST_WORK = 5e10
"""...and sum of the cubes of its blocks' widths: a few seconds, as some hundred iterations take instead."""
TOLERANCE, MOST_ITERATIONS = 1e-11, 3000
"""Residual left by conjugate gradients, as a share of the right-hand side."""
IMAGE, LANDMARK = 6, 3
"""Unknowns of an image and of a landmark."""


@dataclass(frozen=True)
class Plan:
    """One side of the graph to eliminate, g nodes of e unknowns, and the other to retain, h nodes of s unknowns.

    ``eliminated`` (g,) and ``retained`` (h,) nodes in their order; ``edges`` (E,) those of the graph, of which ``row``
    and ``column`` (E,) are the places in the two, sorted by both.  ``blocks`` are where blocks of retained nodes begin,
    and their end; all neighbours of an eliminated node lie in the block of number ``window`` (g,), ascending, or the
    next one.
    """

    eliminated: Index
    retained: Index
    edges: Index
    row: Index
    column: Index
    blocks: Index
    window: Index
    sizes: tuple[int, int]

    @classmethod
    def of(cls, ends: tuple[Index, Index], retained: Index, count: int, sizes: tuple[int, int]) -> Plan:
        """For edges between nodes ``ends`` (E,), (E,) of both sides, ``count`` of them to be eliminated."""
        place = np.empty(retained.size, dtype=np.int64)
        place[retained] = np.arange(retained.size)
        column = place[ends[1]]
        nearest, farthest = np.full(count, retained.size - 1), np.zeros(count, dtype=np.int64)
        np.minimum.at(nearest, ends[0], column)
        np.maximum.at(farthest, ends[0], column)
        reach = np.arange(retained.size)
        np.maximum.at(reach, nearest, farthest)
        blocks = _blocks(np.maximum.accumulate(reach), max(1, BLOCK // sizes[1]))
        eliminated = np.argsort(nearest, kind="stable")
        position = np.empty(count, dtype=np.int64)
        position[eliminated] = np.arange(count)
        row = position[ends[0]]
        edges = np.lexsort((column, row))
        window = np.searchsorted(blocks, nearest[eliminated], side="right") - 1
        return cls(eliminated, retained, edges, row[edges], column[edges], blocks, window, sizes)

    @property
    def widths(self) -> Array:
        """Unknowns of the blocks of S."""
        return self.sizes[1] * np.diff(self.blocks).astype(np.float64)

    @property
    def work(self) -> float:
        """Floating point operations, roughly, of forming S and solving with it."""
        neighbours = np.bincount(self.row, minlength=1).astype(np.float64)
        forming = self.sizes[0] * np.sum((self.sizes[1] * neighbours) ** 2)
        return float(forming + 2.0 * np.sum(self.widths**3))

    def factored(self, patience: float) -> bool:
        """Whether S is to be factored."""
        w = self.widths
        stored = np.sum(w**2) + np.sum(w[1:] * w[:-1])
        return bool(stored <= MOST_STORED and np.sum(w**3) <= patience * MOST_WORK)

    def windows(self, M: Array) -> Iterator[tuple[int, slice, slice, Any]]:
        """Blocks k with the places of eliminated nodes whose window is k, a few at a time, those of their edges, and
        their rows of M (E, e, s) over the blocks k and k + 1 as a sparse matrix of blocks."""
        from scipy.sparse import bsr_array

        e, s = self.sizes
        begin = np.searchsorted(self.row, np.arange(self.eliminated.size + 1))
        starts = np.searchsorted(self.window, np.arange(self.blocks.size))
        for k, (start, stop) in enumerate(pairwise(starts.tolist())):
            first, last = int(self.blocks[k]), int(self.blocks[min(k + 2, self.blocks.size - 1)])
            size = max(1, WINDOW // (e * s * (last - first)))
            for at in range(start, stop, size):
                end = min(at + size, stop)
                edges = slice(int(begin[at]), int(begin[end]))
                own = (M[edges], self.column[edges] - first, begin[at : end + 1] - begin[at])
                shape = (e * (end - at), s * (last - first))
                yield k, slice(at, end), edges, bsr_array(own, shape=shape)


def _blocks(reach: Index, least: int) -> Index:
    """Where blocks begin, and the end, so that the ``reach`` (h,) of each node of a block ends in the next."""
    starts = [0]
    while starts[-1] < reach.size:
        begun = int(reach[starts[-1] - 1]) + 1 if len(starts) > 1 else 0
        starts.append(min(reach.size, max(begun, starts[-1] + least)))
    return np.array(starts)


def plan(pairs: Pairs, m: int, q: int) -> Plan:
    """The cheaper elimination of m images or q landmarks."""
    order = _from_the_far_end(pairs, m, q)
    images = Plan.of((pairs.landmark, pairs.image), order[order < m], q, (LANDMARK, IMAGE))
    landmarks = Plan.of((pairs.image, pairs.landmark), order[order >= m] - m, m, (IMAGE, LANDMARK))
    return min(images, landmarks, key=lambda plan: plan.work)


def _from_the_far_end(pairs: Pairs, m: int, q: int) -> Index:
    """All nodes, images first, ordered part by part of the graph, by distance from a node at its far end."""
    if min(IMAGE * m, LANDMARK * q) <= 10 * BLOCK:  # the smaller side is a few blocks in any order
        return np.arange(m + q)
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components, dijkstra

    # 32 bit: the oldest SciPy that we allow searches graphs with no other indices
    ends = (
        np.concatenate([pairs.image, pairs.landmark + m]).astype(np.int32),
        np.concatenate([pairs.landmark + m, pairs.image]).astype(np.int32),
    )
    graph = csr_array((np.ones(2 * pairs.image.size), ends), shape=(m + q, m + q))
    part, distance = connected_components(graph, directed=False)[1], np.zeros(m + q)
    for _ in range(
        3
    ):  # the farthest node from anywhere, the farthest from there, and the distances from that
        farthest = np.lexsort((-distance, part))
        starts = farthest[np.flatnonzero(np.diff(part[farthest], prepend=-1))].astype(np.int32)
        distance = dijkstra(graph, indices=starts, unweighted=True, min_only=True)
    return np.lexsort((distance, part))


@dataclass(frozen=True)
class Schur:
    """One side eliminated: ``root`` (g, e, e) are L^-1 in the plan's order, ``M`` (E, e, s) = L^-1 times coupling."""

    plan: Plan
    pairs: Pairs
    root: Array
    M: Array
    S: BlockTridiagonal | Iterations

    @property
    def images_eliminated(self) -> bool:
        return self.plan.sizes[0] == IMAGE

    def sides(self, images: Array, landmarks: Array) -> tuple[Array, Array]:
        """What belongs to the side eliminated and to the one retained."""
        return (images, landmarks) if self.images_eliminated else (landmarks, images)

    def solve(self, n: Normal) -> tuple[Array, Array]:
        """C of images (m, 6, c) and of landmarks (q, 3, c)."""
        p, (e, s), c = self.plan, self.plan.sizes, n.common.shape[-1]
        own, other = self.sides(n.image[..., 6:], n.landmark[..., 3:])
        right = (self.root @ own[p.eliminated]).reshape(-1, c)
        rest = np.array(other[p.retained]).reshape(-1, c)
        for k, nodes, _, rows in p.windows(self.M):
            at = s * int(p.blocks[k])
            rest[at : at + rows.shape[1]] -= rows.T @ right[e * nodes.start : e * nodes.stop]
        solved = self.S.solve(rest)
        for k, nodes, _, rows in p.windows(self.M):
            at = s * int(p.blocks[k])
            right[e * nodes.start : e * nodes.stop] -= rows @ solved[at : at + rows.shape[1]]
        found, kept = np.empty(own.shape), np.empty(other.shape)
        found[p.eliminated] = self.root.mT @ right.reshape(-1, e, c)
        kept[p.retained] = solved.reshape(-1, s, c)
        return (found, kept) if self.images_eliminated else (kept, found)

    def cofactors(self) -> Cofactors | None:
        """With Z = S^-1, that of an eliminated node is ``L^-T (1 + M Z M^T) L^-1``, and that of it with a retained
        neighbour a block of ``-L^-T M Z``; None where S is not factored."""
        if not isinstance(self.S, BlockTridiagonal):
            return None
        p, (e, s) = self.plan, self.plan.sizes
        diagonal, above = self.S.inverse_blocks()
        own, other = np.empty((p.eliminated.size, e, e)), np.empty((p.retained.size, s, s))
        pair = np.empty((p.edges.size, e, s))
        for k, (first, last) in enumerate(pairwise(p.blocks.tolist())):
            each = np.arange(last - first)
            other[p.retained[first:last]] = diagonal[k].reshape(each.size, s, -1, s)[each, :, each]
        own[p.eliminated] = self.root.mT @ self.root
        met, Z = -1, np.empty((0, 0))
        for k, nodes, edges, rows in p.windows(self.M):
            if k != met:
                met, Z = k, _window(diagonal, above, k)
            node, place = p.row[edges] - nodes.start, p.column[edges] - int(p.blocks[k])
            through = (rows @ Z).reshape(nodes.stop - nodes.start, e, -1, s)[node, :, place]
            inside = sums(through @ self.M[edges].mT, node, nodes.stop - nodes.start)
            root = self.root[nodes]
            own[p.eliminated[nodes]] += root.mT @ inside @ root
            pair[p.edges[edges]] = -(root[node].mT @ through)
        return Cofactors(own, other, pair) if self.images_eliminated else Cofactors(other, own, pair.mT)


def _window(diagonal: list[Array], above: list[Array], k: int) -> Array:
    """The inverse over blocks k and k + 1."""
    if k == len(above):
        return diagonal[k]
    return np.block([[diagonal[k], above[k]], [above[k].mT, diagonal[k + 1]]])


@dataclass(frozen=True)
class Iterations:
    """S not formed: conjugate gradients on ``F y - M^T (M y)`` with the inverse of its diagonal blocks."""

    F: Array
    M: Any
    inverse: Array

    def solve(self, right: Array) -> Array:
        """S^-1 right, (w, c).  Raises LinAlgError where iterations do not reach it, or numbers are not finite."""
        from scipy.sparse.linalg import LinearOperator, cg

        if not np.all(np.isfinite(right)):
            raise np.linalg.LinAlgError("the normal equations are not finite")

        def blocks(B: Array, y: Array) -> Array:
            return np.asarray((B @ y.reshape(*B.shape[:2], 1)).reshape(-1))

        transposed, shape = self.M.T, (right.shape[0],) * 2
        matrix = LinearOperator(shape, lambda y: blocks(self.F, y) - transposed @ (self.M @ y))
        inverse = LinearOperator(shape, lambda y: blocks(self.inverse, y))
        found = np.empty(right.shape)
        for column in range(right.shape[1]):
            found[:, column], left = cg(
                matrix, right[:, column], rtol=TOLERANCE, maxiter=MOST_ITERATIONS, M=inverse
            )
            if left:
                raise np.linalg.LinAlgError("conjugate gradients did not converge")
        return found


def _complement(p: Plan, M: Array, F: Array) -> tuple[list[Array], list[Array]]:
    """S, F being its blocks (h, s, s): its diagonal blocks, and those below them."""
    s, diagonal = p.sizes[1], []
    for first, last in pairwise(p.blocks.tolist()):
        nodes, block = np.arange(last - first), np.zeros((last - first, s, last - first, s))
        block[nodes, :, nodes] = F[first:last]
        diagonal.append(block.reshape(s * nodes.size, -1))
    below = [np.zeros((after.shape[0], before.shape[0])) for before, after in pairwise(diagonal)]
    for k, _, edges, rows in p.windows(M):
        w = diagonal[k].shape[0]
        parts = [(diagonal[k], 0, 0)]
        if k < len(below):
            parts += [(below[k], w, 0), (diagonal[k + 1], w, w)]
        if M[edges].size >= SPARSE * rows.shape[0] * rows.shape[1]:
            square = rows.toarray()
            square = square.T @ square
            for block, i, j in parts:
                block -= square[i : i + block.shape[0], j : j + block.shape[1]]
            continue
        few = rows.tocsr()
        few = few.T @ few
        for block, i, j in parts:
            found = few[i : i + block.shape[0], j : j + block.shape[1]].tocoo()
            block[found.row, found.col] -= found.data
    return diagonal, below


def _iterations(p: Plan, M: Array, F: Array) -> Iterations:
    from scipy.sparse import bsr_array

    begin = np.searchsorted(p.row, np.arange(p.eliminated.size + 1))
    shape = p.sizes[0] * p.eliminated.size, p.sizes[1] * p.retained.size
    own = F - sums(M.mT @ M, p.column, p.retained.size)
    return Iterations(F, bsr_array((M, p.column, begin), shape=shape), np.asarray(np.linalg.inv(own)))


def eliminate_sparse(n: Normal, pairs: Pairs, patience: float = 1.0) -> Eliminated:
    """:func:`starplumb.solve.normal.eliminate` without batch axes, of any number of landmarks.

    ``patience`` is how much longer than iterations a factor may take, for the cofactors need one.
    Raises LinAlgError where the numbers are not finite, or iterations do not converge.
    """
    p = plan(pairs, n.image.shape[0], n.landmark.shape[0])
    images_eliminated = p.sizes[0] == IMAGE
    G, D = n.image[..., :6] + np.eye(6), n.landmark[..., :3] + np.eye(3)
    own, other = (G, D) if images_eliminated else (D, G)
    root = np.linalg.inv(np.linalg.cholesky(own[p.eliminated]))
    coupling = n.pair[p.edges]
    M = np.asarray(root[p.row] @ (coupling if images_eliminated else coupling.mT))
    F = other[p.retained]
    S: BlockTridiagonal | Iterations
    S = BlockTridiagonal.factor(*_complement(p, M, F)) if p.factored(patience) else _iterations(p, M, F)
    schur = Schur(p, pairs, root, M, S)
    return Eliminated(*schur.solve(n), schur.cofactors)
