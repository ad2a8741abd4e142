"""The fuzzy state observer: scalar by scalar corrections, repeated over the same sightings until they settle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.errors import InputError
from ...physics.units import ARCSEC
from ...table.equation import predict
from ...table.observations import Observations
from ...table.simulate import Errors, measure
from ..protocol import AlignmentEstimate, Status, without_prior
from ..usable import status_of
from .observer_rows import SIGHTING_ROWS, STATE_ROWS, Parameters
from .observer_run import run

Array = NDArray[np.float64]

ONE_DIRECTION = 1e-15
"""Sum of squares, rad^2, of directions about their mean below which rounding cannot tell them apart."""
REDRAW_SEED = 2019
"""Seed of the errors redrawn for a covariance: the same campaign has the same answer."""


@dataclass(frozen=True, kw_only=True)
class ObserverEstimate(AlignmentEstimate):
    """An estimate with its course.

    ``trace_xyzw`` (1 + cycles, 4, ...) quaternion of C_EK after the very first equation and after each cycle;
    ``C_EK_model`` (..., 3, 3) where it started; ``settle`` rad, the change of a cycle below which it counts as settled.
    """

    trace_xyzw: Array
    C_EK_model: Array
    settle: float

    def C_EK_after(self, cycle: int) -> Array:
        """Mounting (..., 3, 3) after a cycle 1, 2, ...; 0 is the mounting after the very first equation."""
        return so3.from_quaternion(np.moveaxis(self.trace_xyzw[cycle], 0, -1))

    @property
    def first_correction_E(self) -> Array:
        """Initial error theta_E (..., 3) rad by the very first equation alone (table 3 of the paper)."""
        return so3.log(self.C_EK_model @ self.C_EK_after(0).mT)

    @property
    def change_E(self) -> Array:
        """beta (..., cycles - 1, 3) rad between cycles: ``C_EK(L - 1) = exp(beta) C_EK(L)`` (table 4 of the paper)."""
        cycles = len(self.trace_xyzw) - 1
        C = [self.C_EK_after(cycle) for cycle in range(1, cycles + 1)]
        changes = [so3.log(before @ after.mT) for before, after in pairwise(C)]
        return np.stack(changes, axis=-2) if changes else np.zeros((*self.C_EK.shape[:-2], 0, 3))

    @property
    def remarks(self) -> tuple[str, ...]:
        """How large the initial error was, whether the estimate has settled, and when."""
        return tuple(describe(self))

    def describe(self, C_EK_best: Array) -> tuple[str, ...]:
        """Its notes, and when it settled."""
        if not Status(int(self.status)).usable:
            return super().describe(C_EK_best)
        cycles = int(self.cycles_needed)
        settled = f"settled by cycle {cycles}" if cycles else "had not settled after its last cycle"
        return (*self.notes, settled)

    @property
    def cycles_needed(self) -> NDArray[np.int64]:
        """Cycle (...) after which none moved the estimate by more than ``settle``; 0 where the last one still did."""
        moving = ~(np.linalg.norm(self.change_E, axis=-1) < self.settle)
        cycles = len(self.trace_xyzw) - 1
        if cycles < 2:
            return np.zeros(self.C_EK.shape[:-2], dtype=np.int64)
        numbered = np.where(
            moving, np.arange(2, cycles + 1), 1
        )  # change between L - 1 and L belongs to cycle L
        last = np.max(numbered, axis=-1)
        return np.asarray(np.where(last == cycles, 0, last))


@dataclass(frozen=True)
class Observer:
    """Formulas (3), (4) of Tkachenko 2019, cycled over the same sightings.

    Every sighting is a vector equation (2) in J, ``e_J* - e_J = G theta_E`` with ``e_J* = C_JE C_EK e_K`` and
    ``G = -C_JE [e_E*]``.  Its scalar rows g are taken in turn, each left side z less what those before have corrected::

        K = P g / (alpha + g^T P g),   theta_E <- theta_E + K z
        gamma_i^2 = max(floor, w_i z^2 / (beta + g^T P g)),   P <- Gamma (P - K g^T P) Gamma

    and after each vector equation the mounting is turned back exactly, ``C_EK <- exp(-theta_E) C_EK``, before the
    next is formed.  One cycle takes the images in the order of their numbers and the sightings of an image in theirs;
    P is carried on from cycle to cycle.

    Frames and signs are ours throughout: theta_E is the paper's, and only unit vectors to the markers enter, so the
    paper's camera looking along -z needs no conversion.  P is no covariance of anything: it is inflated by whatever
    the innovation happens to be.  The estimate states none, unless ``covariance_draws`` redraws of the stated errors
    are run through the observer from the same initial error; their second moment about the estimate is its covariance.

    The defaults were fitted to tables 1 to 4 of the paper, which prints none of its parameters
    (``published/paper2019.toml``).  Source: A. I. Tkachenko, Problemy upravleniya i informatiki 2019.
    """

    alpha: float = 10.0**-8.40
    """rad^2: noise of a scalar equation in the gain."""
    beta: float = 10.0**-10.22
    """rad^2: noise of a scalar equation in the test of its innovation."""
    w: tuple[float, float, float] = (1.0, 1.0, 10.0**0.085)
    """Weights of the innovation in gamma about E's axes."""
    P0: float | tuple[float, float, float] = 10.0**-2.67
    """rad^2: diagonal of P at the start."""
    cycles: int = 20
    floor: float = 1.0
    """Least gamma^2.  At 1 P is never shrunk by a small innovation; the paper prints no floor (0), and then the angle
    about the line of sight freezes."""
    order: tuple[int, int, int] = (0, 1, 2)
    """Order in which the scalar equations of J's axes are taken."""
    factorised: bool = True
    """Carry P as U D U^T; otherwise as its upper triangle.  Both stay symmetric; the full matrix in plain form does
    not, and diverges in 2 % of runs by 20 cycles."""
    settle: float = 5.0 * ARCSEC
    """rad: change by a cycle below which the estimate counts as settled."""
    covariance_draws: int = 0

    def __post_init__(self) -> None:
        positive = {"alpha": self.alpha, "beta": self.beta, "w": min(self.w), "P0": np.min(self.P0)}
        for name, value in positive.items():
            if not (isfinite(value) and value > 0.0):
                raise InputError(f"observer: found {name} = {value}, wanted a positive number")
        if self.cycles < 1:
            raise InputError(f"observer: found cycles = {self.cycles}, wanted 1 or more")
        if sorted(self.order) != [0, 1, 2]:
            raise InputError(f"observer: found order = {self.order}, wanted the axes 0, 1, 2 each once")

    @property
    def parameters(self) -> Parameters:
        """What the formulas of ``observer_rows`` take."""
        v1, v2, v3 = (float(root) for root in np.sqrt(self.w))
        return self.alpha, self.beta, v1, v2, v3

    def __call__(self, observations: Observations, C_EK: Array) -> ObserverEstimate:
        rows, batch = self._rows(observations, C_EK)
        flat = rows.reshape(len(rows), -1)
        trace = np.empty((1 + self.cycles, 4, *batch))
        steps = trace.reshape(1 + self.cycles, 4, -1)
        with np.errstate(over="ignore", invalid="ignore"):  # what diverges is said by the status
            # the very first equation is a run of one cycle over one sighting
            run(flat[: STATE_ROWS + SIGHTING_ROWS], 1, self.parameters, steps[:1], self.factorised)
            run(flat, self.cycles, self.parameters, steps[1:], self.factorised)
        C = so3.from_quaternion(np.moveaxis(trace[-1], 0, -1))
        status = self._status(observations, C, rows, trace)
        model = np.broadcast_to(C_EK, C.shape)
        covariance = self._covariance(observations, C, model) if self.covariance_draws else None
        return ObserverEstimate(
            C_EK=C,
            covariance_E=covariance,
            status=status,
            iterations=np.full(batch, self.cycles),
            notes=without_prior(
                observations,
                "tuned, not weighed by the stated errors; its P is no covariance, so it states no sigma",
            ),
            trace_xyzw=trace,
            C_EK_model=model,
            settle=self.settle,
        )

    def _rows(self, o: Observations, C_EK: Array) -> tuple[Array, tuple[int, ...]]:
        """Initial work rows (10 + 16 n, *batch) of ``observer_rows`` and the batch."""
        batch = np.broadcast_shapes(o.batch, o.C_EJ.shape[:-3], C_EK.shape[:-2])
        rows = np.empty((STATE_ROWS + SIGHTING_ROWS * o.n, *batch))
        rows[:4] = np.moveaxis(np.broadcast_to(so3.to_quaternion(C_EK), (*batch, 4)), -1, 0)
        rows[4:10] = 0.0
        rows[[4, 7, 9]] = np.broadcast_to(self.P0, (3,)).reshape(3, *(1 for _ in batch))
        block = rows[STATE_ROWS:].reshape(o.n, SIGHTING_ROWS, *batch)
        seen = (o.weight > 0.0)[..., None]
        turn = self._sequence(o)
        axes_E = o.C_EJ[..., list(self.order)].mT.reshape(*o.C_EJ.shape[:-2], 9)
        parts = {
            0: o.e_K * seen,
            3: o.e_E * seen,
            6: axes_E,
            15: np.sqrt(np.where(seen, self.floor, max(self.floor, 1.0))),
        }
        for first, part in parts.items():
            width = part.shape[-1]
            ordered = np.broadcast_to(part, (*batch, o.n, width))[..., turn, :]
            block[:, first : first + width] = np.moveaxis(ordered, (-2, -1), (0, 1))
        return rows, batch

    def _sequence(self, o: Observations) -> NDArray[np.int64]:
        """Sightings image by image."""
        return np.argsort(o.image, kind="stable")

    def _status(self, o: Observations, C: Array, rows: Array, trace: Array) -> NDArray[np.int64]:
        """SINGULAR where all markers lie in one direction, WEAK where the last cycle still moved the estimate."""
        e = rows[STATE_ROWS:].reshape(-1, SIGHTING_ROWS, *rows.shape[1:])[:, 3:6]
        number = np.maximum(np.sum(e * e, axis=(0, 1)), 1.0)
        spread = number - np.sum(np.sum(e, axis=0) ** 2, axis=0) / number
        status = status_of(o, C, determined=spread > ONE_DIRECTION * number)
        if self.cycles > 1:
            # half the sine of the change's half angle is |q - q'| to third order
            moved = 2.0 * np.linalg.norm(trace[-1] - trace[-2], axis=0)
            status[(status == int(Status.OK)) & ~(moved < self.settle)] = int(Status.WEAK)
        return status

    def _covariance(self, o: Observations, C: Array, C_EK_model: Array) -> Array:
        """Second moment (..., 3, 3) rad^2 of the observer's errors when the stated errors are drawn anew about C."""
        batch = C.shape[:-2]
        truth = replace(o, xy_K=predict(C, o.e_E))
        errors = Errors.draw(truth, np.random.default_rng(REDRAW_SEED), (self.covariance_draws, *batch))
        again = replace(self, covariance_draws=0)(measure(truth, C, errors), C_EK_model)
        error_E = so3.log(again.C_EK @ C.mT)
        return np.asarray(np.mean(error_E[..., :, None] * error_E[..., None, :], axis=0))


def describe(estimate: ObserverEstimate) -> list[str]:
    """One run of the observer in sentences: the initial error, whether it settled, and when."""
    first, beta = estimate.first_correction_E / ARCSEC, estimate.change_E / ARCSEC
    cycles = len(estimate.trace_xyzw) - 1
    lines = [
        f"the very first equation put the initial error at {_triple(first)} about E's axes "
        "(it does not see the turn about its line of sight)"
    ]
    if cycles < 2:
        return [
            *lines,
            "one cycle was run, so whether the estimate has settled cannot be said; run two or more",
        ]
    lines.append(f"the last of {cycles} cycles changed the estimate by {_triple(beta[-1])}")
    needed = int(estimate.cycles_needed)
    limit = f"{estimate.settle / ARCSEC:.3g} arcsec"
    if needed:
        lines.append(f"the estimate has settled: after cycle {needed} no cycle moved it by more than {limit}")
    else:
        lines.append(
            f"the estimate has NOT settled: its last cycle moved it by more than {limit}; run more cycles"
        )
    return lines


def _triple(v: Array) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in v) + ") arcsec"
