"""Where the time of a calibration goes, and how SciPy does on the same residuals.

``python benchmarks/calibrate.py`` writes a campaign of 100 images x 100 markers to a temporary folder, reads and
calibrates it as the command does, solves the same problem by ``scipy.optimize.least_squares`` in the same run, and
times ``starplumb --help`` against ``python -c "import typer, rich"``.  Best of several rounds in processor seconds (the
start-up in seconds on the clock); set OMP_NUM_THREADS=1.  Markdown on stdout.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from scenes import C_EK_TRUE, marked, photographed
from scipy.optimize import least_squares
from scipy.sparse import coo_array, diags_array, vstack

from starplumb.estimators.gls import Gls
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.judge.calibrate import calibrate
from starplumb.physics import so3
from starplumb.physics.covariance import square_root
from starplumb.physics.orientation import EarthOrientation
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.campaign import Campaign
from starplumb.table.equation import linearise, residual_px
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors


def best(function: Callable[[], Any], rounds: int) -> tuple[float, Any]:
    """Shortest processor time of a call, s, and what it returned."""
    times, answer = [], None
    for _ in range(rounds):
        start = process_time()
        answer = function()
        times.append(process_time() - start)
    return min(times), answer


def under_the_real_earth(campaign: Campaign) -> Campaign:
    """The same Earth-fixed scene with its inertial attitude seen from the axes that a reader will turn back."""
    attitude, earth = campaign.attitude, EarthOrientation.load()
    C_EJ, _ = attitude.at(attitude.t_ns)
    q_EI = so3.to_quaternion(C_EJ @ earth.C_IJ(attitude.t_ns).mT)
    return replace(campaign, attitude=replace(attitude, q_EF=q_EI, orientation=earth), orientation=earth)


def write(folder: Path, images: int, markers: int) -> Path:
    """A delivered campaign with errors as stated and a model mounting half a degree off."""
    rng = np.random.default_rng(1)
    campaign = under_the_real_earth(marked(photographed(images), markers, rng))
    errors = Errors.draw(observe(campaign), rng)
    model = so3.exp(np.array([0.5, -0.4, 0.3]) * DEG) @ C_EK_TRUE
    return write_campaign(folder, scene.measured(campaign, errors, model))


def by_images(o: Observations, C_EK: np.ndarray) -> np.ndarray:
    """SciPy with three unknowns: every image's residuals whitened by the dense covariance of their errors."""
    model = linearise(o, C_EK)
    sightings = [np.flatnonzero(o.image == i) for i in range(o.n_images)]
    roots = []
    for i, j in enumerate(sightings):
        H, R = model.H[j].reshape(-1, 3), model.R[j].reshape(-1, 3)
        V = H @ o.cov_attitude_E[i] @ H.mT + R @ o.cov_position_J[i] @ R.mT
        own = model.R[j] @ o.cov_landmark_J[o.landmark[j]] @ model.R[j].mT + o.sigma_px[
            j, None, None
        ] ** 2 * np.eye(2)
        for k in range(j.size):
            V[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += own[k]
        roots.append(np.linalg.inv(np.linalg.cholesky(V)))

    def whitened(d: np.ndarray) -> np.ndarray:
        z = residual_px(o, so3.exp(d * ARCSEC) @ C_EK)
        return np.concatenate([root @ z[j].reshape(-1) for root, j in zip(roots, sightings, strict=True)])

    return so3.exp(least_squares(whitened, np.zeros(3), method="lm").x * ARCSEC) @ C_EK


def with_all_unknowns(o: Observations, C_EK: np.ndarray) -> np.ndarray:
    """SciPy with every shared error as an unknown of unit prior beside the mounting, sparse Jacobian given."""
    S = [square_root(c) for c in (o.cov_attitude_E, o.cov_position_J, o.cov_landmark_J)]
    m, width = o.n_images, 3 + 6 * o.n_images + 3 * o.n_landmarks
    start = np.stack([0 * o.image, 3 + 6 * o.image, 6 + 6 * o.image, 3 + 6 * m + 3 * o.landmark], axis=-1)
    column = (start[:, :, None] + np.arange(3)).reshape(o.n, 1, 12) + np.zeros((1, 2, 1), dtype=int)
    row = np.arange(2 * o.n).reshape(o.n, 2, 1) + np.zeros((1, 1, 12), dtype=int)

    def at(y: np.ndarray) -> np.ndarray:
        return so3.exp(y[:3] * ARCSEC) @ C_EK

    def design(y: np.ndarray) -> Any:
        model = linearise(o, at(y))
        blocks = [
            ARCSEC * model.H,
            -model.H @ S[0][o.image],
            model.R @ S[1][o.image],
            -model.R @ S[2][o.landmark],
        ]
        values = np.concatenate(blocks, axis=-1) / o.sigma_px[:, None, None]
        return coo_array((values.ravel(), (row.ravel(), column.ravel())), shape=(2 * o.n, width)).tocsr()

    def fun(y: np.ndarray) -> np.ndarray:
        shared = y.copy()
        shared[:3] = 0.0
        z = (residual_px(o, at(y)) / o.sigma_px[:, None]).ravel()
        return np.concatenate([z - design(y) @ shared, y[3:]])

    def jac(y: np.ndarray) -> Any:
        J = design(y) @ diags_array(np.where(np.arange(width) < 3, 1.0, -1.0))
        prior = coo_array(
            (np.ones(width - 3), (np.arange(width - 3), np.arange(3, width))), shape=(width - 3, width)
        )
        return vstack([J, prior]).tocsr()

    found = least_squares(fun, np.zeros(width), jac=jac, method="trf", tr_solver="lsmr", xtol=1e-12)
    return at(found.x)


def start_up(rounds: int) -> tuple[float, float]:
    """Seconds of ``starplumb --help`` and of ``import typer, rich``, taken in turn."""
    command = [
        sys.executable,
        "-c",
        "import sys; sys.argv = ['starplumb', '--help']; import starplumb.cli as c; c.main()",
    ]
    bare = [sys.executable, "-c", "import typer, rich"]
    times: dict[int, list[float]] = {0: [], 1: []}
    for _ in range(rounds):
        for which, arguments in enumerate((command, bare)):
            start = perf_counter()
            subprocess.run(arguments, capture_output=True, check=True)
            times[which].append(perf_counter() - start)
    return min(times[0]), min(times[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=100)
    parser.add_argument("--markers", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder) / "campaign", options.images, options.markers)
        reading, loaded = best(lambda: load_campaign(path), options.rounds)
        campaign = loaded.campaign
        table, o = best(lambda: observe(campaign), options.rounds)
        solving, estimate = best(lambda: Gls()(o, campaign.C_EK), options.rounds)
        whole, _ = best(lambda: calibrate(campaign, Gls()), options.rounds)
    print(f"{options.images} images x {options.markers} markers\n")
    print("| step | CPU s |\n|---|---|")
    print(f"| reading and checking the files | {reading:.3f} |")
    print(f"| table of observations (orbit, attitude, light) | {table:.3f} |")
    print(f"| gls, {int(estimate.iterations)} iterations from half a degree | {solving:.3f} |")
    print(f"| calibrate: table, gls, residuals, reliability, judgement | {whole:.3f} |")
    print("\n| solver on the same residuals | CPU s | off gls, arcsec | in its sigmas |\n|---|---|---|---|")
    print(f"| gls | {solving:.3f} | | |")
    for name, peer in (
        ("SciPy, 3 unknowns, dense by image", by_images),
        ("SciPy, all unknowns, sparse", with_all_unknowns),
    ):
        # from the closed form's neighbourhood: the dense covariance is taken once, where SciPy starts
        seconds, C = best(lambda peer=peer: peer(o, so3.exp(np.full(3, 20 * ARCSEC)) @ estimate.C_EK), 1)
        off = so3.log(C @ estimate.C_EK.mT)
        share = np.max(np.abs(off) / estimate.sigma_E)
        print(f"| {name} | {seconds:.3f} | {np.linalg.norm(off) / ARCSEC:.1g} | {share:.1g} |")
    command, bare = start_up(options.rounds)
    print(f"\nstarplumb --help {command:.3f} s, import typer, rich {bare:.3f} s: {command / bare:.2f} times")


if __name__ == "__main__":
    main()
