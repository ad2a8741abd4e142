"""What times and samples of the files show by themselves: an attitude sample that its neighbours contradict, samples
too far apart to follow the motion, times with too few digits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.series import Attitude, seconds
from ...physics.units import ARCSEC
from ...table.campaign import Campaign
from ...table.geometry import stations
from ...table.parameters import TimeOffset
from ..files.digits import written_step
from ..files.neighbours import NODES, between, is_motion, left_out, missed_between, without
from .mistake import Mistake, epoch_text

Array = NDArray[np.float64]
Index = NDArray[np.int64]

OUTSTANDING = 6.0
"""A sample is suspected when it lies this many times farther from the prediction by its neighbours than is usual."""
NEAR = 6
"""Samples on either side of an exposure that are looked at."""


def _near(attitude: Attitude, epochs: Index) -> Index:
    """Samples near any of the epochs that have two neighbours on either side in their burst."""
    left = np.searchsorted(attitude.t_ns, epochs, side="right") - 1
    rows = np.unique(np.clip(left[:, None] + np.arange(-NEAR, NEAR + 2), 0, attitude.t_ns.size - 1))
    first, last = (bound[rows] for bound in attitude.bursts.bounds)
    return np.asarray(rows[(rows - NODES // 2 >= first) & (rows + NODES // 2 <= last)], dtype=np.int64)


def _exposures(campaign: Campaign) -> Index:
    s = campaign.sightings
    return np.unique(campaign.images.exposed(s.image, s.row_px))


def _attitude_sigma(campaign: Campaign) -> float:
    """The smallest stated standard deviation of the attitude about any axis, rad."""
    return float(np.sqrt(np.min(np.linalg.eigvalsh(campaign.cov_attitude_E))))


def wrong_samples(campaign: Campaign) -> Iterator[Mistake]:
    """An attitude sample that its neighbours contradict, and that an image rests on."""
    epochs, sigma = _exposures(campaign), _attitude_sigma(campaign)
    for series, attitude in enumerate(campaign.attitudes):
        near = _near(attitude, epochs)
        if near.size < NODES + 1:
            continue
        off = np.linalg.norm(left_out(attitude, near).angle, axis=-1)
        usual = max(float(np.median(off)), sigma)
        for place in np.argsort(-off, kind="stable")[:4].tolist():
            row = int(near[place])
            beside = off[np.abs(near - row) <= NODES // 2]
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
        number = iter(range(len(c.attitudes)))
        return c.with_attitude(lambda a: without(a, row) if next(number) == series else a)

    return undo


def coarse_samples(campaign: Campaign) -> Iterator[Mistake]:
    """Attitude samples too far apart to follow the motion between them."""
    epochs, sigma = _exposures(campaign), _attitude_sigma(campaign)
    for attitude in campaign.attitudes:
        place = between(attitude, epochs)
        if place.query.size == 0 or not is_motion(attitude, place):
            continue  # the noise of samples is no motion
        worst = float(np.max(np.linalg.norm(missed_between(attitude, place), axis=-1)))
        if worst < sigma:
            continue
        step = float(np.median(seconds(attitude.t_ns[place.left + 1] - attitude.t_ns[place.left])))
        usual = float(np.median(np.linalg.norm(left_out(attitude, np.unique(place.nodes)).angle, axis=-1)))

        def undo(c: Campaign, worst: float = worst) -> Campaign:
            return replace(c, cov_attitude_E=c.cov_attitude_E + (worst / 2.0) ** 2 * np.eye(3))

        yield Mistake(
            "sampling.attitude",
            f"the attitude is sampled too coarsely for the motion: every {step:.3g} s, which leaves up to "
            f"{worst / ARCSEC:.2g} arcsec between the samples",
            "use an attitude with more samples, or state attitude.sigma_arcsec = "
            f"{np.hypot(worst, sigma) / ARCSEC:.2g}",
            undo,
            evidence=f"a sample of the attitude lies {usual / ARCSEC:.2g} arcsec (median) from where its neighbours "
            f"predict it, so interpolation is off by up to {worst / ARCSEC:.2g} arcsec (stated sigma "
            f"{sigma / ARCSEC:.2g})",
        )


def few_digits(campaign: Campaign) -> Iterator[Mistake]:
    """Image times with so few digits that the camera moves by more than its stated errors meanwhile."""
    step, image = written_step(campaign.images.t_ns), np.unique(campaign.sightings.image)
    if not step or image.size < 3:  # two times may be round by design
        return
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
        evidence=f"the times of all images are whole multiples of {step:g} s: that is {turn / ARCSEC:.0f} arcsec, and "
        f"{stated / ARCSEC:.2g} arcsec are stated",
    )
