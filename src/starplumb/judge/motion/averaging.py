"""How a mounting moves: models of its motion averaged by their evidence, their amplitudes too.

A model is a constant, about which nothing is known beforehand, and columns f_a of time, orbit or temperature whose
coefficients are drawn with the standard deviation ``A s_a``, s_a = 1/k for harmonic k.  With M and v of
:mod:`starplumb.judge.motion.sums` its evidence, posterior mean and covariance are::

    log E = 1/2 v^T P v - 1/2 log det (1 + S M S),   c = -P v,   P = S (1 + S M S)^-1 S,   S = diag(A s)

The average over all models and over a grid of A has the mean ``sum w c`` and the covariance
``sum w (P + c c^T) - mean mean^T``: what parts the models is in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .regressors import LINEAR, MEAN, ORBIT, STEP, Scales, When, harmonics, told_apart
from .sums import ImageSums

Array = NDArray[np.float64]

AMPLITUDES = 2.0 ** np.arange(-2, 9)
"""Grid of A, in standard deviations of an image's own rotation about the axis that it tells best."""
FREE = 1e3
"""Standard deviation of the constant beforehand, in the same unit, over the largest amplitude."""
SHRUNK = 4
"""Harmonics of the model whose amplitudes fall as 1/k."""
NEGLIGIBLE = 1e-4
"""Weight of a model below which it is left out."""

Structure = tuple[str, ...]
"""Names of the columns of a model beside the constant."""


@dataclass(frozen=True)
class Motion:
    """How a mounting moves: ``names`` (Q,) of columns, the first the mean, their ``coefficients`` (Q, 3) rad about E
    with ``covariance`` (3 Q, 3 Q); ``weights`` of the models in it by name."""

    names: tuple[str, ...]
    coefficients: Array
    covariance: Array
    scales: Scales
    weights: Mapping[str, float]

    def at(self, when: When) -> tuple[Array, Array]:
        """Rotation (n, 3) rad about E and its covariance (n, 3, 3): the mounting is ``exp(d) C_EK``."""
        F = self.scales.columns(self.names, when)
        q = len(self.names)
        P = self.covariance.reshape(q, 3, q, 3)
        return F @ self.coefficients, np.einsum("na,aibj,nb->nij", F, P, F)

    @property
    def mean(self) -> Array:
        """That of the constant (3,) rad."""
        return np.asarray(self.coefficients[0])

    @property
    def mean_covariance(self) -> Array:
        return np.asarray(self.covariance[:3, :3])


def structures(families: Mapping[str, Sequence[Structure]]) -> dict[str, tuple[Structure, ...]]:
    """Kinds of models of what images can tell, each with its alternatives; ``families`` as they are tested."""
    found: dict[str, tuple[Structure, ...]] = {"constant": ((),)}
    found |= {name: tuple(sets) for name, sets in families.items()}
    if (first := f"{ORBIT}:1") in families:
        for other in (LINEAR, STEP):
            if other in families:
                found[f"{first}+{other}"] = tuple((*harmonics(1), *names) for names in families[other])
        if f"{ORBIT}:3" in families:
            found[f"{ORBIT}:{SHRUNK}"] = (harmonics(SHRUNK),)
    return found


def averaged(
    sums: ImageSums,
    when: When,
    scales: Scales,
    kinds: Mapping[str, Sequence[Structure]],
    variance: float = 1.0,
) -> Motion:
    """The average of models by their evidence; ``variance`` is that of the errors over what is stated."""
    sums = sums.scaled(variance)
    unit = _unit(sums)
    parts: list[_Fitted] = []
    for kind, sets in kinds.items():
        F = [scales.columns((MEAN, *names), when) for names in sets]
        good = [i for i, one in enumerate(F) if not sets[i] or told_apart(one)]
        if good:
            chosen = [sets[i] for i in good]
            parts += _fitted(sums, np.stack([F[i] for i in good]), chosen, kind, 1.0 / len(good), unit)
    return _collapsed(parts, scales)


@dataclass(frozen=True)
class _Fitted:
    kind: str
    columns: Structure
    log_weight: float
    c: Array
    P: Array


def _unit(sums: ImageSums) -> float:
    """Standard deviation of the rotation of a usual image about the axis that it tells best, rad."""
    return float(1.0 / np.sqrt(np.median(np.linalg.eigvalsh(sums.N)[:, -1])))


def _fitted(
    sums: ImageSums, F: Array, sets: Sequence[Structure], kind: str, weight: float, unit: float
) -> list[_Fitted]:
    """Posteriors of models F (b, m, q) of one kind, averaged over A each."""
    M, v = sums.equations(F)
    M[..., :3, :3] += sums.prior
    v[..., :3] += sums.prior_vector
    amplitudes = unit * (AMPLITUDES if F.shape[-1] > 1 else AMPLITUDES[:1])
    size = np.repeat(np.array([_falls(name) for name in (MEAN, *sets[0])]), 3)
    S = amplitudes[:, None] * size
    S[:, :3] = FREE * unit * AMPLITUDES[-1]
    A = np.eye(size.size) + S[:, :, None] * M[:, None] * S[:, None, :]
    half = S[:, :, None] * np.linalg.inv(A) * S[:, None, :]
    c = -(half @ v[:, None, :, None])[..., 0]
    log = -0.5 * np.sum(c * v[:, None, :], axis=-1) - 0.5 * np.linalg.slogdet(A)[1]
    log += np.log(weight / amplitudes.size)
    top = np.max(log, axis=-1, keepdims=True)
    w = np.exp(log - top)
    total = np.sum(w, axis=-1, keepdims=True)
    w = w / total
    mean = np.einsum("ba,bai->bi", w, c)
    away = c - mean[:, None]
    P = np.einsum("ba,baij->bij", w, half) + np.einsum("ba,bai,baj->bij", w, away, away)
    logs = (top + np.log(total))[:, 0]
    return [
        _Fitted(kind, names, float(one), *rest) for names, one, *rest in zip(sets, logs, mean, P, strict=True)
    ]


def _falls(name: str) -> float:
    """Standard deviation of a coefficient over A."""
    kind, _, which = name.partition(":")
    return 1.0 / int(which.partition(" ")[0]) if kind == ORBIT else 1.0


def _collapsed(parts: Sequence[_Fitted], scales: Scales) -> Motion:
    log = np.array([part.log_weight for part in parts])
    w = np.exp(log - log.max())
    w /= w.sum()
    kept = [(float(x), part) for x, part in zip(w, parts, strict=True) if x >= NEGLIGIBLE]
    total = sum(x for x, _ in kept)
    names = tuple(dict.fromkeys((MEAN, *(name for _, part in kept for name in part.columns))))
    Q = len(names)
    mean, second, weights = np.zeros(3 * Q), np.zeros((3 * Q, 3 * Q)), dict[str, float]()
    for x, part in kept:
        at = np.array([names.index(name) for name in (MEAN, *part.columns)])
        where = (3 * at[:, None] + np.arange(3)).reshape(-1)
        share = x / total
        mean[where] += share * part.c
        second[np.ix_(where, where)] += share * (part.P + np.outer(part.c, part.c))
        weights[part.kind] = weights.get(part.kind, 0.0) + share
    P = second - np.outer(mean, mean)
    return Motion(names, mean.reshape(Q, 3), (P + P.T) / 2.0, scales, weights)
