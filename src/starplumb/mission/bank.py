"""What a mounting does between campaigns: a bank of filters, weighed by how well each foretold the next campaign.

The mounting at time t (years) is ``level + c cos 2 pi t + s sin 2 pi t``; its level walks with the variance ``q^2 dt``,
drifts with a slope, and may jump.  A member of the bank is a walk q, and standard deviations beforehand of slope and
season; 0 of each is among them.  A campaign's rotation y with covariance R updates each member by Kalman's equations,
once as if nothing had jumped and once as if the level had, by a jump of standard deviation J::

    S_0 = H P H^T + R,   S_1 = S_0 + J^2,   w = p N(v; S_1) / ((1 - p) N(v; S_0) + p N(v; S_1))

and the two answers are merged into their mean and covariance.  The evidence of a member is the product of those
denominators.  ``p`` is larger in a gap in which something happened to the satellite.
Source: P. J. Harrison, C. F. Stevens, Bayesian forecasting, J. R. Statist. Soc. B 38 (1976).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WALKS = (0.0, 0.125, 0.25, 0.5, 1.0, 2.0)
"""Walk from one campaign to the next, over a campaign's own sigma."""
SLOPES = (0.0, 2.0)
"""Standard deviation of the slope in a year, over a campaign's own sigma."""
SEASONS = (0.0, 1.0, 4.0)
"""Standard deviation of each season coefficient, over a campaign's own sigma."""
JUMP = 8.0
"""Standard deviation of a jump, over a campaign's own sigma."""
CHANCE, AFTER_EVENT = 0.01, 0.3
"""Probability of a jump between two campaigns, and where something happened between them."""
PRESENT = 0.3
"""Probability beforehand of a walk, of a slope, and of a season."""
FLAT = 1e4
"""Standard deviation of the level beforehand, over a campaign's own sigma."""
LEVEL, SLOPE, COSINE, SINE = range(4)


