"""Two cameras that image together: their relative mounting from one adjustment, beside two calibrations apart.

    OPENBLAS_NUM_THREADS=1 python benchmarks/cameras.py --runs 300 --seed 71000

Twelve images by both cameras at the same times, 12 markers each, whose errors of tracker and orbit both share; the
second looks along the first (bands) or 22 deg ahead of it (stereo).  Each run is a campaign, measured with errors, with
model mountings off by up to a minute of arc, estimated as ``starplumb calibrate`` does.  "Bound" is that of one dense
covariance of all residuals.  Sigmas are medians, errors and intervals those of the second camera against the first,
about x, y, z of E; "jointly" counts chi-square of the joint covariance of both mountings below its 95 % quantile.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scenes import C_EK_TRUE, marked, photographed
from scipy.linalg import block_diag
from scipy.special import chdtri

from starplumb.estimators.cameras.jointly import Jointly
from starplumb.estimators.campaign_table import table_of
from starplumb.estimators.default import Default
from starplumb.estimators.gls import Gls
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan.scene import measured
from starplumb.table.cameras.rig import Rig
from starplumb.table.cameras.views import of_camera
from starplumb.table.campaign import Campaign, Landmarks, Sightings
from starplumb.table.equation import linearise
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors

Array = np.ndarray

IMAGES, MARKERS = 12, 12
TURNS = {"bands": np.array([0.02, 0.3, 0.05]), "stereo, 22 deg": np.array([22.0, 0.0, 0.0])}
"""C_KC of the second camera, a rotation vector, deg."""
TRACKERS = ((5.0, 5.0, 12.0), (1.0, 1.0, 2.0))
OFF = 60.0 * ARCSEC
"""Largest error of a model mounting about each axis."""
NAMES = ("A", "B")


def two_cameras(C_KC: Array, tracker_arcsec: Sequence[float], rng: np.random.Generator) -> Campaign:
    """A true campaign of two cameras, landmarks of their own."""
    flown = replace(photographed(IMAGES), cov_attitude_E=np.diag((np.array(tracker_arcsec) * ARCSEC) ** 2))
    parts = [marked(replace(flown, C_EK=C_EK_TRUE @ C), MARKERS, rng) for C in (np.eye(3), C_KC)]
    landmarks = Landmarks(
        tuple(f"{name}{i}" for name, part in zip(NAMES, parts, strict=True) for i in part.landmarks.ids),
        np.concatenate([part.landmarks.r_J for part in parts]),
        np.concatenate([part.landmarks.covariance_J for part in parts]),
    )
    count = len(parts[0].landmarks.ids)
    seen = [
        replace(p.sightings, image=p.sightings.image + k * IMAGES, landmark=p.sightings.landmark + k * count)
        for k, p in enumerate(parts)
    ]
    of_image = np.repeat([0, 1], IMAGES)
    images = replace(
        flown.images,
        ids=tuple(f"{name}{i}" for name in NAMES for i in flown.images.ids),
        t_ns=np.tile(flown.images.t_ns, 2),
        camera=tuple(NAMES[k] for k in of_image),
    )
    rig = Rig(NAMES, (flown.camera,) * 2, np.stack([np.eye(3), C_KC]), of_image)
    return replace(flown, landmarks=landmarks, images=images, sightings=Sightings.joined(seen), rig=rig)


def delivered(true: Campaign, errors: Errors, rng: np.random.Generator) -> Campaign:
    """What is delivered of it: measured with errors, the model mountings off."""
    off = rng.uniform(-OFF, OFF, (2, 3))
    given = measured(true, errors, so3.exp(off[0]) @ C_EK_TRUE)
    assert true.rig is not None
    C_KC = np.stack([np.eye(3), true.rig.C_KC[1] @ so3.exp(off[1])])
    return replace(given, rig=replace(true.rig, C_KC=C_KC))


def bound(o: Observations) -> Array:
    """Covariance (6, 6) rad^2 about E of the errors of both mountings by one dense covariance of all residuals."""
    model = linearise(o, C_EK_TRUE)
    G = [np.zeros((2 * o.n, 3 * count)) for count in (o.n_images, o.n_images, o.n_landmarks)]
    A = np.zeros((2 * o.n, 6))
    for i in range(o.n):
        rows, image, k = slice(2 * i, 2 * i + 2), int(o.image[i]), int(o.camera[i])
        A[rows, 3 * k : 3 * k + 3] = model.H[i]
        for block, at, M in zip(
            G, (image, image, o.landmark[i]), (model.H[i], model.R[i], model.R[i]), strict=True
        ):
            block[rows, 3 * at : 3 * at + 3] = M
    stated = o.cov_attitude_E, o.cov_position_J, o.cov_landmark_J
    V = block_diag(*o.noise_px) + sum(g @ block_diag(*P) @ g.T for g, P in zip(G, stated, strict=True))
    return np.linalg.inv(A.T @ np.linalg.solve(V, A))


def apart(true: Campaign) -> Array:
    """Sigmas (3,) rad of the difference of two calibrations, each of one camera."""
    sigma = []
    for k in range(2):
        one = of_camera(true, k)
        sigma.append(Gls()(observe(one), one.C_EK).sigma_E)
    return np.hypot(*sigma)


def errors_and_covariance(given: Campaign, true: Campaign) -> tuple[Array, Array, bool]:
    """Errors (6,) rad of both mountings about E, their stated covariance (6, 6), and whether the answer is ok."""
    found = Jointly(NAMES, Default, Gls())(table_of(given), given.C_EK)
    assert given.rig is not None
    assert true.rig is not None
    assert found.parameters is not None
    value = found.parameters.values
    C_EC = found.C_EK @ given.rig.C_KC
    C_EC[1] = C_EC[1] @ so3.exp(value)
    T = np.zeros((6, 6))
    T[:3, :3] = T[3:, :3] = np.eye(3)
    T[3:, 3:] = C_EC[1] @ so3.left_jacobian(-value)
    error = so3.log(C_EC @ (true.C_EK @ true.rig.C_KC).mT).reshape(6)
    return error, T @ found.parameters.covariance @ T.T, int(found.status) == 0


def cells(*rows: Sequence[float]) -> str:
    return " | ".join(", ".join(f"{x:.3g}" for x in row) for row in rows)


def row_of(true: Campaign, runs: int, rng: np.random.Generator) -> str:
    o = observe(true)
    difference = np.hstack([-np.eye(3), np.eye(3)])
    least = np.sqrt(np.diagonal(difference @ bound(o) @ difference.T))
    alone = apart(true)
    errors, sigmas, joint, ok = [], [], [], 0
    for _ in range(runs):
        e, P, good = errors_and_covariance(delivered(true, Errors.draw(o, rng, ()), rng), true)
        ok += good
        errors.append(difference @ e)
        sigmas.append(np.sqrt(np.diagonal(difference @ P @ difference.T)))
        joint.append(e @ np.linalg.solve(P, e) < chdtri(6, 0.05))
    error, sigma = np.array(errors), np.array(sigmas)
    score, own = error / sigma, np.median(sigma, axis=0)
    return cells(
        alone / ARCSEC,
        own / ARCSEC,
        least / ARCSEC,
        alone / own,
        np.sqrt(np.mean(score**2, axis=0)),
        100.0 * np.mean(np.abs(score) < 1.96, axis=0),
        [100.0 * float(np.mean(joint))],
        [100.0 * ok / runs],
    )


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--runs", type=int, default=300)
    options.add_argument("--seed", type=int, default=71000)
    options.add_argument("--row", type=int, help="one row of the table only, 0 to 3")
    asked = options.parse_args()
    print(
        "| second camera, tracker, arcsec | apart, arcsec | together, arcsec | bound, arcsec | apart / together | "
        "error / sigma | 95 % intervals that hold, % | jointly, % | ok, % |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    rows = [(words, turn, tracker) for words, turn in TURNS.items() for tracker in TRACKERS]
    for words, turn, tracker in rows if asked.row is None else rows[asked.row : asked.row + 1]:
        rng = np.random.default_rng([asked.seed, len(words), int(tracker[0])])
        true = two_cameras(so3.exp(turn * DEG), tracker, rng)
        stated = ", ".join(f"{x:g}" for x in tracker)
        print(f"| {words}; {stated} | {row_of(true, asked.runs, rng)} |", flush=True)


if __name__ == "__main__":
    main()
