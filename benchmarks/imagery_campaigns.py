"""Whole campaigns from raw images: is the error of the mounting what its sigma says, and is every image found?

    python benchmarks/imagery_campaigns.py [CAMPAIGNS] [SEED]

Set OPENBLAS_NUM_THREADS=1.  Each campaign is that of `starplumb init --imagery`, of its own ground and draw, but
smaller: four frame images of 240 px under 10 to 35 % of cloud, another season, 6 % of the ground changed, a reference
and heights with errors, a mounting that errs by 60 arcsec.  Images are measured and calibrated from their files, as
`measure --calibrate` does.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import starplumb as sp
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.plan import drawn_demo
from starplumb.session.imagery.example import write_drawn_example

GRID = "\n[measure]\ngrid = [4, 4]\n"


def small():
    """The example, drawn smaller."""
    drawn_demo.SIZE_PX = 240
    drawn_demo.REACH_M = 3000.0
    drawn_demo.SIGMA_MOUNTING = np.array([60.0, 60.0, 120.0]) * ARCSEC


def campaign(folder, seed):
    """Images, those measured, chips, those used; correction over sigma (3,) and whether 95 % intervals hold (3,)."""
    path, images = write_drawn_example(folder, seed)
    if "[measure]" not in path.read_text():
        path.write_text(path.read_text() + GRID)
    found = sp.measure(path)
    used = sum(len(image.used) for image in found.images if not image.reason)
    counts = images, found.acquired, sum(len(image.chips) for image in found.images), used
    if not found.usable:
        return counts, None
    found.save(folder / "measured", report=False)
    loaded = sp.read_campaign(folder / "measured" / "campaign.toml")
    result = sp.calibrate(loaded)
    error = so3.log(result.C_EK @ loaded.loaded.C_EK_true.T)
    return counts, error / (ARCSEC * np.sqrt(np.diagonal(result.covariance_arcsec2)))


if __name__ == "__main__":
    trials, seed = (int(a) for a in (*sys.argv[1:3], *("10", "1000")[len(sys.argv[1:3]) :]))
    small()
    counts, over, began = [], [], time.process_time()
    for k in range(trials):
        with tempfile.TemporaryDirectory() as folder:
            count, z = campaign(Path(folder) / "drawn", seed + k)
        counts.append(count)
        if z is not None:
            over.append(z)
            print(seed + k, count, np.round(z, 2), flush=True, file=sys.stderr)
    images, measured, chips, used = np.sum(counts, axis=0)
    z = np.array(over)
    print(
        "| campaigns | images found | chips used | error/sigma rms x, y, z | 95 % intervals hold | CPU s each |"
    )
    print("|---|---|---|---|---|---|")
    rms = ", ".join(f"{value:.2f}" for value in np.sqrt(np.mean(z**2, axis=0)))
    holds = 100.0 * np.mean(np.abs(z) < 1.96)
    spent = (time.process_time() - began) / trials
    print(f"| {trials} | {measured} of {images} | {used} of {chips} | {rms} | {holds:.0f} % | {spent:.1f} |")
