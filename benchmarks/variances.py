"""How often 95 % intervals hold where the stated errors are not the world's: stated, from the data, and as given.

    python benchmarks/variances.py --campaigns 500 --seed 20

Each campaign has 12 markers an image, tracker 5, 5, 12 arcsec, orbit 3 m, survey 1, 1, 1.5 m and 0.3 px unless the row
says otherwise; it is calibrated by default.  Marks are drawn by formulas of their own: SciPy's rotations, rows searched
for.  "Stated": 1.96 stated sigmas; "from the data": Student's t on the variances that the images show; "given": the
interval of the result.  Widths are means, over 1.96 sigmas of a statement that is true of that row's images as far as
it goes.  "Next": how often the mounting as a further session shows it lies in the interval given for it.  "Named":
campaigns in which a source is said to be larger than stated, at p = 1e-3 in all; those of good campaigns are false
alarms.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.default import Default
from starplumb.judge.calibrate import Calibration, calibrate
from starplumb.judge.scatter.sources import TOO_SMALL_P
from starplumb.physics.light import Corrections
from starplumb.plan.scene import Sigmas
from starplumb.table.campaign import Campaign, SharedErrors
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations

Array = np.ndarray
Rng = np.random.Generator
ARCSEC = np.pi / 648_000.0
PERIOD_S = 5830.0


@dataclass(frozen=True)
class Row:
    """``session`` arcsec is drawn once for each of ``groups`` (number, images each), ``wander`` arcsec within images;
    ``stated`` are factors of the stated sigmas of attitude and of sightings, ``fine`` of those of sightings and orbit
    in truth and statement alike."""

    name: str
    images: int
    stated: tuple[float, float] = (1.0, 1.0)
    groups: tuple[int, int] | None = None
    session: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wander: float = 0.0
    camera: object = FRAME
    attitude: tuple[float, float, float] = (5.0, 5.0, 12.0)
    fine: float = 1.0


SHARP = {"attitude": (1.0, 1.0, 2.0), "fine": 0.1}
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
    Row("pixels and landmarks stated a third, 8 images", 8, stated=(1.0, 1.0 / 3.0)),
    Row("session 3, 3, 6 arcsec, 2 passes x 4 images", 8, groups=(2, 4), session=(3.0, 3.0, 6.0)),
    Row("session 3, 3, 6 arcsec, 4 passes x 4 images", 16, groups=(4, 4), session=(3.0, 3.0, 6.0)),
    Row("wander 2 arcsec, 1 s, 8 line-scan images", 8, wander=2.0, camera=LINE),
    Row("session 1 arcsec, 6 dates x 3 images, tracker 1, 1, 2", 18, groups=(6, 3), session=(1.0,) * 3, **SHARP),
    Row("session 1 arcsec, 20 dates x 3 images, tracker 1, 1, 2", 60, groups=(20, 3), session=(1.0,) * 3, **SHARP),
]  # fmt: skip


def scene_of(row: Row) -> Campaign:
    """Passes eight orbits apart, images of one 30 s apart, stated to have an error each."""
    sigmas = Sigmas(
        ARCSEC * np.array(row.attitude), np.full(3, 3.0), np.array([1.0, 1.0, 1.5]), 0.3 * row.fine
    )
    sigmas = replace(sigmas, position=row.fine * sigmas.position, landmark=row.fine * sigmas.landmark)
    count, each = row.groups or (1, row.images)
    time_s = (8.1 * PERIOD_S * np.arange(count)[:, None] + 30.0 * np.arange(each)).reshape(-1)
    yaw = 0.0 if row.camera is LINE else 60.0
    c = truth(row.camera, row.images, 12, 15.0, yaw, False, Corrections(False, False), sigmas, time_s)
    own = SharedErrors("image")
    return replace(c, attitude_errors=own, position_errors=own)


def group_of(row: Row) -> Array:
    return np.repeat(np.arange(row.groups[0]), row.groups[1]) if row.groups else np.zeros(row.images, int)


def offset(o: Observations, C_EK: Array, alpha: Array, rho: Array, pi: Array) -> Array:
    """How far (n, 2) px a mark moves where attitude, position and place are truly turned by alpha and moved by rho and
    pi (n, 3) from what the table has."""

    def missed(pixel: Array) -> Array:
        late_s = (pixel[:, 1] * o.line_period_s)[:, None]
        turned = Rotation.from_rotvec(alpha) * Rotation.from_rotvec(late_s * o.omega_E)
        e = o.p_J + pi - o.r_J - rho - late_s * o.v_J
        s = turned.apply((o.C_EJ @ e[:, :, None])[:, :, 0]) @ C_EK
        return s[:, :2] / s[:, 2:] - o.xy_K - (o.slope_K @ pixel[:, :, None])[:, :, 0]

    found = np.zeros((o.n, 2))
    for _ in range(4):
        miss = missed(found)
        J = np.stack([missed(found + step) - miss for step in np.eye(2)], axis=-1)
        found = found - np.linalg.solve(J, miss[:, :, None])[:, :, 0]
    return found


def drawn(row: Row, c: Campaign, o: Observations, rng: Rng) -> Campaign:
    """The campaign as measured and stated: measured series stay, so that the true ones are off by the errors."""
    own = rng.normal(size=(row.images, 3)) * ARCSEC * np.array(row.attitude)
    shared = rng.normal(size=(row.images, 3)) * ARCSEC * np.array(row.session)
    alpha = (own + shared[group_of(row)])[o.image]
    if row.wander:
        t_s = 1e-9 * c.images.exposed(o.image, c.sightings.row_px)
        one = o.image[:, None] == o.image
        R = np.where(one, np.exp(-np.abs(t_s[:, None] - t_s)), 0.0) + 1e-9 * np.eye(o.n)
        alpha = alpha + row.wander * ARCSEC * np.linalg.cholesky(R) @ rng.normal(size=(o.n, 3))
    rho = (rng.normal(size=(row.images, 3)) * c.sigma_position)[o.image]
    roots = np.linalg.cholesky(c.landmarks.covariance_J)
    pi = (roots @ rng.normal(size=(len(roots), 3, 1)))[o.landmark, :, 0]
    s = c.sightings
    moved = offset(o, C_EK_TRUE, -alpha, -rho, -pi) + s.sigma_px[:, None] * rng.normal(size=(o.n, 2))
    attitude, sightings = row.stated
    marks = replace(
        s,
        column_px=s.column_px + moved[:, 0],
        row_px=s.row_px + moved[:, 1],
        sigma_px=sightings * s.sigma_px,
    )
    off = Rotation.from_rotvec(0.1 * np.pi / 180.0 * rng.normal(size=3)).as_matrix()
    return replace(
        c,
        C_EK=off @ C_EK_TRUE,
        sightings=marks,
        landmarks=replace(c.landmarks, covariance_J=sightings**2 * c.landmarks.covariance_J),
        cov_attitude_E=attitude**2 * c.cov_attitude_E,
        images=replace(c.images, passes=tuple(map(str, group_of(row)))),
    )


@dataclass(frozen=True)
class Held:
    """Of one campaign: error (3,), half-widths stated, from the data and given (3, 3), the share of further sessions in
    the interval of the next (3,), whether a source is named, and the status."""

    error: Array
    half: Array
    following: Array
    named: bool
    status: str


def one(row: Row, c: Campaign, o: Observations, rng: Rng) -> Held | None:
    found = calibrate(drawn(row, c, o, rng), Default())
    if found.from_data is None or found.interval_95_E is None:
        return None
    error = Rotation.from_matrix(found.C_EK @ C_EK_TRUE.T).as_rotvec()
    half = np.array([1.96 * found.sigma_E, found.from_data.half_95_E, found.interval_95_E])
    p = [s.p for s in found.from_data.sources]
    return Held(error, half, following(row, found, error), min(p) < TOO_SMALL_P / len(p), found.status.name)


def following(row: Row, found: Calibration, error: Array) -> Array:
    """Share (3,) of further sessions, drawn as those of the row, that the interval of the next one holds."""
    if found.next_session_95_E is None:
        return np.full(3, np.nan)
    sigma = np.maximum(ARCSEC * np.array(row.session), 1e-12)
    half = found.next_session_95_E
    return ndtr((half - error) / sigma) - ndtr((-half - error) / sigma)


def line(row: Row, runs: int, seed: int) -> str:
    c = scene_of(row)
    o = observe(c)
    rng = np.random.default_rng([seed, zlib.crc32(row.name.encode())])
    every = [one(row, c, o, rng) for _ in range(runs)]
    held = [x for x in every if x is not None]
    error, half = np.abs([x.error for x in held]), np.array([x.half for x in held])
    first = half[:, :1]

    def shares(values: Array) -> str:
        return " ".join(f"{x:.3f}"[1:] if x < 0.9995 else "1" for x in values)

    cells = [shares(np.mean(error < half[:, 0], axis=0))]
    for k in (1, 2):
        wide = " ".join(f"{x:.2f}" for x in np.mean(half[:, k] / first[:, 0], axis=0))
        cells.append(f"{shares(np.mean(error < half[:, k], axis=0))} ({wide})")
    following = np.array([x.following for x in held])
    cells.append("" if np.isnan(following[0, 0]) else shares(np.nanmean(following, axis=0)))
    statuses = [x.status for x in held]
    ok = 100.0 * statuses.count("OK") / len(every)
    cells += [f"{100.0 * np.mean([x.named for x in held]):.1f} %", f"{ok:.0f} %"]
    return f"| {row.name} | {' | '.join(cells)} |"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--campaigns", type=int, default=500)
    options.add_argument("--seed", type=int, default=20)
    options.add_argument("--only", default="", help="part of the rows' names")
    asked = options.parse_args()
    print(
        "| truth beyond the statement | stated holds | from the data (width) | given (width) | next | named | ok |"
        "\n|---|---|---|---|---|---|---|"
    )
    for row in ROWS:
        if asked.only in row.name:
            print(line(row, asked.campaigns, asked.seed), flush=True)


if __name__ == "__main__":
    main()
