"""Which marker is which: detections without names, a mounting known to a degree or two.

Every pair of a detection and a landmark within reach of it is a candidate sighting.  Two candidates of one image fix
the mounting exactly (:mod:`starplumb.estimators.consensus`); a wrong pair is given away by its angle, by a rotation
beyond the stated reach, and by the other detections of all images, which a wrong rotation does not explain.  The
placement that explains most is taken if chance would not do as well, and if no other placement comes near it: when as
many markers may be missed as found, the ratio of two placements' likelihoods is ``(1/q)^(n1 - n2)`` with n the
detections that each explains and q what a wrong placement explains by chance.

After that the errors that an image shares are estimated, and each detection is given the landmark whose test
(:mod:`starplumb.reliability`) it passes alone; one that passes with two, or two that pass with one, get none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from . import so3
from .campaign import Campaign, Detections, Sightings
from .estimators.consensus import GATE, Directions, pair_rotation
from .estimators.protocol import Status
from .estimators.robust import Robust
from .estimators.selfcal import SelfCalibration, State
from .geometry import observe, stations
from .observations import Observations
from .reliability import excess, reliability
from .units import ARCSEC, DEG

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

PAIRS = 400
"""Pairs of detections of an image from which rotations are taken, the widest ones."""
HYPOTHESES = 4_000
"""Rotations tried on all images."""
BY_CHANCE = 1e-4
"""Expected number of wrong placements explaining as much at which one is believed."""
ODDS = 1e6
"""Odds of the best placement against the next below which both are possible."""
CELLS = 1 << 22
"""Candidates times rotations looked at together."""


class Label(IntEnum):
    """What became of a detection."""

    LABELLED = 0
    NO_LANDMARK = 1
    AMBIGUOUS = 2


@dataclass(frozen=True)
class Labels:
    """Landmark of each of n detections, -1 for none, and why; ``C_EK`` the mounting found.

    ``refusal`` says why there is no answer, empty where there is one; all detections are then unlabelled.
    """

    landmark: Index
    label: NDArray[np.int64]
    C_EK: Array
    refusal: str = ""

    @property
    def counts(self) -> dict[str, int]:
        """How many detections there are, and what became of them."""
        each = {kind.name.lower(): int(np.sum(self.label == int(kind))) for kind in Label}
        return {"detections": int(self.label.size), **each}

    def sightings(self, detections: Detections) -> Sightings:
        """The detections that were given a landmark, as sightings."""
        d, rows = detections, np.flatnonzero(self.landmark >= 0)
        columns = (d.column_px[rows], d.row_px[rows], d.sigma_px[rows])
        return Sightings(d.image[rows], self.landmark[rows], *columns, np.zeros(rows.size, dtype=bool))


@dataclass(frozen=True)
class _Candidates:
    """Detections (d,) paired with landmarks within reach: ``table`` (p rows), ``detection`` (p,) of each row."""

    table: Observations
    detection: Index
    directions: Directions
    detections: int
    reach: float


def label(campaign: Campaign, detections: Detections, reach: float = 2.0 * DEG, seed: int = 0) -> Labels:
    """Find the landmark of each detection, the model mounting being wrong by ``reach`` (rad) at most.

    Raises EpochError where an image lies outside the orbit or attitude.
    """
    candidates = _candidates(campaign, detections, reach)
    rotations = _hypotheses(candidates, campaign.C_EK, np.random.default_rng(seed))
    if rotations.size == 0:
        return _refused(campaign, detections, _why_nothing(candidates))
    score = _scores(candidates, rotations)
    best = int(np.argmax(score))
    refusal = _doubt(candidates, rotations, score, best)
    if refusal:
        return _refused(campaign, detections, refusal)
    return _assign(campaign, candidates, rotations[best])


def _refused(campaign: Campaign, detections: Detections, why: str) -> Labels:
    none = np.full(detections.image.size, -1)
    return Labels(none, np.full(none.size, int(Label.NO_LANDMARK)), campaign.C_EK, why)


def _candidates(campaign: Campaign, d: Detections, reach: float) -> _Candidates:
    """All pairs of a detection and a landmark seen within reach of its line of sight."""
    station = stations(campaign, d.image, d.row_px)
    xy_K, _ = campaign.camera.tan_from_px(d.column_px, d.row_px)
    e_K = np.concatenate([xy_K, np.ones((xy_K.shape[0], 1))], axis=-1)
    look_J = (station.C_EJ.mT @ campaign.C_EK @ e_K[..., None])[..., 0]
    look_J /= np.linalg.norm(look_J, axis=-1, keepdims=True)
    cosine, p_J = np.cos(reach + 30.0 * ARCSEC), campaign.landmarks.r_J
    rows, columns = [], []
    for i in range(d.image.size):
        line = p_J - station.r_J[i]
        facing = np.sum(line * p_J, axis=-1) < 0.0
        near = np.flatnonzero(facing & (line @ look_J[i] > cosine * np.linalg.norm(line, axis=-1)))
        rows.append(np.full(near.size, i))
        columns.append(near)
    row, landmark = np.concatenate(rows), np.concatenate(columns)
    pixels = (d.column_px[row], d.row_px[row], d.sigma_px[row])
    sightings = Sightings(d.image[row], landmark, *pixels, np.zeros(row.size, dtype=bool))
    table = observe(replace(campaign, sightings=sightings))
    return _Candidates(table, row, Directions.of(table), d.image.size, reach)


def _hypotheses(c: _Candidates, C_EK_model: Array, rng: np.random.Generator) -> Array:
    """Rotations (h, 3, 3) within reach from consistent pairs of candidates of one image."""
    found = [_of_image(c, np.flatnonzero(c.table.image == i)) for i in np.unique(c.table.image)]
    a, b = (np.concatenate(part) for part in zip(*found, strict=True)) if found else (np.zeros(0, int),) * 2
    d = c.directions
    C = pair_rotation(d.e_E[a], d.e_E[b], d.e_K[a], d.e_K[b])
    turn = np.linalg.norm(so3.log(C @ C_EK_model.mT), axis=-1)
    chord = np.linalg.norm(d.e_K[a] - d.e_K[b], axis=-1)
    blur = 4.0 * np.hypot(d.own[a], d.own[b]) / np.maximum(chord, 1e-12)  # of the turn about the line
    C = C[turn < c.reach + blur]
    return np.asarray(C if len(C) <= HYPOTHESES else C[rng.permutation(len(C))[:HYPOTHESES]])


def _of_image(c: _Candidates, rows: Index) -> tuple[Index, Index]:
    """Pairs of candidates of an image with the same angle in E and in K: two detections, two landmarks."""
    d, spots = c.directions, np.unique(c.detection[rows])
    where = {int(spot): rows[c.detection[rows] == spot] for spot in spots}
    first, second = np.triu_indices(spots.size, 1)
    ray = {int(spot): d.e_K[where[int(spot)][0]] for spot in spots}
    width = [
        float(np.linalg.norm(ray[int(spots[i])] - ray[int(spots[j])]))
        for i, j in zip(first, second, strict=True)
    ]
    a_found, b_found = [np.zeros(0, int)], [np.zeros(0, int)]
    for pair in np.argsort(width)[::-1][:PAIRS]:
        a, b = where[int(spots[first[pair]])], where[int(spots[second[pair]])]
        apart = np.linalg.norm(d.e_E[a][:, None] - d.e_E[b][None], axis=-1)
        variance = d.own[a][:, None] ** 2 + d.own[b][None] ** 2
        same = (apart - width[pair]) ** 2 < GATE**2 * variance
        same &= (c.table.landmark[a][:, None] != c.table.landmark[b][None]) & (
            width[pair] ** 2 > 100.0 * variance
        )
        i, j = np.nonzero(same)
        a_found.append(a[i])
        b_found.append(b[j])
    return np.concatenate(a_found), np.concatenate(b_found)


def _gate(d: Directions) -> Array:
    """Square of the angle (p,) within which a candidate agrees with a rotation from a pair of another image."""
    return np.asarray(GATE**2 * (2.0 * d.own**2 + 2.0 * d.shared**2))


def _scores(c: _Candidates, C: Array) -> Array:
    """How many detections each rotation explains (h,), a perfect fit counting most."""
    d, gate = c.directions, _gate(c.directions)
    start = np.flatnonzero(np.diff(c.detection, prepend=-1))
    scores = []
    size = max(1, CELLS // (3 * max(1, c.detection.size)))
    for at in range(0, len(C), size):
        misfit = np.sum((d.e_K @ C[at : at + size].mT - d.e_E) ** 2, axis=-1)
        support = np.maximum(0.0, 1.0 - 0.5 * misfit / gate)
        support[misfit > gate] = 0.0
        scores.append(np.sum(np.maximum.reduceat(support, start, axis=-1), axis=-1))
    return np.concatenate(scores)


def _explained(c: _Candidates, C: Array) -> Mask:
    """Candidates (p,) within the gate of a rotation."""
    d = c.directions
    return np.asarray(np.sum((d.e_K @ C.mT - d.e_E) ** 2, axis=-1) < _gate(d))


def _by_chance(c: _Candidates) -> float:
    """Detections that a wrong rotation explains on average: candidates times the gate's area over that of the reach."""
    return float(np.sum(np.minimum(1.0, _gate(c.directions) / c.reach**2)))


