"""Samples that end milliseconds short of the image, as those of Pleiades Neo do: continued by steps as their last."""

from __future__ import annotations

import numpy as np

from ..text.tree import Array, Epochs

MOST_NS = 20_000_000
"""So far a satellite bends from its tangent by 2 mm, and one that turns by 0.01 deg/s^2 by 0.01 arcsec."""
_MOST_STEPS = 4


def reaching(t_ns: Epochs, values: Array, first_ns: int, last_ns: int) -> tuple[Epochs, Array, int]:
    """``t_ns`` (n,) and ``values`` (n, k), continued to ``first_ns`` and ``last_ns`` where MOST_NS and four at most
    of their steps lack; and how much lacked, ns.  Of quaternions the two signs are one."""
    before_ns, before = _continued(t_ns, values, int(t_ns[0]) - first_ns)
    after_ns, after = _continued(t_ns[::-1], values[::-1], last_ns - int(t_ns[-1]))
    every = np.concatenate([before_ns[::-1], t_ns, after_ns])
    far = max(
        [int(t_ns[0]) - first_ns] * bool(before_ns.size)
        + [last_ns - int(t_ns[-1])] * bool(after_ns.size)
        + [0]
    )
    return every, np.concatenate([before[::-1], values, after]), far


def _continued(t_ns: Epochs, values: Array, lacking_ns: int) -> tuple[Epochs, Array]:
    """The samples before the first two, the nearest first, so that ``lacking_ns`` are covered."""
    step_ns = int(t_ns[1] - t_ns[0])
    steps = -(-lacking_ns // abs(step_ns))
    if not (0 < lacking_ns <= MOST_NS and steps <= _MOST_STEPS):
        return t_ns[:0], values[:0]
    count = np.arange(1, steps + 1)
    second = values[1] if values[0] @ values[1] >= 0.0 else -values[1]
    return t_ns[0] - count * step_ns, values[0] - count[:, None] * (second - values[0])
