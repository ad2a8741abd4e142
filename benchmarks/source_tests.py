"""How often the test of each source of error speaks: of an attitude stated half, and of good campaigns.

    python benchmarks/source_tests.py --campaigns 400 --good 1000 --seed 30

Campaigns are those of `benchmarks/variances.py`, adjusted by least squares.  A source is said to be larger than stated
at p = 1e-3 over the number of sources; 1e-4 is beside it, and the chi-square of all residuals at 1e-4.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from variances import Row, drawn, group_of, scene_of

from starplumb.estimators.campaign_table import table_of
from starplumb.estimators.gls import Gls
from starplumb.judge.consistency import chi2_p
from starplumb.judge.scatter.from_data import FromData, from_data, levels_of
from starplumb.judge.scatter.rotations import image_rotations
from starplumb.judge.snooping import fit_at
from starplumb.table.geometry import observe

HALF = [Row(f"attitude stated half, {m} images", m, stated=(0.5, 1.0)) for m in (5, 10, 20)]
GOOD = [
    Row("good, 5 images", 5),
    Row("good, 8 images", 8),
    Row("good, 20 images", 20),
    Row("good, 4 passes x 3 images", 12, groups=(4, 3)),
]


@dataclass(frozen=True)
class Spoken:
    """Smallest probability of a source times their number, and that of chi-square."""

    source: float
    whole: float


def one(row: Row, rng: np.random.Generator) -> Spoken:
    c = scene_of(row)
    measured = drawn(row, c, observe(c), rng)
    table = table_of(measured)
    found = Gls()(table, measured.C_EK)
    fit = fit_at(found.unknowns, table, measured.C_EK, found, np.ones(table.n, dtype=bool))
    images = image_rotations(fit)
    levels = levels_of(images, [("pass", group_of(row))])
    scatter: FromData = from_data(images, found.C_EK, found.sigma_E, levels)
    p = [source.p for source in scatter.sources]
    return Spoken(len(p) * min(p), chi2_p(float(found.chi2), int(found.degrees_of_freedom)))


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--campaigns", type=int, default=400)
    options.add_argument("--good", type=int, default=1000, help="good campaigns, of all kinds together")
    options.add_argument("--seed", type=int, default=30)
    options.add_argument("--only", default="", help="part of the names of campaigns")
    asked = options.parse_args()
    print(
        "| campaigns | number | a source, 1e-3 | a source, 1e-4 | chi-square, 1e-4 |\n|---|---|---|---|---|"
    )
    for number, row in enumerate([*HALF, *GOOD]):
        if asked.only not in row.name:
            continue
        runs = asked.campaigns if row in HALF else asked.good // len(GOOD)
        rng = np.random.default_rng([asked.seed, number])
        found = [one(row, rng) for _ in range(runs)]
        source, whole = np.array([s.source for s in found]), np.array([s.whole for s in found])
        said = (source < 1e-3, source < 1e-4, whole < 1e-4)
        cells = " | ".join(f"{np.sum(x)} ({100.0 * np.mean(x):.1f} %)" for x in said)
        print(f"| {row.name} | {runs} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
