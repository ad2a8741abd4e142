"""How much better gls is than every other method, and how fast the one-step methods are.

``python benchmarks/methods.py`` prints the two tables of docs/methods.md (Markdown, about a minute on one core).
The true scenes are those of the tests; the model mounting is off by 10 arcmin (one sigma) about each axis.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time

import numpy as np

from starplumb.estimators import METHODS
from starplumb.estimators.protocol import Estimator
from starplumb.estimators.published.cross_product import CrossProduct
from starplumb.estimators.published.ground_plane import GroundPlane
from starplumb.estimators.published.image_plane import ImagePlane
from starplumb.estimators.published.least_squares import LeastSquares
from starplumb.physics import so3
from starplumb.physics.units import ARCMIN, ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors, measure

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from problems import C_EK_TRUE, FRAME, LINE, truth

SCENES = {
    "2 images x 2 markers": lambda: truth(FRAME, images=2, markers=2),
    "1 x 6": lambda: truth(FRAME, images=1, markers=6),
    "4 x 6": lambda: truth(FRAME, images=4, markers=6),
    "4 x 6, turned": lambda: truth(FRAME, images=4, markers=6, tilt_deg=20.0, yaw_deg=80.0),
    "6 x 4, one site": lambda: truth(FRAME, images=6, markers=4, shared_site=True),
    "line, 3 x 6": lambda: truth(LINE, images=3, markers=6),
}
MANY_BY_ONE = ("robust",)
"""Methods that take the runs of a batch one by one: left out here, on clean data they are gls."""
ONE_STEP: tuple[Callable[..., Estimator], ...] = (ImagePlane, GroundPlane, CrossProduct, LeastSquares)


def rmse(estimator: Estimator, table: Observations, C_EK: np.ndarray) -> np.ndarray | None:
    """Root mean square error about E's axes, arcsec; None where the method has no answer."""
    estimate = estimator(table, C_EK)
    usable = estimate.status <= 1
    if not np.all(usable):
        return None
    error = so3.log(estimate.C_EK @ C_EK_TRUE.mT) / ARCSEC
    return np.sqrt(np.mean(error**2, axis=0))


def accuracy(runs: int, seed: int) -> None:
    """Markdown table: RMSE of gls, and that of the others in multiples of it."""
    columns: list[dict[str, np.ndarray | None]] = []
    for scene in SCENES.values():
        rng = np.random.default_rng(seed)
        o = observe(scene())
        table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (runs,)))
        C_EK = so3.exp(10 * ARCMIN * rng.standard_normal((runs, 3))) @ C_EK_TRUE
        methods = {n: m for n, m in METHODS.items() if n not in MANY_BY_ONE}
        columns.append({name: rmse(method(), table, C_EK) for name, method in methods.items()})
    print("| method | " + " | ".join(SCENES) + " |")
    print("|---" * (1 + len(SCENES)) + "|")
    for name in columns[0]:
        cells = []
        for column in columns:
            best, own = column["gls"], column[name]
            if own is None or best is None:
                cells.append("not applicable")
            elif name == "gls":
                cells.append(" / ".join(f'{v:.2f}"' for v in best))
            else:
                cells.append(" / ".join(f"{v:.3g}" if v >= 9.995 else f"{v:.2f}" for v in own / best))
        print(f"| {name} | " + " | ".join(cells) + " |")


def speed(runs: int) -> None:
    """Markdown table: estimates per CPU second in one batch, 2 images x 2 markers, one step."""
    o = observe(SCENES["2 images x 2 markers"]())
    table = measure(o, C_EK_TRUE, Errors.draw(o, np.random.default_rng(0), (runs,)))
    print("\n| one step, 2 x 2 | no covariance | stated covariance |\n|---|---|---|")
    for kind in ONE_STEP:
        cells = []
        for covariance in ("none", "stated"):
            estimator = kind(iterations=1, covariance=covariance)
            best = np.inf
            for _ in range(7):
                start = process_time()
                estimator(table, C_EK_TRUE)
                best = min(best, process_time() - start)
            cells.append(f"{runs / best / 1e3:.0f} k/s")
        print(f"| {kind.__name__} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    accuracy(arguments.runs, arguments.seed)
    speed(4096)
