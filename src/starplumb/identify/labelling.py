"""Which marker is which: detections without names, a mounting known to a degree or two.

The rotation on which most detections agree (:mod:`starplumb.identify.placement`) says which landmarks each may be.
After that the errors that an image shares are estimated, and each detection is given the landmark whose test
(:mod:`starplumb.solve.reliability`) it passes alone; one that passes with two, or two that pass with one, get none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import Fit, State, Unknowns
from ..estimators.protocol import Status
from ..estimators.robust import Robust
from ..physics.units import DEG
from ..solve.reliability import excess
from ..table.campaign import Campaign, Detections, Sightings
from ..table.observations import Observations
from .placement import Candidates, place

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


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
        rows = np.flatnonzero(self.landmark >= 0)
        return detections.seen_as(rows, self.landmark[rows])


def label(campaign: Campaign, detections: Detections, reach: float = 2.0 * DEG, seed: int = 0) -> Labels:
    """Find the landmark of each detection, the model mounting being wrong by ``reach`` (rad) at most.

    Raises EpochError where an image lies outside the orbit or attitude.
    """
    rng = np.random.default_rng(seed)
    deciding = Candidates.deciding(campaign, detections, reach, rng)
    C_EK, refusal = place(deciding, campaign.C_EK, rng)
    if refusal:
        return _refused(campaign, detections, refusal)
    close = float(np.sqrt(np.max(deciding.gate)))
    candidates = Candidates.of(replace(campaign, C_EK=C_EK), detections, close)
    return _assign(campaign, candidates, detections.image.size, C_EK)


def _refused(campaign: Campaign, detections: Detections, why: str) -> Labels:
    return Labels(*_nothing(detections.image.size), campaign.C_EK, why)


def _assign(campaign: Campaign, c: Candidates, count: int, C: Array) -> Labels:
    """Labels at the mounting found: from the gate of all errors down to the test without those an image shares."""
    rows = np.flatnonzero(c.explained(C))
    table = c.table.select(rows)
    used = _alone(c.detection[rows], table, _misfit(table, C))
    fits = used
    for _ in range(4):
        estimate = Robust()(replace(table, weight=used.astype(float)), C)
        if not Status(int(estimate.status)).usable:
            return Labels(*_nothing(count), campaign.C_EK, "the labels found contradict each other")
        weight = np.where(used & (estimate.verdict == 0), 1.0, 0.0)
        state = State(estimate.C_EK, np.zeros(0))
        tested = Fit(Unknowns(), replace(table, weight=weight), state, C).tested()
        if tested is None:
            return Labels(*_nothing(count), campaign.C_EK, "the labels found do not determine the alignment")
        T = excess(tested, used, 1e-3, 1e-4)[0]
        fits = T <= 1.0
        again = _only(c.detection[rows], table, T <= 2.0) & fits
        C = estimate.C_EK
        if np.array_equal(again, used):
            break
        used = again
    landmark, verdict = _nothing(count)
    verdict[c.detection[rows[fits & ~used]]] = int(Label.AMBIGUOUS)
    landmark[c.detection[rows[used]]] = table.landmark[used]
    verdict[c.detection[rows[used]]] = int(Label.LABELLED)
    return Labels(landmark, verdict, C)


def _nothing(count: int) -> tuple[Index, NDArray[np.int64]]:
    """No landmark for any of so many detections."""
    return np.full(count, -1), np.full(count, int(Label.NO_LANDMARK))


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
