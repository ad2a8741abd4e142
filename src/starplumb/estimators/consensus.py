"""The rotation on which most sightings agree, found from exact rotations of pairs.

Two sightings fix the mounting exactly.  A wrong one among them betrays itself twice: the angle between two directions
is the same in E and in K, and a rotation from a wrong pair is not that of any other.  All tests are angles on the
sphere, so neither the size of the initial error nor sightings behind the camera matter.

Source: M. A. Fischler and R. C. Bolles, Random sample consensus, Communications of the ACM 24 (1981); the score is that
of P. H. S. Torr and A. Zisserman, MLESAC, Computer Vision and Image Understanding 78 (2000).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..physics.covariance import pixel_axes
from ..table.equation import Linearised
from ..table.observations import Observations
from .protocol import Status
from .wahba import Wahba

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

GATE = 4.0
"""Misfit, in sigmas, up to which a sighting supports a rotation."""
PAIRS = 20_000
"""Pairs of sightings looked at, all if there are no more."""
HYPOTHESES = 256
"""Rotations tried."""
BY_CHANCE = 1e-3
"""Probability of finding as many agreeing sightings by chance at which they are believed."""
JUDGES = 4_000
"""Sightings that judge them."""
ANCHORS = 200
"""Residuals of an image about which its largest cluster is looked for, all if there are no more."""


@dataclass(frozen=True)
class Directions:
    """Sightings as pairs of unit vectors ``e_E``, ``e_K`` (n, 3), with the sigmas of the angle between them, rad.

    ``own`` (n,) is the sigma of what a sighting shares with no other of its image, ``shared`` (n,) that of what it
    does; each is the largest over the directions in the image.
    """

    e_E: Array
    e_K: Array
    image: Index
    own: Array
    shared: Array

    @classmethod
    def of(cls, o: Observations, slack: Array | float = 0.0) -> Directions:
        """Of a table without batch axes; ``slack`` (n,) rad is what further unknowns may add to ``own``."""
        column = np.linalg.norm(o.slope_K[..., 0], axis=-1)
        row = np.linalg.norm(o.slope_K[..., 1], axis=-1) + np.linalg.norm(o.row_rate_E, axis=-1)
        place = _largest_of(o.cov_landmark_J, o.landmark) / o.range_m**2
        _, largest_px = pixel_axes(o.sigma_px, o.ellipse)
        own = (largest_px * np.maximum(column, row)) ** 2 + place + np.square(slack)
        position = _largest_of(o.cov_position_J, o.image) / o.range_m**2
        shared = _largest_of(o.cov_attitude_E, o.image) + position
        return cls(o.e_E, o.e_K, o.image, np.sqrt(own), np.sqrt(shared))


@dataclass(frozen=True)
class Consensus:
    """The rotation found, which sightings (n,) lie within the gate of it, and whether so many would not by chance."""

    C_EK: Array
    agree: Mask
    convincing: bool


def _largest_of(covariance: Array, member: Index) -> Array:
    """Largest eigenvalue (n,) of each member's covariance (count, 3, 3)."""
    if member.size < len(covariance):
        return _largest(covariance[member])
    return _largest(covariance)[member]


def _largest(S: Array) -> Array:
    """Largest eigenvalue of symmetric S (..., 3, 3), from the angle that the three roots of its cubic share."""
    a, b, c = S[..., 0, 0], S[..., 1, 1], S[..., 2, 2]
    d, e, f = S[..., 1, 2], S[..., 0, 2], S[..., 0, 1]
    middle = (a + b + c) / 3.0
    a, b, c = a - middle, b - middle, c - middle
    size = np.sqrt((a * a + b * b + c * c + 2.0 * (d * d + e * e + f * f)) / 6.0)
    half = 0.5 * (a * (b * c - d * d) - f * (f * c - d * e) + e * (f * d - b * e))
    cosine = np.divide(half, size**3, out=np.ones_like(size), where=size > 0.0)
    return np.asarray(middle + 2.0 * size * np.cos(np.arccos(np.clip(cosine, -1.0, 1.0)) / 3.0))


