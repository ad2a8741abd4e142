"""The adjustment at an estimate: linearised where it is asked for, whole or in portions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..solve.adjustment import is_large, solve_large
from ..solve.portions import Portion, Tested, reader, repeated, single
from ..solve.reliability import reliability
from ..solve.streaming import Stream, Sum, blocks, part, streams
from ..table.equation import Linearised
from ..table.observations import Observations
from .selfcal import Problem, SelfCalibration, State

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Fit:
    """The adjustment of a table (no batch axes) at a state; weight zero keeps a sighting out of the solution."""

    calibration: SelfCalibration
    table: Observations
    state: State
    C_EK_model: Array

    def problem(self, part: Observations) -> Problem:
        """The linear problem of a part of the table."""
        return self.calibration.problem(part, self.state, self.C_EK_model)

    def linear(self, part: Observations) -> tuple[Observations, Linearised, Array]:
        """A part of the table with the parameters applied, linearised, and its design."""
        problem = self.problem(part)
        return problem.observations, problem.model, problem.A

    @cached_property
    def whole(self) -> Problem:
        """The linear problem of the whole table."""
        return self.problem(self.table)

    @cached_property
    def solution(self) -> Sum | None:
        """The step that is left for the common parameters of a table taken in portions, None for any other."""
        if not streams(self.table):
            return None
        stream = Stream.of(self.table, self.calibration.parameters, self.calibration.compiled)
        return stream.step(self.state.C_EK, self.state.values, self.prior)

    @property
    def prior(self) -> tuple[Array, Array]:
        """Information and step of the prior on all common parameters."""
        return self.problem(part(self.table, slice(0, 1))).prior  # it is that of any part

    def step(self) -> Array:
        """The Gauss-Newton step (k,) of the common parameters."""
        if self.solution is not None:
            return self.solution.x
        if is_large(self.table):
            return solve_large(self.table, reader(self.table, self.linear), self.prior).x
        return self.whole.solve().x

    def parts(self) -> Iterator[tuple[Index, tuple[Observations, Linearised, Array]]]:
        """Rows of whole images, and the table, linearisation and design of each."""
        every = np.arange(self.table.n)
        for _, pieces in blocks(self.table):
            rows = np.concatenate([every[rows] for rows in pieces])
            yield rows, self.linear(part(self.table, rows))

    def portions(self) -> Iterator[Portion]:
        """What the adjustment says of its observations; nothing where the common parameters are not determined."""
        if self.solution is not None:
            if np.all(np.isfinite(self.solution.covariance)):
                yield from single(self.table, self.linear, self.solution)
            return
        if is_large(self.table):
            yield from repeated(self.table, self.linear, self.prior)
            return
        p = self.whole
        tested = reliability(p.observations, p.model, p.A, p.prior)
        if tested is not None:
            members = np.arange(self.table.n_images), tested.repeated
            yield Portion(slice(None), *members, p.observations, p.model, tested)

    def tested(self) -> Tested | None:
        """The statistics of all observations; None where the common parameters are not determined."""
        tested, portion = Tested.empty(self.table), None
        for portion in self.portions():
            tested.put(portion)
        return None if portion is None else tested
