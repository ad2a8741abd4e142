"""Attitude samples held against their neighbours: sampled too coarsely, scattered, or one of them wrong.

What the prediction of a sample misses tells what the interpolation misses at an image
(:mod:`starplumb.judge.files.neighbours`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...physics.series import Attitude, seconds
from ...physics.timescales import format_iso
from ...physics.trackers import FusedAttitude
from ...physics.units import ARCSEC
from ...table.campaign import Campaign
from ..consistency import chi2_p
from ..trust import IMPLAUSIBLE_P
from .evidence import NOTICEABLE, Evidence, growth, listed, worst
from .image_errors import ImageErrors
from .neighbours import NODES, Between, Missed, between, is_motion, left_out, missed_between, without

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Epochs = NDArray[np.int64]

SUSPECT, LEFT_OVER = 3.0, 0.2
"""A sample is wrong when its neighbours put it more than 3 sigmas away, and agree without it to a fifth of that..."""
BAD_SAMPLE, NOISE = 6.0, 3.5
"""...or more than 6 sigmas away (once in ten million samples), and agree without it as their own noise lets them."""
LEAST_SIGMA = 0.01 * ARCSEC
"""Stands in for the sigma of an attitude that claims to be exact."""
MOST_BAD = 5
"""Wrong samples looked for, one after another."""
CORRELATED = 2.7
"""Predictions of neighbouring samples share noise: so many of them are worth one (1 + 2 (0.8^2 + 0.4^2 + 0.1^2))."""


@dataclass(frozen=True)
class Watched:
    """One tracker's series as the images see it: the matrix ``C_EA`` by which its errors enter the attitude in E (of
    several trackers its part), and of the exposures (q,) that count their image, epoch and stated sigma (q, 3) rad
    about the tracker's own axes."""

    attitude: Attitude
    C_EA: Array
    image: Index
    t_ns: Epochs
    sigma: Array
    names: tuple[str, ...]


def sampling(campaign: Campaign, errors: ImageErrors, covariance_E: Array) -> Iterator[Evidence]:
    """What the samples of each tracker say of one another, as it bears on the images that count."""
    for watched in _watched(campaign, errors):
        cleaned, found = _without_bad(watched, errors, covariance_E)
        yield from found
        place = between(cleaned.attitude, cleaned.t_ns)
        if place.query.size == 0:
            continue
        check = _coarse if is_motion(cleaned.attitude, place) else _scattered
        yield from check(cleaned, place, errors, covariance_E)


def _watched(campaign: Campaign, errors: ImageErrors) -> Iterator[Watched]:
    s, attitude, names = campaign.sightings, campaign.attitude, campaign.images.ids
    rows = np.flatnonzero(errors.observations.weight > 0.0)
    epochs = campaign.images.exposed(s.image[rows], s.row_px[rows])
    image, t_ns = _distinct(s.image[rows], epochs)
    if not isinstance(attitude, FusedAttitude):
        variance = np.diagonal(campaign.cov_attitude_E, axis1=-2, axis2=-1)
        sigma = np.broadcast_to(np.sqrt(variance), (len(names), 3))[image]
        yield Watched(attitude, np.eye(3), image, t_ns, np.maximum(sigma, LEAST_SIGMA), names)
        return
    for tracker in attitude.trackers:
        part = tracker.C_EA / len(attitude.trackers)
        sigma = np.maximum(tracker.sigma_A(t_ns), LEAST_SIGMA)
        yield Watched(tracker.attitude, part, image, t_ns, sigma, names)


def _distinct(image: Index, t_ns: Epochs) -> tuple[Index, Epochs]:
    """Each pair of an image and an epoch once, in their order (``np.unique`` of columns takes ten times as long)."""
    order = np.lexsort((t_ns, image))
    image, t_ns = image[order], t_ns[order]
    first = np.ones(image.size, dtype=np.bool_)
    first[1:] = (np.diff(image) != 0) | (np.diff(t_ns) != 0)
    return image[first], t_ns[first]


def _shared(errors: ImageErrors, image: Index, angle_E: Array) -> Array:
    """Image errors (m, 6, 6): mean square over its epochs of attitude errors (q, 3) of images (q,)."""
    out = np.zeros_like(errors.stated)
    np.add.at(out[:, :3, :3], image, angle_E[:, :, None] * angle_E[:, None, :])
    return out / np.maximum(np.bincount(image, minlength=len(out)), 1)[:, None, None]


def _coarse(w: Watched, place: Between, errors: ImageErrors, covariance_E: Array) -> Iterator[Evidence]:
    attitude = w.attitude
    missed = missed_between(attitude, place)
    at, missed_E = w.image[place.query], missed @ w.C_EA.mT
    mean = np.zeros((len(errors.stated), 6))
    np.add.at(mean[:, :3], at, missed_E)
    mean /= np.maximum(np.bincount(at, minlength=len(mean)), 1)[:, None]
    common = errors.by_common(mean)
    further = errors.by_images(_shared(errors, at, missed_E)) + np.outer(common, common)
    if growth(covariance_E, further) <= NOTICEABLE:
        return
    step = float(np.median(seconds(attitude.t_ns[place.left + 1] - attitude.t_ns[place.left])))
    largest = float(np.max(np.linalg.norm(missed, axis=-1))) / ARCSEC
    yield Evidence(
        "sampling",
        f"{attitude.name}: samples every {step:.3g} s are too far apart for this motion: predicted from their "
        f"neighbours they show that interpolation misses up to {largest:.2g} arcsec at the images, which adds "
        f"{worst(covariance_E, further)}",
        "give the attitude at a higher rate, or state a larger attitude sigma",
        covariance_E=further,
    )