def consensus(
    o: Observations, rng: np.random.Generator, slack: Array | float = 0.0, *, alone: bool = False
) -> Consensus | None:
    """The rotation with the most support among sightings of weight above zero; None where no pair is consistent.

    With ``alone`` the table is one image and errors it shares are taken as part of the rotation.
    """
    d = Directions.of(o, slack)
    seen = np.flatnonzero(o.weight > 0.0)
    a, b = consistent_pairs(d, seen, rng)
    if a.size == 0:
        return None
    chord = np.linalg.norm(d.e_K[a] - d.e_K[b], axis=-1)
    if a.size > HYPOTHESES:
        chosen = rng.choice(a.size, HYPOTHESES, replace=False, p=chord / chord.sum())
        a, b, chord = a[chosen], b[chosen], chord[chosen]
    C = pair_rotation(d.e_E[a], d.e_E[b], d.e_K[a], d.e_K[b])
    judges = seen if seen.size <= JUDGES else rng.choice(seen, JUDGES, replace=False)
    shared = 0.0 if alone else 2.0 * d.shared[judges] ** 2
    turn = (d.own[a] ** 2 + d.own[b] ** 2) / chord**2  # variance of the rotation about the pair's middle
    middle = 0.5 * (d.e_K[a] + d.e_K[b])
    lever = _squares(d.e_K[judges].mT - middle[:, :, None])
    own = d.own[judges] ** 2 + 0.5 * (d.own[a] ** 2 + d.own[b] ** 2)[:, None]
    score = np.sum(_support(d, C, judges, own + shared + turn[:, None] * lever), axis=-1)
    C_best, agree = _polish(o, d, C[int(np.argmax(score))], seen, alone=alone)
    return Consensus(C_best, agree, _convincing(d, agree, seen, a.size))


def _support(d: Directions, C: Array, rows: Index, variance: Array) -> Array:
    """1 for a perfect fit down to 0 at the gate, of rotations (h, 3, 3) by sightings (r,): (h, r)."""
    turned = (C.reshape(-1, 3) @ d.e_K[rows].mT).reshape(*C.shape[:-1], -1)
    misfit = _squares(turned - d.e_E[rows].mT)
    return np.asarray(np.maximum(0.0, 1.0 - misfit / (GATE**2 * variance)))


def _squares(v: Array) -> Array:
    """Squares of the lengths (h, r) of vectors (h, 3, r): component by component, which NumPy streams through."""
    x, y, z = v[..., 0, :], v[..., 1, :], v[..., 2, :]
    return np.asarray(x * x + y * y + z * z)


def _convincing(d: Directions, agree: Mask, seen: Index, tried: int) -> bool:
    """Whether all sightings agree, or more of them than any of the rotations tried would find by chance.

    A wrong sighting lies within the gate with the probability p that the gate's area is of the field's (for a square
    field 6 times the mean square radius); beyond the two that made it a rotation then finds Poisson(n p) more.
    """
    from ..solve.probability import pdtrc

    count = int(np.sum(agree[seen]))
    if count == seen.size:
        return True
    centred = d.e_K[seen] - np.mean(d.e_K[seen], axis=0)
    gate = GATE**2 * np.mean(d.own[seen] ** 2 + 2.0 * d.shared[seen] ** 2)
    share = min(1.0, np.pi * gate / (6.0 * np.mean(np.sum(centred**2, axis=-1))))
    return count > 3 and bool(tried * pdtrc(count - 3, seen.size * share) < BY_CHANCE)


def _polish(o: Observations, d: Directions, C: Array, seen: Index, *, alone: bool) -> tuple[Array, Mask]:
    """The closed form over the sightings that agree, until they are the same."""
    variance = d.own**2 + (0.0 if alone else 2.0 * d.shared**2)
    agree = np.zeros(o.n, dtype=bool)
    for _ in range(10):
        before = agree.copy()
        agree = np.zeros(o.n, dtype=bool)
        agree[seen] = _support(d, C[None], seen, variance[seen])[0] > 0.0
        if np.sum(agree) < 2 or np.array_equal(agree, before):
            break
        refined = Wahba()(replace(o, weight=agree.astype(np.float64)), C)
        if refined.status == int(Status.SINGULAR):
            break
        C = refined.C_EK
    return C, agree


def consistent_pairs(d: Directions, seen: Index, rng: np.random.Generator) -> tuple[Index, Index]:
    """Pairs of sightings (p,), (p,) whose angle is the same in E and in K; within an image where there are any."""
    a, b = _pairs(d.image[seen], rng)
    a, b = seen[a], seen[b]
    apart = np.linalg.norm(d.e_K[a] - d.e_K[b], axis=-1)
    difference = apart - np.linalg.norm(d.e_E[a] - d.e_E[b], axis=-1)
    variance = d.own[a] ** 2 + d.own[b] ** 2
    variance = variance + np.where(d.image[a] == d.image[b], 0.0, d.shared[a] ** 2 + d.shared[b] ** 2)
    good = (difference**2 < GATE**2 * variance) & (apart**2 > 100.0 * variance)
    return a[good], b[good]


