"""Does a common mistake that is one number (a clock, a focal length, heights) fit better than none?

A single number that is wrong hides in a chi-square of hundreds of degrees of freedom, and moves the answer by many
sigmas all the same.  A test directed at it does not.  With N and b the normal equations of what was estimated (a) and
of one further number (j), at the estimate::

    n = N_jj - N_ja N_aa^-1 N_aj,     r = b_j - N_ja N_aa^-1 b_a,     value = -r / n,     gain in chi-square = r^2 / n

and the estimate would move by ``N_aa^-1 N_aj r / n``.  All numbers are tested with one pass over the data.
Source: C. R. Rao, Proceedings of the Cambridge Philosophical Society 44 (1948).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import Fit, State, Unknowns
from ..physics.units import ARCSEC
from ..solve.chunks import sample, sampled
from ..table.campaign import Campaign
from ..table.parameters import Parameter
from .conventions.mistake import Mistake
from .conventions.unknowns import numbers
from .trust import NORMAL_95, Finding

Array = NDArray[np.float64]

LEVEL = 1e-4
"""Probability that a good campaign is said to contain any of these mistakes."""


@dataclass(frozen=True)
class Better:
    """A number that fits better than zero: by how much chi-square falls, its value and sigma, and how far the answer
    moves with it, (3,) rad about E."""

    mistake: Mistake
    gain: float
    value: Array
    sigma: Array
    turn_E: Array

    @property
    def reach_E(self) -> Array:
        """How far from the answer (3,) rad the truth may then lie: the turn and 1.96 of its own sigmas."""
        return np.asarray(np.abs(self.turn_E) * (1.0 + NORMAL_95 / np.sqrt(self.gain)))


def unmodelled(campaign: Campaign, fit: Fit, scale: float = 1.0) -> Finding | None:
    """The number that fits best, if it is improbable that it does so by chance; the interval then holds both answers.

    ``scale`` is the variance factor of the fit: what residuals larger than stated explain needs no further mistake.
    """
    from ..solve.probability import chdtri

    tried = list(better(campaign, fit))
    if not tried:
        return None
    least = max(scale, 1.0) * float(chdtri(1, LEVEL / len(tried)))
    found = [one for one in tried if one.gain > least]
    if not found:
        return None
    best = max(found, key=lambda one: one.gain)
    assert best.mistake.measured is not None
    moved = float(np.linalg.norm(best.turn_E)) / ARCSEC
    return Finding(
        f"it looks as if {best.mistake.measured(best.value, best.sigma)} (chi-square would fall by {best.gain:.3g}, "
        f"and the answer move by {moved:.2g} arcsec): {best.mistake.remedy}, or run starplumb diagnose",
        True,
        reach_E=np.max([one.reach_E for one in found], axis=0),
    )


def better(campaign: Campaign, fit: Fit) -> Iterator[Better]:
    """Every number that could be tried and is not estimated already."""
    known = set(fit.unknowns.names)
    tried = [m for m in numbers(campaign) if known.isdisjoint(n for p in m.free for n in p.names)]
    if not tried or np.any(fit.table.batch):
        return
    extra = tuple(parameter for mistake in tried for parameter in mistake.free)
    solution = wider(fit, extra).solve()
    N, b = solution.information, -(solution.information @ solution.x[:, None])[:, 0]
    first, count = 3 + len(fit.unknowns.names), len(tried)
    a = np.setdiff1d(np.arange(len(N)), np.arange(first, first + count))
    inner = np.linalg.solve(N[np.ix_(a, a)], np.column_stack([N[a, first : first + count], b[a]]))
    for j, mistake in enumerate(tried, start=first):
        through = inner[:, j - first]
        n, r = N[j, j] - N[j, a] @ through, b[j] - N[j, a] @ inner[:, -1]
        if n > 1e-12 * N[j, j]:
            turn_E = through[:3] * r / n
            yield Better(mistake, r * r / n, np.array([-r / n]), np.array([n**-0.5]), turn_E)


def wider(fit: Fit, extra: tuple[Parameter, ...]) -> Fit:
    """The fit with further numbers at zero, of a sample where the table is large."""
    table = sample(fit.table) if sampled(fit.table) else fit.table
    unknowns = Unknowns((*fit.unknowns.parameters, *extra))
    values = np.concatenate([fit.state.values, np.zeros(sum(len(p.names) for p in extra))])
    return replace(fit, unknowns=unknowns, table=table, state=State(fit.state.C_EK, values))
