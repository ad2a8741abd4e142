"""Kinds of views, and what some more of each would be worth: which kind cures what is badly determined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.units import DEG
from .information import Information
from .pick import Design, Limits, State, greedy
from .views import Views

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NEAR_NADIR, UNTURNED, SAME_PHASE = 3.0 * DEG, 1.0 * DEG, 30.0 * DEG
"""Pitch, turn about the boresight and argument of latitude that a view of the usual kind may differ by."""
USUAL = "the usual view: the home site abeam, unturned"

TIES = "tie points in the images there are"
"""Places that nobody surveyed, measured in all images of a site: no kind of view."""


def kinds(views: Views) -> dict[str, Mask]:
    """Which views are of each kind.  The usual one looks straight across the track at the home site, unturned."""
    ahead = np.abs(views.pitch) > NEAR_NADIR
    turned = np.abs(np.sin(0.5 * views.yaw)) > np.sin(0.5 * UNTURNED)
    home = views.site == 0
    phase = np.angle(np.sum(np.exp(1j * views.u[home]))) if np.any(home) else 0.0
    away = np.abs(np.angle(np.exp(1j * (views.u - phase)))) > SAME_PHASE
    plain = ~ahead & ~turned
    found = {
        USUAL: home & plain,
        "a look ahead or back (pitch)": home & ahead & ~turned,
        "a turn about the boresight (yaw)": home & ~ahead & turned,
        "pitch and yaw together": home & ahead & turned,
        "another site near the same phase of the orbit": ~home & plain & ~away,
        "another site at another phase of the orbit": ~home & plain & away,
    }
    return {name: mask for name, mask in found.items() if np.any(mask)}


@dataclass(frozen=True)
class Cure:
    """``count`` more views of a kind, after which the criterion is ``value`` m^2."""

    kind: str
    count: int
    value: float


def usual(design: Design, views: Views, limits: Limits, count: int) -> list[int]:
    """Up to so many views of the usual kind, the best of them."""
    mask = kinds(views).get(USUAL)
    return [] if mask is None else greedy(State(design), limits, count, mask)


def cures(design: Design, views: Views, limits: Limits, before: list[int], count: int) -> tuple[Cure, ...]:
    """What ``count`` views of each kind are worth after those ``before``, the best kind first.

    All kinds get equally many: of fewer where one that can be had has not so many.
    """
    start, free = State(design), ~limits.blocked(before)
    for j in before:
        start.change(j)
    offered = {name: mask & free for name, mask in kinds(views).items() if np.any(mask & free)}
    taken = {name: greedy(start.copy(), limits, count, mask) for name, mask in offered.items()}
    least = min((len(picks) for picks in taken.values()), default=0)
    found = []
    for name, picks in taken.items():
        state = start.copy()
        for j in picks[:least]:
            state.change(j)
        found.append(Cure(name, least, state.value))
    return tuple(sorted(found, key=lambda cure: cure.value))


def shares(information: Information, design: Design, picks: list[int], axis: Array) -> dict[str, float]:
    """By which part the variance along an axis (3,) would fall after some images if the errors of a source that they
    share were known; the largest first."""
    mine = information.only(np.array(picks))

    def variance(of: Information) -> float:
        state = State(Design(of, design.P_theta, design.W))
        for j in range(of.n):
            state.change(j)
        return float(axis @ state.P[:3, :3] @ axis)

    whole = variance(mine)
    found = {name: 1.0 - variance(mine.without(name)) / whole for name in mine.sources}
    return dict(sorted(found.items(), key=lambda item: -item[1]))
