"""The choice of images: one after another the one that lowers the criterion most, then exchanges.

The criterion is ``f = tr(W P)`` with P the covariance of the mounting beside all shared errors, W what a turn does on
the ground, m^2 per rad^2: A-optimality, the mean square error in metres.  With the factor U of an image and
W = R R^T::

    P' = P - P U (1 + K)^-1 U^T P,   K = U^T P U,   gain = || R^T P U (1 + K)^-1/2 ||^2

K and B = R^T P U of all candidates are kept and brought up to date after each choice: ``K' = K - T^T T``,
``B' = B - R^T Q T`` with ``Q = P U_j (1 + K_j)^-1/2`` of the image chosen and ``T = Q^T U``.  Candidates are the last
axis, so that every step is a few long loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .information import Information

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Design:
    """What is chosen from: the information of the candidates, the covariance ``P_theta`` (3, 3) rad^2 of the mounting
    beforehand, and W (3, 3) m^2/rad^2."""

    information: Information
    P_theta: Array
    W: Array

    @cached_property
    def root(self) -> Array:
        """R (3, 3) with W = R R^T."""
        values, axes = np.linalg.eigh(self.W)
        return np.asarray(axes * np.sqrt(np.maximum(values, 0.0)))

    @property
    def sites(self) -> int:
        return int(self.information.site_of.max(initial=-1)) + 1

    @property
    def start(self) -> Array:
        """Covariance beforehand over [mounting, campaign | site by site]."""
        i = self.information
        P = np.eye(i.common + i.of_site * self.sites)
        P[:3, :3] = self.P_theta
        return P

    def value(self, P: Array) -> float:
        """The criterion, m^2."""
        return float(np.sum(self.W * P[:3, :3]))


class State:
    """What is known after some images, and what each candidate would add; changed by :meth:`change`."""

    def __init__(self, design: Design) -> None:
        i = design.information
        self.design, self.n, self.rank = design, i.n, i.factor.shape[-1]
        self.P = design.start
        self.slot: dict[int, int] = {}
        g, p = i.common, i.of_pass
        U = np.ascontiguousarray(np.moveaxis(i.factor, 0, -1))  # (d, r, n)
        self.U = U[:g], U[g : g + p], U[g + p :]
        self.in_pass = _members(i.pass_of)
        self.in_site = _members(i.site_of)
        self.U_site = {
            site: np.ascontiguousarray(self.U[2][..., mine]) for site, mine in self.in_site.items()
        }
        everywhere = np.arange(g)
        PU = np.tensordot(self.P[np.ix_(everywhere, everywhere)], self.U[0], axes=(1, 0))
        self.K = np.einsum("arn,asn->rsn", self.U[0], PU) + sum(
            np.einsum("arn,asn->rsn", V, V) for V in self.U[1:]
        )
        self.B = np.tensordot(design.root.T, PU[:3], axes=(1, 0))

    def copy(self) -> State:
        """The same, to be changed by itself."""
        other = copy(self)
        other.P, other.K, other.B, other.slot = self.P.copy(), self.K.copy(), self.B.copy(), dict(self.slot)
        return other

    @property
    def value(self) -> float:
        return self.design.value(self.P)

    @property
    def sigma(self) -> float:
        """Standard deviation of the mounting about the axis known worst, rad."""
        return float(np.sqrt(np.max(np.diagonal(self.P)[:3])))

    def gains(self) -> Array:
        """By how much each candidate would lower the criterion, (n,) m^2."""
        return _gains(self.K, self.B)

    def _rows(self, j: int) -> Index:
        """Where the unknowns of a candidate stand in P; a pass that has none yet is given its place."""
        i, size = self.design.information, len(self.P)
        mine, site = int(i.pass_of[j]), int(i.site_of[j])
        if mine not in self.slot and i.of_pass:
            self.slot[mine] = size
            grown = np.eye(size + i.of_pass)
            grown[:size, :size] = self.P
            self.P = grown
        at = i.common + i.of_site * site
        start = self.slot.get(mine, 0)
        return np.concatenate(
            [np.arange(i.common), np.arange(start, start + i.of_pass), np.arange(at, at + i.of_site)]
        )

    def change(self, j: int, sign: float = 1.0) -> None:
        """Add candidate j, or with sign -1 take it away again."""
        rows = self._rows(j)
        U = self.design.information.factor[j]
        PU = self.P[:, rows] @ U
        M = np.eye(self.rank) + sign * (U.T @ PU[rows])
        Q = np.linalg.solve(np.linalg.cholesky(0.5 * (M + M.T)), PU.T).T
        self.P = self.P - sign * (Q @ Q.T)
        T = self._felt(Q)
        self.B -= sign * np.tensordot(self.design.root.T @ Q[:3], T, axes=(1, 0))
        for r in range(self.rank):
            for s in range(r, self.rank):
                step = sign * np.einsum("qn,qn->n", T[:, r], T[:, s])
                self.K[r, s] -= step
                if s > r:
                    self.K[s, r] -= step

    def _felt(self, Q: Array) -> Array:
        """``Q^T U`` of all candidates, (r, r, n)."""
        i = self.design.information
        T = np.tensordot(Q[: i.common].T, self.U[0], axes=(1, 0))
        for site, mine in self.in_site.items():
            at = i.common + i.of_site * site
            part = Q[at : at + i.of_site]
            if np.any(part):
                T[..., mine] += np.tensordot(part.T, self.U_site[site], axes=(1, 0))
        for one, start in self.slot.items():
            mine = self.in_pass[one]
            T[..., mine] += np.tensordot(Q[start : start + i.of_pass].T, self.U[1][..., mine], axes=(1, 0))
        return T


def _members(of: Index) -> dict[int, Index]:
    order = np.argsort(of, kind="stable")
    names, first = np.unique(of[order], return_index=True)
    return dict(zip(names.tolist(), np.split(order, first[1:]), strict=True))


def _gains(K: Array, B: Array) -> Array:
    """``|| B (1 + K)^-1/2 ||^2`` for each of n, by Cholesky's method on all at once."""
    r = len(K)
    L: list[list[Array]] = []
    total = np.zeros(K.shape[-1])
    solved: list[Array] = []
    for a in range(r):
        row: list[Array] = []
        for b in range(a):
            row.append((K[a, b] - sum(row[c] * L[b][c] for c in range(b))) / L[b][b])
        row.append(np.sqrt(1.0 + K[a, a] - sum(x * x for x in row)))
        L.append(row)
        y = B[:, a] - sum(row[c] * solved[c] for c in range(a))
        solved.append(y / row[a])
        total += np.sum(solved[a] ** 2, axis=0)
    return total


