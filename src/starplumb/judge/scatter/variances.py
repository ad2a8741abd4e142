"""Variance components of rotations that images make each: their estimate, and the test of each.

Rotations d (m, 3) have one mean and the covariance ``V(f) = sum_s f_s V_s`` with ``V_s = own_s + Z_s Z_s^T``: what an
image has of its own (m, 3, 3), and what c draws do to all images (m, 3, c).  With U the columns ``sqrt(f_s) Z_s`` and
those of the mean, and W the inverse of what is each image's own, the projector of the residuals is::

    P = W - W U (U^T W U + J)^-1 U^T W,    J the identity, 0 for the mean

so that everything costs as many operations as there are images.  Restricted maximum likelihood solves
``tr(P V_s) = d^T P V_s P d`` by Fisher scoring with the information ``1/2 tr(P V_s P V_t)``; at the stated factors the
same numbers test a source, ``d^T P V_s P d`` being about a chi-square scaled to that mean and to the variance
``2 tr(P V_s P V_s)``.
Sources: H. D. Patterson, R. Thompson, Biometrika 58 (1971); F. E. Satterthwaite, Biometrics Bulletin 2 (1946).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDS, TOLERANCE = 60, 1e-3
"""Steps of the scoring at most, and the change of a factor at which it ends."""
LEAST = 1e-3
"""A stated variance is taken to be no smaller than this times what is stated."""
MOST_DEGREES = 1e6
SEVERAL_DRAWS = 1.5
"""Independent draws from which on the scatter tells a factor: two passes have 2, one error of all images is 1."""
ALIKE = 1e-6
"""Part of what the data tell of a factor, not told of others already, below which it is none of its own."""


@dataclass(frozen=True)
class Component:
    """One source of the scatter: ``own`` (m, 3, 3) and ``common`` (m, 3, c) rad.

    ``stated`` is its factor as the campaign has it: 1, or 0 for an error that it does not state.  ``squares``, the
    factor times a chi-square of so many ``degrees`` of freedom, tell of the same factor apart from the rotations.
    ``drawn_anew`` marks what a further session has a draw of its own of.
    """

    name: str
    own: Array
    common: Array
    stated: float = 1.0
    squares: float = 0.0
    degrees: float = 0.0
    drawn_anew: bool = False

    @property
    def single(self) -> bool:
        """Whether images have one draw of it, so that their scatter confirms no stated factor: the draws are the
        variance of one over that of the mean of all."""
        if self.stated == 0.0 or self.degrees > 0.0:
            return False
        of_sum = float(np.sum(np.trace(self.own, axis1=-2, axis2=-1)))
        of_each = len(self.own) * (of_sum + float(np.sum(self.common**2)))
        of_sum += float(np.sum(np.sum(self.common, axis=0) ** 2))
        return of_each < SEVERAL_DRAWS * of_sum

    def spread(self, gain: Array) -> Array:
        """Covariance (3, 3) of the sum of ``gain`` (m, 3, 3) times its errors, at the factor 1."""
        response = np.sum(gain @ self.common, axis=0)
        return np.asarray(np.sum(gain @ self.own @ gain.mT, axis=0) + response @ response.mT)


@dataclass(frozen=True)
class Projector:
    """The residuals' projector at factors f (s,) of components."""

    components: Sequence[Component]
    f: Array

    @cached_property
    def W(self) -> Array:
        return np.linalg.inv(sum(f * c.own for f, c in zip(self.f, self.components, strict=True)))

    @cached_property
    def columns(self) -> Array:
        """U (m, 3, k) without the mean."""
        return np.concatenate(
            [np.sqrt(f) * c.common for f, c in zip(self.f, self.components, strict=True)], -1
        )

    @cached_property
    def U(self) -> Array:
        columns = self.columns
        mean = np.broadcast_to(np.eye(3), (len(columns), 3, 3))
        return np.concatenate([columns, mean], axis=-1)

    @cached_property
    def WU(self) -> Array:
        return np.asarray(self.W @ self.U)

    @cached_property
    def inverse(self) -> Array:
        """``(U^T W U + J)^-1`` (k, k)."""
        k = self.columns.shape[-1]
        M = _products(self.U, self.WU)
        M[np.arange(k), np.arange(k)] += 1.0
        return np.asarray(np.linalg.inv(M))

    def of(self, X: Array) -> Array:
        """P X of X (m, 3, c)."""
        return np.asarray(self.W @ X - self.WU @ (self.inverse @ _products(self.WU, X)))

    @property
    def gain(self) -> Array:
        """G (m, 3, 3) of the weighted mean: its error is the sum of G d."""
        k = self.columns.shape[-1]
        # the mean's rows of (U^T W U + J)^-1 U^T W
        return np.asarray((self.WU @ self.inverse[:, k:]).mT)

    def moments(self, d: Array) -> tuple[Array, Array, Array]:
        """``d^T P V_s P d`` (s,), ``tr(P V_s)`` (s,) and ``tr(P V_s P V_t)`` (s, s)."""
        y = self.of(d[..., None])
        Z = [c.common for c in self.components]
        PZ = [self.of(z) for z in Z]
        WS = [self.W @ c.own for c in self.components]
        SWU = [c.own @ self.WU for c in self.components]
        A = [self.inverse @ _products(self.WU, x) for x in SWU]
        q = np.array(
            [np.sum(y.mT @ c.own @ y) + np.sum(np.sum(c.common.mT @ y, axis=0) ** 2) for c in self.components]
        )
        trace = np.array(
            [_trace(ws) - np.trace(a) + np.sum(z * pz) for ws, a, z, pz in zip(WS, A, Z, PZ, strict=True)]
        )
        s = len(self.components)
        pairs = np.empty((s, s))
        for i in range(s):
            for j in range(i + 1):
                middle = self.inverse * _products(SWU[i], self.W @ SWU[j])
                own = np.sum(WS[i] * WS[j].mT) - 2.0 * np.sum(middle) + np.sum(A[i] * A[j].T)
                mixed = np.sum(PZ[j] * (self.components[i].own @ PZ[j]))
                mixed += np.sum(PZ[i] * (self.components[j].own @ PZ[i]))
                both = _products(Z[i], PZ[j])
                pairs[i, j] = pairs[j, i] = own + mixed + np.sum(both**2)
        return q, trace, pairs


