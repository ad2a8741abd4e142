"""Which cluster of each image's residuals to believe: those on which the images agree.

The right sightings of an image lie in one cluster of residuals, and so may wrong ones that share a mistake: labels
shifted by one, a wrong orthoimage.  The larger cluster is not always the right one.  But each cluster implies a
rotation of its whole image, whose size the stated errors of attitude and position bound, and the right ones of all
images imply the same.  So every image votes with the cluster that fits a common rotation best, by its share of the
image's sightings times ``1 - m^2 / 21.1``, m the Mahalanobis distance of the two rotations; the rotation with the most
votes is the answer.  That with the most votes among what is rejected in the end is its rival: where it has nearly as
many, nothing says which of the two is right.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..solve.problem import Linear
from .consensus import cluster, own_covariance

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

GATE = 21.1
"""Square of the Mahalanobis distance up to which a cluster supports a rotation: chi-square of 3, once in
10 000, as rare as a good image that is rejected."""
AT_MOST = 4
"""Clusters looked for in an image."""
LEAST_SHARE = 0.15
"""Share of its image's sightings below which a cluster is scatter."""
COMPARABLE = 0.5
"""Size, over that of the largest cluster of its image, up to which a cluster may be the right one."""
HELD = 10.0
"""Times what is not known of the common state to which a rotation is held: one sighting fixes none."""
JUDGES = 2_000
"""Clusters that judge the rotations tried, all if there are no more."""
HYPOTHESES = 200
"""Clusters whose rotations are tried."""
AT_ONCE = 10_000
"""Pairs of a cluster and a rotation looked at together."""
REFINED = 30
"""Of these, the best, which are refined by the clusters that support them."""
ROUNDS = 5
"""Times they are refined at most."""
MEMBERS = 3
"""Rejected sightings of an image that must agree before they speak for another answer."""


@dataclass(frozen=True)
class Clusters:
    """Clusters (k,) of residuals, each with its ``image``, its ``rows`` of the table and its ``share`` of the image's
    sightings, and the rotation ``d_E`` (k, 3) rad of the state that it implies, with the covariance ``S_E`` (k, 3, 3)
    that the errors of sightings, image and common unknowns leave it."""

    image: Index
    rows: tuple[Index, ...]
    share: Array
    d_E: Array
    S_E: Array

    @property
    def size(self) -> int:
        return self.image.size

    @cached_property
    def one_each(self) -> bool:
        """Whether no image has two, and they stand in the order of the images."""
        return bool(np.all(np.diff(self.image) > 0))

    def some(self, chosen: Index) -> Clusters:
        """The chosen ones."""
        rows = tuple(self.rows[k] for k in chosen)
        return Clusters(self.image[chosen], rows, self.share[chosen], self.d_E[chosen], self.S_E[chosen])


@dataclass(frozen=True)
class Agreement:
    """A rotation ``d_E`` (3,) rad of the state with its covariance, the ``votes`` for it, one an image at most, and
    which clusters gave them."""

    d_E: Array
    S_E: Array
    votes: float
    clusters: Index


def clusters_of(parts: Iterable[tuple[Index, Linear]], seen: Mask, known: Array) -> Clusters:
    """All clusters of a table (n,) linearised in parts; ``known`` (k,) are the standard deviations of the common
    unknowns, alignment first."""
    found = [
        (image, rows[mine], share, *implied)
        for rows, linear in parts
        for image, mine, share, implied in _of_part(linear, seen[rows], known)
    ]
    image, rows, share, d_E, S_E = zip(*found, strict=True) if found else ((),) * 5
    shape = np.reshape(d_E, (-1, 3)), np.reshape(S_E, (-1, 3, 3))
    return Clusters(np.array(image, dtype=np.int64), tuple(rows), np.array(share, dtype=np.float64), *shape)


def _of_part(
    linear: Linear, seen: Mask, known: Array
) -> Iterator[tuple[int, Index, float, tuple[Array, Array]]]:
    """Clusters of some images: image, rows, share, and the rotation implied with its covariance."""
    table, model, A = linear
    V, U = own_covariance(table, model), A[..., : known.size] * known
    for mine in members(table.image, seen):
        left = mine
        for _ in range(AT_MOST):
            if left.size < max(1.0, LEAST_SHARE * mine.size):
                break
            inside = cluster(model.z_px[left], V[left], U[left])
            if np.sum(inside) < max(1.0, LEAST_SHARE * mine.size):
                break
            chosen = left[inside]
            implied = _implied(linear, chosen, V[chosen], U[chosen], known)
            yield int(table.image[chosen[0]]), chosen, chosen.size / mine.size, implied
            left = left[~inside]


