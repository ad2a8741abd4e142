"""The adjustment at an estimate: what it estimates, and its linear problem."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..solve.adjustment import Adjustment
from ..solve.problem import Linear, Problem, TestedPart
from ..solve.reliability import Tested
from ..table.cameras.mounting import CAMERA_MOUNTING
from ..table.observations import Observations
from ..table.parameters import Parameter
from ..table.seen import ImageErrors

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class State:
    """Where an estimate stands: ``C_EK`` (..., 3, 3) and the parameters' ``values`` (..., p), and the ``errors`` of the
    images about which it is linearised, None for none."""

    C_EK: Array
    values: Array
    errors: ImageErrors | None = None

    def moved(self, x: Array, errors: ImageErrors | None = None) -> State:
        """After a step of the alignment and the parameters, x (..., 3 + p or more)."""
        p = self.values.shape[-1]
        return State(so3.exp(x[..., :3]) @ self.C_EK, self.values + x[..., 3 : 3 + p], errors)


@dataclass(frozen=True)
class Unknowns:
    """What an adjustment estimates: the alignment, and further parameters beside it."""

    parameters: tuple[Parameter, ...] = ()

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
        """The adjustment of a table at a state."""
        prior = self.prior(observations, state, C_EK_model)
        return Problem(observations, self.parameters, state.C_EK, state.values, prior, state.errors)

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
        at, known = self.of_mountings, o.rig_known
        if known is not None and o.C_KC is not None and at.size == len(known.covariance_E):
            c = so3.log(state.C_EK @ C_EK_model.mT)
            values = state.values[at[3:] - 3].reshape(-1, 3)
            information[np.ix_(at, at)], step[at] = known.prior(c, C_EK_model, o.C_KC, values)
        return information, step

    @property
    def of_mountings(self) -> Index:
        """Where the mountings stand among the unknowns: the first camera's three, then those of further ones."""
        further = [3 + i for i, name in enumerate(self.names) if name.startswith(CAMERA_MOUNTING)]
        return np.array([0, 1, 2, *further])


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
        """The adjustment of a part of the table."""
        return self.unknowns.problem(part, self.state, self.C_EK_model)

    @cached_property
    def whole(self) -> Problem:
        """The adjustment of the whole table."""
        return self.problem(self.table)

    def solve(self) -> Adjustment:
        """The Gauss-Newton step of the common unknowns with their information."""
        return self.whole.solution

    def step(self) -> Array:
        """The Gauss-Newton step (..., k) of the common unknowns: alignment, parameters, common errors."""
        return self.solve().x

    def parts(self) -> Iterator[tuple[Index, Linear]]:
        """Rows of whole images, and the table, linearisation and design of each."""
        return self.whole.parts()

    def tested_parts(self) -> Iterator[TestedPart]:
        """What the adjustment says of its sightings; nothing where that is not known."""
        return self.whole.tested_parts()

    def tested(self) -> Tested | None:
        """The statistics of all observations; None where they are not known."""
        return self.whole.tested()