def _doubt(c: _Candidates, C: Array, score: Array, best: int) -> str:
    """Why the best rotation is not to be believed; empty if it is."""
    from scipy.special import pdtrc

    count = np.unique(c.detection[_explained(c, C[best])]).size
    chance = _by_chance(c)
    if count < 4 or len(C) * pdtrc(count - 3, chance) > BY_CHANCE:
        return (
            f"no placement of the landmarks explains more than {count} of the {c.detections} detections, "
            "which chance does as well"
        )
    d = c.directions
    apart = np.max(np.sum((d.e_K @ C.mT - d.e_K @ C[best].T) ** 2, axis=-1), axis=-1)
    other = apart > 4.0 * float(np.max(_gate(d)))
    if not np.any(other):
        return ""
    second = int(np.argmax(np.where(other, score, -1.0)))
    rival = np.unique(c.detection[_explained(c, C[second])]).size
    per_match = np.log(max(1.0 / max(chance, 1e-12), 2.0))
    if (count - rival) * per_match >= np.log(ODDS):
        return ""
    turn = np.linalg.norm(so3.log(C[second] @ C[best].T)) / DEG
    return (
        f"two placements of the landmarks, {turn:.2g} deg apart, explain {count} and {rival} of the "
        f"{c.detections} detections: which is right cannot be told"
    )


