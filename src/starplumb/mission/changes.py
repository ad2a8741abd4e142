"""Every change of a mounting with its significance and its size, all of them estimated side by side.

The campaigns' rotations are one regression on a mean and the columns of what may change it: a steady trend, the year,
the jumps that were found, temperatures, the phase of the orbit.  Its covariance has the campaigns' own errors, those
that they have in common, and the walk, so that a wander is no trend.  A change is tested by the chi-square of its
coefficients; that of a jump whose time was looked for counts as many times as there are gaps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .trend import YEAR_NS, Trend

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]

FEWEST_BEYOND = 3
"""Campaigns at least beyond the number of columns."""
TOLD_APART = 0.1
"""Smallest singular value of a column apart from the others, per root of the number of campaigns."""


@dataclass(frozen=True)
class Change:
    """One change: its kind and what it is counted by, ``size_E`` (3,) rad (over the whole span, of a jump, half the
    range of a year, of a temperature or of a turn) with ``covariance_E`` (3, 3), its probability ``p`` by chance, and,
    of a jump, between which campaigns."""

    kind: str
    size_E: Array
    covariance_E: Array
    p: float
    between: tuple[int, int] | None = None


def changes(
    found: Trend, temperatures_c: Mapping[str, Array] | None = None, u: Array | None = None
) -> list[Change]:
    """Those that the campaigns can tell, the most significant first; ``temperatures_c`` by name and the argument of
    latitude ``u`` (m,) rad are means of campaigns, not finite where not known."""
    columns = _told(_columns(found, temperatures_c or {}, u))
    if not columns:
        return []
    F = np.concatenate([np.ones((len(found.t_ns), 1)), *columns.values()], axis=1)
    c, P = _regressed(found, F)
    listed, start = [], 1
    for kind, block in columns.items():
        at = slice(3 * start, 3 * (start + block.shape[1]))
        listed.append(_change(found, kind, c[at], P[at, at]))
        start += block.shape[1]
    return sorted(listed, key=lambda change: change.p)


def _columns(found: Trend, temperatures_c: Mapping[str, Array], u: Array | None) -> dict[str, Array]:
    """Columns (m, q) by the kind of change, the surest to be there first."""
    t = (found.t_ns - found.t_ns[0]) / YEAR_NS
    columns = {f"jump:{k}": np.where(np.arange(t.size) >= k, 0.5, -0.5)[:, None] for k in found.jumps}
    if t[-1] > 0.0:
        columns["trend"] = (t / t[-1] - 0.5)[:, None]
    columns["season"] = _circle(2.0 * np.pi * t)
    for name, values in temperatures_c.items():
        if np.all(np.isfinite(values)) and np.ptp(values) > 0.0:
            columns[f"temperature:{name}"] = ((values - np.mean(values)) / (np.ptp(values) / 2.0))[:, None]
    if u is not None and np.all(np.isfinite(u)):
        columns["orbit phase"] = _circle(u)
    return columns


def _circle(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _told(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Those that the campaigns tell apart from a mean and from the ones before."""
    kept: dict[str, Array] = {}
    for kind, block in columns.items():
        m = len(block)
        F = np.concatenate([np.ones((m, 1)), *kept.values(), block], axis=1)
        least = np.linalg.svd(F, compute_uv=False)[-1]
        if m >= F.shape[1] + FEWEST_BEYOND and least > TOLD_APART * np.sqrt(m):
            kept[kind] = block
    return kept


def _regressed(found: Trend, F: Array) -> tuple[Array, Array]:
    """Coefficients (3 q,) of columns F (m, q) and their covariance."""
    m = len(F)
    t = (found.t_ns - found.t_ns[0]) / YEAR_NS
    away = found.points.common_E - np.mean(found.points.common_E, axis=0)
    C = away.reshape(3 * m, -1)
    V = C @ C.T + np.kron(float(found.bank.wander) * np.minimum(t[:, None], t), np.eye(3))
    rows = 3 * np.arange(m)[:, None, None] + np.arange(3)[:, None]
    V[rows, rows.mT] += found.points.own_E
    X, y = np.kron(F, np.eye(3)), found.points.value_E.reshape(-1)
    W = np.linalg.solve(V, np.column_stack([X, y]))
    P = np.linalg.inv(X.T @ W[:, :-1])
    return P @ (X.T @ W[:, -1]), P


def _change(found: Trend, kind: str, c: Array, P: Array) -> Change:
    from ..solve.probability import chdtrc

    p = float(chdtrc(c.size, c @ np.linalg.solve(P, c)))
    if c.size == 6:  # a sine: its amplitude about each axis, the covariance along its phase
        amplitude = np.hypot(c[:3], c[3:])
        along = (
            np.concatenate([np.diag(c[:3]), np.diag(c[3:])], axis=1) / np.maximum(amplitude, 1e-300)[:, None]
        )
        return Change(kind, amplitude, along @ P @ along.T, p)
    name, _, at = kind.partition(":")
    if name != "jump":
        return Change(kind, c, P, p)
    k = int(at)
    tried = 1 if found.chances[k] > found.chances.min() else len(found.t_ns) - 1
    return Change("jump", c, P, min(1.0, tried * p), (k - 1, k))
