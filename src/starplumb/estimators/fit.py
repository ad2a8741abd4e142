"""The adjustment at an estimate: what it estimates, and its linear problem, whole or in portions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..solve.adjustment import Adjustment, is_large, solve, solve_large
from ..solve.portions import Portion, Tested, reader, repeated, single
from ..solve.reliability import reliability
from ..solve.streaming import Stream, Sum, blocks, part, streams
from ..table.equation import Linearised, linearise
from ..table.observations import Observations
from ..table.parameters import Parameter, split

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class State:
    """Where an estimate stands: ``C_EK`` (..., 3, 3) and the parameters' ``values`` (..., p)."""

    C_EK: Array
    values: Array

    def moved(self, x: Array) -> State:
        """After a step of the alignment and the parameters, x (..., 3 + p or more)."""
        p = self.values.shape[-1]
        return State(so3.exp(x[..., :3]) @ self.C_EK, self.values + x[..., 3 : 3 + p])


@dataclass(frozen=True)
class Problem:
    """The adjustment at a state: the table with the parameters applied, its linearisation, the design of all common
    unknowns (..., n, 2, 3 + p + c) and their prior (information, step); c is the number of errors in ``common_px``."""

    observations: Observations
    model: Linearised
    A: Array
    prior: tuple[Array, Array]

    def solve(self) -> Adjustment:
        return solve(self.observations, self.model, self.A, *self.prior)


@dataclass(frozen=True)
class Unknowns:
    """What an adjustment estimates: the alignment, and further parameters beside it.

    ``compiled`` takes large tables through the same formulas compiled by numba.
    """

    parameters: tuple[Parameter, ...] = ()
    compiled: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for parameter in self.parameters for name in parameter.names)

    @property
    def sigma(self) -> Array:
        """Prior standard deviations (p,), infinite for free parameters."""
        return np.array([s for parameter in self.parameters for s in parameter.sigma])

    @property
    def range(self) -> Array:
        """Largest errors that make sense (p,)."""
        return np.array([r for parameter in self.parameters for r in parameter.range])

    def problem(self, observations: Observations, state: State, C_EK_model: Array) -> Problem:
        """The linear problem at a state."""
        o, own = observations, split(self.parameters, state.values)
        for parameter, value in own:
            o = parameter.apply(o, value)
        model = linearise(o, state.C_EK)
        parts = [model.H, *(parameter.moves(o, value).design(model) for parameter, value in own)]
        parts += [] if o.common_px is None else [o.common_px]
        return Problem(o, model, _beside(parts), self.prior(o, state, C_EK_model))

    def prior(self, o: Observations, state: State, C_EK_model: Array) -> tuple[Array, Array]:
        """Information and step of what is known beforehand of all common unknowns.

        The mounting by ``observations.prior_E``, a parameter by its sigma or, where it is free, its plausible range,
        a common error by its own sigma of one.
        """
        p, common = len(self.names), 0 if o.common_px is None else o.common_px.shape[-1]
        batch, width = state.C_EK.shape[:-2], 3 + p + common
        information, step = np.zeros((*batch, width, width)), np.zeros((*batch, width))
        of_mounting = mounting_prior(o, state.C_EK, C_EK_model)
        if of_mounting is not None:
            information[..., :3, :3], step[..., :3] = of_mounting
        held = np.where(np.isfinite(self.sigma), self.sigma, self.range)
        diagonal = np.arange(3, width)
        information[..., diagonal, diagonal] = np.concatenate([held**-2.0, np.ones(common)])
        step[..., 3 : 3 + p] = -state.values
        return information, step


def _beside(parts: list[Array]) -> Array:
    """Designs (..., n, 2, .) side by side."""
    if len(parts) == 1:
        return parts[0]
    batch = np.broadcast_shapes(*(part.shape[:-3] for part in parts))
    return np.concatenate([np.broadcast_to(p, (*batch, *p.shape[-3:])) for p in parts], axis=-1)


def mounting_prior(observations: Observations, C_EK: Array, C_EK_model: Array) -> tuple[Array, Array] | None:
    """Information and step of the prior about the model mounting.

    ``exp(x) C = exp(c + J^-1 x) C_model`` with ``c = log(C C_model^T)``: the prior says ``c + J^-1 x ~ N(0, prior)``.
    """
    if observations.prior_E is None:
        return None
    c = so3.log(C_EK @ C_EK_model.mT)
    J_inverse = np.linalg.inv(so3.left_jacobian(c))
    return J_inverse.mT @ np.linalg.inv(observations.prior_E) @ J_inverse, -c  # J c = c


@dataclass(frozen=True)
class Fit:
    """The adjustment of a table at a state; weight zero keeps a sighting out of the solution.

    :meth:`solve` takes leading batch axes; everything that is said of single sightings is of one run.
    """

    unknowns: Unknowns
    table: Observations
    state: State
    C_EK_model: Array

    def problem(self, part: Observations) -> Problem:
        """The linear problem of a part of the table."""
        return self.unknowns.problem(part, self.state, self.C_EK_model)

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
        """The step that is left for the common unknowns of a table taken in portions, None for any other."""
        if self.state.C_EK.ndim != 2 or not streams(self.table):
            return None
        stream = Stream.of(self.table, self.unknowns.parameters, self.unknowns.compiled)
        return stream.step(self.state.C_EK, self.state.values, self.prior)

    @property
    def prior(self) -> tuple[Array, Array]:
        """Information and step of what is known beforehand of all common unknowns."""
        return self.unknowns.prior(self.table, self.state, self.C_EK_model)

    def solve(self) -> Adjustment | Sum:
        """The Gauss-Newton step of the common unknowns with their information; of a large table in chunks."""
        if self.solution is not None:
            return self.solution
        if self.state.C_EK.ndim == 2 and is_large(self.table):
            return solve_large(self.table, reader(self.table, self.linear), self.prior)
        return self.whole.solve()

    def step(self) -> Array:
        """The Gauss-Newton step (..., k) of the common unknowns: alignment, parameters, common errors."""
        return self.solve().x

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