def _why_nothing(c: _Candidates) -> str:
    reach = c.reach
    if c.detection.size == 0:
        return f"no landmark lies within {reach / DEG:g} deg of any detection's predicted place"
    return (
        f"no two detections of an image match two landmarks within {reach / DEG:g} deg of their predicted places; "
        "wanted two marker images in one image"
    )


def _assign(campaign: Campaign, c: _Candidates, C: Array) -> Labels:
    """Labels at the mounting found: from the gate of all errors down to the test without those an image shares."""
    near = _explained(c, C)
    rows = np.flatnonzero(near)
    table = c.table.select(rows)
    used = _alone(c.detection[rows], table, _misfit(table, C))
    fits = used
    for _ in range(4):
        estimate = Robust()(replace(table, weight=used.astype(float)), C)
        if not Status(int(estimate.status)).usable:
            return Labels(*_nothing(c), campaign.C_EK, "the labels found contradict each other")
        weight = np.where(used & (estimate.verdict == 0), 1.0, 0.0)
        calibration = SelfCalibration()
        problem = calibration.problem(replace(table, weight=weight), State(estimate.C_EK, np.zeros(0)), C)
        tested = reliability(problem.observations, problem.model, problem.A, problem.prior)
        if tested is None:
            return Labels(*_nothing(c), campaign.C_EK, "the labels found do not determine the alignment")
        T = excess(tested, used, 1e-3, 1e-4)[0]
        fits = T <= 1.0
        again = _only(c.detection[rows], table, T <= 2.0) & fits
        C = estimate.C_EK
        if np.array_equal(again, used):
            break
        used = again
    landmark, verdict = _nothing(c)
    verdict[c.detection[rows[fits & ~used]]] = int(Label.AMBIGUOUS)
    landmark[c.detection[rows[used]]] = table.landmark[used]
    verdict[c.detection[rows[used]]] = int(Label.LABELLED)
    return Labels(landmark, verdict, C)


def _nothing(c: _Candidates) -> tuple[Index, NDArray[np.int64]]:
    return np.full(c.detections, -1), np.full(c.detections, int(Label.NO_LANDMARK))


def _misfit(table: Observations, C: Array) -> Array:
    return np.asarray(np.linalg.norm(table.e_K @ C.mT - table.e_E, axis=-1))


def _places(table: Observations) -> Index:
    """One number for each landmark in each image."""
    return table.image * table.n_landmarks + table.landmark


def _alone(detection: Index, table: Observations, misfit: Array) -> Mask:
    """Rows that are the best of their detection and of their landmark in its image."""
    best = np.ones(misfit.size, dtype=bool)
    for key in (detection, _places(table)):
        _, group = np.unique(key, return_inverse=True)
        least = np.full(group.max(initial=0) + 1, np.inf)
        np.minimum.at(least, group, misfit)
        best &= misfit <= least[group]
    return best


def _only(detection: Index, table: Observations, fits: Mask) -> Mask:
    """Rows that fit where no other row of their detection, or of their landmark in its image, does."""
    only = fits.copy()
    for key in (detection, _places(table)):
        _, group = np.unique(key, return_inverse=True)
        only &= np.bincount(group, weights=fits)[group] < 1.5
    return only