def _pairs(image: Index, rng: np.random.Generator) -> tuple[Index, Index]:
    """Pairs (p,), (p,) of sightings of the same image, drawn where there are more than PAIRS; else of any images."""
    order = np.argsort(image, kind="stable")
    counts = np.bincount(image)[image[order]]
    start = np.searchsorted(image[order], image[order])
    if not np.any(counts > 1):
        start, counts = np.zeros_like(start), np.full_like(counts, image.size)
    if image.size and np.sum(counts - 1) // 2 <= PAIRS:
        first = np.repeat(np.arange(image.size), counts)
        offset = np.arange(first.size) - np.repeat(np.cumsum(counts) - counts, counts)
        second = start[first] + offset
        above = second > first
        return order[first[above]], order[second[above]]
    first = rng.integers(image.size, size=PAIRS)
    second = start[first] + rng.integers(counts[first])
    apart = first != second
    return order[first[apart]], order[second[apart]]


def pair_rotation(e_Ea: Array, e_Eb: Array, e_Ka: Array, e_Kb: Array) -> Array:
    """C_EK (..., 3, 3) that best carries two directions in K to two in E, both with the same weight.

    The frames are built on the bisector of the two, their difference and the normal, which is the closed form of the
    least-squares rotation of two vectors.
    Source: M. D. Shuster, S. D. Oh, Three-axis attitude determination from vector observations, J. Guidance 4 (1981).
    """
    return np.asarray(_frame(e_Ea, e_Eb) @ _frame(e_Ka, e_Kb).mT)


def _frame(a: Array, b: Array) -> Array:
    """Axes (..., 3, 3) as columns: bisector, difference, normal."""
    x, y = a + b, b - a
    x, y = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (x, y))
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def cluster(z: Array, V: Array, U: Array) -> Mask:
    """The largest cluster (n,) of residuals z (n, 2) px of one image.

    Two residuals belong together when ``d^T (V_a + V_b + (U_a - U_b) (U_a - U_b)^T)^-1 d < 16``, d their difference,
    V (n, 2, 2) what a sighting does not share and U (n, 2, s) what is not known of the state, by unit errors.
    """
    anchors = slice(None, None, 1 if len(z) <= ANCHORS else len(z) // ANCHORS + 1)
    support = np.zeros(len(z[anchors]))
    for at in range(0, len(z), JUDGES):
        rows = slice(at, at + JUDGES)
        distance = _distance((z[anchors], V[anchors], U[anchors]), (z[rows], V[rows], U[rows]))
        support += np.sum(np.maximum(0.0, 1.0 - distance / GATE**2), axis=-1)
    best = np.arange(len(z))[anchors][[int(np.argmax(support))]]
    return np.asarray(_distance((z[best], V[best], U[best]), (z, V, U))[0] < GATE**2)


def _distance(a: tuple[Array, Array, Array], b: tuple[Array, Array, Array]) -> Array:
    """Square of the distance (a, b) of all pairs of two sets of residuals in units of what may lie between them."""
    dx, dy = (a[0][:, None, i] - b[0][None, :, i] for i in range(2))
    xx, xy, yy = (_between(a, b, i, j) for i, j in ((0, 0), (0, 1), (1, 1)))
    squares = yy * dx * dx
    squares -= 2.0 * xy * dx * dy
    squares += xx * dy * dy
    squares /= xx * yy - xy * xy
    return np.asarray(squares)


def _between(a: tuple[Array, Array, Array], b: tuple[Array, Array, Array], i: int, j: int) -> Array:
    """Entry i, j of ``V_a + V_b + (U_a - U_b) (U_a - U_b)^T`` of all pairs, as one product of what belongs to each."""
    (x, own_a), (y, own_b) = (
        ((U[:, i], U[:, j]), V[:, i, j] + np.vecdot(U[:, i], U[:, j])) for _, V, U in (a, b)
    )
    left = np.concatenate([-x[0], -x[1], own_a[:, None], np.ones((len(own_a), 1))], axis=-1)
    right = np.concatenate([y[1], y[0], np.ones((len(own_b), 1)), own_b[:, None]], axis=-1)
    return np.asarray(left @ right.mT)


def own_covariance(o: Observations, model: Linearised) -> Array:
    """Covariance (n, 2, 2) px^2 of pixel noise and landmark."""
    place = model.R @ o.cov_landmark_J[o.landmark] @ model.R.mT
    return np.asarray(place + o.noise_px)
