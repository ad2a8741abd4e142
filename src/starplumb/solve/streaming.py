"""The adjustment of tables too large to hold a design of: whole images at a time, a few megabytes each.

Images share nothing but the common parameters where every landmark is seen once, so their reduced normal equations are
simply added up, and nothing grows with the number of sightings.  The rows of a chunk's design are made by
:mod:`starplumb.solve.design_rows`.  With S a root of the covariance of an image's attitude and position errors, G =
(H, R) S and Y = (z, H, E) it adds ``Y^T Y - Y^T G (G^T G + I)^-1 G^T Y`` to the normal equations of everything
common."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ..physics.covariance import square_root
from ..table.equation import Nine
from ..table.observations import PER_SIGHTING, Observations
from ..table.parameters import OPTICS, Moves, Optics, Parameter, split
from .adjustment import invert_information
from .design_rows import COLUMN, LENS, NO_LENS, PER_RAD, ROW, ROWS, WHITENING, filler, load

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Rows = slice | Index

LARGE = 10_000
"""Sightings from which a table is taken in chunks."""
Z, H = 0, slice(1, 4)
"""Places of the residual and of the derivatives by the mounting among a sighting's rows."""
CHUNK = 4_096
"""Sightings of a chunk: what fits the processor's cache with all that is made of it."""
SAMPLE = 30_000
"""Sightings of the sample from which the adjustment of a table several times larger starts."""


@dataclass(frozen=True)
class Sum:
    """Solution of one linear step: ``x`` (k,), ``information`` and ``covariance`` (k, k), ``chi2`` at the minimum."""

    x: Array
    information: Array
    covariance: Array
    chi2: Array


def streams(o: Observations) -> bool:
    """Whether a table is large, without batch axes and of landmarks seen once, so that it can be taken in chunks."""
    if not (o.n > LARGE and o.batch == ()):
        return False
    seen = np.zeros(o.n_landmarks, dtype=np.bool_)
    seen[o.landmark] = True
    return int(np.count_nonzero(seen)) == o.n


def sampled(o: Observations) -> bool:
    """Whether a sample is worth to start from."""
    return o.n >= 2 * SAMPLE and streams(o)


def sample(o: Observations) -> Observations:
    """Whole images drawn from the table (always the same ones), some ten thousand sightings in all."""
    drawn = np.random.default_rng(0).random(o.n_images) < SAMPLE / o.n
    return part(o, np.flatnonzero(drawn[o.image]))


def part(o: Observations, rows: Rows) -> Observations:
    """Some rows, by a slice without copying, with all images and landmarks as they were (no batch axes)."""
    own = {name: getattr(o, name)[rows] for name in ("image", "landmark", *PER_SIGHTING)}
    return replace(o, **own, common_px=None if o.common_px is None else o.common_px[rows])


