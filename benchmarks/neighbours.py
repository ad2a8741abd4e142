"""Chips whose reference is alike over a distance: what do thousands cost, and is the sigma that of all of them?

    python benchmarks/neighbours.py --images 2 5 10 30 --campaigns 300 --seed 61000

Images of 49 chips over 34 km, the reference's errors of 5 m alike over 8 km, drawn with their whole correlation.
"Sigma / whole" is that of dense least squares with three unknowns a chip, up to ``--whole`` images.  "Error / sigma",
the share of 95 % intervals that hold the truth and the ratio found of the sightings' noise are over campaigns of four
images of 25 chips.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from scenes import C_EK_TRUE, marked, photographed

from starplumb.estimators.default import Default
from starplumb.estimators.gls import Gls
from starplumb.judge.calibrate import calibrate
from starplumb.physics import so3
from starplumb.plan import scene
from starplumb.table import sharing
from starplumb.table.campaign import Campaign
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors

LENGTH_M, SIGMA_M = 8e3, 5.0


def chips(images: int, count: int, rng: np.random.Generator) -> Campaign:
    """A true campaign of chips, their reference's error stated."""
    true = marked(photographed(images), count, rng)
    covariance_J = np.broadcast_to(SIGMA_M**2 * np.eye(3), true.landmarks.covariance_J.shape)
    return replace(
        true, landmarks=replace(true.landmarks, covariance_J=covariance_J, correlation_length=LENGTH_M)
    )


def measured(true: Campaign, rng: np.random.Generator) -> Campaign:
    """What is delivered of it: the model mounting 200 arcsec off."""
    p = true.landmarks.r_J
    alike = np.exp(-np.linalg.norm(p[:, None] - p, axis=-1) / LENGTH_M)
    errors = Errors.draw(observe(true), rng)
    pi_J = SIGMA_M * np.linalg.cholesky(alike) @ rng.standard_normal(p.shape)
    model = so3.exp(rng.standard_normal(3) * 1e-3) @ C_EK_TRUE
    return scene.measured(true, replace(errors, pi_J=pi_J), model)


def cost(images: int, whole: int, seed: int) -> None:
    rng = np.random.default_rng([seed, images])
    campaign = measured(chips(images, 49, rng), rng)
    start = time.process_time()
    done = calibrate(campaign, Default())
    seconds = time.process_time() - start
    ratio = "-"
    if images <= whole:
        kept, sharing.FEW_NEIGHBOURS = sharing.FEW_NEIGHBOURS, sharing.MOST_NEIGHBOURS
        table = sharing.with_shared(campaign, observe(campaign), done.estimate.C_EK)
        sharing.FEW_NEIGHBOURS = kept
        exact = Gls()(table, done.estimate.C_EK).sigma_E
        ratio = ", ".join(f"{x:.4f}" for x in done.sigma_E / exact)
    columns = done.observations.common_px.shape[-1]
    print(f"| {images} | {49 * images} | {columns} | {seconds:.1f} | {ratio} |", flush=True)


def statistics(campaigns: int, seed: int) -> None:
    scores, noise, held = [], [], []
    for number in range(campaigns):
        rng = np.random.default_rng([seed, 1000, number])
        done = calibrate(measured(chips(4, 25, rng), rng), Default())
        if not done.status.usable:
            continue
        error = so3.log(done.estimate.C_EK @ C_EK_TRUE.mT)
        scores.append(error / done.sigma_E)
        held.append(np.abs(error) < done.interval_95_E)
        noise += [s.ratio for s in done.from_data.sources if s.unit == "px"]
    rms = np.sqrt(np.mean(np.square(scores), axis=0))
    print(
        f"\n{len(scores)} of {campaigns} campaigns: error / sigma {rms.round(2)}, 95 % intervals held "
        f"{np.mean(held, axis=0).round(3)}, noise of the sightings over what is stated {np.mean(noise):.3f}"
    )


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--images", type=int, nargs="*", default=[2, 5, 10, 30])
    options.add_argument("--whole", type=int, default=5)
    options.add_argument("--campaigns", type=int, default=300)
    options.add_argument("--seed", type=int, default=61000)
    asked = options.parse_args()
    print("| images | chips | columns | calibrate, CPU s | sigma / whole |\n|---|---|---|---|---|")
    for images in asked.images:
        cost(images, asked.whole, asked.seed)
    statistics(asked.campaigns, asked.seed)


if __name__ == "__main__":
    main()
