"""The fuzzy observer's Monte Carlo: draws, scene, 20 cycles and statistics of 45 000 runs of 2 images x 2 markers.

``python benchmarks/observer.py`` times it run by run on 3 x 3 matrices and on NumPy rows, in interleaved rounds; CPU
seconds of the whole process, median of the rounds; Markdown on stdout.

``python benchmarks/observer.py --single 1000 10000 50000`` times ONE run over so many sightings instead (20 cycles), as
``compare`` has it: by Python's own numbers, compiled for the first time (with the import of numba), and loaded as an
earlier process has left it; each in a process of its own on a copy of the package, so that the first is the first.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np

from starplumb.estimators.published.observer import Observer
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.published.tables import scenario
from starplumb.published.tkachenko2019 import observer, view
from starplumb.published.tkachenko_rows import draws, errors_E
from starplumb.published.tkachenko_scene import C_EK_MODEL, Scene, draw

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from observer_loop import cycle_run

CHUNK = 8192
"""Runs drawn at a time: the memory does not grow with their number."""

Statistics = tuple[np.ndarray, np.ndarray]


def in_rows(scene: Scene, options: Observer, runs: int) -> Statistics:
    """Mean and standard deviation (3,) arcsec; chunk c draws from a generator keyed by c."""
    total, squares = np.zeros(3), np.zeros(3)
    for chunk, start in enumerate(range(0, runs, CHUNK)):
        rng = np.random.default_rng([1, chunk])
        Z = rng.standard_normal((draws(scene), min(CHUNK, runs - start)))
        last = errors_E(scene, options, Z)[-1] / ARCSEC
        total += last.sum(axis=1)
        squares += np.vecdot(last, last)
    mean = total / runs
    return mean, np.sqrt((squares - runs * mean**2) / (runs - 1))


def simulated(scene: Scene, options: Observer, runs: int) -> Statistics:
    """The same through the simulator and the observer as any user has them."""
    errors = []
    for chunk, start in enumerate(range(0, runs, CHUNK)):
        drawn = draw(scene, np.random.default_rng([3, chunk]), min(CHUNK, runs - start))
        C_EK = options(drawn.observations, C_EK_MODEL).C_EK
        errors.append(so3.log(C_EK @ drawn.C_EK_true.mT) / ARCSEC)
    found = np.concatenate(errors)
    return np.mean(found, axis=0), np.std(found, axis=0, ddof=1)


def run_by_run(scene: Scene, options: Observer, runs: int) -> Statistics:
    """The same one run at a time, the observer on 3 x 3 matrices."""
    errors = []
    for run in range(runs):
        drawn = draw(scene, np.random.default_rng([2, run]), 1)
        o, P = drawn.observations, options.P0 * np.eye(3)
        keys = {name: getattr(options, name) for name in ("alpha", "beta", "w", "floor", "cycles")}
        C_EK = cycle_run(o.e_K[0], o.e_E[0], o.C_EJ[0], C_EK_MODEL, P, **keys)
        errors.append(so3.log(C_EK @ drawn.C_EK_true[0].T) / ARCSEC)
    return np.mean(errors, axis=0), np.std(errors, axis=0, ddof=1)


def ways(
    scene: Scene, options: Observer, runs: int, loop_runs: int
) -> dict[str, tuple[int, Callable[[], Statistics]]]:
    """What is timed: name, runs, and a call."""

    def rows(factorised: bool) -> tuple[int, Callable[[], Statistics]]:
        chosen = replace(options, factorised=factorised)
        return runs, lambda: in_rows(scene, chosen, runs)

    return {
        "run by run, 3 x 3 matrices": (loop_runs, lambda: run_by_run(scene, options, loop_runs)),
        "simulator, then observer, NumPy": (runs, lambda: simulated(scene, options, runs)),
        "NumPy rows, U D U^T": rows(True),
        "NumPy rows, upper triangle": rows(False),
    }


PYTHON, COMPILED = 10**12, 0
"""Work from which compiled code is taken, so that it never is and always is."""


def one_run(sightings: int, limit: int) -> float:
    """CPU seconds of one run of the observer over a campaign of 100 markers an image."""
    from felt import campaign_of

    from starplumb.estimators.campaign_table import table_of
    from starplumb.estimators.published import observer_run

    campaign = campaign_of(sightings // 100, 100)
    table = table_of(campaign)
    observer_run.TO_LOAD = observer_run.TO_COMPILE = limit
    begun = process_time()
    Observer()(table, campaign.C_EK)
    return process_time() - begun


def single(sizes: list[int], rounds: int) -> None:
    """A row for each number of sightings, the least of the rounds."""
    print("| sightings | Python | compiled for the first time | loaded |\n|---|---|---|---|")
    here = Path(__file__).resolve().parents[1] / "src"
    for n in sizes:
        found = []
        for _ in range(rounds):
            with tempfile.TemporaryDirectory() as folder:
                copy = shutil.copytree(
                    here, Path(folder) / "src", ignore=shutil.ignore_patterns("__pycache__")
                )
                environment = os.environ | {"PYTHONPATH": str(copy)}
                environment.pop("PYTHONDONTWRITEBYTECODE", None)
                found.append([in_a_process(n, limit, environment) for limit in (PYTHON, COMPILED, COMPILED)])
        print(f"| {n} | {' | '.join(f'{min(each):.2f}' for each in zip(*found, strict=True))} |", flush=True)


def in_a_process(n: int, limit: int, environment: dict[str, str]) -> float:
    command = [sys.executable, __file__, "--one", str(n), str(limit)]
    return float(subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=45_000)
    parser.add_argument("--loop-runs", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--single", type=int, nargs="+", help="sightings of one run")
    parser.add_argument("--one", type=int, nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(one_run(*given.one))
        return
    if given.single:
        single(given.single, given.rounds)
        return
    paper = scenario("paper2019")
    scene, options = view(paper, "two_images"), observer(paper, 20)
    timed = ways(scene, options, given.runs, given.loop_runs)
    start = process_time()
    for _, call in timed.values():
        call()
    warm = process_time() - start
    seconds: dict[str, list[float]] = {name: [] for name in timed}
    found: dict[str, Statistics] = {}
    for _ in range(given.rounds):
        for name, (_, call) in timed.items():
            start = process_time()
            found[name] = call()
            seconds[name].append(process_time() - start)
    rates = {name: runs / median(seconds[name]) for name, (runs, _) in timed.items()}
    slowest = next(iter(rates.values()))
    print("| | runs | runs per CPU second | times the loop | sigma, arcsec |\n|---|---|---|---|---|")
    for name, (runs, _) in timed.items():
        sigma = ", ".join(f"{s:.2f}" for s in found[name][1])
        print(f"| {name} | {runs} | {rates[name]:,.0f} | {rates[name] / slowest:,.0f} | {sigma} |")
    print(f"\nFirst calls of all, compilation included: {warm:.1f} CPU s.")


if __name__ == "__main__":
    main()