@dataclass(frozen=True)
class Bank:
    """h members after some campaigns, of any leading batch of runs with the same times.

    ``x`` (..., h, 4 d) level, slope (a year), cosine and sine of d axes with ``P`` (..., h, 4 d, 4 d), at the time
    ``t`` (years); ``log`` (..., h) evidence times weight beforehand; ``walk``, ``slope`` and ``season`` (h,) are the
    members' own numbers, rad.
    """

    t: float
    x: Array
    P: Array
    log: Array
    walk: Array
    slope: Array
    season: Array
    jump: float

    @classmethod
    def start(
        cls, unit: float, gap: float, d: int, t: float, batch: tuple[int, ...] = (), *, yearly: bool = True
    ) -> Bank:
        """Before any campaign: ``unit`` rad is a campaign's own sigma, ``gap`` years the usual time between two.

        ``yearly`` False leaves seasons out.
        """
        members = np.array(list(product(WALKS, SLOPES, SEASONS if yearly else SEASONS[:1])))
        some = np.array([len(WALKS), len(SLOPES), len(SEASONS if yearly else SEASONS[:1])]) - 1
        # the sizes of a kind of motion that is there are equally likely
        absent = np.where(some > 0, 1.0 - PRESENT, 1.0)
        chance = np.prod(np.where(members > 0.0, PRESENT / np.maximum(some, 1), absent), axis=1)
        sizes = unit * members
        variance = np.zeros((len(members), 4, d))
        variance[:, LEVEL] = (FLAT * unit) ** 2
        variance[:, SLOPE] = sizes[:, 1, None] ** 2
        variance[:, COSINE:] = sizes[:, 2, None, None] ** 2
        P = np.zeros((len(members), 4 * d, 4 * d))
        P[:, np.arange(4 * d), np.arange(4 * d)] = variance.reshape(len(members), -1)
        return cls(
            t,
            np.zeros((*batch, *P.shape[:2])),
            np.broadcast_to(P, (*batch, *P.shape)).copy(),
            np.broadcast_to(np.log(chance), (*batch, len(members))).copy(),
            sizes[:, 0] / np.sqrt(gap),
            sizes[:, 1],
            sizes[:, 2],
            JUMP * unit,
        )

    @property
    def d(self) -> int:
        return int(self.x.shape[-1]) // 4

    @property
    def weights(self) -> Array:
        """Of the members (..., h)."""
        w = np.exp(self.log - np.max(self.log, axis=-1, keepdims=True))
        return np.asarray(w / np.sum(w, axis=-1, keepdims=True))

    def at(self, t: float) -> Bank:
        """Foretold for another time; backwards the variance of the walk grows just so."""
        dt, d = t - self.t, self.d
        x, P = self.x.copy(), self.P.copy()
        level, slope = slice(d), slice(d, 2 * d)
        x[..., level] += dt * x[..., slope]
        P[..., level, :] += dt * P[..., slope, :]
        P[..., level] += dt * P[..., slope]
        P[..., level, level] += (self.walk**2 * abs(dt))[:, None, None] * np.eye(d)
        return replace(self, t=t, x=x, P=P)

    def observed(self, y: Array, R: Array, chance: float = CHANCE) -> tuple[Bank, Array]:
        """After a campaign at this time with the rotation y (..., d) of covariance R (d, d), and the probability (...)
        that the mounting had jumped."""
        H, level = self.looks, slice(self.d)
        jump = self.jump**2 * np.eye(self.d)
        v = y[..., None, :] - self.x @ H.T
        PH = np.stack([self.P @ H.T] * 2)  # as if nothing had jumped, and as if the level had
        PH[1, ..., level, :] += jump
        K, density = _gain(v, PH, H @ PH + R)
        a, b = density[0] + np.log1p(-chance), density[1] + np.log(chance)
        log = np.logaddexp(a, b)
        w = np.exp(b - log)
        moved = (K @ v[..., None])[..., 0]
        apart = moved[1] - moved[0]
        # the mean of P - K PH^T over both, and what their answers differ by, as one product
        p = w[..., None, None]
        less = np.concatenate([(1.0 - p) * K[0], p * K[1], -p * (1.0 - p) * apart[..., None]], axis=-1)
        P = self.P - less @ np.concatenate([PH[0], PH[1], apart[..., None]], axis=-1).mT
        P[..., level, level] += p * jump
        x = self.x + moved[0] + w[..., None] * apart
        after = replace(self, x=x, P=(P + P.mT) / 2.0, log=self.log + log)
        return after, np.sum(after.weights * w, axis=-1)

    @property
    def looks(self) -> Array:
        """H (d, 4 d): the mounting of the state at this time."""
        one = np.eye(self.d)
        angle = 2.0 * np.pi * self.t
        return np.concatenate([one, 0.0 * one, np.cos(angle) * one, np.sin(angle) * one], axis=1)

    @property
    def state(self) -> tuple[Array, Array]:
        """Mean (..., 4 d) and covariance (..., 4 d, 4 d) of the state, averaged over the members."""
        return averaged(self.weights, self.x, self.P)

    @property
    def mounting(self) -> tuple[Array, Array]:
        """Mean (..., d) and covariance (..., d, d) of the mounting at this time."""
        return averaged(*self.seen)

    @property
    def seen(self) -> tuple[Array, Array, Array]:
        """Of each member its weight (..., h), and mean (..., h, d) and covariance (..., h, d, d) of the mounting at
        this time."""
        H = self.looks
        return self.weights, self.x @ H.T, H @ self.P @ H.T

    @property
    def wander(self) -> Array:
        """Mean variance (...) of the walk in a year."""
        return np.asarray(self.weights @ self.walk**2)

    @property
    def kinds(self) -> Mapping[str, float]:
        """Weights of the kinds of motion, the likeliest first, of a single run; ``constant`` is none of them."""
        found: dict[str, float] = {}
        parts = {"walk": self.walk, "trend": self.slope, "season": self.season}
        for i, weight in enumerate(self.weights.tolist()):
            name = "+".join(kind for kind, size in parts.items() if size[i] > 0.0) or "constant"
            found[name] = found.get(name, 0.0) + weight
        return dict(sorted(found.items(), key=lambda item: -item[1]))


def _gain(v: Array, PH: Array, S: Array) -> tuple[Array, Array]:
    """Kalman's gain (..., 4 d, d) for innovations v (..., d) of covariance S, and the logarithm of their density."""
    W = np.linalg.inv(S)
    square = (v[..., None, :] @ W @ v[..., None])[..., 0, 0]
    return PH @ W, -0.5 * (square + np.linalg.slogdet(S)[1])


def averaged(w: Array, mean: Array, P: Array) -> tuple[Array, Array]:
    """Mean (..., k) and covariance (..., k, k) of members with weights w (..., h)."""
    middle = (w[..., None, :] @ mean)[..., 0, :]
    away = mean - middle[..., None, :]
    own = np.sum(w[..., None, None] * P, axis=-3)
    return middle, own + (w[..., None] * away).mT @ away
