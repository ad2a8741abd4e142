"""Where a set of landmarks appears: the rotation that explains most detections without names, or why none is believed.

Every pair of a detection and a landmark within reach of it is a candidate sighting.  Two candidates of one image fix
the mounting exactly (:mod:`starplumb.estimators.consensus`); a wrong pair is given away by its angle, by a rotation
beyond the stated reach, and by the other detections of all images, which a wrong rotation does not explain.  The
placement that explains most is taken if chance would not do as well, and if no other placement comes near it: when as
many markers may be missed as found, the ratio of two placements' likelihoods is ``(1/q)^(n1 - n2)`` with n the
detections that each explains and q what a wrong placement explains by chance.

Of many detections a few of each image, drawn at random, decide: what a placement takes grows with detections times
landmarks within reach.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from ..estimators.consensus import GATE, Directions, pair_rotation
from ..physics import so3
from ..physics.units import ARCSEC, DEG
from ..table.campaign import Campaign, Detections
from ..table.geometry import observe, stations
from ..table.observations import Observations

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

DECIDING = 40
"""Detections of an image that decide."""
CANDIDATES = 100_000
"""Candidates looked at, as many images as have them; of a single image that has more, fewer detections."""
FEWEST = 8
"""Detections of a single image that decide however many landmarks are within reach."""
PAIRS = 400
"""Pairs of detections of an image from which rotations are taken, the widest ones."""
HYPOTHESES = 4_000
"""Rotations tried on all images."""
FINALISTS = 200
"""Rotations that are tried on all candidates where there are too many to try all on all."""
TRIALS = 1 << 27
"""Candidates times rotations that are not too many."""
CELLS = 1 << 22
"""Candidates times rotations looked at together."""
BY_CHANCE = 1e-4
"""Expected number of wrong placements explaining as much at which one is believed."""
ODDS = 1e6
"""Odds of the best placement against the next below which both are possible."""


@dataclass(frozen=True)
class Candidates:
    """Detections (d,) paired with landmarks within ``reach`` (rad) of their lines of sight.

    ``table`` has p rows, ``detection`` (p,) says of which of the d detections each is, in ascending order.
    """

    table: Observations
    detection: Index
    directions: Directions
    detections: int
    reach: float

    @classmethod
    def of(cls, campaign: Campaign, d: Detections, reach: float) -> Candidates:
        """All pairs of a detection and a landmark.  Raises EpochError outside the orbit or attitude."""
        rows, columns = _within(campaign, d, np.arange(d.image.size), reach)
        return cls._of_pairs(campaign, d, rows, columns, reach)

    @classmethod
    def deciding(
        cls, campaign: Campaign, d: Detections, reach: float, rng: np.random.Generator
    ) -> Candidates:
        """Those of the detections that decide."""
        rows, columns, count = [np.zeros(0, int)], [np.zeros(0, int)], 0
        for image in rng.permutation(np.unique(d.image)):
            own = np.flatnonzero(d.image == image)
            own = np.sort(rng.permutation(own)[:DECIDING])
            row, column = _within(campaign, d, own, reach)
            if count and count + row.size > CANDIDATES:
                continue
            if row.size > CANDIDATES:
                few = rng.permutation(own)[: max(FEWEST, own.size * CANDIDATES // row.size)]
                row, column = row[np.isin(row, few)], column[np.isin(row, few)]
            rows.append(row)
            columns.append(column)
            count += row.size
        row, column = np.concatenate(rows), np.concatenate(columns)
        order = np.argsort(row, kind="stable")
        return cls._of_pairs(campaign, d, row[order], column[order], reach)

    @classmethod
    def _of_pairs(
        cls, campaign: Campaign, d: Detections, row: Index, landmark: Index, reach: float
    ) -> Candidates:
        table = observe(replace(campaign, sightings=d.seen_as(row, landmark)))
        return cls(table, row, Directions.of(table), np.unique(row).size, reach)

    @property
    def gate(self) -> Array:
        """Square of the angle (p,) within which a candidate agrees with a rotation from a pair of another image."""
        own, shared = self.directions.own, self.directions.shared
        return np.asarray(GATE**2 * (2.0 * own**2 + 2.0 * shared**2))

    def explained(self, C_EK: Array) -> Mask:
        """Candidates (p,) within the gate of a rotation (3, 3)."""
        d = self.directions
        return np.asarray(np.sum((d.e_K @ C_EK.mT - d.e_E) ** 2, axis=-1) < self.gate)

    def number_explained(self, C_EK: Array) -> int:
        """Detections with a candidate within the gate of a rotation."""
        return int(np.unique(self.detection[self.explained(C_EK)]).size)

    @property
    def by_chance(self) -> float:
        """Detections that a wrong rotation explains on average: candidates times the gate's area over the reach's."""
        return float(np.sum(np.minimum(1.0, self.gate / self.reach**2)))


def _within(campaign: Campaign, d: Detections, chosen: Index, reach: float) -> tuple[Index, Index]:
    """Some detections, and landmarks, that are within reach of each other, as equally long lists of both."""
    station = stations(campaign, d.image[chosen], d.row_px[chosen])
    xy_K, _ = campaign.camera.tan_from_px(d.column_px[chosen], d.row_px[chosen])
    e_K = np.concatenate([xy_K, np.ones((xy_K.shape[0], 1))], axis=-1)
    look_J = (station.C_EJ.mT @ campaign.C_EK @ e_K[..., None])[..., 0]
    look_J /= np.linalg.norm(look_J, axis=-1, keepdims=True)
    cosine, p_J = np.cos(reach + 30.0 * ARCSEC), campaign.landmarks.r_J
    rows, columns = [np.zeros(0, int)], [np.zeros(0, int)]
    for i, row in enumerate(chosen):
        line = p_J - station.r_J[i]
        facing = np.vecdot(line, p_J) < 0.0
        near = np.flatnonzero(facing & (line @ look_J[i] > cosine * np.linalg.norm(line, axis=-1)))
        rows.append(np.full(near.size, row))
        columns.append(near)
    return np.concatenate(rows), np.concatenate(columns)


def place(c: Candidates, C_EK_model: Array, rng: np.random.Generator) -> tuple[Array, str]:
    """The rotation C_EK (3, 3) on which most detections agree, and why it is not to be believed (empty if it is)."""
    C = _hypotheses(c, C_EK_model, rng)
    if C.size == 0:
        return C_EK_model, _why_nothing(c)
    if len(C) * c.detection.size > TRIALS:
        few = np.unique(c.detection)
        few = rng.permutation(few)[: max(FEWEST, few.size * TRIALS // (len(C) * c.detection.size))]
        C = C[np.argsort(_scores(c, C, np.isin(c.detection, few)))[::-1][:FINALISTS]]
    score = _scores(c, C, np.ones(c.detection.size, dtype=bool))
    best = int(np.argmax(score))
    return C[best], _doubt(c, C, score, best)


def _hypotheses(c: Candidates, C_EK_model: Array, rng: np.random.Generator) -> Array:
    """Rotations (h, 3, 3) within reach from consistent pairs of candidates of one image, the widest of each first."""
    images = [_pairs_of_image(c, C_EK_model, rows) for rows in _by(c.table.image)]
    found, count = [np.zeros((0, 3, 3))], 0
    for pairs in zip_longest(*images):
        of_images = [pair for pair in pairs if pair is not None]
        a, b = (np.concatenate(side) for side in zip(*of_images, strict=True))
        found.append(_rotations(c, C_EK_model, a, b))
        count += len(found[-1])
        if count > HYPOTHESES:
            break
    C = np.concatenate(found)
    return np.asarray(C if len(C) <= HYPOTHESES else C[rng.permutation(len(C))[:HYPOTHESES]])


def _by(key: Index) -> list[Index]:
    """Rows of each value of a key (p,)."""
    order = np.argsort(key, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(key[order])) + 1) if key.size else []


def _rotations(c: Candidates, C_EK_model: Array, a: Index, b: Index) -> Array:
    """Exact rotations of pairs of candidates that lie within reach of the model mounting."""
    d = c.directions
    C = pair_rotation(d.e_E[a], d.e_E[b], d.e_K[a], d.e_K[b])
    turn = np.linalg.norm(so3.log(C @ C_EK_model.mT), axis=-1)
    chord = np.linalg.norm(d.e_K[a] - d.e_K[b], axis=-1)
    blur = GATE * np.hypot(d.own[a], d.own[b]) / np.maximum(chord, 1e-12)  # of the turn about the line
    return np.asarray(C[turn < c.reach + blur])


def _pairs_of_image(c: Candidates, C_EK_model: Array, rows: Index) -> Iterator[tuple[Index, Index]]:
    """Pairs of candidates of an image with the same angle in E and in K: for two detections after two detections.

    Within reach of the model mounting ``e_E[b] - e_E[a]`` is what the model makes of ``e_K[b] - e_K[a]``, turned by the
    reach at most: partners are looked for near there, not among all.
    """
    from scipy.spatial import KDTree

    d, spots = c.directions, [rows[of] for of in _by(c.detection[rows])]
    trees = [KDTree(d.e_E[spot]) for spot in spots]
    first, second = np.triu_indices(len(spots), 1)
    ray = np.array([d.e_K[spot[0]] for spot in spots])
    width = np.linalg.norm(ray[first] - ray[second], axis=-1)
    for pair in np.argsort(width)[::-1][:PAIRS]:
        i, j = first[pair], second[pair]
        own = GATE * np.hypot(np.max(d.own[spots[i]]), np.max(d.own[spots[j]]))
        expected = d.e_E[spots[i]] + C_EK_model @ (ray[j] - ray[i])
        near = KDTree(expected).sparse_distance_matrix(
            trees[j], c.reach * width[pair] + own, output_type="ndarray"
        )
        a, b = spots[i][near["i"]], spots[j][near["j"]]
        apart = np.linalg.norm(d.e_E[a] - d.e_E[b], axis=-1)
        variance = d.own[a] ** 2 + d.own[b] ** 2
        same = ((apart - width[pair]) ** 2 < GATE**2 * variance) & (width[pair] ** 2 > 100.0 * variance)
        same &= c.table.landmark[a] != c.table.landmark[b]
        yield a[same], b[same]


def _scores(c: Candidates, C: Array, which: Mask) -> Array:
    """How many detections each rotation explains (h,), a perfect fit counting most, by some of the candidates."""
    d, gate, detection = c.directions, c.gate[which], c.detection[which]
    e_K, e_E = d.e_K[which], d.e_E[which]
    start = np.flatnonzero(np.diff(detection, prepend=-1))
    scores = []
    size = max(1, CELLS // (3 * max(1, detection.size)))
    for at in range(0, len(C), size):
        misfit = np.sum((e_K @ C[at : at + size].mT - e_E) ** 2, axis=-1)
        support = np.maximum(0.0, 1.0 - 0.5 * misfit / gate)
        support[misfit > gate] = 0.0
        scores.append(np.sum(np.maximum.reduceat(support, start, axis=-1), axis=-1))
    return np.concatenate(scores)


def _doubt(c: Candidates, C: Array, score: Array, best: int) -> str:
    """Why the best rotation is not to be believed; empty if it is."""
    from ..solve.probability import pdtrc

    count, chance = c.number_explained(C[best]), c.by_chance
    if count < 4 or len(C) * pdtrc(count - 3, chance) > BY_CHANCE:
        return (
            f"no placement of the landmarks explains more than {count} of the {c.detections} detections, "
            "which chance does as well"
        )
    rays = c.directions.e_K[np.flatnonzero(np.diff(c.detection, prepend=-1))]
    apart = np.array([np.max(np.sum((rays @ (other - C[best]).mT) ** 2, axis=-1)) for other in C])
    elsewhere = apart > 4.0 * float(np.max(c.gate))
    if not np.any(elsewhere):
        return ""
    second = int(np.argmax(np.where(elsewhere, score, -1.0)))
    rival = c.number_explained(C[second])
    per_match = np.log(max(1.0 / max(chance, 1e-12), 2.0))
    if (count - rival) * per_match >= np.log(ODDS):
        return ""
    turn = np.linalg.norm(so3.log(C[second] @ C[best].mT)) / DEG
    return (
        f"two placements of the landmarks, {turn:.2g} deg apart, explain {count} and {rival} of the "
        f"{c.detections} detections, too similar a number to decide between them"
    )


def _why_nothing(c: Candidates) -> str:
    reach = c.reach
    if c.detection.size == 0:
        return f"no landmark lies within {reach / DEG:g} deg of any detection's predicted place"
    return (
        f"no two detections of an image match two landmarks within {reach / DEG:g} deg of their predicted places; "
        "wanted two marker images in one image"
    )
