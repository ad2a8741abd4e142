"""The normal equations of tables too large to hold a design of: whole images at a time, a few megabytes each.

Images share nothing but the common parameters where every landmark is seen once, so that they are eliminated chunk by
chunk and nothing grows with the number of sightings; of landmarks seen again, one block is kept of each pair that
meets.  The rows of a chunk's design are made by :mod:`starplumb.solve.design_rows`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ..physics.lens import LensNumbers, near
from ..table.cameras.mounting import CameraMounting
from ..table.equation import Nine, predicted
from ..table.observations import Observations
from ..table.parameters import OPTICS, LookAngles, Moves, Optics, Parameter, split
from ..table.seen import ImageErrors, without_errors
from .chunks import Rows, blocks, part
from .design_rows import COLUMN, LENS, NO_LENS, PER_RAD, ROW, ROWS, WHITENING, fill, load
from .normal import Eliminated, Normal, Pairs, eliminate
from .schur import eliminate_sparse
from .whitening import Roots, accumulate

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Pair = tuple[Array, Array]

POSITION = slice(4, 7)
"""The derivatives by the position among a sighting's rows (z, H, R, E): a landmark's place moves them alike."""


@dataclass(frozen=True)
class Stream:
    """A table without batch axes and the parameters to estimate from it besides the mounting.

    ``single`` is the table with the errors of its landmarks seen once only.
    """

    single: Observations
    parameters: tuple[Parameter, ...]
    roots: Roots
    pairs: Pairs
    errors: ImageErrors | None

    @classmethod
    def of(
        cls,
        o: Observations,
        parameters: Sequence[Parameter],
        errors: ImageErrors | None = None,
    ) -> Stream:
        roots = Roots.of(o)
        if roots.repeated.size:
            own = np.array(o.cov_landmark_J)
            own[roots.repeated] = 0.0
            o = replace(o, cov_landmark_J=own)
        return cls(o, tuple(parameters), roots, Pairs.among(o, roots), errors if parameters else None)

    def squares(self, C_EK: Array, values: Array) -> tuple[Array, Array]:
        """Normal equations (k + 1, k + 1) of Y = [A, z] less the shared errors, at a mounting (3, 3) and parameters
        (p,), and what explains each column in unit errors of the images (m, 6, k + 1), nothing of it where no
        parameters are estimated.  Raises LinAlgError where there is no solution."""
        if self.roots.repeated.size:
            found, left = self.eliminated(C_EK, values)
            return left, found.C_image
        left, own, m = np.zeros(()), np.zeros((0, 6, 0)), self.single.n_images
        for images, n in self._blocks(C_EK, values):
            found = eliminate(n, self.pairs)
            left = left + found.squares(n)
            if self.parameters:
                own = own if own.size else np.zeros((m, *found.C_image.shape[1:]))
                own[images] = found.C_image
        return left, own

    def eliminated(self, C_EK: Array, values: Array, patience: float = 1.0) -> tuple[Eliminated, Array]:
        """The same with the shared errors; for ``patience`` see :func:`starplumb.solve.schur.eliminate_sparse`."""
        n = self.normal(C_EK, values)
        again = self.roots.repeated.size > 0
        found = eliminate_sparse(n, self.pairs, patience) if again else eliminate(n, self.pairs)
        return found, found.squares(n)

    def normal(self, C_EK: Array, values: Array) -> Normal:
        """The normal equations of the whole table."""
        parts = self._blocks(C_EK, values)
        images, first = next(parts)
        total = replace(first, image=np.zeros((self.single.n_images, *first.image.shape[1:])))
        total.image[images] = first.image
        for images, n in parts:
            total.image[images] = n.image
            total.common[...] += n.common
        return total

    def _S(self, images: Index) -> Array:
        """Turn unit errors of images (g,) into those of ``-theta_E`` and of their positions, (g, 6, 6)."""
        S = np.zeros((images.size, 6, 6))
        S[:, :3, :3], S[:, 3:, 3:] = self.roots.S_attitude[images], -self.roots.S_position[images]
        return S

    def _blocks(self, C_EK: Array, values: Array) -> Iterator[tuple[Index, Normal]]:
        """Images (g,) and their normal equations, those of landmarks and pairs summed up to there."""
        q, E = self.roots.repeated.size, self.pairs.image.size
        landmark, pair = np.zeros((q, 3, 0)), np.zeros((E, 6, 3))
        at = split(self.parameters, values)
        lens = next((p.through(value) for p, value in at if isinstance(p, Optics)), NO_LENS)
        for images, pieces in blocks(self.single):
            own, others = np.zeros(()), np.zeros(())
            for rows in pieces:
                axes = self._rows(rows, C_EK, at, lens)
                own, others = (
                    total + new
                    for total, new in zip((own, others), _multiplied(axes, images.size), strict=True)
                )
                if landmark.shape[-1] == 0:
                    landmark = np.zeros((q, 3, len(axes[0])))
                if q:
                    self._add_landmarks(axes, rows, landmark, pair)
                del axes  # so that the next rows take the same memory, which the cache still holds
            S, total = self._S(images), np.concatenate([np.sum(own, axis=0), others])
            G = S.mT @ own[:, 1:LENS]
            image = np.concatenate([G[..., 1:LENS] @ S, _ordered(G)], axis=-1)
            yield images, Normal(image, landmark, pair, _ordered(_ordered(total).mT))

    def _add_landmarks(self, axes: Sequence[Array], rows: Rows, landmark: Array, pair: Array) -> None:
        """What sightings of landmarks seen more than once say of these."""
        place = self.roots.place[rows]
        again = np.flatnonzero(place >= 0)
        S, image = self.roots.S_landmark[place[again]], self.single.image[rows][again]
        chosen = [axis[:, again] for axis in axes]
        products = sum(axis[POSITION, None] * axis[None] for axis in chosen)
        DF = S @ np.moveaxis(np.asarray(products), 2, 0)  # D^T (z, H, R, E, ...)
        accumulate(landmark, np.concatenate([DF[..., POSITION] @ S, _ordered(DF)], axis=-1), place[again])
        accumulate(pair, self._S(image).mT @ DF[..., 1:LENS].mT, self.pairs.of[rows][again])

    def _rows(
        self, rows: Rows, C_EK: Array, own: Sequence[tuple[Parameter, Array]], lens: LensNumbers
    ) -> list[Array]:
        """Whitened rows z, H, R, then those of parameters and common errors, of columns and of rows (f, n)."""
        o, errors = self.single, self.errors
        if any(not isinstance(parameter, Optics) for parameter in self.parameters):
            o, rows = part(o, rows), slice(None)
        for parameter, value in own:
            if not isinstance(parameter, Optics):
                o = parameter.apply(o, value)
        W = np.empty((ROWS, o.image[rows].size))
        load(W, o, rows, errors)
        self._fill(W, part(o, rows) if o.C_KC is not None else o, C_EK, lens)
        looks = next((p for p, _ in own if isinstance(p, LookAngles | CameraMounting)), None)
        if looks is not None:
            h = predicted(o, C_EK, o.e_E if errors is None else without_errors(o, errors))
            o = replace(o, xy_K=near(h, o.xy_K, looks.reach))
        pairs = _design(W, o, own)
        if o.common_px is not None:
            pairs.append(_whitened(W, o.common_px[rows]))
        return [_joined(axis) for axis in zip(*pairs, strict=True)]

    def _fill(self, W: Array, o: Observations, C_EK: Array, lens: LensNumbers) -> None:
        """Make what stands behind what was measured, camera by camera where there are several."""
        about = self.errors is not None
        if o.C_KC is None:
            fill(W, _nine(C_EK), lens, about)
            return
        for k, C_KC in enumerate(o.C_KC):
            mine = np.flatnonzero(o.camera == k)
            own = np.ascontiguousarray(W[:, mine])
            fill(own, _nine(C_EK @ C_KC), lens, about)
            W[:, mine] = own


def _nine(C: Array) -> Nine:
    return cast("Nine", tuple(C.reshape(-1).tolist()))


def _ordered(products: Array) -> Array:
    """Y = [A, z], which is (H, E, ..., z), of the columns z, H, R, E, ..."""
    return np.concatenate([products[..., 1:4], products[..., LENS:], products[..., :1]], axis=-1)


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