def _implied(linear: Linear, rows: Index, V: Array, U: Array, known: Array) -> tuple[Array, Array]:
    """Rotation (3,) of the state that sightings of one image imply, and its covariance.

    ``d = -N^-1 H^T V^-1 z`` with ``N = H^T V^-1 H``; V holds what they do not share.  What they do share, the errors of
    the image and of the further unknowns, moves d as a whole.
    """
    table, model, _ = linear
    H, image = model.H[rows], int(table.image[rows[0]])
    HW = H.mT @ np.linalg.inv(V)
    Q = np.linalg.inv(np.sum(HW @ H, axis=0) + np.eye(3) / (HELD * known[0]) ** 2)
    gain = Q @ HW
    d_E = -np.sum(gain @ model.z_px[rows][..., None], axis=0)[:, 0]
    position, further = np.sum(gain @ model.R[rows], axis=0), np.sum(gain @ U[..., 3:], axis=0)
    cov_position_J = table.cov_position_J[image]
    shared = table.cov_attitude_E[image] + position @ cov_position_J @ position.mT + further @ further.mT
    return d_E, Q + shared


def agreed(found: Clusters) -> Agreement:
    """The rotation on which most images agree; ``found`` holds one cluster at least."""
    return max(_tried(found), key=lambda agreement: agreement.votes)


def _tried(found: Clusters) -> list[Agreement]:
    """The best of the rotations that single clusters imply, each refined by all that support it."""
    judges = found if found.size <= JUDGES else found.some(_spread(found.size, JUDGES))
    tried = _spread(found.size, HYPOTHESES)
    scores = _all_votes(judges, found.d_E[tried], found.S_E[tried])
    best = tried[np.argsort(scores, kind="stable")[::-1][:REFINED]]
    known: dict[bytes, Agreement] = {}
    return [_refined(found, found.d_E[k], found.S_E[k], known) for k in best]


def _spread(size: int, most: int) -> Index:
    """Rows spread evenly over a table, all if there are no more."""
    return np.unique(np.linspace(0, size - 1, min(size, most)).astype(np.int64))


def _support(found: Clusters, d_E: Array, S_E: Array) -> Array:
    """What each cluster gives (..., k) to rotations (..., 1, 3) with their covariances."""
    e = found.d_E - d_E
    m2 = np.vecdot(e, np.linalg.solve(found.S_E + S_E, e[..., None])[..., 0])
    return np.asarray(found.share * np.maximum(0.0, 1.0 - m2 / GATE))


def _all_votes(found: Clusters, d_E: Array, S_E: Array) -> Array:
    """Votes (r,) for rotations (r, 3), some at a time."""
    order = np.argsort(found.image, kind="stable")
    first = np.flatnonzero(np.diff(found.image[order], prepend=-1))
    step = max(1, AT_ONCE // found.size)
    votes = np.empty(len(d_E))
    for at in range(0, len(d_E), step):
        some = slice(at, at + step)
        support = _support(found, d_E[some, None], S_E[some, None])
        votes[some] = np.sum(np.maximum.reduceat(support[:, order], first, axis=1), axis=1)
    return votes


def _votes(found: Clusters, d_E: Array, S_E: Array) -> tuple[float, Index]:
    """Votes for a rotation, and the clusters that give them, one an image at most."""
    support = _support(found, d_E, S_E)
    if found.one_each:
        giving = np.flatnonzero(support > 0.0)
        return float(np.sum(support[giving])), giving
    order = np.lexsort((support, found.image))
    last = order[np.append(np.diff(found.image[order]) > 0, True)]
    giving = last[support[last] > 0.0]
    return float(np.sum(support[giving])), giving


def _refined(found: Clusters, d_E: Array, S_E: Array, known: dict[bytes, Agreement]) -> Agreement:
    """The weighted mean of the clusters that support a rotation, until they are the same; what becomes of those that
    support it at first is ``known`` from then on."""
    votes, giving = _votes(found, d_E, S_E)
    first = giving.tobytes()
    if first not in known:
        known[first] = _settled(found, d_E, S_E, votes, giving)
    return known[first]


def _settled(found: Clusters, d_E: Array, S_E: Array, votes: float, giving: Index) -> Agreement:
    """The mean of the clusters that give votes, and so on from there."""
    for _ in range(ROUNDS):
        before = giving
        W = np.linalg.inv(found.S_E[giving])
        S_E = np.linalg.inv(np.sum(W, axis=0))
        d_E = S_E @ np.sum(W @ found.d_E[giving][..., None], axis=0)[:, 0]
        votes, giving = _votes(found, d_E, S_E)
        if giving.size == 0 or np.array_equal(before, giving):
            break
    return Agreement(d_E, S_E, votes, giving)


def large(found: Clusters) -> Clusters:
    """The clusters at least :data:`COMPARABLE` times as large as the largest of their image."""
    most = np.zeros(np.max(found.image, initial=-1) + 1)
    np.maximum.at(most, found.image, found.share)
    return found.some(np.flatnonzero(found.share >= COMPARABLE * most[found.image]))


def contradicting(found: Clusters, used: Mask) -> Clusters:
    """Clusters of rejected sightings that speak for an answer of their own."""
    out = [k for k, rows in enumerate(found.rows) if rows.size >= MEMBERS and np.mean(used[rows]) < 0.5]
    return found.some(np.array(out, dtype=np.int64))


def members(image: Index, chosen: Mask) -> Iterator[Index]:
    """The chosen rows of each image that has any."""
    rows = np.flatnonzero(chosen)
    rows = rows[np.argsort(image[rows], kind="stable")]
    if rows.size:
        yield from np.split(rows, np.flatnonzero(np.diff(image[rows])) + 1)
