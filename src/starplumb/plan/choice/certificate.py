"""A certified bound on the criterion of the best choice, by the convex problem whose images may be taken in part.

``f(w) = tr(W P(w))``, ``P(w) = (N_0 + sum_i w_i U_i U_i^T)^-1`` is convex in the parts w.  Every choice of k images is
a w of zeros and ones, so with any w whatsoever::

    f(choice) >= f(w) + min_s  grad f(w)^T (s - w),      d f / d w_i = - || R^T P U_i ||^2

where s runs over 0 <= s_i <= 1, sum s <= k, at most one of images that clash, at most so many of a pass: the largest
gains.  The Frank-Wolfe method improves w, and the largest bound met holds.  Draws of passes are eliminated pass by
pass.
Source: M. Frank and P. Wolfe, Naval Research Logistics Quarterly 3 (1956); duality gap: M. Jaggi, ICML (2013).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .pick import Design

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CLOSE = 2e-3
"""Part of the criterion between value and bound at which the search ends."""
SMALLEST_STEP = 1e-5
"""Part of the way below which the search ends."""


@dataclass(frozen=True)
class Room:
    """What a relaxed choice may take: at most ``count`` in all, one of each ``slot`` (n,), ``per_pass`` of a pass."""

    count: int
    slot: Index
    pass_of: Index
    per_pass: int

    def largest(self, gain: Array) -> Array:
        """The s (n,) of zeros and ones with the largest sum of gains: the limits lie one within the other."""
        order = np.argsort(-gain, kind="stable")
        order = order[_first(self.slot[order], 1)]
        order = order[_first(self.pass_of[order], self.per_pass)][: self.count]
        s = np.zeros(gain.size)
        s[order[gain[order] > 0.0]] = 1.0
        return s


def _first(group: Index, most: int) -> NDArray[np.bool_]:
    """Which entries are among the first ``most`` of their group."""
    order = np.argsort(group, kind="stable")
    sorted_ = group[order]
    start = np.searchsorted(sorted_, sorted_)
    out = np.empty(group.size, dtype=np.bool_)
    out[order] = np.arange(group.size) - start < most
    return out


class _Relaxed:
    """The sums of parts of images, group by group of one pass and one site."""

    def __init__(self, design: Design) -> None:
        i = self.i = design.information
        self.design = design
        self.order = np.lexsort((i.site_of, i.pass_of))
        key = i.pass_of[self.order] * (design.sites + 1) + i.site_of[self.order]
        first = np.flatnonzero(np.diff(key, prepend=-1))
        self.bounds = list(zip(first.tolist(), [*first[1:].tolist(), i.n], strict=True))
        self.pass_ = np.unique(i.pass_of[self.order][first], return_inverse=True)[1]
        site = i.site_of[self.order][first]
        U = i.factor[self.order]
        self.flat = [
            np.ascontiguousarray(np.moveaxis(U[a:b], 1, 0).reshape(U.shape[1], -1)) for a, b in self.bounds
        ]
        g = i.common
        base = np.broadcast_to(np.arange(g), (site.size, g))
        self.where = np.concatenate([base, g + i.of_site * site[:, None] + np.arange(i.of_site)], axis=1)
        self.kept = np.concatenate([np.arange(g), np.arange(g + i.of_pass, U.shape[1])])
        of = [np.flatnonzero(self.pass_ == k) for k in range(int(self.pass_.max()) + 1)]
        pairs = [(a, b) for mine in of for a in mine.tolist() for b in mine.tolist()]
        self.a, self.b = np.array(pairs, dtype=np.int64).T
        self.size = len(design.start)
        self.known = np.linalg.inv(design.start)

    def sums(self, w: Array) -> Array:
        """``sum w U U^T`` of each group, (G, d, d)."""
        r, d = self.i.factor.shape[-1], self.i.factor.shape[1]
        parts = np.repeat(w[self.order], r)
        out = np.zeros((len(self.flat), d, d))
        for k, ((a, b), U) in enumerate(zip(self.bounds, self.flat, strict=True)):
            on = np.flatnonzero(parts[a * r : b * r])
            if on.size:
                V = U[:, on]
                out[k] = (V * parts[a * r + on]) @ V.T
        return out

    def covariance(self, M: Array) -> tuple[Array, Array]:
        """P over [mounting, campaign | sites], and what the eliminated passes take from each group, (G, kept, p)."""
        i = self.i
        passes = slice(i.common, i.common + i.of_pass)
        inside = M[:, self.kept[:, None], self.kept]
        total = self._spread(self.where, self.where, inside)
        side = M[:, self.kept, passes]
        own = np.zeros((int(self.pass_.max()) + 1, i.of_pass, i.of_pass))
        np.add.at(own, self.pass_, M[:, passes, passes])
        carried = side @ np.linalg.inv(own + np.eye(i.of_pass))[self.pass_] if i.of_pass else side
        taken = carried[self.a] @ side[self.b].mT
        total -= self._spread(self.where[self.a], self.where[self.b], taken)
        N = self.known + total
        return np.asarray(np.linalg.inv(0.5 * (N + N.T))), carried

    def _spread(self, rows: Index, columns: Index, blocks: Array) -> Array:
        """The sum of blocks (x, a, b) at rows (x, a) and columns (x, b) of a matrix."""
        at = rows[:, :, None] * self.size + columns[:, None, :]
        total = np.bincount(at.ravel(), blocks.ravel(), self.size**2)
        return np.asarray(total.reshape(self.size, self.size))

    def value(self, M: Array) -> float:
        return self.design.value(self.covariance(M)[0])

    def gains(self, P: Array, carried: Array) -> Array:
        """``|| R^T P U_i ||^2`` (n,) in the order of the candidates."""
        i = self.i
        top = (self.design.root.T @ P[:3])[:, self.where].swapaxes(0, 1)
        of_pass = np.zeros((int(self.pass_.max()) + 1, 3, i.of_pass))
        np.add.at(of_pass, self.pass_, top @ carried)
        rows = np.concatenate([top[..., : i.common], -of_pass[self.pass_], top[..., i.common :]], axis=-1)
        out = np.empty(i.n)
        for (a, b), U, row in zip(self.bounds, self.flat, rows, strict=True):
            out[self.order[a:b]] = np.sum((row @ U).reshape(3, b - a, -1) ** 2, axis=(0, 2))
        return out


@dataclass(frozen=True)
class Certificate:
    """``bound`` m^2 below which the criterion of no choice can lie, and the ``relaxed`` value met."""

    bound: float
    relaxed: float
    rounds: int


def certificate(design: Design, room: Room, start: Array, rounds: int = 100) -> Certificate:
    """The largest bound in so many rounds, from parts ``start`` (n,)."""
    relaxed = _Relaxed(design)
    w = np.array(start, dtype=np.float64)
    M = relaxed.sums(w)
    bound, value, done, step = 0.0, np.inf, 0, 0.25
    while done < rounds and step >= SMALLEST_STEP:
        done += 1
        P, carried = relaxed.covariance(M)
        value, gain = design.value(P), relaxed.gains(P, carried)
        s = room.largest(gain)
        bound = max(bound, value - float(gain @ (s - w)))
        if value <= bound * (1.0 + CLOSE):
            break
        away = relaxed.sums(s) - M
        step = _along(relaxed, M, away, value, min(4.0 * step, 1.0))
        w, M = w + step * (s - w), M + step * away
    return Certificate(bound, value, done)


def _along(relaxed: _Relaxed, M: Array, away: Array, value: float, step: float) -> float:
    """The part of the way, halved from ``step`` as long as that is better; 0 where none is."""
    best, at = value, 0.0
    while step >= SMALLEST_STEP:
        new = relaxed.value(M + step * away)
        if new >= best and at > 0.0:
            break
        if new < best:
            best, at = new, step
        step *= 0.5
    return at
