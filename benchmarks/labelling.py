"""Unlabelled markers: how often the labels are found, how often wrongly, how often refused.

    python benchmarks/labelling.py --campaigns 1000

Each row: campaigns of 6 images x 8 markers on sites of their own, a mounting wrong by a stated angle in a random
direction, a share of markers missed, and false detections so that they are a stated share of all.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from scenes import C_EK_TRUE, marked, photographed
from tally import tally

from starplumb.estimators.protocol import Status
from starplumb.estimators.robust import Robust
from starplumb.identify.labelling import label
from starplumb.judge.calibrate import calibrate
from starplumb.physics import so3
from starplumb.physics.units import DEG
from starplumb.table.campaign import Campaign, Detections
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors


@dataclass(frozen=True)
class Case:
    """What makes it hard."""

    error_deg: float
    clutter: float
    missed: float


CASES = (
    Case(1.0, 0.3, 0.0),
    Case(1.0, 0.3, 0.3),
    Case(2.0, 0.3, 0.3),
    Case(2.0, 0.5, 0.5),
)


def measured(true: Campaign, case: Case, rng: np.random.Generator) -> tuple[Campaign, Detections, np.ndarray]:
    """A campaign with errors of every kind, its detections in random order, and their true landmarks (-1: clutter)."""
    o = observe(true)
    errors = Errors.draw(o, rng)
    s = true.sightings
    t, series = true.images.t_ns, true.attitude
    image_of = np.argmin(np.abs(series.t_ns[:, None] - t[None]), axis=1)
    C = so3.exp(errors.alpha_E[image_of]) @ so3.from_quaternion(series.q_EF)
    attitude = replace(series, q_EF=so3.to_quaternion(C))
    ephemeris = replace(true.ephemeris, r_J=true.ephemeris.r_J + errors.rho_J[image_of])
    landmarks = replace(true.landmarks, r_J=true.landmarks.r_J + errors.pi_J)
    axis = rng.standard_normal(3)
    model = so3.exp(case.error_deg * DEG * axis / np.linalg.norm(axis)) @ C_EK_TRUE
    seen = rng.random(s.image.size) >= case.missed
    false = rng.binomial(int(seen.sum() / (1.0 - case.clutter)), case.clutter)
    image = np.concatenate([s.image[seen], rng.integers(t.size, size=false)])
    pixel = np.stack([s.column_px, s.row_px], axis=-1)[seen] + errors.pixel[seen]
    pixel = np.concatenate([pixel, rng.uniform(0.0, 11999.0, (false, 2))])
    named = np.concatenate([s.landmark[seen], np.full(false, -1)])
    order = rng.permutation(image.size)
    detections = Detections(image[order], pixel[order, 0], pixel[order, 1], np.full(image.size, 0.3))
    campaign = replace(true, C_EK=model, attitude=attitude, ephemeris=ephemeris, landmarks=landmarks)
    return campaign, detections, named[order]


def run(case: Case, campaigns: int, rng: np.random.Generator) -> str:
    """One row of the table."""
    answered = wrong = wrong_labels = found = there = 0
    normalised, spent = [], 0.0
    for _ in range(campaigns):
        true = marked(photographed(6), 8, rng)
        campaign, detections, named = measured(true, case, rng)
        start = time.process_time()
        labels = label(campaign, detections)
        if labels.refusal:
            spent += time.process_time() - start
            continue
        done = calibrate(replace(campaign, sightings=labels.sightings(detections)), Robust())
        spent += time.process_time() - start
        if not done.status.usable:
            continue
        answered += 1
        error = so3.log(done.estimate.C_EK @ C_EK_TRUE.mT) / done.estimate.sigma_E
        normalised.append(error)
        wrong += int(np.abs(error).max() > 5.0 and done.status is Status.OK)
        wrong_labels += int(np.sum((labels.landmark >= 0) & (labels.landmark != named)))
        found += int(np.sum((labels.landmark >= 0) & (labels.landmark == named)))
        there += int(np.sum(named >= 0))
    sd = np.std(normalised, axis=0)
    return (
        f"| {case.error_deg:g} | {case.clutter:.0%} | {case.missed:.0%} | {answered} of {campaigns} | {wrong} | "
        f"{wrong_labels} | {found / there:.2%} | {sd[0]:.2f} {sd[1]:.2f} {sd[2]:.2f} | {1e3 * spent / campaigns:.0f} |"
    )


HEADER = (
    "| error deg | clutter | missed | answered | wrong answers `ok` | wrong labels | markers "
    "labelled | sd of error / sigma | CPU ms |"
)


def many(images: int, markers: int, rng: np.random.Generator) -> str:
    """One campaign of many detections: how many are named, rightly and wrongly, and in what time."""
    campaign, detections, named = measured(marked(photographed(images), markers, rng), CASES[2], rng)
    start = time.process_time()
    labels = label(campaign, detections)
    spent = time.process_time() - start
    given = labels.landmark >= 0
    right = int(np.sum(given & (labels.landmark == named)))
    return (
        f"| {images} | {markers} | {named.size} | {right} of {np.sum(named >= 0)} | {given.sum() - right} "
        f"| {spent:.1f} |"
    )


if __name__ == "__main__":
    tally(__doc__, HEADER, CASES, run)
    print("\n| images | markers | detections | named rightly | wrongly | CPU s |\n|---|---|---|---|---|---|")
    for images, markers in ((6, 50), (6, 200), (20, 200)):
        print(many(images, markers, np.random.default_rng(1)), flush=True)
