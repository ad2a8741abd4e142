"""Which of images and landmarks to eliminate, and in what order to solve for the others.

Images and the landmarks seen more than once form a graph with an edge for every pair that meets.  Only such edges
couple unknowns, so that either side can be eliminated node by node; two nodes of the side that is kept are then coupled
if they have a neighbour in common.  Counted from a node at the far end, these lie at most one level apart: the kept
side's matrix is block tridiagonal, level by level, and one component of the graph knows nothing of another.  For each
component that side is eliminated which leaves less work.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.int64]

LEAST = 96
"""Unknowns that a block should have at least: below, the calls cost more than the arithmetic."""
IMAGE, LANDMARK = 6, 3
"""Unknowns of an image and of a landmark."""


@dataclass(frozen=True)
class Plan:
    """One elimination: ``gone`` (g,) and ``kept`` (h,) nodes in order; ``edges`` (E,) those of the graph in it.

    Of each edge ``row`` (E,) and ``column`` (E,) are the places of its nodes in ``gone`` and ``kept``; edges are sorted
    by both.  ``blocks`` are the places in ``kept`` where blocks begin, and their end; ``window`` (g,), ascending, the
    first of the two neighbouring blocks in which all kept neighbours of a node lie; ``images_go`` says which side goes.
    """

    gone: Index
    kept: Index
    edges: Index
    row: Index
    column: Index
    blocks: Index
    window: Index
    images_go: bool

    @property
    def sizes(self) -> tuple[int, int]:
        """Unknowns of a node that goes and of one that is kept."""
        return (IMAGE, LANDMARK) if self.images_go else (LANDMARK, IMAGE)

    @property
    def width_squares(self) -> int:
        """Entries of the kept side's matrix, blocks on and below the diagonal."""
        width = self.sizes[1] * np.diff(self.blocks)
        return int(np.sum(width**2) + np.sum(width[1:] * width[:-1]))

    @property
    def width_cubes(self) -> float:
        """Sum of the cubes of its blocks' widths."""
        return float(np.sum((self.sizes[1] * np.diff(self.blocks).astype(np.float64)) ** 3))


def plans(image: Index, landmark: Index, m: int, q: int) -> tuple[Plan, Plan]:
    """The eliminations of images and of landmarks, for the pairs (E,) of m images and q landmarks that meet."""
    component, level = _levels(image, landmark, m, q)
    images_go = _cheaper(component, level, (image, landmark), m)[component]
    node = np.arange(m + q)
    of_images = node < m
    edge_goes = images_go[image]
    found = []
    for way in (True, False):
        chosen = images_go == way
        gone, kept = node[chosen & (of_images == way)], node[chosen & (of_images != way)]
        ends = (image, landmark + m) if way else (landmark + m, image)
        found.append(_plan(gone, kept, np.flatnonzero(edge_goes == way), ends, (component, level), way, m))
    return found[0], found[1]


def _plan(
    gone: Index,
    kept: Index,
    edges: Index,
    ends: tuple[Index, Index],
    order: tuple[Index, Index],
    images_go: bool,
    m: int,
) -> Plan:
    component, level = order
    size = LANDMARK if images_go else IMAGE
    kept = kept[np.lexsort((level[kept], component[kept]))]
    turns = (np.diff(component[kept], prepend=-1) != 0) | (np.diff(level[kept], prepend=-1) != 0)
    step_starts = np.flatnonzero(turns)
    bins = (size * step_starts) // LEAST
    blocks = np.append(step_starts[np.diff(bins, prepend=-1) != 0], kept.size)
    place = np.zeros(component.size, dtype=np.int64)
    place[kept] = np.arange(kept.size)
    column = place[ends[1][edges]]
    block = np.searchsorted(blocks, column, side="right") - 1
    first = np.full(component.size, blocks.size)
    np.minimum.at(first, ends[0][edges], block)
    gone = gone[np.argsort(first[gone], kind="stable")]
    place[gone] = np.arange(gone.size)
    row = place[ends[0][edges]]
    sort = np.lexsort((column, row))
    shift = 0 if images_go else m
    return Plan(
        gone - shift,
        kept - (m - shift),
        edges[sort],
        row[sort],
        column[sort],
        blocks,
        first[gone],
        images_go,
    )


def _levels(image: Index, landmark: Index, m: int, q: int) -> tuple[Index, Index]:
    """Component and level of every node, images first: half the distance from a node at the component's far end."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = np.concatenate([image, landmark + m]), np.concatenate([landmark + m, image])
    graph = coo_array((np.ones(2 * image.size, dtype=np.int8), ends), shape=(m + q, m + q)).tocsr()
    component = connected_components(graph, directed=False)[1].astype(np.int64)
    degree = np.diff(graph.indptr)
    distance = np.zeros(m + q, dtype=np.int64)
    for _ in range(
        3
    ):  # the farthest node of a search from anywhere, of one from there, and the levels from that
        sort = np.lexsort((degree, -distance, component))
        starts = sort[np.flatnonzero(np.diff(component[sort], prepend=-1))]
        distance = _distances(graph.indptr, graph.indices, starts)
    return component, distance // 2


def _distances(begin: Index, neighbour: Index, starts: Index) -> Index:
    """Distance of every node of a graph (compressed rows) from the nearest start."""
    distance = np.full(begin.size - 1, -1)
    mark = np.empty(begin.size - 1, dtype=np.int64)
    front, d = starts, 0
    while front.size:
        distance[front] = d
        counts = begin[front + 1] - begin[front]
        at = np.repeat(begin[front] - (np.cumsum(counts) - counts), counts) + np.arange(counts.sum())
        near = neighbour[at]
        near = near[distance[near] < 0]
        mark[near] = np.arange(near.size)  # one of those that name a node writes last
        front, d = near[mark[near] == np.arange(near.size)], d + 1
    return distance


def _cheaper(component: Index, level: Index, edges: tuple[Index, Index], m: int) -> NDArray[np.bool_]:
    """For each component whether to eliminate its images: floating point operations either way, roughly."""
    count = int(component.max(initial=-1)) + 1
    key = component * (int(level.max(initial=0)) + 1) + level
    work = []
    for kept, size, other, (here, there) in (
        (slice(m, None), LANDMARK, IMAGE, (edges[0], slice(None, m))),
        (slice(None, m), IMAGE, LANDMARK, (edges[1], slice(m, None))),
    ):
        _, first, nodes = np.unique(key[kept], return_index=True, return_counts=True)
        solving = np.bincount(component[kept][first], 2.0 * (size * nodes) ** 3.0, minlength=count)
        met = np.bincount(here, minlength=component[there].size)
        solving = solving + np.bincount(component[there], other * (size * met) ** 2.0, minlength=count)
        work.append(solving)
    return np.asarray(work[0] <= work[1])
