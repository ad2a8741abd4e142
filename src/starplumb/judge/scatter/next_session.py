"""The mounting that a further session or pass shows: what its images share is drawn anew, with a variance that few
sessions hardly tell.

Given the other factors, the columns Z of what sessions share and the projector P of the residuals without it reduce
the images to independent numbers: with ``Z^T P Z = Q diag(l) Q^T`` the entries of ``Q^T Z^T P d`` over ``sqrt(l)`` are
normal with the variances ``1 + f l``.  The factor f then has the density of these times Jeffreys' prior
``sqrt(sum (l / (1 + f l))^2)``, a chi-square's for equal l, cut off where f would be negative.  With f drawn from it,
and the variance of the mounting with its own degrees of freedom, the interval holds 95 % of the normals of all these
variances: a factor that is found to be 0 is not taken to be 0.
Source: H. Jeffreys, Proc. R. Soc. A 186 (1946); G. C. Tiao, W. Y. Tan, Biometrika 52 (1965).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .variances import Component, Factors, Projector, satterthwaite

Array = NDArray[np.float64]

FEW_SESSIONS = 5
"""Sessions below which the interval is wider by much, and this is said."""
DRAWS = 256
"""Variances over which the interval is averaged: quantiles, combined as by a Latin square."""
TOLD = 1e-9
"""Number l over the largest below which a combination of sessions tells nothing."""
FAR = 1e4
"""Variance over that found from which on a factor is not looked for."""


@dataclass(frozen=True)
class NextSession:
    """Half-widths ``half_95_E`` (3,) rad of the 95 % intervals of the mounting at a further session (or pass: ``of``),
    from so many ``groups``."""

    of: str
    groups: int
    half_95_E: Array


def factors(d_E: Array, components: Sequence[Component], f: Array, k: int) -> Array:
    """Equally probable values (DRAWS,) of the factor k, at the other factors of f (s,)."""
    Z, without = components[k].common, f.copy()
    without[k] = 0.0
    projector, columns = Projector(components, without), Z.reshape(-1, Z.shape[-1])
    values, axes = np.linalg.eigh(columns.T @ projector.of(Z).reshape(columns.shape))
    told = values > TOLD * values[-1]
    r = columns.T @ projector.of(d_E[..., None]).reshape(-1)
    return _drawn(values[told], (axes.T @ r)[told] ** 2 / values[told])


def _drawn(values: Array, squares: Array) -> Array:
    """Of ``squares`` of normals with the variances ``1 + f values`` the quantiles (DRAWS,) of f."""
    mean = float(np.mean(values))
    u = np.linspace(0.0, np.log(FAR * max(1.0, float(np.mean(squares)))), 1001)
    f = np.expm1(u) / mean
    grown = 1.0 + f[:, None] * values
    prior = 0.5 * np.log(np.sum((values / grown) ** 2, axis=1))
    log = prior + u - 0.5 * np.sum(np.log(grown) + squares / grown, axis=1)
    density = np.exp(log - np.max(log))
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    return np.asarray(np.interp((np.arange(DRAWS) + 0.5) / DRAWS, summed / summed[-1], f))


def half_95(variance: Array, degrees: Array, shared: Sequence[tuple[Array, Array]]) -> Array:
    """Half-widths (3,) of a ``variance`` (3,) with ``degrees`` (3,) of freedom to which each of ``shared`` adds: its
    factors (DRAWS,), and what it does at the factor 1 (3,)."""
    from ...solve.probability import chdtri

    order, levels = np.random.default_rng(0), (np.arange(DRAWS) + 0.5) / DRAWS
    total = variance * degrees / chdtri(degrees, levels[:, None])
    for f, slope in shared:
        total = total + order.permutation(f)[:, None] * slope
    return _holding(np.sqrt(total))


def _holding(sigmas: Array) -> Array:
    """Half-widths (3,) that hold 95 % of the normals of all these sigmas (DRAWS, 3)."""
    from ...solve.probability import ndtr

    low, high = np.zeros(sigmas.shape[1]), 10.0 * np.max(sigmas, axis=0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        enough = np.mean(2.0 * ndtr(middle / sigmas) - 1.0, axis=0) >= 0.95
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return np.asarray(high)


def next_session(
    d_E: Array, components: Sequence[Component], found: Factors, slopes: Array
) -> NextSession | None:
    """Of a mounting whose variance is ``found.f @ slopes`` (s, 3); None where no component is drawn anew."""
    shared = [k for k, c in enumerate(components) if c.drawn_anew]
    if not shared:
        return None
    f = found.f.copy()
    f[shared] = 0.0
    variance, degrees = satterthwaite(slopes, Factors(f, found.spread))
    new = [np.mean(np.sum(components[k].common ** 2, axis=-1), axis=0) for k in shared]
    drawn = [(factors(d_E, components, found.f, k), slopes[k] + x) for k, x in zip(shared, new, strict=True)]
    first = components[shared[0]]
    return NextSession(
        first.name.partition(",")[0], first.common.shape[-1] // 3, half_95(variance, degrees, drawn)
    )
