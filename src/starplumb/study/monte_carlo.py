"""Monte Carlo of a scenario: any estimators on common draws, in chunks that depend on nothing but seed and number.

Chunk c draws from the counter-based generator Philox keyed by (seed, c), so it can be run again, alone, anywhere, and
gives the same bits.  What is kept of it is its :class:`Tally` per estimator and, if wanted, its samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimators.protocol import AlignmentEstimate, Estimator, Status
from ..physics import so3
from ..plan.scenario import Scenario
from ..table.error_sources import draw
from ..table.observations import Observations
from ..table.simulate import measure
from .provenance import made_with
from .refined import of_scene
from .statistics import Moments

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Arrays = dict[str, NDArray[Any]]

CHUNK = 4096
"""Trials of a chunk: large enough for array arithmetic, small enough for the cache and for many workers."""
FORMAT = 3
"""Of the arrays of a chunk: those of another format are refused."""
SIGHTINGS_AT_ONCE = 32768
"""Trials of a chunk are run in batches of about this many sightings, so that memory does not grow with the scene."""


@dataclass(frozen=True)
class Samples:
    """What one estimator made of b trials: ``theta_E`` (b, 3) rad error, ``sigma_E`` (b, 3) rad stated (NaN for none),
    ``nees`` (b,) error squared by its stated covariance over 3, ``fit`` (b,) chi-square per degree of freedom (NaN for
    none), ``status`` (b,)."""

    theta_E: Array
    sigma_E: Array
    nees: Array
    fit: Array
    status: Index

    @classmethod
    def of(cls, estimate: AlignmentEstimate, C_EK_true: Array) -> Samples:
        theta = so3.log(estimate.C_EK @ C_EK_true.mT)
        b = theta.shape[0]
        sigma, nees, fit = np.full((b, 3), np.nan), np.full(b, np.nan), np.full(b, np.nan)
        if estimate.covariance_E is not None:
            covariance = np.broadcast_to(estimate.covariance_E, (b, 3, 3))
            known = np.all(np.isfinite(covariance), axis=(-2, -1))
            safe = np.where(known[:, None, None], covariance, np.eye(3))
            sigma = np.where(known[:, None], np.sqrt(np.diagonal(safe, axis1=-2, axis2=-1)), np.nan)
            weighted = np.linalg.solve(safe, theta[..., None])[..., 0]
            nees = np.where(known, np.sum(theta * weighted, axis=-1) / 3.0, np.nan)
        if estimate.chi2 is not None and estimate.degrees_of_freedom is not None:
            dof = np.broadcast_to(estimate.degrees_of_freedom, (b,)).astype(np.float64)
            fit = np.divide(np.broadcast_to(estimate.chi2, (b,)), dof, out=fit, where=dof > 0)
        return cls(theta, sigma, nees, fit, np.broadcast_to(estimate.status, (b,)).astype(np.int64))

    @classmethod
    def joined(cls, parts: list[Samples]) -> Samples:
        return cls(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)))


@dataclass(frozen=True)
class Tally:
    """Statistics of one estimator over any number of trials; chunks are merged in their order.

    ``status`` (4,) trials by :class:`Status`; ``unusable`` () those without a finite estimate, which no figure can
    hold; ``theta``, ``sigma``, ``ratio`` (error over stated sigma) about the axes of E; ``ground_m``, the horizontal
    displacement of the centres of the images.
    """

    status: Index
    unusable: Index
    theta: Moments
    sigma: Moments
    ratio: Moments
    nees: Moments
    fit: Moments
    ground_m: Moments

    @classmethod
    def of(cls, samples: Samples, ground_m: Array) -> Tally:
        finite = np.all(np.isfinite(samples.theta_E), axis=-1)
        theta = samples.theta_E[finite]
        stated = finite & np.isfinite(samples.nees)
        ratio = samples.theta_E[stated] / samples.sigma_E[stated]
        fit = samples.fit[finite & np.isfinite(samples.fit)]
        return cls(
            np.bincount(samples.status, minlength=len(Status)).astype(np.int64),
            np.array(np.sum(~finite)),
            Moments.of(theta),
            Moments.of(samples.sigma_E[stated]),
            Moments.of(ratio),
            Moments.of(samples.nees[stated, None]),
            Moments.of(fit[:, None]),
            Moments.of(on_ground(theta, ground_m)[:, None]),
        )

    def merge(self, other: Tally) -> Tally:
        merged: dict[str, Any] = {}
        for entry in fields(self):
            a, b = getattr(self, entry.name), getattr(other, entry.name)
            merged[entry.name] = np.asarray(a + b) if isinstance(a, np.ndarray) else a.merge(b)
        return Tally(**merged)

    def arrays(self, prefix: str) -> Arrays:
        """The same as named arrays, to be stored."""
        named: Arrays = {}
        for entry in fields(self):
            part = getattr(self, entry.name)
            if isinstance(part, np.ndarray):
                named[f"{prefix}{entry.name}"] = part
            else:
                named |= {f"{prefix}{entry.name}.{f.name}": getattr(part, f.name) for f in fields(part)}
        return named

    @classmethod
    def from_arrays(cls, named: Mapping[str, NDArray[Any]], prefix: str) -> Tally:
        parts: dict[str, Any] = {}
        for entry in fields(cls):
            name = f"{prefix}{entry.name}"
            if entry.name in ("status", "unusable"):
                parts[entry.name] = named[name]
            else:
                parts[entry.name] = Moments(**{f.name: named[f"{name}.{f.name}"] for f in fields(Moments)})
        return cls(**parts)


def on_ground(theta_E: Array, ground_m: Array) -> Array:
    """Horizontal displacements (n m,), m, of the centres of m images by errors (n, 3) rad; ``ground_m`` (m, 2, 3)."""
    return np.asarray(np.linalg.norm(ground_m @ theta_E[:, None, :, None], axis=(-2, -1)).reshape(-1))


@dataclass(frozen=True)
class Study:
    """A study to run: ``methods`` on a number of ``trials`` of a scenario, drawn from a ``seed``."""

    scenario: Scenario
    methods: Mapping[str, Estimator]
    seed: int
    trials: int
    chunk: int = CHUNK
    keep_samples: bool = False

    @property
    def chunks(self) -> int:
        return -(-self.trials // self.chunk)

    def count(self, c: int) -> int:
        """Trials of chunk c."""
        return min(self.chunk, self.trials - c * self.chunk)

    @cached_property
    def fingerprint(self) -> dict[str, str | int | bool]:
        """All that a chunk's numbers depend on, except how many of its trials are asked for."""
        return {
            **made_with(self.scenario, self.methods),
            "seed": self.seed,
            "chunk": self.chunk,
            "samples": self.keep_samples,
            "format": FORMAT,
        }

    @cached_property
    def estimators(self) -> dict[str, Estimator]:
        """The methods as they run here: least squares on all runs of the scenario together."""
        return {name: of_scene(estimator, self.scenario) for name, estimator in self.methods.items()}

    def generator(self, c: int) -> np.random.Generator:
        """The generator of chunk c."""
        return np.random.Generator(np.random.Philox(key=np.array([self.seed, c], dtype=np.uint64)))

    def measured(self, rng: np.random.Generator, batch: int) -> tuple[Observations, Array]:
        """Measurements of ``batch`` trials and the model mountings (batch, 3, 3) they start from."""
        scenario = self.scenario
        errors = draw(scenario.truth, scenario.sources, rng, (batch,))
        theta = scenario.initial.sigma * scenario.initial.distribution.draw(rng, (batch, 3))
        observations = measure(scenario.stated, scenario.C_EK_true, errors)
        return observations, so3.exp(theta) @ scenario.C_EK_true

    def samples(self, c: int, told: Callable[[int], None] = lambda trials: None) -> dict[str, Samples]:
        """What each method makes of the trials of chunk c; ``told`` hears how many more are done."""
        rng, left = self.generator(c), self.count(c)
        batch = max(1, SIGHTINGS_AT_ONCE // self.scenario.truth.n)
        made: dict[str, list[Samples]] = {name: [] for name in self.methods}
        while left > 0:
            observations, C_EK = self.measured(rng, min(batch, left))
            for name, estimator in self.estimators.items():
                # a run that fails is data: its status is counted, its arithmetic may overflow
                with np.errstate(all="ignore"):
                    made[name].append(Samples.of(estimator(observations, C_EK), self.scenario.C_EK_true))
            told(min(batch, left))
            left -= min(batch, left)
        return {name: Samples.joined(parts) for name, parts in made.items()}

    def run(self, c: int, told: Callable[[int], None] = lambda trials: None) -> Arrays:
        """Chunk c as arrays: ``METHOD/tally/...``, ``METHOD/theta_E`` and, if kept, ``METHOD/samples/...``."""
        arrays: Arrays = {"trials": np.array(self.count(c))}
        for name, samples in self.samples(c, told).items():
            arrays |= Tally.of(samples, self.scenario.ground_m).arrays(f"{name}/tally/")
            arrays[f"{name}/theta_E"] = samples.theta_E
            if self.keep_samples:
                arrays |= {f"{name}/samples/{f.name}": getattr(samples, f.name) for f in fields(samples)}
        return arrays
