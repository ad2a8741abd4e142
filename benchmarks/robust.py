"""Blunders: how often the robust estimate is right, how honest its sigma is, and what it costs.

    python benchmarks/robust.py --campaigns 1000

Each row: campaigns of 20 images x 20 markers with their own errors and their own blunders.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from scenes import C_EK_TRUE, marked, photographed
from tally import tally

from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Verdict
from starplumb.estimators.robust import Robust
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors, measure

PIXEL = 9e-6 / 2.2
"""Tangent of a pixel."""


@dataclass(frozen=True)
class Spoiling:
    """What is made wrong: a share of labels exchanged within their image, of measurements moved by up to ``within_px``
    in column and row, one image's attitude turned, one image's epoch shifted."""

    name: str
    labels: float = 0.0
    pixels: float = 0.0
    within_px: float = 0.0
    glitch: bool = False

    def apply(self, o: Observations, rng: np.random.Generator) -> tuple[Observations, np.ndarray]:
        """The spoilt table and which sightings (n,) are wrong."""
        xy, wrong = o.xy_K.copy(), np.zeros(o.n, dtype=bool)
        chosen = rng.permutation(o.n)[: round((self.labels + self.pixels) * o.n)]
        wrong[chosen] = True
        if self.pixels:
            xy[chosen] += PIXEL * self.within_px * rng.uniform(-1.0, 1.0, (chosen.size, 2))
        elif self.labels:
            for image in range(o.n_images):
                mine = chosen[o.image[chosen] == image]
                xy[mine] = xy[np.roll(mine, 1)]
                wrong[mine] = mine.size > 1
        o = replace(o, xy_K=xy)
        return (_with_bad_images(o), wrong | (o.image < 2)) if self.glitch else (o, wrong)


def _with_bad_images(o: Observations) -> Observations:
    """Image 0 with an attitude wrong by 60 arcsec, image 1 taken 50 ms before its stated time."""
    C_EJ, r_J = o.C_EJ.copy(), o.r_J.copy()
    first, second = o.image == 0, o.image == 1
    C_EJ[first] = so3.exp(np.array([40.0, -40.0, 20.0]) * ARCSEC) @ C_EJ[first]
    C_EJ[second] = so3.exp(0.05 * o.omega_E[second]) @ C_EJ[second]
    r_J[second] += 0.05 * o.v_J[second]
    return o.with_geometry(C_EJ=C_EJ, r_J=r_J)


CASES = (
    Spoiling("none"),
    Spoiling("10 % labels", labels=0.1),
    Spoiling("40 % labels", labels=0.4),
    Spoiling("40 % within 50 px", pixels=0.4, within_px=50.0),
    Spoiling("40 % within 10 px", pixels=0.4, within_px=10.0),
    Spoiling("60 % labels", labels=0.6),
    Spoiling("60 % within 50 px", pixels=0.6, within_px=50.0),
    Spoiling("80 % labels", labels=0.8),
    Spoiling("40 % labels, 2 bad images", labels=0.4, glitch=True),
)


def run(case: Spoiling, campaigns: int, rng: np.random.Generator) -> str:
    """One row of the table."""
    normalised, plain, hits, false, missed, bad = [], [], 0, 0, 0, 0
    n_wrong = n_right = 0
    spent = 0.0
    o = observe(marked(photographed(20), 20, rng))
    for _ in range(campaigns):
        table, wrong = case.apply(measure(o, C_EK_TRUE, Errors.draw(o, rng)), rng)
        model = so3.exp(DEG * rng.standard_normal(3)) @ C_EK_TRUE
        start = time.process_time()
        estimate = Robust()(table, model)
        spent += time.process_time() - start
        kept = estimate.verdict == Verdict.USED
        error = so3.log(estimate.C_EK @ C_EK_TRUE.mT)
        normalised.append(error / estimate.sigma_E)
        clean = Gls()(table.select(~wrong), model)
        plain.append(so3.log(clean.C_EK @ C_EK_TRUE.mT) / clean.sigma_E)
        hits += bool(estimate.status == 0 and np.all(np.abs(normalised[-1]) < 4.0))
        bad += bool(estimate.status != 0)
        missed += int(np.sum(kept & wrong))
        false += int(np.sum(~kept & ~wrong))
        n_wrong, n_right = n_wrong + int(np.sum(wrong)), n_right + int(np.sum(~wrong))
    sd, ideal = np.std(normalised, axis=0), np.std(plain, axis=0)
    return (
        f"| {case.name} | {hits} of {campaigns} | {bad} | {sd[0]:.3f} {sd[1]:.3f} {sd[2]:.3f} | "
        f"{ideal[0]:.3f} {ideal[1]:.3f} {ideal[2]:.3f} | {missed / max(n_wrong, 1):.2%} | {false / n_right:.3%} | "
        f"{1e3 * spent / campaigns:.0f} |"
    )


HEADER = (
    "| wrong | within 4 sigma | refused | sd of error / sigma | same, wrong ones known | "
    "wrong kept | good lost | CPU ms |"
)

if __name__ == "__main__":
    tally(__doc__, HEADER, CASES, run)
