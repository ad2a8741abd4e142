"""What to do about a mounting, by the metres that it is expected to gain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..physics.orbit import EARTH_RADIUS, GM_EARTH
from .trend import YEAR_NS, Trend

Array = NDArray[np.float64]
Foretold = Callable[[int], tuple[Array, Array]]

STEPS = 8
"""Times of the horizon at which a loss is looked at."""
WORTH = 0.05
"""Part of the error in use that a change must gain to be worth its work."""
COARSER = 1.5
"""A new campaign is due when the error on the ground is larger than right after one by this factor."""
LONGEST_YEARS = 5.0
"""How far ahead the next campaign is looked for."""

Action = Literal["keep", "issue", "calibrate"]


@dataclass(frozen=True)
class Advice:
    """What to do: ``keep`` the mounting in use, ``issue`` the foretold one, or ``calibrate`` again.

    ``in_use`` rad is the rms error across the line of sight over the horizon of the mounting that was issued, None
    where none was; ``if_issued`` that of the one that would be now, ``if_calibrated`` right after a campaign like the
    latest.  ``calibrate_by_ns`` is when a new campaign is due, None for no time that matters.
    """

    action: Action
    in_use: float | None
    if_issued: float
    if_calibrated: float
    calibrate_by_ns: int | None

    @property
    def gain(self) -> float | None:
        """By issuing, rad."""
        return None if self.in_use is None else self.in_use - self.if_issued


def altitude_m(period_s: float) -> float:
    """Height of a round orbit above the equator by its period: what an arc second is on the ground at the nadir."""
    a = (GM_EARTH * (period_s / (2.0 * np.pi)) ** 2) ** (1.0 / 3.0)
    return float(a - EARTH_RADIUS)


def across(C_EK: Array) -> Array:
    """Projector (3, 3) on the rotations about E that move the centre of the image on the ground: not about the line of
    sight."""
    b = C_EK[:, 2]
    return np.asarray(np.eye(3) - np.outer(b, b))


def advice(found: Trend, issued: Foretold | None, now_ns: int, horizon_ns: int) -> Advice:
    """By the trend and the mounting in use, ``issued`` of a time, about that of the points; over a horizon from now."""
    Q = across(found.points.C_EK)
    times = [now_ns + horizon_ns * k // (STEPS - 1) for k in range(STEPS)]
    foretold = [found.at(t) for t in times]
    new = _rms([np.trace(Q @ P) for _, P in foretold])
    old = None
    if issued is not None:
        off = [value - issued(t)[0] for (value, _), t in zip(foretold, times, strict=True)]
        old = _rms([np.trace(Q @ P) + d @ Q @ d for (_, P), d in zip(foretold, off, strict=True)])
    after = _after_a_campaign(found, now_ns, Q)
    due = _due(found, now_ns, after, Q)
    action: Action = "keep"
    if due is not None and due <= now_ns + horizon_ns:
        action = "calibrate"
    elif old is None or old - new > WORTH * old:
        action = "issue"
    return Advice(action, old, new, after, due)


def _rms(variances: list[float]) -> float:
    return float(np.sqrt(np.mean(variances)))


def _after_a_campaign(found: Trend, t_ns: int, Q: Array) -> float:
    """Error right after a campaign at a time that is like the latest ones."""
    P = found.at(t_ns)[1] - found.shared_E
    R = np.median(found.points.own_E[-5:], axis=0)
    after = P - P @ np.linalg.solve(P + R, P)
    return _rms([float(np.trace(Q @ (after + found.shared_E)))])


def _due(found: Trend, now_ns: int, after: float, Q: Array) -> int | None:
    ahead = now_ns + (np.geomspace(1.0 / 365.25, LONGEST_YEARS, 60) * YEAR_NS).astype(np.int64)
    for t in [now_ns, *ahead.tolist()]:
        if _rms([float(np.trace(Q @ found.at(t)[1]))]) > COARSER * after:
            return int(t)
    return None
