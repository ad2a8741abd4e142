"""Which mounting to use until the next campaign: rules compared on simulated missions.

A campaign a month measures one axis of a mounting that walks, moves with the year and jumps now and then; each rule
names a value for the month that follows.  ``issued`` is what :class:`~starplumb.mission.bank.Bank` foretells.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .bank import Bank

Array = NDArray[np.float64]

SIGNIFICANT = 1.959963985
"""Sigmas of a change that the rule ``newest if significant`` acts on."""


@dataclass(frozen=True)
class Mission:
    """A kind of mission: the ``sigma`` of a campaign, the ``walk`` in a month, the amplitude ``yearly``, so many
    ``jumps`` of standard deviation ``jump``, all in one unit; ``months``."""

    sigma: float
    walk: float
    yearly: float
    jumps: int
    jump: float = 5.0
    months: int = 60


def compared(kind: Mission, rng: np.random.Generator, runs: int) -> Mapping[str, float]:
    """Root mean square error of the mounting in use over the month after each campaign, by rule."""
    x = _moves(kind, rng, runs)
    y = x + kind.sigma * rng.standard_normal(x.shape)
    used = {
        "first": np.broadcast_to(y[:, :1], y.shape),
        "newest": y,
        "newest if significant": _significant(y, kind.sigma),
        "mean": np.cumsum(y, axis=1) / np.arange(1, kind.months + 1),
        "issued": foretold(y, kind.sigma),
    }
    return {name: float(np.sqrt(np.mean((value[:, :-1] - x[:, 1:]) ** 2))) for name, value in used.items()}


def _moves(kind: Mission, rng: np.random.Generator, runs: int) -> Array:
    month = np.arange(kind.months)
    x = np.cumsum(kind.walk * rng.standard_normal((runs, kind.months)), axis=1)
    x += kind.yearly * np.sin(2.0 * np.pi * (month / 12.0 + rng.random((runs, 1))))
    for _ in range(kind.jumps):
        at, size = rng.integers(6, kind.months, (runs, 1)), kind.jump * rng.standard_normal((runs, 1))
        x += np.where(month >= at, size, 0.0)
    return np.asarray(x - x[:, :1])


def _significant(y: Array, sigma: float) -> Array:
    """The newest value only where it differs from the one in use by more than chance allows."""
    used = y.copy()
    for k in range(1, y.shape[1]):
        far = np.abs(y[:, k] - used[:, k - 1]) > SIGNIFICANT * np.sqrt(2.0) * sigma
        used[:, k] = np.where(far, y[:, k], used[:, k - 1])
    return used


def foretold(y: Array, sigma: float) -> Array:
    """What is foretold for the next month after each campaign (runs, months)."""
    runs, months = y.shape
    bank = Bank.start(sigma, 1.0 / 12.0, 1, 0.0, (runs,))
    found = np.zeros_like(y)
    R = np.array([[sigma**2]])
    for k in range(months):
        bank, _ = bank.at(k / 12.0).observed(y[:, k, None], R)
        found[:, k] = bank.at((k + 1) / 12.0).mounting[0][:, 0]
    return found
