"""Wrong sightings that agree among themselves: what an answer is called, and how far it is from the truth.

    python benchmarks/coherent_blunders.py --campaigns 1000 --seed 1000

Each row: campaigns of 8 frame images of the example, with their own errors and their own blunders, judged by
`starplumb.judge` as `calibrate` does.  Limits and thresholds were set on the seeds 0 to 99.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from starplumb.estimators import METHODS
from starplumb.estimators.protocol import Estimator, Status
from starplumb.judge import calibrate as judge
from starplumb.physics import so3
from starplumb.physics.earth import C_JT, itrf_to_geodetic
from starplumb.physics.units import ARCSEC
from starplumb.plan.demo import demo
from starplumb.table.campaign import Campaign
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors, measure

What = Literal["pixels", "ground", "images", "late", "random", "corner", "swapped", "row", "nothing"]


@dataclass(frozen=True)
class Blunder:
    """What is made wrong in a ``share`` of each image's markers, or of the images, by ``size`` in px, m, arcsec or s;
    ``alike`` in all images, or in each by a direction of its own."""

    what: What
    size: float = 0.0
    share: float = 0.0
    alike: bool = False

    @property
    def name(self) -> str:
        unit = {"ground": "m", "images": "arcsec", "late": "s"}.get(self.what, "px")
        of = "images" if self.what in ("images", "late") else "markers"
        if self.what == "nothing":
            return "nothing wrong"
        size = f" {self.size:g} {unit}" if self.size else ""
        return f"{self.what}{size}, {self.share:.0%} of {of}{', all alike' if self.alike else ''}"

    def apply(self, o: Observations, rng: np.random.Generator) -> Observations:
        if self.what == "images":
            turn = self.size * ARCSEC * self._directions(o.n_images, 3, rng) * self._bad(o, rng)[:, None]
            return o.with_geometry(C_EJ=so3.exp(turn[o.image]) @ o.C_EJ)
        if self.what == "late":
            t = (self.size * self._bad(o, rng))[o.image][:, None]
            return o.with_geometry(C_EJ=so3.exp(t * o.omega_E) @ o.C_EJ, r_J=o.r_J + t * o.v_J)
        chosen = self._markers(o, rng)
        if self.what == "ground":
            latitude, longitude, _ = itrf_to_geodetic(o.p_J)
            level = np.append(self.size * self._directions(1, 2, rng)[0], 0.0)
            return o.with_geometry(p_J=o.p_J + chosen[:, None] * (C_JT(latitude, longitude) @ level))
        if self.what == "swapped":
            return replace(o, xy_K=_swapped(o, chosen))
        move = self._directions(o.n_images, 2, rng)[o.image]
        if self.what in ("random", "corner"):
            move = rng.uniform(-1.0, 1.0, (o.n, 2))
        if self.what == "row":  # a shift that grows along the column: a wrong line rate
            move = np.stack([np.zeros(o.n), o.xy_K[:, 1] / np.std(o.xy_K[:, 1])], axis=-1)
        shift = (o.slope_K @ (self.size * move)[..., None])[..., 0]
        return replace(o, xy_K=o.xy_K + chosen[:, None] * shift)

    def _directions(self, n: int, axes: int, rng: np.random.Generator) -> np.ndarray:
        u = rng.normal(size=(1 if self.alike else n, axes))
        return np.broadcast_to(u / np.linalg.norm(u, axis=-1, keepdims=True), (n, axes))

    def _bad(self, o: Observations, rng: np.random.Generator) -> np.ndarray:
        bad = np.zeros(o.n_images)
        bad[rng.choice(o.n_images, round(self.share * o.n_images), replace=False)] = 1.0
        return bad

    def _markers(self, o: Observations, rng: np.random.Generator) -> np.ndarray:
        chosen = np.zeros(o.n, dtype=bool)
        for image in range(o.n_images):
            mine = np.flatnonzero(o.image == image)
            count = round(self.share * mine.size)
            if self.what == "corner":  # those farthest towards one corner
                chosen[mine[np.argsort(np.sum(o.xy_K[mine], axis=-1))[mine.size - count :]]] = True
            else:
                chosen[rng.choice(mine, count, replace=False)] = True
        return chosen


def _swapped(o: Observations, chosen: np.ndarray) -> np.ndarray:
    """The labels of the chosen ones shifted by one within their image."""
    xy = o.xy_K.copy()
    for image in range(o.n_images):
        mine = np.flatnonzero(chosen & (o.image == image))
        xy[mine] = o.xy_K[np.roll(mine, 1)]
    return xy


KINDS = [
    Blunder("nothing"),
    *(Blunder("pixels", px, share) for px in (3, 10, 30, 300) for share in (0.2, 0.4, 0.6)),
    *(Blunder("ground", m, share) for m in (5, 20, 100) for share in (0.4, 0.6)),
    *(Blunder("images", arcsec, 0.5) for arcsec in (30, 100, 1000)),
    *(Blunder("late", s, share) for s in (0.01, 0.1) for share in (0.25, 0.5)),
    *(Blunder("random", px, share) for px in (10, 100, 1000) for share in (0.05, 0.3, 0.6)),
    # kinds that no threshold was set on
    *(Blunder("pixels", 30, share, alike=True) for share in (0.2, 0.4, 0.6)),
    *(Blunder("images", 100, share, alike=True) for share in (0.25, 0.5)),
    *(Blunder("swapped", share=share) for share in (0.3, 0.6)),
    *(Blunder("corner", px, 0.4) for px in (10, 100)),
    *(Blunder("row", px, 1.0) for px in (3, 30)),
]


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--campaigns", type=int, default=100)
    options.add_argument("--seed", type=int, default=1000)
    options.add_argument("--method", choices=["default", "gls", "robust"], default="default")
    options.add_argument("--only", default="", help="kinds whose names begin so")
    asked = options.parse_args()
    estimator = METHODS[asked.method]()
    campaign, C_EK_true = demo("frame", 8, 1)
    heads = (
        "wrong, ok, weak, refuted, no answer, within 4 sigma, beyond as ok, beyond twice the interval, CPU ms"
    )
    print(f"| {heads.replace(', ', ' | ')} |")
    print("|---|---|---|---|---|---|---|---|---|")
    for blunder in (blunder for blunder in KINDS if blunder.name.startswith(asked.only)):
        print(row(blunder, campaign, C_EK_true, estimator, asked.campaigns, asked.seed), flush=True)


def row(
    blunder: Blunder, campaign: Campaign, C_EK_true: np.ndarray, estimator: Estimator, trials: int, seed: int
) -> str:
    """A row of the table."""
    scene = observe(campaign)
    counts: Counter[str] = Counter()
    start = time.process_time()
    for trial in range(trials):
        rng = np.random.default_rng([seed, trial])
        table = blunder.apply(measure(scene, C_EK_true, Errors.draw(scene, rng)), rng)
        judge.table_of = lambda _, table=table: table
        judge._evidence = lambda *_: ()
        counts.update(outcome(judge.calibrate(campaign, estimator), C_EK_true))
    seconds = time.process_time() - start
    names = ("OK", "WEAK", "REFUTED", "none", "right", "ok but wrong", "outside")
    cells = [blunder.name, *(str(counts[name]) for name in names), f"{1e3 * seconds / trials:.0f}"]
    return f"| {' | '.join(cells)} |"


def outcome(found: judge.Calibration, C_EK_true: np.ndarray) -> list[str]:
    """The status, and how far off a usable answer is."""
    if not found.status.usable:
        return ["REFUTED" if found.status is Status.REFUTED else "none"]
    error = np.abs(so3.log(found.C_EK @ C_EK_true.mT))
    assert found.sigma_E is not None
    assert found.interval_95_E is not None
    right = np.max(error / found.sigma_E) <= 4.0
    said = [found.status.name, *(["right"] if right else [])]
    said += ["ok but wrong"] if found.status is Status.OK and not right else []
    return said + (["outside"] if np.max(error / found.interval_95_E) > 2.0 else [])


if __name__ == "__main__":
    main()
