"""How fast is a study?  CPU seconds of this process, median of interleaved rounds, beside SciPy one run at a time.

    python benchmarks/montecarlo.py --rounds 5

1. Estimates per second: batches of NumPy against SciPy's align_vectors and least_squares on the same measurements.
2. The whole of a study of the published two-image scenario: draws, simulation, 20 cycles of the observer, statistics.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from starplumb.estimators import METHODS
from starplumb.estimators.published.observer import Observer
from starplumb.io.scenario.read import find_scenario, load_scenario
from starplumb.physics import so3
from starplumb.study.monte_carlo import CHUNK, Study, Tally
from starplumb.table.equation import residual_px

ONE_BY_ONE = 200
"""Runs of SciPy a round."""


def one_by_one(study: Study, solve: Callable[[int], object]) -> Callable[[], int]:
    def work() -> int:
        for i in range(ONE_BY_ONE):
            solve(i)
        return ONE_BY_ONE

    return work


def contenders(study: Study) -> dict[str, Callable[[], int]]:
    """Work by name; each does its work and says how many estimates it made."""
    observations, C_EK = study.measured(study.generator(0), CHUNK)
    e_K, e_E = observations.e_K, observations.e_E
    scenario = study.scenario

    def align_vectors(i: int) -> object:
        return Rotation.align_vectors(e_E[i], e_K[i])

    runs = [observations.run((i,)) for i in range(ONE_BY_ONE)]

    def scipy_least_squares(i: int) -> object:
        def residual(theta: np.ndarray) -> np.ndarray:
            return residual_px(runs[i], so3.exp(theta) @ scenario.C_EK_true).reshape(-1)

        return least_squares(residual, np.zeros(3), method="lm")

    work = {
        "SciPy align_vectors": one_by_one(study, align_vectors),
        "SciPy least_squares": one_by_one(study, scipy_least_squares),
    }
    for name in ("wahba", "image-plane", "cross-product", "least-squares", "gls"):

        def batch(name: str = name) -> int:
            METHODS[name]()(observations, C_EK)
            return CHUNK

        work[f"{name}, batch"] = batch
    return work


def campaign(study: Study) -> Callable[[], int]:
    """One chunk from draws to statistics."""

    def work() -> int:
        for samples in study.samples(0).values():
            Tally.of(samples, study.scenario.ground_m)
        return study.count(0)

    return work


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    scenario = load_scenario(find_scenario("two-images"))
    work = contenders(Study(scenario, {}, 1, CHUNK))
    work["draws, simulation"] = lambda: len(
        Study(scenario, {}, 1, CHUNK).measured(np.random.default_rng(1), CHUNK)[1]
    )
    work["study, observer 20 cycles"] = campaign(Study(scenario, {"observer": Observer()}, 1, CHUNK))
    for run in work.values():
        run()  # cached, warm
    spent: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(rounds):
        for name, run in work.items():
            start = time.process_time()
            count = run()
            spent[name].append((time.process_time() - start) / count)
    print(f"{'':40s} us each   per CPU second")
    for name, each in spent.items():
        middle = statistics.median(each)
        print(f"{name:40s} {1e6 * middle:8.2f}   {1.0 / middle:12.0f}")


if __name__ == "__main__":
    main()
