"""What an error of the start does to every method that has to start somewhere.

    python benchmarks/starts.py --campaigns 40

Campaigns of 6 images x 6 markers, a model mounting off by so much about a random axis.  Each cell: answers that may be
used, and of them those that lie farther than a sigma of gls from the method's answer started at the truth.
"""

from __future__ import annotations

import argparse

import numpy as np
from scenes import C_EK_TRUE, marked, photographed

from starplumb.estimators import BEARS, methods
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.physics import so3
from starplumb.physics.units import DEG
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

ANGLES = (0.01, 0.1, 1.0, 20.0, 90.0, 179.0)


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--campaigns", type=int, default=40)
    asked = options.parse_args()
    print(f"| method | start | {' | '.join(f'{angle:g} deg' for angle in ANGLES)} |")
    print("|---" * (2 + len(ANGLES)) + "|")
    for name in BEARS:
        for start in ("closed-form", "model"):
            cells = [cell(name, start, angle, asked.campaigns) for angle in ANGLES]
            print(f"| `{name}` | {start} | {' | '.join(cells)} |", flush=True)


def cell(name: str, start: str, angle_deg: float, campaigns: int) -> str:
    """Answers that may be used, and how many of them are moved by the start."""
    rng = np.random.default_rng([2019, int(100 * angle_deg)])
    scene = observe(marked(photographed(6), 6, rng))
    usable = moved = 0
    for _ in range(campaigns):
        table = measure(scene, C_EK_TRUE, Errors.draw(scene, rng))
        axis = rng.standard_normal(3)
        far = so3.exp(angle_deg * DEG * axis / np.linalg.norm(axis)) @ C_EK_TRUE
        method = methods(start)[name]()
        found, near = method(table, far), method(table, C_EK_TRUE)
        if Status(int(found.status)).usable:
            apart = np.abs(so3.log(found.C_EK @ near.C_EK.mT) / Gls()(table, C_EK_TRUE).sigma_E)
            usable, moved = usable + 1, moved + bool(np.max(apart) > 1.0)
    return f"{usable}, {moved}"


if __name__ == "__main__":
    main()