def _scattered(w: Watched, place: Between, errors: ImageErrors, covariance_E: Array) -> Iterator[Evidence]:
    """White noise of the samples that is larger than the stated sigma of the attitude."""
    samples, owner = np.unique(place.nodes, return_index=True)
    missed = left_out(w.attitude, samples)
    white, stated = missed.angle / missed.noise[:, None], w.sigma[place.query[owner // NODES]]
    freedom = int(white.size / CORRELATED)
    if freedom < 3 or chi2_p(float(np.sum((white / stated) ** 2)) / CORRELATED, freedom) > IMPLAUSIBLE_P:
        return
    rms = np.sqrt(np.mean(white**2, axis=0))
    weight = np.sqrt(np.sum(place.weights**2, axis=-1))
    excess = np.sqrt(np.maximum((weight[:, None] * rms) ** 2 - w.sigma[place.query] ** 2, 0.0))
    at = w.image[place.query]
    own = sum(_shared(errors, at, excess[:, i : i + 1] * w.C_EA[:, i]) for i in range(3))
    further = errors.by_images(np.asarray(own))
    if growth(covariance_E, further) <= NOTICEABLE:
        return
    yield Evidence(
        "scatter",
        f"{w.attitude.name}: the samples scatter about their neighbours by "
        f"{', '.join(f'{x / ARCSEC:.2g}' for x in rms)} arcsec about x, y, z, more than the stated sigma of "
        f"{', '.join(f'{x / ARCSEC:.2g}' for x in np.median(stated, axis=0))} arcsec; that adds "
        f"{worst(covariance_E, further)}",
        "state the sigma of a sample, or give a filtered attitude",
        covariance_E=further,
    )


def _without_bad(w: Watched, errors: ImageErrors, covariance_E: Array) -> tuple[Watched, list[Evidence]]:
    """The series without samples that contradict all their neighbours, and what is said of each."""
    found: list[Evidence] = []
    for _ in range(MOST_BAD):
        attitude, place = w.attitude, between(w.attitude, w.t_ns)
        bad = _bad_sample(attitude, place, w.sigma)
        if bad is None:
            break
        k, angle = bad
        feeds = np.flatnonzero(np.any(place.nodes == k, axis=1))
        weight = np.sum(place.weights[feeds] * (place.nodes[feeds] == k), axis=-1)
        at = w.image[place.query[feeds]]
        further = errors.by_images(_shared(errors, at, weight[:, None] * (w.C_EA @ angle)))
        names = [w.names[i] for i in np.unique(at)]
        time = format_iso(attitude.t_ns[k : k + 1], "UTC", digits=3)[0]
        found.append(
            Evidence(
                "sample",
                f"{attitude.name}: the sample at {time} UTC lies {np.linalg.norm(angle) / ARCSEC:.0f} arcsec from "
                f"where its neighbours put it, and these agree without it; it feeds {listed(names)} and moves the "
                f"answer by {worst(covariance_E, further)}",
                "leave the sample out of the table",
                weakens=growth(covariance_E, further) > NOTICEABLE,
                covariance_E=further,
                rows=(time, *names),
            )
        )
        w = replace(w, attitude=without(attitude, k))
    return w, found


def _bad_sample(attitude: Attitude, place: Between, sigma: Array) -> tuple[int, Array] | None:
    """The sample that feeds an image and is wrong by most, and by how much (3,) rad; None where none is."""
    if place.query.size == 0:
        return None
    samples, owner = _around(attitude, place)
    missed = left_out(attitude, samples)
    far = _in_sigmas(missed, sigma[place.query[owner]])
    at = int(np.argmax(far))
    k, sigma_k = int(samples[at]), sigma[place.query[owner[at]]]
    first, last = (int(bound[k]) for bound in attitude.bursts.bounds)
    if far[at] < SUSPECT or last - first < NODES + 2:
        return None
    around = np.setdiff1d(np.arange(max(first, k - NODES), min(last, k + NODES) + 1), k)
    others = left_out(without(attitude, k), around - (around > k))
    left = float(np.max(_in_sigmas(others, sigma_k)))
    agree = left <= LEFT_OVER * far[at] or (far[at] > BAD_SAMPLE and left <= NOISE)
    return (k, missed.angle[at]) if agree else None


def _in_sigmas(missed: Missed, sigma: Array) -> Array:
    """Length (p,) of what is missed in units of what stated noise of the samples would miss."""
    return np.asarray(np.linalg.norm(missed.angle / sigma, axis=-1) / missed.noise)


def _around(attitude: Attitude, place: Between) -> tuple[Index, Index]:
    """Samples within reach of the nodes at the images, and an epoch (of ``place``) that each is near to."""
    first, last = (bound[place.left][:, None] for bound in attitude.bursts.bounds)
    near = np.clip(place.left[:, None] + np.arange(-NODES, NODES + 2), first, last)
    samples, at = np.unique(near, return_index=True)
    return samples, at // near.shape[1]
