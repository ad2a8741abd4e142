"""Size: one adjustment of the alignment, 8 numbers of interior orientation and 6 errors per image, to convergence.

    python benchmarks/adjustment_size.py 10000 100000 1000000 --scipy 100000

CPU seconds of this process (set OPENBLAS_NUM_THREADS=1), images of 100 markers, and the memory that the estimate takes
above the table itself.  With ``--scipy`` the same problem, up to that size, is given to SciPy's sparse least squares in
the same run: Jacobian as a sparse matrix, tight LSMR.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from dataclasses import replace

import numpy as np
from scenes import C_EK_TRUE, CAMERA, marked, photographed

from starplumb import so3
from starplumb.adjustment import square_root, whiten
from starplumb.estimators.protocol import AlignmentEstimate
from starplumb.estimators.selfcal import SelfCalibration, State
from starplumb.geometry import observe
from starplumb.observations import Observations
from starplumb.parameters import OPTICS, Optics
from starplumb.simulate import Errors, measure
from starplumb.units import ARCSEC

CALIBRATION = SelfCalibration((Optics(CAMERA, OPTICS, (np.inf,) * len(OPTICS)),))
MARKERS = 100
IMAGES = 40
"""Images of the scene that is repeated, each time with errors of its own."""


def table(n: int, rng: np.random.Generator) -> Observations:
    """n sightings of landmarks of their own: a scene of 40 images again and again, with fresh errors."""
    true = observe(marked(photographed(IMAGES), MARKERS, rng))
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


def ours(o: Observations, model: np.ndarray) -> tuple[AlignmentEstimate, float, float]:
    """The estimate, its CPU seconds, and in another run the largest memory it took, MB."""
    start = time.process_time()
    estimate = CALIBRATION(o, model)
    seconds = time.process_time() - start
    tracemalloc.start()
    CALIBRATION(o, model)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return estimate, seconds, peak / 2.0**20


def by_scipy(o: Observations, model: np.ndarray) -> tuple[np.ndarray, float]:
    """Alignment by scipy.optimize.least_squares over all unknowns, the errors of images among them, and CPU seconds."""
    from scipy.optimize import least_squares
    from scipy.sparse import csr_matrix, hstack, identity, vstack

    start = time.process_time()
    k, m = 3 + len(OPTICS), o.n_images
    S = np.concatenate([square_root(o.cov_attitude_E), square_root(o.cov_position_J)], axis=-1)
    begin = CALIBRATION._closed(o, model).C_EK
    unit = np.array([ARCSEC] * 3 + [CALIBRATION.range[i] * 1e-4 for i in range(k - 3)])
    rows = np.repeat(np.arange(2 * o.n), 6)
    columns = (6 * np.repeat(o.image, 2)[:, None] + np.arange(6)).reshape(-1)

    def parts(y):
        common, own = y[:k] * unit, y[k:].reshape(m, 6)
        state = State(so3.exp(common[:3]) @ begin, common[3:])
        moved = o.with_geometry(
            C_EJ=so3.exp(-(S[:, :, :3] @ own[:, :3, None])[..., 0])[o.image] @ o.C_EJ,
            r_J=o.r_J - (S[:, :, 3:] @ own[:, 3:, None])[o.image, :, 0],
        )
        problem = CALIBRATION.problem(moved, state, model)
        return whiten(problem.observations, problem.model, problem.A)

    def residual(y):
        return np.concatenate([parts(y).P[..., -1].reshape(-1), y[k:]])

    def jacobian(y):
        P = parts(y).P
        common = csr_matrix(P[..., 6:-1].reshape(-1, k) * unit)
        own = csr_matrix((P[..., :6].reshape(-1), (rows, columns)), shape=(2 * o.n, 6 * m))
        prior = hstack([csr_matrix((6 * m, k)), identity(6 * m)])
        return vstack([hstack([common, own]), prior]).tocsr()

    found = least_squares(
        residual,
        np.zeros(k + 6 * m),
        jacobian,
        method="trf",
        tr_solver="lsmr",
        tr_options={"atol": 1e-12, "btol": 1e-12, "maxiter": 3000},
        xtol=1e-10,
        ftol=1e-12,
        gtol=1e-10,
    )
    return so3.exp(found.x[:3] * unit[:3]) @ begin, time.process_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sizes", type=int, nargs="*", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--scipy", type=int, default=0, help="largest size given to SciPy as well")
    arguments = parser.parse_args()
    print(
        "| sightings | CPU s | passes | memory above the table MB | error / sigma | SciPy CPU s | apart sigma |"
    )
    print("|---|---|---|---|---|---|---|")
    model = so3.exp(np.array([0.01, -0.005, 0.008])) @ C_EK_TRUE
    for n in arguments.sizes:
        o = table(n, np.random.default_rng(1))
        estimate, seconds, above = ours(o, model)
        error = so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E
        row = f"| {o.n} | {seconds:.2f} | {int(estimate.iterations)} | {above:.0f} | {np.abs(error).max():.2f} |"
        if n <= arguments.scipy:
            C, theirs = by_scipy(o, model)
            apart = np.abs(so3.log(C @ estimate.C_EK.mT) / estimate.sigma_E).max()
            row += f" {theirs:.1f} | {apart:.1e} |"
        print(row, flush=True)


if __name__ == "__main__":
    main()
