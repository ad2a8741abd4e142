"""Whole campaigns from raw images: is the error of the mounting what its sigma says, and is every image found?

    python benchmarks/imagery_campaigns.py [CAMPAIGNS] [SEED] [frame|line-scan|chips]

Set OPENBLAS_NUM_THREADS=1.  Each campaign is that of `starplumb init --imagery`, of its own ground and draw, but
smaller: four images of 190 px with nine chips each, under 10 to 35 % of cloud, another season, 6 % of the ground
changed, a reference and heights with errors, a mounting that errs by 45 arcsec.  Images are measured and calibrated
from their files, as `measure --calibrate` does.  With `chips` a line scanner's images are measured by the library that
a frame camera's campaign of the same ground has cut: by another camera, without orthoimage and heights.
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

GRID = "\n[measure]\ngrid = [3, 3]\n"
LINE_PERIOD_S = 2.05e-3
"""Lines as far apart as columns, at a ground speed of 6.8 km/s."""


def small():
    """The example, drawn smaller."""
    drawn_demo.SIZE_PX = 190
    drawn_demo.REACH_M = 2500.0
    drawn_demo.SIGMA_MOUNTING = np.array([45.0, 45.0, 90.0]) * ARCSEC


def by_library(folder, text, seed):
    """A campaign's text with the chips that a frame camera's campaign of its ground cuts as its reference."""
    path, _ = write_drawn_example(folder / "frame", seed)
    path.write_text(path.read_text() + GRID)
    sp.measure(path).save_chips(folder / "library")
    head, _, rest = text.partition("[reference]\n")
    return f'{head}[reference]\nkind = "chips"\nfiles = ["library"]\n\n[' + rest.partition("\n[")[2]


def campaign(folder, seed, kind="frame"):
    """Images, those measured, chips, those used; correction over sigma (3,) and whether 95 % intervals hold (3,)."""
    period = 0.0 if kind == "frame" else LINE_PERIOD_S
    path, images = write_drawn_example(folder, seed, line_period_s=period)
    text = path.read_text() + GRID
    path.write_text(by_library(folder, text, seed) if kind == "chips" else text)
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
    trials, seed, kind = (*sys.argv[1:4], *("10", "1000", "frame")[len(sys.argv[1:4]) :])
    trials, seed = int(trials), int(seed)
    small()
    counts, over, began = [], [], time.process_time()
    for k in range(trials):
        with tempfile.TemporaryDirectory() as folder:
            count, z = campaign(Path(folder) / "drawn", seed + k, kind)
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
