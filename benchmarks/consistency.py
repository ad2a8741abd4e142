"""Is the covariance of gls right?  Every shipped scenario whose stated model is true, all errors and each source alone.

    python benchmarks/consistency.py --trials 45000 --workers 2

For each case: rms of error / stated sigma and RMSE / Cramer-Rao bound about x, y, z, and NEES with its 95 % band.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from starplumb.estimators.gls import Gls
from starplumb.io.scenario.read import load_scenario, shipped_scenarios
from starplumb.plan.bound import bound_E
from starplumb.plan.scenario import Scenario
from starplumb.study.monte_carlo import Study, Tally
from starplumb.study.run import choose, run
from starplumb.study.statistics import chi2_band
from starplumb.study.store import Store
from starplumb.study.summary import tally


def case(label: str, scenario: Scenario, trials: int, workers: int) -> bool:
    """Run one case, print its row and say whether it holds."""
    study = Study(scenario, {"gls": Gls()}, 1, trials)
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        store = Store.open(Path(folder), study)
        run(store, choose(workers, None, study.chunks))
        found: Tally = tally(store)["gls"][0]
    bound = bound_E(scenario)
    assert bound is not None
    ratio, efficiency = found.ratio.rms, found.theta.rms / np.sqrt(np.diagonal(bound))
    nees, (low, high) = float(found.nees.mean[0]), chi2_band(3.0 * trials)
    error = float(found.nees.mean_error[0])
    # with many cases one in twenty lies outside a 95 % band, so a case fails only beyond the 99.9 % one
    band = chi2_band(3.0 * trials, 0.999)
    holds = bool(
        np.all(efficiency <= 1.02) and np.all(np.abs(ratio - 1.0) <= 0.02) and band[0] <= nees <= band[1]
    )
    row = "  ".join(" ".join(f"{value:.3f}" for value in values) for values in (ratio, efficiency))
    inside = "in " if low <= nees <= high else "out"
    print(
        f"{label:45s} {row}  {nees:.4f} +- {error:.4f} {inside} [{low:.4f}, {high:.4f}]  "
        f"{time.perf_counter() - start:6.1f} s  {'holds' if holds else 'FAILS'}",
        flush=True,
    )
    return holds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=45000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="", help="scenarios whose name holds this")
    parser.add_argument(
        "--alone", action="store_true", help="each source alone, without all of them together"
    )
    options = parser.parse_args()
    print(f"{'case':45s} error/stated x y z    RMSE/bound x y z     NEES")
    holds = True
    for name, path in shipped_scenarios().items():
        scenario = load_scenario(path)
        if options.only not in name or not scenario.model_is_true:
            continue
        if not options.alone:
            holds &= case(f"{name}: all", scenario, options.trials, options.workers)
        for source in scenario.sources:
            holds &= case(
                f"{name}: {source.name}", scenario.alone(source.name), options.trials, options.workers
            )
    print("every case holds" if holds else "SOME CASE FAILS")


if __name__ == "__main__":
    main()
