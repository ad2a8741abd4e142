"""Reliability of large tables, a portion of whole images at a time: nothing is held but what is asked of each sighting.

Images whose landmarks are seen once share only the common parameters.  With these solved for, all else is said by an
image's own rows: with ``C = (G^T G + I)^-1 G^T A`` its errors are ``a = -(G^T G + I)^-1 G^T (z + A x)``, and a row
(G, A) has the cofactor ``(A - G C) Q (A - G C)^T + G (G^T G + I)^-1 G^T``, Q the covariance of x.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..table.equation import Linearised
from ..table.observations import Observations
from .adjustment import solve_common
from .arrow import Read, Shared, left_over
from .elimination import Normal
from .reliability import Reliability
from .streaming import Rows, Sum, blocks, part
from .whitening import Design, Roots

Array = NDArray[np.float64]
Index = NDArray[np.int64]

PATIENCE = 20.0
"""How much longer than a step of the estimate its cofactors may take: half a minute or so at most."""

Linear = Callable[[Observations], tuple[Observations, Linearised, Array]]
"""Makes the linear problem of a part of a table: the part with its parameters applied, linearised, and its design A."""


@dataclass(frozen=True)
class Portion:
    """Some rows of a table and what is known of them: ``images`` (g,) and ``landmarks`` (q,) are those that
    ``tested.images`` and ``tested.landmarks`` speak of; ``table`` has the parameters applied."""

    rows: Rows
    images: Index
    landmarks: Index
    table: Observations
    model: Linearised
    tested: Reliability


@dataclass(frozen=True)
class Tested:
    """T and its degrees of freedom, of n sightings, of m images, and of the q landmarks ``repeated``."""

    sightings: tuple[Array, Index]
    images: tuple[Array, Index]
    landmarks: tuple[Array, Index]
    repeated: Index

    @classmethod
    def empty(cls, o: Observations) -> Tested:
        """For a table: nothing tested yet."""
        repeated = np.flatnonzero(np.bincount(o.landmark, minlength=o.n_landmarks) > 1)
        n, m, q = (
            (np.zeros(size), np.zeros(size, dtype=np.int64)) for size in (o.n, o.n_images, repeated.size)
        )
        return cls(n, m, q, repeated)

    def put(self, portion: Portion) -> None:
        """Write down what a portion says."""
        landmarks = np.searchsorted(self.repeated, portion.landmarks)
        tested = portion.tested
        self.sightings[0][portion.rows], self.sightings[1][portion.rows] = tested.sightings
        self.images[0][portion.images], self.images[1][portion.images] = tested.images
        self.landmarks[0][landmarks], self.landmarks[1][landmarks] = tested.landmarks


@dataclass(frozen=True)
class Images:
    """Images (g,): ``inverse`` (g, 6, 6) of G^T G + I, ``C`` (g, 6, k), ``a`` (g, 6)."""

    inverse: Array
    C: Array
    a: Array

    @classmethod
    def of(cls, squares: Array, x: Array) -> Images:
        """Of sums (g, 6, 6 + k + 1) of G^T [G, A, z] over the sightings in the solution."""
        inverse = np.asarray(np.linalg.inv(squares[..., :6] + np.eye(6)), dtype=np.float64)
        coupled = inverse @ squares[..., 6:]
        return cls(inverse, coupled[..., :-1], -(coupled[..., -1] + coupled[..., :-1] @ x))

    def tested(self, o: Observations, d: Design, solution: Sum) -> Reliability:
        """Reliability of rows of these images: all of them, image after image, or some of a single one."""
        g, k = len(self.a), d.P.shape[-1] - 7
        P = d.P.reshape(g, -1, 7 + k)
        G = np.ascontiguousarray(P[..., :6])
        v = P[..., -1:] + G @ self.a[..., None] + P[..., 6:-1] @ solution.x[:, None]
        reduced = P[..., 6:-1] - G @ self.C
        spread, own = reduced @ solution.covariance, G @ self.inverse
        rows = [array.reshape(o.n, 2, array.shape[-1]) for array in (reduced, spread, G, own)]
        hat = np.empty((o.n, 2, 2))
        for i, j in ((0, 0), (0, 1), (1, 1)):
            hat[:, i, j] = np.vecdot(rows[0][:, i], rows[1][:, j]) + np.vecdot(rows[2][:, i], rows[3][:, j])
        hat[:, 1, 0] = hat[:, 0, 1]
        cofactor = self.inverse + self.C @ solution.covariance @ self.C.mT
        return Reliability(
            used=o.weight > 0.0,
            v=v.reshape(o.n, 2),
            hat=hat,
            per_px=d.W,
            effect=-rows[1].mT,
            image_error=self.a,
            image_cofactor=cofactor,
            landmark_error=np.zeros((0, 3)),
            landmark_cofactor=np.zeros((0, 3, 3)),
            repeated=np.zeros(0, dtype=np.int64),
        )


@dataclass(frozen=True)
class Block:
    """Rows of a table, all of ``images`` (g,) with equally many each, or some of a single one.

    ``table`` has the parameters applied, ``model`` and ``design`` are those of all its rows, whatever their weight;
    ``squares`` (g, 6, 6 + k + 1) sums G^T [G, A, z] over the images' sightings in the solution.
    """

    rows: Rows
    images: Index
    table: Observations
    model: Linearised
    design: Design
    squares: Array


def read(o: Observations, linear: Linear) -> Iterator[Block]:
    """A table of landmarks seen once, block by block."""
    roots = Roots.of(o)

    def linearised(pieces: list[Rows]) -> Iterator[tuple[Observations, Linearised, Design]]:
        for rows in pieces:
            table, model, A = linear(part(o, rows))
            of_rows = replace(roots, place=roots.place[rows])
            yield table, model, of_rows.rows(replace(table, weight=np.ones(table.n)), model, A)

    for images, pieces in blocks(o):
        if len(pieces) > 1:  # an image too large to be held at once is read twice
            squares = np.asarray(sum(_squares(table, d, 1) for table, _, d in linearised(pieces)))
            again = linearised(pieces)
        else:
            only = next(linearised(pieces))
            squares, again = _squares(only[0], only[2], images.size), iter([only])
        for rows, (table, model, d) in zip(pieces, again, strict=True):
            yield Block(rows, images, table, model, d, squares)


def single(o: Observations, linear: Linear, solution: Sum) -> Iterator[Portion]:
    """Portions of a table of landmarks seen once, given the solution for the common parameters."""
    none = np.zeros(0, dtype=np.int64)
    for block in read(o, linear):
        tested = Images.of(block.squares, solution.x).tested(block.table, block.design, solution)
        yield Portion(block.rows, block.images, none, block.table, block.model, tested)


def reader(o: Observations, linear: Linear) -> Read:
    """Reads rows of a table for :func:`starplumb.solve.adjustment.solve_large`."""

    def read(roots: Roots, rows: Rows) -> Design:
        return replace(roots, place=roots.place[rows]).rows(*linear(part(o, rows)))

    return read


def repeated(o: Observations, linear: Linear, prior: tuple[Array, Array]) -> Iterator[Portion]:
    """Portions of a large table whose landmarks are seen again and again; the first one speaks of all landmarks.

    Nothing where the common parameters are not determined, or where images and landmarks are woven too closely for the
    cofactors to be had.
    """
    shared = Shared.of(o, reader(o, linear), PATIENCE)
    x, _, Q = solve_common(shared.squares, prior)
    if not (shared.factored and np.all(np.isfinite(Q))):
        return
    z, y, roots = shared.cofactors(), np.append(x, 1.0), shared.table.roots
    C_image, C_landmark = shared.C_image[..., :-1], shared.C_landmark[..., :-1]
    landmarks, b = roots.repeated, -(shared.C_landmark @ y)
    of_landmarks = z.LL + C_landmark @ Q @ C_landmark.mT
    for rows in shared.table.rows():
        table, model, A = linear(part(o, rows))
        d = replace(roots, place=roots.place[rows]).rows(replace(table, weight=np.ones(table.n)), model, A)
        left = left_over(d, shared.C_image[table.image], shared.C_landmark)
        spread, images = left[..., :-1] @ Q, np.unique(table.image)
        C = C_image[images]
        yield Portion(
            rows,
            images,
            landmarks,
            table,
            model,
            Reliability(
                used=table.weight > 0.0,
                v=left @ y,
                hat=left[..., :-1] @ spread.mT + _by_shared(d, z, table.image, shared.table.pair[rows]),
                per_px=d.W,
                effect=-spread.mT,
                image_error=-(shared.C_image[images] @ y),
                image_cofactor=z.II[images] + C @ Q @ C.mT,
                landmark_error=b,
                landmark_cofactor=of_landmarks,
                repeated=landmarks,
            ),
        )
        landmarks, b, of_landmarks = landmarks[:0], b[:0], of_landmarks[:0]


def _by_shared(d: Design, z: Normal, image: Index, pair: Index) -> Array:
    """Covariance (n, 2, 2) of a row's [G, D] times the shared errors, x known."""
    G = d.P[..., :6]
    V = G @ z.II[image] @ G.mT
    again = np.flatnonzero(pair >= 0)
    if again.size:
        D = d.D[again]
        cross = G[again] @ z.IL[pair[again]] @ D.mT
        V[again] += cross + cross.mT + D @ z.LL[d.place[again]] @ D.mT
    return np.asarray(V)


def _squares(o: Observations, d: Design, images: int) -> Array:
    """Sums (g, 6, 6 + k + 1) of G^T [G, A, z] over the sightings in the solution."""
    P = d.P
    if not np.all(o.weight == 1.0):
        P = P * np.sqrt(o.weight)[:, None, None]
    P = P.reshape(images, -1, P.shape[-1])
    return np.asarray(P[..., :6].mT @ P)
