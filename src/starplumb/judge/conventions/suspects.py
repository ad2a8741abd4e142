"""Single culprits: an image, a landmark, a star tracker that contradicts the others; with those of
:mod:`starplumb.judge.conventions.samples`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.errors import InputError
from ...physics.trackers import FusedAttitude
from ...physics.units import ARCSEC, DEG
from ...table.campaign import Campaign
from ..consistency import chi2_p
from .mistake import Mistake, image_text
from .samples import coarse_samples, few_digits, wrong_samples

Array = NDArray[np.float64]
Index = NDArray[np.int64]

WRONG_IMAGE = (60.0 * ARCSEC, 1.0 * DEG)
"""Standard deviations of the attitude of an image that is wrong: a little, or altogether."""
WRONG_PLACE_M = 1000.0
"""Standard deviation of the place of a landmark that is wrong."""
MOST_IMAGES = 30
"""So many images are tried one by one, those with the largest residuals."""
MOST_LANDMARKS = 30
IMPOSSIBLE_P = 1e-6
"""Readings of star trackers less probable than this contradict each other."""


def suspects(campaign: Campaign, statistic: Array) -> list[Mistake]:
    """The culprits worth trying; ``statistic`` (m,) orders the images by how badly they fit."""
    kinds: tuple[Callable[[], Iterator[Mistake]], ...] = (
        lambda: _images(campaign, statistic),
        lambda: _landmarks(campaign),
        lambda: _trackers(campaign),
        lambda: wrong_samples(campaign),
        lambda: coarse_samples(campaign),
        lambda: few_digits(campaign),
    )
    found: list[Mistake] = []
    for kind in kinds:
        with suppress(InputError):  # an exposure that the orbit or the attitude does not cover
            found += kind()
    return found


def _images(campaign: Campaign, statistic: Array) -> Iterator[Mistake]:
    """An image whose attitude is not that of its exposure."""
    count = np.bincount(campaign.sightings.image, minlength=len(campaign.images.ids))
    there = np.flatnonzero(count > 1)
    if there.size < 3:  # of two images that disagree either may be wrong
        return
    worst = there[np.argsort(-statistic[there], kind="stable")][:MOST_IMAGES]
    own = np.broadcast_to(campaign.cov_attitude_E, (count.size, 3, 3))
    for image, sigma in product(worst.tolist(), WRONG_IMAGE):

        def undo(c: Campaign, image: int = image, sigma: float = sigma) -> Campaign:
            covariance = np.array(np.broadcast_to(c.cov_attitude_E, (count.size, 3, 3)))
            covariance[image] += sigma**2 * np.eye(3)
            return replace(c, cov_attitude_E=covariance)

        yield Mistake(
            f"image.{campaign.images.ids[image]}",
            f"the attitude or the time of {image_text(campaign, image)} is wrong: it contradicts the other images",
            f"check the time of {campaign.images.ids[image]!r} and the attitude around it, or leave the image out",
            undo,
            cost=2.0 * np.log(there.size) + _widening(own[image], sigma),
        )


def _widening(covariance: Array, sigma: float) -> float:
    """``log(det(C + sigma^2 I) / det C)``: what it costs to allow for an error of sigma in each of three directions;
    an exact statement counts as one of a hundredth of sigma."""
    variances = np.maximum(np.linalg.eigvalsh(covariance), 1e-4 * sigma**2)
    return float(np.sum(np.log1p(sigma**2 / variances)))


def _landmarks(campaign: Campaign) -> Iterator[Mistake]:
    """A landmark seen in several images that is not where its table says."""
    count = np.bincount(campaign.sightings.landmark, minlength=len(campaign.landmarks.ids))
    again = np.flatnonzero(count > 1)
    for place in again[np.argsort(-count[again], kind="stable")][:MOST_LANDMARKS].tolist():

        def undo(c: Campaign, place: int = place) -> Campaign:
            covariance = c.landmarks.covariance_J.copy()
            covariance[place] += WRONG_PLACE_M**2 * np.eye(3)
            return replace(c, landmarks=replace(c.landmarks, covariance_J=covariance))

        name = campaign.landmarks.ids[place]
        yield Mistake(
            f"landmark.{name}",
            f"the landmark {name!r} lies elsewhere than its table says",
            f"check the coordinates of {name!r}, or leave it out",
            undo,
            cost=2.0 * np.log(again.size) + _widening(campaign.landmarks.covariance_J[place], WRONG_PLACE_M),
        )


def _trackers(campaign: Campaign) -> Iterator[Mistake]:
    """A star tracker whose readings differ from the first one's by the same turn in every image."""
    attitude = campaign.attitude
    epochs = np.unique(campaign.images.t_ns[np.unique(campaign.sightings.image)])
    if not isinstance(attitude, FusedAttitude):
        return
    used = attitude.used(epochs)
    together = used[:, np.all(used, axis=0)].shape[1]
    if together == 0:
        return
    epochs = epochs[np.all(used, axis=0)]
    freedom = 3 * (len(attitude.trackers) - 1) * together
    if chi2_p(float(np.sum(attitude.disagreement(epochs))), freedom) > IMPOSSIBLE_P:
        return
    readings = np.stack([t.C_EA @ t.attitude.at(epochs)[0] for t in attitude.trackers])
    first = _reference(attitude)
    for j, tracker in enumerate(attitude.trackers):
        if j == first:
            continue
        turn_E = np.mean(so3.log(readings[j] @ readings[first].mT), axis=0)

        def undo(c: Campaign, j: int = j, turn_E: Array = turn_E) -> Campaign:
            assert isinstance(c.attitude, FusedAttitude)
            trackers = list(c.attitude.trackers)
            trackers[j] = replace(trackers[j], C_EA=so3.exp(-turn_E) @ trackers[j].C_EA)
            return replace(c, attitude=replace(c.attitude, trackers=tuple(trackers)))

        name, other = tracker.name, attitude.trackers[first].name
        apart = float(np.linalg.norm(turn_E)) / ARCSEC
        yield Mistake(
            f"tracker.{name}",
            f"the mounting of the star tracker {name!r} against {other!r} is off by {apart:.0f} arcsec",
            f"correct the mounting of {name!r}; or let a column tracker of the table of images say which tracker each "
            "image's attitude is from, and calibrate with --estimate trackers",
            undo,
            evidence=f"the star trackers {name!r} and {other!r} differ by {apart:.0f} arcsec on average over "
            f"{together} images, which their sigmas do not allow",
        )


def _reference(attitude: FusedAttitude) -> int:
    """The tracker whose frame is E, or the first one where no tracker has the frame E."""
    off = [float(np.abs(tracker.C_EA - np.eye(3)).max()) for tracker in attitude.trackers]
    return int(np.argmin(off))
