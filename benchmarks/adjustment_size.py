"""Size: one adjustment of the alignment, 8 numbers of interior orientation and 6 errors per image, to convergence.

    python benchmarks/adjustment_size.py 10000 100000 1000000 --scipy 100000 --ceres PROGRAM

CPU seconds of one process (set OPENBLAS_NUM_THREADS=1), the best of ``--rounds``; images of 100 markers; the memory
taken above the table itself.  Where the lens is mostly noise the whole estimate also takes its covariance to
second order; no peer does, and the solution alone is what they are held against.  "All 11" is the distance of all
common unknowns together, by their covariance.
With ``--scipy`` the same problem, up to that size, is given to SciPy's sparse least
squares in the same run; with ``--ceres`` to the program built from ``ceres/adjustment.cpp`` (its heading says how), up
to ``--ceres-most``.  Their seconds leave out what it takes to hand them the problem.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from adjustment_peers import Found, Problem, by_ceres, by_scipy
from scenes import C_EK_TRUE, CAMERA, marked, photographed

from starplumb.estimators.gls import Gls
from starplumb.physics import so3
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.parameters import OPTICS, Optics
from starplumb.table.simulate import Errors, measure

OPTICAL = Optics(CAMERA, OPTICS, (np.inf,) * len(OPTICS))
CALIBRATION = Gls((OPTICAL,))
MARKERS = 100
SOLUTION = "starplumb, the solution alone"
IMAGES = 40
"""Images of the scene that is repeated, each time with errors of its own."""


def table(n: int, rng: np.random.Generator, sigma_px: float | None = None) -> Observations:
    """n sightings of landmarks of their own: a scene of 40 images again and again, with fresh errors."""
    true = observe(marked(photographed(min(IMAGES, n // MARKERS)), MARKERS, rng))
    if sigma_px is not None:
        true = replace(true, sigma_px=np.full(true.n, sigma_px))
    repeats = max(1, n // true.n)
    parts = [measure(true, C_EK_TRUE, Errors.draw(true, rng)) for _ in range(repeats)]
    per_sighting = ("xy_K", "slope_K", "line_period_s", "C_EJ", "omega_E", "r_J", "v_J", "p_J", "e_E")
    per_sighting += ("row_rate_E", "range_m", "sigma_px", "weight")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in per_sighting}
    m, L = true.n_images, true.n_landmarks
    shift = np.repeat(np.arange(repeats), true.n)
    return replace(
        true,
        **joined,
        image=np.tile(true.image, repeats) + m * shift,
        landmark=np.tile(true.landmark, repeats) + L * shift,
        cov_attitude_E=np.tile(np.broadcast_to(true.cov_attitude_E, (m, 3, 3)), (repeats, 1, 1)),
        cov_position_J=np.tile(np.broadcast_to(true.cov_position_J, (m, 3, 3)), (repeats, 1, 1)),
        cov_landmark_J=np.tile(true.cov_landmark_J, (repeats, 1, 1)),
        epoch_s=None,
    )


def memory_mb(o: Observations, model: np.ndarray, calibration: Gls) -> float:
    """The largest memory an estimate takes above the table."""
    tracemalloc.start()
    calibration(o, model)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak / 2.0**20


def ours(o: Observations, model: np.ndarray, calibration: Gls, whole: bool = True) -> Found:
    """With ``whole`` all of the estimate, else the solution alone, which is what a peer gives."""
    start = time.process_time()
    estimate = calibration(o, model) if whole else calibration.estimate(o, model, calibration.start(o, model))
    seconds = time.process_time() - start
    return Found(estimate.C_EK, int(estimate.iterations), seconds, optics=estimate.parameters.values)


def peers(arguments: argparse.Namespace, n: int) -> dict[str, Callable[[Problem], Found]]:
    """The general solvers asked for at this size."""
    chosen: dict[str, Callable[[Problem], Found]] = {}
    if arguments.ceres and n <= arguments.ceres_most:
        for per in ("sighting", "image"):
            chosen[f"Ceres, a cost per {per}"] = partial(by_ceres, program=arguments.ceres, per=per)
            if arguments.ceres_own_radius:
                own = partial(by_ceres, program=arguments.ceres, per=per, radius=1e4)
                chosen[f"Ceres, a cost per {per}, its own trust region"] = own
    if n <= arguments.scipy:
        chosen["SciPy, scaled block by block"] = partial(by_scipy, blocks=True)
    if n <= arguments.scipy_columns:
        chosen["SciPy, scaled column by column"] = partial(by_scipy, blocks=False)
    return chosen


def compare(n: int, arguments: argparse.Namespace) -> None:
    """Rows of one size."""
    model = so3.exp(np.array([0.01, -0.005, 0.008])) @ C_EK_TRUE
    o = table(n, np.random.default_rng(1))
    others = peers(arguments, n)
    problem = Problem.of(o, model, OPTICAL) if others else None
    first, memory = CALIBRATION(o, model), memory_mb(o, model, CALIBRATION)
    runs: dict[str, list[Found]] = {name: [] for name in ("starplumb", SOLUTION, *others)}
    for _ in range(arguments.rounds):  # interleaved: who else uses the machine disturbs all alike
        runs["starplumb"].append(replace(ours(o, model, CALIBRATION), memory_mb=memory))
        runs[SOLUTION].append(ours(o, model, CALIBRATION, whole=False))
        for name, solve in others.items():
            runs[name].append(solve(problem))
    unit = min(run.seconds for run in runs[SOLUTION])
    for name, found in runs.items():
        best = min(found, key=lambda run: run.seconds)
        apart, off = (
            np.abs(so3.log(best.C_EK @ C.mT) / first.sigma_E).max() for C in (first.C_EK, C_EK_TRUE)
        )
        d = np.concatenate([so3.log(best.C_EK @ first.C_EK.mT), best.optics - first.parameters.values])
        joint = np.sqrt(d @ np.linalg.solve(first.parameters.covariance, d))
        print(
            f"| {o.n} | {name} | {best.seconds:.2f} | {best.seconds / unit:.1f} | {best.passes} "
            f"| {best.memory_mb:.0f} | {apart:.4f} | {joint:.4f} | {off:.2f} |".replace("nan", ""),
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sizes", type=int, nargs="*", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--rounds", type=int, default=1, help="of which the best counts")
    parser.add_argument("--scipy", type=int, default=0, help="largest size given to SciPy")
    parser.add_argument(
        "--scipy-columns",
        type=int,
        default=0,
        help="the same for SciPy with the usual scaling, which is ten times slower",
    )
    parser.add_argument("--ceres", type=Path, help="the program made of ceres/adjustment.cpp")
    parser.add_argument("--ceres-most", type=int, default=1_000_000, help="largest size given to it")
    parser.add_argument(
        "--ceres-own-radius",
        action="store_true",
        help="also with the trust region that Ceres begins with itself",
    )
    arguments = parser.parse_args()
    print(
        "| sightings | solver | CPU s | times ours | passes | memory MB | apart / sigma | all 11 | error / sigma |"
    )
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    for n in arguments.sizes:
        compare(n, arguments)


if __name__ == "__main__":
    main()
