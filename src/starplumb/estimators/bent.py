"""The covariance of an estimate beside a lens whose numbers are mostly noise.

Through a distortion a shift of the principal point differs from a turn of the camera.  The information at an estimate
counts the noise in both for that, and is too large; and so far out the residuals are bent, whatever the information.
So the covariance is that of the minima, over draws of the errors e, of residuals to second order in the alignment and
the optics, t in units of their sigmas, about what is surely there of the lens::

    v(t) = e + sum_i A_i t_i + sum_ij K_ij t_i t_j,    K_ij = (dA_i/dt_j + dA_j/dt_i) / 4,    minimise |v|^2

With G the normal equations of the columns [A, K], errors of images eliminated, their right side has the covariance G,
and a minimum is found among as many numbers as there are columns.

What is surely there: with the information ``C^-1 = R^T R`` of the lens, R upper triangular, the numbers ``w = R c`` are
independent, of sigma 1: each by itself, those after it in :data:`NESTED` being what they are found to be.  They are
shrunk to ``w max(0, 1 - 4 / w^2)``: those within two sigmas vanish, and the other unknowns follow.
Source: L. Breiman, Better subset regression using the nonnegative garrote, Technometrics 37 (1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..solve.adjustment import eliminated, invert_information
from ..solve.chunks import part
from ..solve.whitening import Roots
from ..table.observations import Observations
from .fit import Fit, State

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NESTED = ("k1", "p1", "p2", "k2", "k3", "principal_column", "principal_row")
"""Numbers of the lens, the more usual ones first."""
DISTORTION = NESTED[:5]
BENDING = ("focal_length", *NESTED)
"""Parameters in which, with the alignment, the residuals are taken to second order."""
SURE = 4.0
"""Square, in variances, below which a number is taken for noise."""
NOTICEABLE = 1.02
"""Growth of a sigma, where the lens is only what is surely there, from which on draws are worth it."""
ROWS, IMAGES = 3_000, 16
"""Sightings, and images at least, from which the growth is computed."""
DRAWS, STEPS, SETTLED = 400, 40, 1e-4
"""Draws at least, steps of each minimum at most, and the gain of chi-square at which it ends."""


def bent(fit: Fit, covariance: Array) -> Array | None:
    """The covariance (3 + p, 3 + p) of an estimate that stands where the fit does and whose information says
    ``covariance``; None where it need not be another (no batch axes)."""
    names = fit.unknowns.names
    if fit.table.batch or covariance.ndim > 2 or not {*DISTORTION} & {*names}:
        return None
    table, times = _sampled(fit.table)
    here = Sampled(replace(fit, table=table), times)
    there = here.at(surely(fit.state, names, covariance))
    found, sure = (invert_information(f.normal()) for f in (here, there))
    if not (np.all(np.isfinite(found)) and np.all(np.isfinite(sure))):
        return None
    sigma, grown = (np.sqrt(np.diagonal(C)) for C in (found, sure))
    if not np.max(grown / sigma) > NOTICEABLE:
        return None
    bending = np.array([0, 1, 2, *(3 + k for k, name in enumerate(names) if name in BENDING)])
    drawn = there.second_order(bending, grown).covariance * np.outer(grown / sigma, grown / sigma)
    L, M = (np.linalg.cholesky(C / np.outer(sigma, sigma)) for C in (covariance, found))
    grow = L @ np.linalg.inv(M)  # the sample is not the whole
    return np.asarray(grow @ drawn @ grow.mT * np.outer(sigma, sigma))


def surely(state: State, names: Sequence[str], covariance: Array) -> State:
    """The state with the part of the lens that is surely there, all other unknowns following."""
    places = [names.index(name) for name in NESTED if name in names]
    sigma = np.sqrt(np.diagonal(covariance))
    unit = covariance / np.outer(sigma, sigma)
    at = [3 + k for k in places]
    block = unit[np.ix_(at, at)]
    R = np.linalg.cholesky(np.linalg.inv(block)).mT
    w = R @ (state.values[places] / sigma[at])
    less = -w * np.minimum(1.0, SURE / np.maximum(w**2, 1e-300))
    return state.moved(sigma * (unit[:, at] @ np.linalg.solve(block, np.linalg.solve(R, less))))


def _sampled(o: Observations) -> tuple[Observations, float]:
    """Some images spread evenly, and of many sightings in few images some for all, each with a landmark of its own; and
    how many images each of them stands for."""
    used = np.unique(o.image[o.weight > 0.0])
    step = min(int(np.ceil(o.n / ROWS)), max(1, used.size // IMAGES))
    rows = np.flatnonzero(np.isin(o.image, used[::step]) & (o.weight > 0.0))
    thin = max(1, rows.size // ROWS)
    some = part(o, rows[::thin])
    cov = o.cov_landmark_J[some.landmark]
    one = replace(some, landmark=np.arange(some.n), cov_landmark_J=cov, weight=thin * some.weight)
    return one, used.size / used[::step].size


@dataclass(frozen=True)
class Sampled:
    """The adjustment of a sample whose images stand for so many ``times`` as many."""

    fit: Fit
    times: float

    def at(self, state: State) -> Sampled:
        return replace(self, fit=replace(self.fit, state=state))

    def normal(self, further: Sequence[Array] = ()) -> Array:
        """Normal equations (k + q, k + q) of the k unknowns and of q further columns (n, 2), what was known of the
        unknowns among them, errors of images and in common eliminated."""
        o, model, A = self.fit.whole.linearised
        prior = self.fit.whole.prior[0]
        k, q = 3 + self.fit.state.values.size, len(further)
        columns = np.concatenate([A[..., :k], *(d[..., None] for d in further), A[..., k:]], axis=-1)
        N = self.times * eliminated(o, Roots.of(o), model, columns)[1][:-1, :-1]
        N[:k, :k] += prior[:k, :k]
        N[k + q :, k + q :] += prior[k:, k:]
        own, rest = slice(k + q), slice(k + q, None)
        return np.asarray(N[own, own] - N[own, rest] @ np.linalg.solve(N[rest, rest], N[rest, own]))

    def second_order(self, bending: Index, unit: Array) -> SecondOrder:
        """The residuals in units of the unknowns, to second order in those that bend them."""
        slopes = []
        for place in bending:
            step = np.zeros(unit.size)
            step[place] = unit[place]
            ahead, behind = (self.at(self.fit.state.moved(s)).fit.whole.A for s in (step, -step))
            slopes.append(0.5 * (ahead - behind)[..., bending] * unit[bending])
        i, j = np.triu_indices(bending.size)
        K = [
            0.25 * (1 + (a != b)) * (slopes[a][..., b] + slopes[b][..., a]) for a, b in zip(i, j, strict=True)
        ]
        scale = np.concatenate([unit, np.ones(i.size)])
        return SecondOrder(self.normal(K) * np.outer(scale, scale), unit.size, bending[i], bending[j])


@dataclass(frozen=True)
class SecondOrder:
    """Residuals to second order in k numbers t: ``|v(t)|^2 = f^T G f - 2 z^T f``, f = (t, t_i t_j) (k + q,)."""

    G: Array
    k: int
    i: Index
    j: Index

    @cached_property
    def draws(self) -> Array:
        """Right sides z (b, k + q) whose second moments are G exactly."""
        q = len(self.G)
        values, axes = np.linalg.eigh(self.G)
        Q = np.linalg.qr(np.random.default_rng(0).normal(size=(max(DRAWS, 2 * q), q)))[0]
        return np.asarray(np.sqrt(len(Q)) * Q @ (axes * np.sqrt(np.maximum(values, 0.0))).mT)

    @property
    def covariance(self) -> Array:
        """Second moments (k, k) of the minima."""
        t = self.minima(self.draws)
        return np.asarray(t.mT @ t / len(t))

    def terms(self, t: Array) -> Array:
        """f (b, k + q) at t (b, k)."""
        return np.concatenate([t, t[:, self.i] * t[:, self.j]], axis=-1)

    def slope(self, t: Array) -> Array:
        """df/dt (b, k + q, k)."""
        D = np.zeros((len(t), len(self.G), self.k))
        D[:, np.arange(self.k), np.arange(self.k)] = 1.0
        rows = self.k + np.arange(self.i.size)
        D[:, rows, self.i] += t[:, self.j]
        D[:, rows, self.j] += t[:, self.i]
        return D

    def cost(self, t: Array, z: Array) -> Array:
        f = self.terms(t)
        return np.asarray(np.sum((f @ self.G - 2.0 * z) * f, axis=-1))

    def minima(self, z: Array) -> Array:
        """The minima (b, k) next to 0, by Levenberg's and Marquardt's method."""
        t, damped, live = np.zeros((len(z), self.k)), np.full(len(z), 1e-3), np.arange(len(z))
        cost, diagonal = np.zeros(len(z)), np.arange(self.k)
        for _ in range(STEPS):
            D = self.slope(t[live])
            down = D.mT @ (z[live] - self.terms(t[live]) @ self.G)[..., None]
            N = D.mT @ (self.G @ D)
            N[:, diagonal, diagonal] *= 1.0 + damped[live, None]
            tried = t[live] + np.linalg.solve(N, down)[..., 0]
            gain = cost[live] - self.cost(tried, z[live])
            better = gain > 0.0
            t[live[better]] = tried[better]
            cost[live] -= np.where(better, gain, 0.0)
            damped[live] *= np.where(better, 0.2, 10.0)
            live = live[~better | (gain > SETTLED)]
            if live.size == 0:
                break
        return t