@dataclass(frozen=True)
class Limits:
    """What may not be taken together: ``clash`` (n, some) of views of one pass too near in time to turn between them,
    as pairs ``first``, ``second`` sorted by the first, and at most ``per_pass`` images of a pass."""

    first: Index
    second: Index
    pass_of: Index
    per_pass: int

    def with_(self, j: int) -> Index:
        """The candidates that cannot be taken beside j."""
        start, end = np.searchsorted(self.first, [j, j + 1])
        return self.second[start:end]

    def blocked(self, picks: list[int]) -> Mask:
        """Candidates that may not be added to some."""
        out = np.zeros(self.pass_of.size, dtype=np.bool_)
        out[picks] = True
        for j in picks:
            out[self.with_(j)] = True
        full = np.bincount(self.pass_of[picks], minlength=self.pass_of.max(initial=0) + 1) >= self.per_pass
        return np.asarray(out | full[self.pass_of])


def greedy(
    state: State,
    limits: Limits,
    count: int,
    among: Mask | None = None,
    sigma: float = 0.0,
    first: Sequence[int] = (),
) -> list[int]:
    """Up to ``count`` candidates (of those ``among``), each the best beside the ones before it, until the mounting is
    known to ``sigma`` rad about each axis; ``first`` are taken at any rate."""
    picks = list(first)
    for j in picks:
        state.change(j)
    while len(picks) < count and state.sigma > sigma:
        gain = state.gains()
        gain[limits.blocked(picks)] = -1.0
        if among is not None:
            gain[~among] = -1.0
        j = int(np.argmax(gain))
        if gain[j] <= 0.0:
            break
        state.change(j)
        picks.append(j)
    return picks


def best_first(design: Design, picks: list[int]) -> tuple[list[int], list[Array]]:
    """The same images, the one that is worth most first, and the covariance (3, 3) of the mounting after each."""
    mine = Design(design.information.only(np.array(picks)), design.P_theta, design.W)
    state, free = State(mine), np.ones(len(picks), dtype=np.bool_)
    order, known = [], []
    for _ in picks:
        j = int(np.argmax(np.where(free, state.gains(), -1.0)))
        free[j] = False
        state.change(j)
        order.append(picks[j])
        known.append(state.P[:3, :3].copy())
    return order, known


WORTH = 1e-6
"""Part of the criterion that an exchange must gain."""


def exchange(state: State, limits: Limits, picks: list[int], sweeps: int) -> list[int]:
    """The choice with each image in turn replaced by the best there is, until none gains or so many times through."""
    picks = list(picks)
    for _ in range(sweeps):
        before = list(picks)
        for i, old in enumerate(before):
            now = state.value
            state.change(old, -1.0)
            rest = [j for j in picks if j != old]
            gain = state.gains()
            gain[limits.blocked(rest)] = -1.0
            best = int(np.argmax(gain))
            new = best if state.value - gain[best] < now * (1.0 - WORTH) else old
            state.change(new)
            picks[i] = new
        if picks == before:
            break
    return picks
