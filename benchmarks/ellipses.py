"""Marks whose noise is a long ellipse: is the error what the sigma says, and what do circles in its place lose?

    python benchmarks/ellipses.py --campaigns 400 --seed 52000

Four images of 12 marks each, pixels governing: 0.5 px along an edge of any direction, ten times less across.  With
``--blunders 0.05`` that share of the marks is wrong by 1 to 3 px in any direction.  Each campaign is calibrated with
the covariances, and with circles of the same mean square.  "Error / sigma" is the rms over campaigns, "held" the share
of 95 % intervals of each axis that hold the truth.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scenes import C_EK_TRUE, marked, photographed

from starplumb.estimators.default import Default
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.physics import so3
from starplumb.physics.covariance import ellipse_of
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors, measure

LONG_PX, RATIO = 0.5, 10.0
SMALL = 0.01
"""Of the scene's errors of tracker, orbit and survey, so that the pixels govern."""


def elongated(o: Observations, rng: np.random.Generator) -> Observations:
    """The table with an ellipse of its own direction for each mark."""
    angle = rng.uniform(0.0, np.pi, o.n)
    c, s = np.cos(angle), np.sin(angle)
    long, short = LONG_PX**2, (LONG_PX / RATIO) ** 2
    column, row = np.sqrt(long * c**2 + short * s**2), np.sqrt(long * s**2 + short * c**2)
    sigma_px, ellipse = ellipse_of(column, row, (long - short) * c * s / (column * row))
    others = ("cov_attitude_E", "cov_position_J", "cov_landmark_J")
    small = {name: SMALL**2 * getattr(o, name) for name in others}
    return replace(o, sigma_px=sigma_px, ellipse=ellipse, **small)


def wrong(o: Observations, rng: np.random.Generator, share: float) -> Observations:
    """Some of the marks moved."""
    out = rng.random(o.n) < share
    size, angle = rng.uniform(1.0, 3.0, o.n), rng.uniform(0.0, 2.0 * np.pi, o.n)
    shift = np.where(out, size, 0.0)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return replace(o, xy_K=o.xy_K + (o.slope_K @ shift[..., None])[..., 0])


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--campaigns", type=int, default=400)
    options.add_argument("--seed", type=int, default=52000)
    options.add_argument("--blunders", type=float, default=0.0)
    asked = options.parse_args()
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for number in range(asked.campaigns):
        rng = np.random.default_rng([asked.seed, number])
        o = elongated(observe(marked(photographed(4), 12, rng)), rng)
        table = wrong(measure(o, C_EK_TRUE, Errors.draw(o, rng)), rng, asked.blunders)
        model = so3.exp(rng.normal(size=3) * 100.0 * ARCSEC) @ C_EK_TRUE
        circles = replace(table, ellipse=None)
        for name, method, given in (
            ("gls, ellipses", Gls(), table),
            ("gls, circles", Gls(), circles),
            ("default, ellipses", Default(), table),
            ("default, circles", Default(), circles),
        ):
            answer = method(given, model)
            if Status(int(answer.status)).usable:
                found.setdefault(name, []).append((so3.log(answer.C_EK @ C_EK_TRUE.mT), answer.sigma_E))
    print("| | answers | rms error, arcsec | error / sigma | held |\n|---|---|---|---|---|")
    for name, answers in found.items():
        error, sigma = (np.array(part) for part in zip(*answers, strict=True))
        score = error / sigma
        cells = [
            ", ".join(f"{x:.2f}" for x in values)
            for values in (
                np.sqrt(np.mean(error**2, axis=0)) / ARCSEC,
                np.sqrt(np.mean(score**2, axis=0)),
                np.mean(np.abs(score) < 1.96, axis=0),
            )
        ]
        print(f"| {name} | {len(answers)} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
