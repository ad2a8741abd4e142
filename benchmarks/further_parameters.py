"""An unknown focal length on the published scenario: what it costs to estimate it, and what to leave it wrong.

    python benchmarks/further_parameters.py --runs 2000

Two images with two markers each at (+-2.5, +-2.5) km on a diagonal, a lens 0.25 % longer than stated (Tkachenko 2019).
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scenes import C_EK_TRUE, CAMERA, SIGMAS, photographed

from starplumb.estimators.gls import Gls
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.plan import scene
from starplumb.table.geometry import observe
from starplumb.table.parameters import Optics
from starplumb.table.simulate import Errors, measure

LONGER = 1.0025


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=2000)
    arguments = parser.parse_args()
    true_camera = replace(CAMERA, focal_length=LONGER * CAMERA.focal_length)
    campaign = photographed(2, camera=true_camera)
    apart = 2500.0 * true_camera.focal_length / true_camera.pitch / 690e3
    pixel = 5999.5 + apart * np.array([[-1.0, -1.0], [1.0, 1.0]] * 2)
    o = observe(scene.mark_pixels(campaign, np.array([0, 0, 1, 1]), pixel, np.zeros(4), SIGMAS))
    right = measure(o, C_EK_TRUE, Errors.draw(o, np.random.default_rng(1), (arguments.runs,)))
    wrong = replace(right, xy_K=right.xy_K * LONGER, slope_K=right.slope_K * LONGER)
    free = Gls((Optics(CAMERA, ("focal_length",), (np.inf,)),))
    cases = {
        "known": (Gls(), right),
        "estimated with it": (free, wrong),
        "left 0.25 % wrong": (Gls(), wrong),
    }
    print("| focal length | stated sigma arcsec | rms error arcsec | error / sigma |\n|---|---|---|---|")
    for name, (estimator, table) in cases.items():
        estimate = estimator(table, C_EK_TRUE)
        error = so3.log(estimate.C_EK @ C_EK_TRUE.mT) @ C_EK_TRUE  # about the camera's axes
        covariance = C_EK_TRUE.T @ estimate.covariance_E @ C_EK_TRUE
        sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        columns = (np.mean(sigma, axis=0) / ARCSEC, np.sqrt(np.mean(error**2, axis=0)) / ARCSEC)
        ratio = np.sqrt(np.mean((error / sigma) ** 2, axis=0))
        words = [" ".join(f"{x:.3g}" for x in column) for column in (*columns, ratio)]
        print(f"| {name} | {' | '.join(words)} |", flush=True)


if __name__ == "__main__":
    main()
