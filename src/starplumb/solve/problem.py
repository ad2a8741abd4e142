"""Least squares of a table at a state of its unknowns, whatever its size: the step, and the tests of every observation.

A table with batch axes, or a small one, is linearised and whitened as a whole; a large one a chunk of whole images at a
time (:mod:`starplumb.solve.chunks` says which is which).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..table.equation import Linearised
from ..table.observations import Observations
from ..table.parameters import Parameter, split
from ..table.seen import ImageErrors, Seen
from .adjustment import Adjustment, Prior, SharedErrors, eliminated
from .chunks import Rows, blocks, in_chunks, part
from .normal import Eliminated, Pairs
from .reliability import Reliability, Solution, Tested, reliability
from .whitening import Roots

if TYPE_CHECKING:
    from .streaming import Stream

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Linear = tuple[Observations, Linearised, Array]
"""A table with its parameters applied, linearised, and the design A (..., n, 2, k) of all common unknowns."""

PATIENCE = 20.0
"""How much longer than a step of the estimate its cofactors may take: half a minute or so at most."""


@dataclass(frozen=True)
class TestedPart:
    """Some rows of a table with the parameters applied, linearised, and what is known of them."""

    rows: Rows
    table: Observations
    model: Linearised
    tested: Reliability


@dataclass(frozen=True)
class Problem:
    """The adjustment of a table at a mounting ``C_EK`` (..., 3, 3) and ``values`` (..., p) of its parameters.

    The common unknowns are the alignment, the parameters and the errors in ``common_px``, in this order, with a prior
    on all of them.  Weight zero keeps a sighting out of the solution.
    """

    table: Observations
    parameters: tuple[Parameter, ...]
    C_EK: Array
    values: Array
    prior: Prior
    errors: ImageErrors | None = None
    """Errors of the images about which the table is linearised, where parameters are estimated; None for none."""

    def linear(self, part: Observations) -> Linear:
        """Some rows of the table, linearised."""
        own = split(self.parameters, self.values)
        s = Seen.of(part, own, self.C_EK, self.errors)
        o, model = s.applied, s.model
        parts = [model.H, *(p.moves(s.predicted, value).design(model) for p, value in own)]
        parts += [] if o.common_px is None else [o.common_px]
        batch = np.broadcast_shapes(*(A.shape[:-3] for A in parts))
        A = np.concatenate([np.broadcast_to(A, (*batch, *A.shape[-3:])) for A in parts], axis=-1)
        return o, model, A

    @cached_property
    def linearised(self) -> Linear:
        """The whole table, linearised."""
        return self.linear(self.table)

    @property
    def observations(self) -> Observations:
        return self.linearised[0]

    @property
    def model(self) -> Linearised:
        return self.linearised[1]

    @property
    def A(self) -> Array:
        return self.linearised[2]

    @cached_property
    def in_chunks(self) -> bool:
        """Whether the table is adjusted a chunk at a time, which needs a single mounting."""
        return self.C_EK.ndim == 2 and self.values.ndim == 1 and in_chunks(self.table)

    @cached_property
    def solution(self) -> Adjustment:
        """The Gauss-Newton step of the common unknowns, with the covariance at the minimum."""
        try:
            squares = self._normals[0]
        except np.linalg.LinAlgError:
            return Adjustment.none(self.prior[1].shape[-1])
        return Adjustment.of(squares, self.prior)

    @cached_property
    def _normals(self) -> tuple[Array, Array]:
        """The normal equations of [A, z] less the shared errors, and each column's unit errors of the images."""
        if self.in_chunks:
            return self._stream.squares(self.C_EK, self.values)
        shared, squares = self._eliminated
        return squares, shared.C_image

    def image_errors(self, x: Array, stands: NDArray[np.bool_]) -> ImageErrors | None:
        """The errors of the images as they are estimated after a step x (..., k), about which to linearise next; those
        of runs that stand (...) remain.  None without parameters or without a solution."""
        if not self.parameters:
            return None
        try:
            C_image = self._normals[1]
        except np.linalg.LinAlgError:
            return None
        y = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)
        own, roots = C_image @ y[..., None, :, None], self._roots
        alpha, rho = roots.S_attitude @ own[..., :3, :], roots.S_position @ own[..., 3:, :]
        return ImageErrors.of(-alpha[..., 0], -rho[..., 0], self.errors, stands)

    @cached_property
    def _roots(self) -> Roots:
        return Roots.of(self.table)

    @cached_property
    def _stream(self) -> Stream:
        from .streaming import Stream

        return Stream.of(self.table, self.parameters, self.errors)

    @cached_property
    def _eliminated(self) -> tuple[Eliminated, Array]:
        """The shared errors, and the normal equations less them."""
        if self.in_chunks:
            return self._stream.eliminated(self.C_EK, self.values, PATIENCE)
        o, model, A = self.linearised
        return eliminated(o, self._roots, model, A)

    def through_inverse(self) -> Array:
        """``V^-1 A`` (n, 2, k) of the whole table, V the covariance of all that is not a common unknown (no batch
        axes)."""
        o, model, A = self.linearised
        d = self._roots.design(o, model, A)
        left = self._eliminated[0].left(d, o.image)
        return np.asarray(d.W.mT @ left[..., :-1])

    def shared_errors(self, x: Array | None = None) -> SharedErrors:
        """The errors of images and landmarks at a step x (..., k) of the common unknowns, by default where they
        stand."""
        try:
            of = self._stream.eliminated(self.C_EK, self.values) if self.in_chunks else self._eliminated
        except np.linalg.LinAlgError:
            return SharedErrors.unknown(self.table)
        return SharedErrors.of(
            self.table, self._roots, of[0], np.zeros(self.prior[1].shape) if x is None else x
        )

    def parts(self) -> Iterator[tuple[Index, Linear]]:
        """Rows of whole images and their linearisation, a chunk at a time (no batch axes)."""
        every = np.arange(self.table.n)
        if not self.in_chunks:
            yield every, self.linearised
            return
        for _, pieces in blocks(self.table):
            rows = np.concatenate([every[rows] for rows in pieces])
            yield rows, self.linear(part(self.table, rows))

    def pieces(self) -> Iterator[tuple[Rows, Linear]]:
        """Rows and their linearisation, a chunk at a time, of an image larger than that too (no batch axes)."""
        if not self.in_chunks:
            yield slice(None), self.linearised
            return
        for _, pieces in blocks(self.table):
            for rows in pieces:
                yield rows, self.linear(part(self.table, rows))

    @cached_property
    def statistics(self) -> Solution | None:
        """What the tests are computed from; None where the common parameters are not determined, or the cofactors of
        the shared errors take too long."""
        try:
            shared, squares = self._eliminated
        except np.linalg.LinAlgError:
            return None
        found = Adjustment.of(squares, self.prior)
        cofactors = shared.cofactors() if np.all(np.isfinite(found.covariance)) else None
        return None if cofactors is None else Solution(found.x, found.covariance, shared, cofactors)

    def tested_parts(self) -> Iterator[TestedPart]:
        """The tests of the sightings, a chunk at a time (no batch axes); nothing where there is no solution."""
        solution = self.statistics
        if solution is None:
            return
        pairs = Pairs.among(self.table, self._roots)
        for rows, (table, model, A) in self.pieces():
            d = self._roots.design(replace(table, weight=np.ones(table.n)), model, A, rows)
            tested = reliability(table.weight > 0.0, d, table.image, pairs.of[rows], solution)
            yield TestedPart(rows, table, model, tested)

    def tested(self) -> Tested | None:
        """The statistics of all observations (no batch axes); None where they are not known."""
        T, dof = np.zeros(self.table.n), np.zeros(self.table.n, dtype=np.int64)
        for some in self.tested_parts():
            T[some.rows], dof[some.rows] = some.tested.sightings
        return self.of_groups((T, dof))

    def of_groups(self, sightings: tuple[Array, Index]) -> Tested | None:
        """The statistics of images and landmarks beside those of the sightings."""
        s = self.statistics
        return None if s is None else Tested(sightings, s.images, s.landmarks, self._roots.repeated)
