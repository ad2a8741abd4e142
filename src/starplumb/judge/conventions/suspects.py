"""Single culprits, and what the files show by themselves: an image, an attitude sample, a landmark, a star tracker that
contradicts the others; times with too few digits; attitude samples too far apart to follow the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.errors import InputError
from ...physics.series import Attitude, seconds
from ...physics.timescales import format_iso
from ...physics.trackers import FusedAttitude
from ...physics.units import ARCSEC, DEG
from ...table.campaign import Campaign
from ...table.geometry import stations
from ...table.parameters import TimeOffset
from ..consistency import chi2_p
from .mistake import Mistake, Written

Array = NDArray[np.float64]
Index = NDArray[np.int64]

WRONG_IMAGE = (60.0 * ARCSEC, 1.0 * DEG)
"""Standard deviations of the attitude of an image that is wrong: a little, or altogether."""
WRONG_PLACE_M = 1000.0
"""Standard deviation of the place of a landmark that is wrong."""
MOST_IMAGES = 30
"""So many images are tried one by one, those with the largest residuals."""
MOST_LANDMARKS = 30
OUTSTANDING = 6.0
"""A sample is suspected when it lies this many times farther from the prediction by its neighbours than is usual."""
COARSE = 3.0
"""Median distance of samples from the prediction, in units of their stated error, at which motion is not followed;
independent noise of the stated size gives 1.4."""
IMPOSSIBLE_P = 1e-6
"""Readings of star trackers less probable than this contradict each other."""
NEAR = 6
NODES = np.array([-2, -1, 1, 2])
"""Neighbours from which a sample is predicted, as :class:`Attitude` interpolates on four."""


def suspects(campaign: Campaign, written: Written, statistic: Array) -> list[Mistake]:
    """The culprits worth trying; ``statistic`` (m,) orders the images by how badly they fit."""
    kinds: tuple[Callable[[], Iterator[Mistake]], ...] = (
        lambda: _images(campaign, statistic),
        lambda: _landmarks(campaign),
        lambda: _trackers(campaign),
        lambda: _samples(campaign),
        lambda: _sampling(campaign),
        lambda: _image_time_digits(campaign, written),
    )
    found: list[Mistake] = []
    for kind in kinds:
        with suppress(InputError):  # an exposure that the orbit or the attitude does not cover
            found += kind()
    return found


def epoch_text(t_ns: int) -> str:
    """An epoch for messages, UTC to the millisecond."""
    return f"{format_iso(np.array([t_ns]), 'UTC', 3)[0]} UTC"


def image_text(campaign: Campaign, image: int) -> str:
    """An image for messages: its id and its time."""
    return f"image {campaign.images.ids[image]!r} ({epoch_text(int(campaign.images.t_ns[image]))})"


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


@dataclass(frozen=True)
class _Predicted:
    """Samples ``at`` (n,) of an attitude less what their neighbours predict, ``off_E`` (n, 3) rad about E's axes, and
    the product of their distances to those, s^4, ``spread`` (n,)."""

    at: Index
    off_E: Array
    spread: Array


def _predicted(attitude: Attitude, rows: Index) -> _Predicted:
    """Cubic prediction of samples ``rows`` from two neighbours on either side, where a burst has them."""
    first, last = attitude.bursts.bounds
    rows = rows[(rows - 2 >= first[rows]) & (rows + 2 <= last[rows])]
    nodes = rows[:, None] + NODES
    tau = seconds(attitude.t_ns[nodes] - attitude.t_ns[rows][:, None])
    weights = np.stack(
        [np.prod(np.delete(-tau, j, 1) / (tau[:, [j]] - np.delete(tau, j, 1)), axis=1) for j in range(4)],
        axis=-1,
    )
    C = so3.from_quaternion(attitude.q_EF)
    turn = so3.log(C[nodes] @ C[rows][:, None].mT)
    return _Predicted(rows, -np.einsum("nj,nji->ni", weights, turn), np.abs(np.prod(tau, axis=1)))


def _near(attitude: Attitude, epochs: Index) -> Index:
    """Samples within NEAR of any of the epochs: those that interpolation uses, and what judges these."""
    left = np.searchsorted(attitude.t_ns, epochs, side="right") - 1
    rows = np.unique(left[:, None] + np.arange(-NEAR, NEAR + 2))
    return np.asarray(rows[(rows >= 0) & (rows < attitude.t_ns.size)], dtype=np.int64)


def _exposures(campaign: Campaign) -> Index:
    s = campaign.sightings
    return np.unique(campaign.images.exposed(s.image, s.row_px))


def _attitude_sigma(campaign: Campaign) -> float:
    """The smallest stated standard deviation of the attitude about any axis, rad."""
    return float(np.sqrt(np.min(np.linalg.eigvalsh(campaign.cov_attitude_E))))


def _samples(campaign: Campaign) -> Iterator[Mistake]:
    """An attitude sample that its neighbours contradict, and that an image rests on."""
    epochs, sigma = _exposures(campaign), _attitude_sigma(campaign)
    for series, attitude in enumerate(campaign.attitudes):
        found = _predicted(attitude, _near(attitude, epochs))
        off = np.linalg.norm(found.off_E, axis=-1)
        if off.size < 5:
            continue
        usual = max(float(np.median(off)), sigma)
        for place in np.argsort(-off, kind="stable")[:4].tolist():
            row = int(found.at[place])
            beside = off[np.abs(found.at - row) <= 2]
            if off[place] < OUTSTANDING * usual or off[place] < np.max(beside):
                continue
            when = epoch_text(int(attitude.t_ns[row]))
            which = "" if len(campaign.attitudes) == 1 else f" of {attitude.name}"
            images = campaign.images
            image = images.ids[int(np.argmin(np.abs(images.t_ns - attitude.t_ns[row])))]
            yield Mistake(
                f"sample.{when.split()[0]}",
                f"the attitude sample{which} at {when}, beside image {image!r}, is wrong: it is off by about "
                f"{off[place] / ARCSEC:.0f} arcsec",
                "leave the sample out of the attitude, or correct it",
                _without_sample(series, row),
                evidence=f"the attitude sample{which} at {when} lies {off[place] / ARCSEC:.0f} arcsec from where its "
                f"neighbours predict it (usually {usual / ARCSEC:.2g} arcsec)",
            )


def _without_sample(series: int, row: int) -> Callable[[Campaign], Campaign]:
    """The change that takes a sample out of one of the attitude series."""

    def undo(c: Campaign) -> Campaign:
        seen = iter(range(len(c.attitudes)))

        def cut(a: Attitude) -> Attitude:
            if next(seen) != series:
                return a
            starts = tuple(s - (s > row) for s in a.starts)
            gap_s = a.bursts.limit_s  # without the sample its neighbours are twice as far apart
            apart = float(a.t_ns[row + 1] - a.t_ns[row - 1]) * 1e-9
            kept = np.arange(a.t_ns.size) != row
            return replace(a, t_ns=a.t_ns[kept], q_EF=a.q_EF[kept], gap_s=max(gap_s, apart), starts=starts)

        return c.with_attitude(cut)

    return undo


def _sampling(campaign: Campaign) -> Iterator[Mistake]:
    """Attitude samples too far apart to follow the motion between them.

    A cubic on the nodes t_j is off by ``f'''' prod(t - t_j) / 24``: what a sample shows against its neighbours,
    scaled by the ratio of the products, is what an exposure between samples suffers.
    """
    epochs, sigma = _exposures(campaign), _attitude_sigma(campaign)
    for attitude in campaign.attitudes:
        found = _predicted(attitude, _near(attitude, epochs))
        off = np.linalg.norm(found.off_E, axis=-1)
        noise = float(np.sqrt(np.max(np.trace(campaign.cov_attitude_E, axis1=-2, axis2=-1))))
        if off.size < 5 or np.median(off) < COARSE * noise:
            continue  # one wrong sample is no lack of samples, and the noise of samples is no motion
        hidden = _interpolation_error(attitude, epochs, found, off)
        if np.max(hidden, initial=0.0) < sigma:
            continue
        step = float(np.median(np.diff(attitude.t_ns[_near(attitude, epochs)]))) * 1e-9
        worst = float(np.max(hidden))

        def undo(c: Campaign, worst: float = worst) -> Campaign:
            return replace(c, cov_attitude_E=c.cov_attitude_E + (worst / 2.0) ** 2 * np.eye(3))

        yield Mistake(
            "sampling.attitude",
            f"the attitude is sampled too coarsely for the motion: every {step:.3g} s, which leaves up to "
            f"{worst / ARCSEC:.2g} arcsec between the samples",
            "use an attitude with more samples, or state attitude.sigma_arcsec = "
            f"{np.hypot(worst, sigma) / ARCSEC:.2g}",
            undo,
            evidence=f"a sample of the attitude lies {np.median(off) / ARCSEC:.2g} arcsec (median) from where its "
            f"neighbours predict it, so interpolation is off by up to {worst / ARCSEC:.2g} arcsec (stated sigma "
            f"{sigma / ARCSEC:.2g})",
        )


def _interpolation_error(attitude: Attitude, epochs: Index, found: _Predicted, off: Array) -> Array:
    """What interpolation between samples is likely off at epochs, rad; 0 where no prediction is near."""
    left = np.clip(np.searchsorted(attitude.t_ns, epochs, side="right") - 1, 1, attitude.t_ns.size - 3)
    tau = seconds(attitude.t_ns[left[:, None] + np.arange(-1, 3)] - epochs[:, None])
    product_at = np.abs(np.prod(tau, axis=1))
    place = np.argmin(np.abs(found.at[None, :] - left[:, None]), axis=1)
    near = np.abs(found.at[place] - left) <= 2
    return np.where(near, off[place] * product_at / found.spread[place], 0.0)


def _image_time_digits(campaign: Campaign, written: Written) -> Iterator[Mistake]:
    """Image times with so few decimals that the camera moves by more than its stated errors meanwhile."""
    if written.image_time_decimals is None or not campaign.sightings.image.size:
        return
    step = 10.0**-written.image_time_decimals
    image = np.unique(campaign.sightings.image)
    station = stations(campaign, image, np.zeros(image.size))
    speed = float(np.median(np.linalg.norm(station.v_J, axis=-1)))
    place = campaign.landmarks.r_J[campaign.sightings.landmark[:1]]
    distance = float(np.linalg.norm(place - station.r_J[:1], axis=-1)[0])
    stated = np.hypot(_attitude_sigma(campaign), float(np.min(campaign.sigma_position)) / distance)
    turn = step * speed / distance
    if not stated < 0.5 * turn:
        return
    yield Mistake(
        "digits.images",
        f"the images' times are written to {step:g} s only, in which the camera moves {step * speed:.0f} m "
        f"({turn / ARCSEC:.0f} arcsec)",
        f"write the times with all their digits, or calibrate with --estimate time_offset={1e3 * step:g}ms",
        free=(TimeOffset(("time_offset",), (step,)),),
        evidence=f"no time of an image has more than {written.image_time_decimals} decimals: {step:g} s are "
        f"{turn / ARCSEC:.0f} arcsec, and {stated / ARCSEC:.2g} arcsec are stated",
    )