def blocks(o: Observations) -> Iterator[tuple[Index, list[Rows]]]:
    """Images (g,) with equally many sightings each, as many as a chunk holds, and their rows, image after image.

    An image larger than a chunk comes alone, its rows in pieces.
    """
    ordered = bool(np.all(o.image[:-1] <= o.image[1:]))
    order = None if ordered else np.argsort(o.image, kind="stable")
    counts = np.bincount(o.image, minlength=o.n_images)
    starts = np.cumsum(counts) - counts
    for count in np.unique(counts[counts > 0]):
        same = np.flatnonzero(counts == count)
        for first in range(0, same.size, max(1, CHUNK // int(count))):
            images = same[first : first + max(1, CHUNK // int(count))]
            yield images, _rows(order, starts[images], int(count))


def _rows(order: Index | None, starts: Index, count: int) -> list[Rows]:
    """Rows of runs of ``count`` that begin at ``starts`` of ``order``, cut into pieces where one run is too long."""
    begin, end = int(starts[0]), int(starts[0]) + count * starts.size
    together = bool(np.all(np.diff(starts) == count))
    rows: Index | None = None
    if order is not None or not together:
        rows = (starts[:, None] + np.arange(count)).reshape(-1)
        rows = rows if order is None else order[rows]
    step = CHUNK if starts.size == 1 else end - begin
    cuts = range(0, count * starts.size, step)
    if rows is None:
        return [slice(begin + at, min(begin + at + step, end)) for at in cuts]
    return [rows[at : at + step] for at in cuts]


@dataclass(frozen=True)
class Stream:
    """A table of single landmarks and the parameters to estimate from it besides the mounting.

    ``roots`` (m, 6, 6) turn unit errors of an image into those of ``-theta_E`` and of its position.
    """

    observations: Observations
    parameters: tuple[Parameter, ...]
    roots: Array
    compiled: bool

    @classmethod
    def of(cls, o: Observations, parameters: Sequence[Parameter], compiled: bool) -> Stream:
        roots = np.zeros((o.n_images, 6, 6))
        roots[:, :3, :3], roots[:, 3:, 3:] = square_root(o.cov_attitude_E), square_root(o.cov_position_J)
        return cls(o, tuple(parameters), roots, compiled)

    def step(self, C_EK: Array, values: Array, prior: tuple[Array, Array]) -> Sum:
        """The step of :func:`starplumb.solve.adjustment.solve` at a mounting (3, 3) and parameters (p,).

        ``prior`` is the information (k, k) and step (k,) of all common unknowns: mounting, parameters, common errors.
        """
        information, step = prior[0].copy(), prior[1]
        right, chi2 = -(prior[0] @ step), float(step @ prior[0] @ step)
        left = np.zeros(())
        for images, pieces in blocks(self.observations):
            parts = [self._products(rows, images.size, C_EK, values) for rows in pieces]
            own, others = (np.sum(same, axis=0) for same in zip(*parts, strict=True))
            left = left + _reduced(own, others, self.roots[images])
        unknown = np.r_[H, LENS : len(left)]
        information += left[np.ix_(unknown, unknown)]
        right += left[unknown, Z]
        chi2 += float(left[Z, Z])
        covariance = invert_information(information)
        x = -(np.where(np.isfinite(covariance), covariance, 0.0) @ right)
        return Sum(x, information, covariance, np.asarray(chi2 + right @ x))

    def _products(self, rows: Rows, images: int, C_EK: Array, values: Array) -> tuple[Array, Array]:
        """Products of the whitened rows (z, H, R, then f - 7 of parameters and common errors) of some sightings.

        Of (z, H, R) with all of them image by image (g, 7, f), of the others with all of them in sum (f - 7, f).
        """
        o, own, lens = self.observations, split(self.parameters, values), NO_LENS
        if any(not isinstance(parameter, Optics) for parameter in self.parameters):
            o, rows = part(o, rows), slice(None)
        for parameter, value in own:
            if isinstance(parameter, Optics):
                lens = parameter.through(value)
            else:
                o = parameter.apply(o, value)
        W = np.empty((ROWS, o.image[rows].size))
        load(W, o, rows)
        filler(self.compiled)(W, cast("Nine", tuple(C_EK.reshape(-1).tolist())), lens)
        pairs = _design(W, o, own)
        if o.common_px is not None:
            pairs.append(_whitened(W, o.common_px[rows]))
        return _multiplied([_joined(axis) for axis in zip(*pairs, strict=True)], images)


Pair = tuple[Array, Array]


def _design(W: Array, o: Observations, own: Sequence[tuple[Parameter, Array]]) -> list[Pair]:
    """Whitened rows of columns and of rows: z, H, R, then those of the parameters in their order."""
    width = LENS
    if own and isinstance(own[0][0], Optics) and own[0][0].names == OPTICS:
        width, own = LENS + len(OPTICS), own[1:]  # a whole lens stands where it should already
    pairs = [(W[COLUMN : COLUMN + width], W[ROW : ROW + width])]
    for parameter, value in own:
        if isinstance(parameter, Optics):
            places = LENS + np.array(parameter.places)
            pairs.append((W[COLUMN + places], W[ROW + places]))
        else:
            pairs.append(_moved(W, parameter.moves(o, value)))
    return pairs


def _moved(W: Array, moves: Moves) -> Pair:
    """Whitened derivatives (s, n) of columns and rows by values that move what is measured (see :class:`Moves`)."""
    V = W[PER_RAD : PER_RAD + 4]
    column, row = 0.0, 0.0
    if moves.xy_K is not None:
        x, y = np.moveaxis(moves.xy_K, (1, 2), (0, 1))
        column, row = column - V[0] * x - V[1] * y, row - V[2] * x - V[3] * y
    for first, sign, move in ((1, -1.0, moves.turn_E), (4, 1.0, moves.shift_J)):
        if move is not None:
            column = column + sign * np.einsum("in,nis->sn", W[COLUMN + first : COLUMN + first + 3], move)
            row = row + sign * np.einsum("in,nis->sn", W[ROW + first : ROW + first + 3], move)
    return np.asarray(column), np.asarray(row)


def _whitened(W: Array, px: Array) -> Pair:
    """Rows (s, n) of errors given in pixels (n, 2, s)."""
    p, q, r = W[WHITENING : WHITENING + 3]
    x, y = np.moveaxis(px, (1, 2), (0, 1))
    return p * x, q * x + r * y


def _joined(parts: Sequence[Array]) -> Array:
    """Rows one under the other."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _multiplied(axes: Sequence[Array], images: int) -> tuple[Array, Array]:
    """Products of rows (f, g M) of g images: of the first seven, image by image (g, 7, f), and of the others in sum."""
    own, others = np.zeros(()), np.zeros(())
    for rows in axes:
        each = rows.reshape(len(rows), images, -1).swapaxes(0, 1)
        # never a matrix times itself: the symmetric product of a linear algebra library is slow on so small ones
        own, others = own + each[:, :LENS] @ each.mT, others + rows[LENS:] @ rows.mT
    return own, others


def _reduced(own: Array, others: Array, S: Array) -> Array:
    """Products (f, f) in sum over images (g,) without the images' own errors, of which S (g, 6, 6) are the roots."""
    G = S.mT @ own[:, 1:LENS]
    C = np.linalg.solve(G[..., 1:LENS] @ S + np.eye(6), G)
    total = np.concatenate([np.sum(own, axis=0), others])
    return np.asarray(total - G.reshape(-1, len(total)).mT @ C.reshape(-1, len(total)))
