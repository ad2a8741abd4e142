"""How often 95 % intervals hold where the stated errors are not the world's: stated, and led by the data.

`python benchmarks/variances.py [CAMPAIGNS] [ROW ...]` (default 200 of each row; a row by the beginning of its name).
Each campaign has 12 markers an image, tracker 5, 5, 12 arcsec, orbit 3 m, survey 1 m and 0.3 px unless the row says
otherwise. Interval: the larger of 1.96 stated sigmas and Student's t on the variances from the data. "Wider": its mean
over 1.96 stated sigmas. "Named": campaigns in which a source is said to be larger than stated, at p = 1e-3 in all;
those of good campaigns are false alarms.
"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.gls import Gls
from starplumb.judge.scatter.from_data import from_data, levels_of
from starplumb.judge.scatter.rotations import image_rotations
from starplumb.judge.scatter.sources import findings_of_sources
from starplumb.judge.snooping import fit_at
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors, measure

Change = Callable[[Observations, Errors, np.random.Generator], Errors]


@dataclass(frozen=True)
class Row:
    """``truly`` draws what the statement lacks; ``stated`` factors of the stated sigmas of attitude and sightings."""

    name: str
    images: int
    truly: Change | None = None
    stated: tuple[float, float] = (1.0, 1.0)
    groups: tuple[int, int] | None = None
    camera: object = FRAME
    attitude: tuple[float, float, float] = (5.0, 5.0, 12.0)
    fine: bool = False


def sessions(groups: tuple[int, int], sigma: tuple[float, float, float]) -> Change:
    number = np.repeat(np.arange(groups[0]), groups[1])

    def change(o: Observations, errors: Errors, rng: np.random.Generator) -> Errors:
        common = rng.normal(size=(groups[0], 3)) * np.array(sigma) * ARCSEC
        return replace(errors, alpha_E=errors.alpha_E + common[number])

    return change


def wander(o: Observations, errors: Errors, rng: np.random.Generator) -> Errors:
    """2 arcsec about each axis within line-scan images, of 1 s."""
    turn = np.zeros((o.n, 3))
    campaign = TRUTHS["wander"]
    t_s = 1e-9 * campaign.images.exposed(o.image, campaign.sightings.row_px)
    for i in range(o.n_images):
        rows = np.flatnonzero(o.image == i)
        R = np.exp(-np.abs(t_s[rows][:, None] - t_s[rows]))
        turn[rows] = (
            2.0 * ARCSEC * np.linalg.cholesky(R + 1e-9 * np.eye(rows.size)) @ rng.normal(size=(rows.size, 3))
        )
    return replace(errors, turn_E=turn)


TRUTHS: dict[str, object] = {}
ROWS = [
    Row("none, 8 images", 8),
    Row("none, 20 images", 20),
    Row("none, 2 passes x 4 images", 8, groups=(2, 4)),
    Row("none, 5 passes x 4 images", 20, groups=(5, 4)),
    Row("none, 10 passes x 4 images", 40, groups=(10, 4)),
    Row("attitude stated half, 4 images", 4, stated=(0.5, 1.0)),
    Row("attitude stated half, 5 images", 5, stated=(0.5, 1.0)),
    Row("attitude stated half, 10 images", 10, stated=(0.5, 1.0)),
    Row("attitude stated half, 20 images", 20, stated=(0.5, 1.0)),
    Row("attitude stated double, 8 images", 8, stated=(2.0, 1.0)),
    Row("sightings stated a third, 8 images", 8, stated=(1.0, 1.0 / 3.0)),
    Row("session 3, 3, 6 arcsec, 2 passes x 4 images", 8, sessions((2, 4), (3.0, 3.0, 6.0)), groups=(2, 4)),
    Row("wander 2 arcsec, 1 s, 8 line-scan images", 8, wander, camera=LINE),
    Row("session 1 arcsec, 20 dates x 3 images, tracker 1, 1, 2", 60, sessions((20, 3), (1.0, 1.0, 1.0)),
        groups=(20, 3), attitude=(1.0, 1.0, 2.0), fine=True),
]  # fmt: skip


def scene_of(row: Row) -> Observations:
    campaign = truth(row.camera, row.images, 12, tilt_deg=15.0, yaw_deg=0.0 if row.camera is LINE else 60.0)
    if row.truly is wander:
        TRUTHS["wander"] = campaign
    o = observe(campaign)
    finer = 0.1 if row.fine else 1.0
    return replace(
        o,
        cov_attitude_E=np.broadcast_to(np.diag((np.array(row.attitude) * ARCSEC) ** 2), (o.n_images, 3, 3)),
        cov_position_J=finer**2 * o.cov_position_J,
        cov_landmark_J=finer**2 * o.cov_landmark_J,
        sigma_px=finer * o.sigma_px,
    )


def one(
    row: Row, o: Observations, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Error, half-widths stated and led by the data, and whether a source is named."""
    errors = Errors.draw(o, rng)
    errors = errors if row.truly is None else row.truly(o, errors, rng)
    attitude, sightings = row.stated
    table = replace(
        measure(o, C_EK_TRUE, errors),
        cov_attitude_E=attitude**2 * o.cov_attitude_E,
        cov_landmark_J=sightings**2 * o.cov_landmark_J,
        sigma_px=sightings * o.sigma_px,
    )
    found = Gls()(table, C_EK_TRUE)
    images = image_rotations(fit_at(found.unknowns, table, C_EK_TRUE, found, np.ones(o.n, dtype=bool)))
    groups = [] if row.groups is None else [("pass", np.repeat(np.arange(row.groups[0]), row.groups[1]))]
    scatter = from_data(images, found.C_EK, found.sigma_E, levels_of(images, groups))
    stated = 1.96 * found.sigma_E
    half = stated if scatter.half_95_E is None else np.maximum(stated, scatter.half_95_E)
    named = any(finding.weakens for finding in findings_of_sources(scatter, row.images))
    return so3.log(found.C_EK @ C_EK_TRUE.mT), stated, half, named


def line(row: Row, runs: int) -> str:
    rng, o = np.random.default_rng(zlib.crc32(row.name.encode())), scene_of(row)
    error, stated, half, named = (
        np.array(x) for x in zip(*(one(row, o, rng) for _ in range(runs)), strict=True)
    )

    def share(width: np.ndarray) -> str:
        return " ".join(f"{x:.2f}"[1:] if x < 0.995 else "1" for x in np.mean(np.abs(error) < width, axis=0))

    wider = " ".join(f"{x:.2f}" for x in np.mean(half / stated, axis=0))
    return f"| {row.name} | {share(stated)} | {share(half)} | {wider} | {100 * np.mean(named):.1f} % |"


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print(f"{runs} campaigns a row; coverage about x, y, z\n")
    print(
        "| truth beyond the statement | stated holds | led by the data holds | wider | named |\n|---|---|---|---|---|"
    )
    for row in ROWS:
        if len(sys.argv) < 3 or any(row.name.startswith(name) for name in sys.argv[2:]):
            print(line(row, runs), flush=True)


if __name__ == "__main__":
    main()
