"""The mounting of a mission against time: what the campaigns say of it, and what will be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .bank import AFTER_EVENT, CHANCE, Bank, averaged
from .points import Points

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]

YEAR_NS = 365.25 * 86_400e9
A_DAY = 1.0 / 365.25
"""Campaigns that are closer together tell of no motion that goes on: theirs would be foretold at a rate no mounting
has."""
HALF_A_YEAR = 0.5
"""Span in years below which no season is told."""
JUMPED = 0.5
"""Probability from which on a jump is taken for one."""


@dataclass(frozen=True)
class Trend:
    """Campaigns at ``t_ns`` (m,) with their ``points``, the mounting ``value_E`` (m, 3) rad about that of the points
    with ``covariance_E`` (m, 3, 3) as it was known after each, and the probability ``jumped`` (m,) that it had jumped
    since the one before; ``bank`` is what is known after the last.  ``shared_E`` (3, 3) is what the campaigns' errors
    have in common, which no change shows and every covariance has."""

    t_ns: Epochs
    points: Points
    value_E: Array
    covariance_E: Array
    jumped: Array
    bank: Bank
    shared_E: Array
    chances: Array

    @property
    def jumps(self) -> list[int]:
        """Campaigns before which the mounting jumped."""
        return [int(k) for k in np.flatnonzero(self.jumped > JUMPED) if k > 0]

    def at(self, t_ns: int) -> tuple[Array, Array]:
        """The mounting (3,) and its covariance (3, 3) at a time: foretold after the last campaign, before it by the
        campaigns on either side."""
        if t_ns >= self.t_ns[-1]:
            value, P = self.bank.at(years(self.t_ns, t_ns)).mounting
            return value, P + self.shared_E
        value, P = _between(self, t_ns)
        return value, P + self.shared_E


def years(t_ns: Epochs, at_ns: int) -> float:
    """Time after the first campaign."""
    return float((at_ns - t_ns[0]) / YEAR_NS)


def trend(t_ns: Epochs, found: Points, events_ns: Sequence[int] = ()) -> Trend:
    """Of campaigns in the order of time; something happened to the satellite at ``events_ns``."""
    m = len(t_ns)
    mean = np.mean(found.common_E, axis=0)
    away = found.common_E - mean
    R = found.own_E + away @ away.mT  # what differs between sites looks like a campaign's own error
    chances = np.full(m, CHANCE)
    for event in events_ns:
        after = int(np.searchsorted(t_ns, event))
        chances[after : after + 1] = AFTER_EVENT
    bank, jumped, seen = _start(t_ns, R), np.zeros(m), []
    for k in range(m):
        bank, jumped[k] = bank.at(years(t_ns, int(t_ns[k]))).observed(
            found.value_E[k], R[k], float(chances[k])
        )
        seen.append(bank.seen)
    value, P = averaged(*map(np.array, zip(*seen, strict=True)))
    jumped[0] = 0.0
    shared = np.asarray(mean @ mean.T)
    return Trend(t_ns, found, value, P + shared, jumped, bank, shared, chances)


def _start(t_ns: Epochs, R: Array) -> Bank:
    unit = float(np.sqrt(np.median(np.linalg.eigvalsh(R)[:, 0])))
    gap = float(np.median(np.diff(t_ns)) / YEAR_NS) if len(t_ns) > 1 else 1.0 / 12.0
    span = years(t_ns, int(t_ns[-1]))
    return Bank.start(unit, max(gap, A_DAY), 3, 0.0, yearly=span > HALF_A_YEAR)


def _between(one: Trend, t_ns: int) -> tuple[Array, Array]:
    """By the campaigns before a time, and by those after it in the opposite order."""
    away = one.points.common_E - np.mean(one.points.common_E, axis=0)
    R = one.points.own_E + away @ away.mT
    sides = []
    for order in (np.flatnonzero(one.t_ns <= t_ns), np.flatnonzero(one.t_ns > t_ns)[::-1]):
        bank = _start(one.t_ns, R)
        for k in order.tolist():
            bank, _ = bank.at(years(one.t_ns, int(one.t_ns[k]))).observed(one.points.value_E[k], R[k], CHANCE)
        if order.size:
            sides.append(bank.at(years(one.t_ns, t_ns)).mounting)
    if len(sides) == 1:
        return sides[0]
    (a, A), (b, B) = sides
    gain = A @ np.linalg.inv(A + B)
    return a + gain @ (b - a), A - gain @ A