def _products(A: Array, B: Array) -> Array:
    """``sum_i A_i^T B_i`` (a, b) of A (m, 3, a) and B (m, 3, b)."""
    rows = 3 * len(A)
    return np.asarray(A.reshape(rows, A.shape[-1]).T @ B.reshape(rows, B.shape[-1]))


def _trace(M: Array) -> float:
    return float(np.sum(np.trace(M, axis1=-2, axis2=-1)))


@dataclass(frozen=True)
class Factors:
    """Estimated factors ``f`` (s,) of components with their covariance ``spread`` (s, s)."""

    f: Array
    spread: Array

    @property
    def degrees(self) -> Array:
        """Degrees of freedom (s,) behind each."""
        return np.clip(2.0 * self.f**2 / np.maximum(np.diagonal(self.spread), 1e-300), 0.0, MOST_DEGREES)


def satterthwaite(slopes: Array, factors: Factors) -> tuple[Array, Array]:
    """Variance (3,) and degrees of freedom (3,) of ``f^T slopes`` (s, 3); factors that are 0 stay out."""
    on = factors.f > 0.0
    variance = factors.f @ slopes
    spread = np.einsum("si,st,ti->i", slopes[on], factors.spread[np.ix_(on, on)], slopes[on])
    return variance, np.clip(2.0 * variance**2 / np.maximum(spread, 1e-300), 1.0, MOST_DEGREES)


def estimate(d: Array, components: Sequence[Component], held: NDArray[np.bool_] | None = None) -> Factors:
    """By restricted maximum likelihood; a factor that is not stated may be 0, one ``held`` (s,) is as stated."""
    sought = np.full(len(components), True) if held is None else ~held
    f = np.array([c.stated for c in components])
    least = np.array([LEAST * c.stated for c in components])
    twice = np.eye(len(f))
    for _ in range(ROUNDS):
        gradient, twice = _score(d, components, f)
        free = sought & ((f > least) | (gradient > 0.0))
        step = np.zeros_like(f)
        step[free] = np.linalg.lstsq(twice[np.ix_(free, free)], gradient[free], rcond=None)[0]
        before, f = f, np.maximum(f + step, np.maximum(least, 0.1 * f))
        f = np.where((f < 1e-4) & (least == 0.0), 0.0, f)
        if np.max(np.abs(f - before) / np.maximum(before, 0.01)) < TOLERANCE:
            break
    return Factors(f, _spread(twice, sought & (f > 0.0), sought))


def _spread(twice: Array, on: NDArray[np.bool_], sought: NDArray[np.bool_]) -> Array:
    """Covariance (s, s) of factors ``sought`` of this information; one that is 0 and does what others do already
    (images of one group each) takes no part."""
    told = on.copy()
    for k in np.flatnonzero(sought & ~on):
        row = twice[k, on]
        left = twice[k, k] - row @ np.linalg.pinv(twice[np.ix_(on, on)]) @ row
        told[k] = left > ALIKE * twice[k, k]
    spread = np.zeros_like(twice)
    spread[np.ix_(told, told)] = 2.0 * np.linalg.pinv(twice[np.ix_(told, told)])
    return spread


def _score(d: Array, components: Sequence[Component], f: Array) -> tuple[Array, Array]:
    """Gradient (s,) and information (s, s) of the restricted likelihood, both twice."""
    q, trace, pairs = Projector(components, f).moments(d)
    squares = np.array([c.squares for c in components])
    degrees = np.array([c.degrees for c in components])
    safe = np.where(degrees > 0, np.maximum(f, 1e-300), 1.0)
    return q - trace + squares / safe**2 - degrees / safe, pairs + np.diag(degrees / safe**2)


def probabilities(d: Array, components: Sequence[Component]) -> Array:
    """Probability (s,) that a source as stated scatters the rotations at least as much as they do."""
    from ...solve.probability import chdtrc

    q, mean, pairs = Projector(components, np.array([c.stated for c in components])).moments(d)
    degrees = np.array([c.degrees for c in components])
    q, mean = q + np.array([c.squares for c in components]), mean + degrees
    variance = 2.0 * (np.diagonal(pairs) + degrees)
    return np.asarray(chdtrc(2.0 * mean**2 / variance, 2.0 * q * mean / variance))
