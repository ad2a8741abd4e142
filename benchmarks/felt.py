"""Where users wait: CPU seconds of the flows of a working day, this code beside another source tree in one run.

    python benchmarks/felt.py compare 10 100 --beside ../before/src --rounds 3

``compare M K``: M images of K markers through every method of ``starplumb compare``, method by method.
``commands M K``: the commands ``calibrate`` and ``compare`` on such a campaign, from its files.
``many N``: the campaign of ``starplumb init`` again and again in one process (milliseconds of loading, of calibrating,
and from files to files with and without the report), and seconds of one command of N campaigns beside N commands.
``study SCENARIO [METHOD]``: microseconds of a method, by default least squares, a trial of a scenario.
Each figure is the best of the rounds, which take the trees in turn, every one in a process of its own with one thread.
Markdown on stdout.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

Figures = dict[str, float]


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Processor seconds of a call and what it returned."""
    start = process_time()
    answer = work()
    return process_time() - start, answer


def campaign_of(images: int, markers: int) -> Any:
    """A campaign with errors as stated and a model mounting half a degree off."""
    import numpy as np
    from scenes import C_EK_TRUE, marked, photographed

    from starplumb.physics import so3
    from starplumb.physics.units import DEG
    from starplumb.plan import scene
    from starplumb.table.geometry import observe
    from starplumb.table.simulate import Errors

    rng = np.random.default_rng(1)
    campaign = marked(photographed(images), markers, rng)
    model = so3.exp(np.array([0.5, -0.4, 0.3]) * DEG) @ C_EK_TRUE
    return scene.measured(campaign, Errors.draw(observe(campaign), rng), model)


def compare(images: int, markers: int) -> Figures:
    """Every method on one campaign, as the command runs it, and beside them ``calibrate``."""
    from starplumb.estimators import methods
    from starplumb.estimators.default import Default
    from starplumb.estimators.gls import Gls
    from starplumb.judge.calibrate import calibrate
    from starplumb.judge.compare import answers

    campaign = campaign_of(images, markers)
    calibrate(campaign, Gls())
    figures = {"calibrate": timed(lambda: calibrate(campaign, Default()))[0]}
    found = answers(campaign, methods())
    for name in methods():
        figures[name] = timed(lambda: next(found))[0]
    figures["compare"] = sum(figures[name] for name in methods())
    return figures


def seconds(*arguments: str, cwd: str | None = None) -> float:
    """Processor seconds of a command; one of several campaigns writes a page of all of them where it is run."""
    program = "import sys; from starplumb.cli import main; sys.argv[0] = 'starplumb'; main()"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, check=True, cwd=cwd)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def many(count: int) -> Figures:
    """A small campaign again and again, in one process and by commands."""
    import starplumb as sp

    with tempfile.TemporaryDirectory() as name:
        folders = [Path(name) / str(k) for k in range(count)]
        for folder in folders:
            seconds("init", str(folder))
        files = [str(folder / "campaign.toml") for folder in folders]
        campaign = sp.read_campaign(files[0])

        def whole(report: bool) -> None:
            sp.calibrate(sp.read_campaign(files[0])).save(Path(name) / f"{report}", report=report)

        flows: dict[str, Callable[[], Any]] = {
            "load, ms": lambda: sp.read_campaign(files[0]),
            "calibrate, ms": lambda: sp.calibrate(campaign),
            "files to files without report, ms": lambda: whole(False),
            "files to files, ms": lambda: whole(True),
        }
        figures = {what: min(timed(flow)[0] for _ in range(10)) * 1e3 for what, flow in flows.items()}
        for options in (("--no-report",), ()):
            words = " ".join(options)
            figures[f"one command {words}, s"] = seconds("calibrate", *files, *options, cwd=name)
            figures[f"{count} commands {words}, s"] = sum(seconds("calibrate", f, *options) for f in files)
    return figures


def commands(images: int, markers: int) -> Figures:
    """Processor seconds of whole commands on a campaign in files, Python's start included."""
    from calibrate import write

    with tempfile.TemporaryDirectory() as folder:
        campaign = str(write(Path(folder), images, markers))
        figures = {"check": seconds("check", campaign)}
        figures["calibrate --no-report"] = seconds("calibrate", campaign, "--no-report")
        figures["calibrate"] = seconds("calibrate", campaign)
        figures["compare"] = seconds("compare", campaign)
    return figures


def study(name: str, method: str = "gls", batches: int = 3) -> Figures:
    """Microseconds of a method a trial, as a study of a scenario runs it."""
    from starplumb.estimators import METHODS
    from starplumb.io.scenario.read import find_scenario, load_scenario
    from starplumb.study.monte_carlo import SIGHTINGS_AT_ONCE, Study

    scenario = load_scenario(find_scenario(name))
    batch = min(4096, SIGHTINGS_AT_ONCE // scenario.truth.n)
    batch = batch if method == "gls" else min(batch, 20)  # the others take run after run
    plan = Study(scenario, {method: METHODS[method]()}, 1, batch)
    estimator = getattr(plan, "estimators", plan.methods)[method]
    runs = [plan.measured(plan.generator(c), batch) for c in range(batches + 1)]
    estimator(*runs[0])
    return {"us a trial": min(timed(lambda r=r: estimator(*r))[0] for r in runs[1:]) / batch * 1e6}


STEPS: dict[str, Callable[..., Figures]] = {
    "compare": compare,
    "commands": commands,
    "many": many,
    "study": study,
}


def measured(step: str, numbers: list[str], source: Path) -> Figures:
    """The figures of a step on the code of a source tree, in a process of its own."""
    environment = os.environ | {
        "PYTHONPATH": str(source),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    command = [sys.executable, __file__, step, *numbers, "--figures"]
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return dict(json.loads(done.stdout))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=STEPS)
    parser.add_argument("numbers", nargs="*", help="what the step takes")
    parser.add_argument("--beside", type=Path, help="src folder of the code to compare with")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--figures", action="store_true", help="of this process alone, as JSON")
    options = parser.parse_args()
    if options.figures:
        arguments = [int(n) if n.isdigit() else n for n in options.numbers]
        print(json.dumps(STEPS[options.step](*arguments)))
        return
    trees = {"now": Path(__file__).resolve().parents[1] / "src"}
    trees |= {} if options.beside is None else {"before": options.beside.resolve()}
    rounds = [
        {name: measured(options.step, options.numbers, tree) for name, tree in trees.items()}
        for _ in range(options.rounds)
    ]
    best = {name: {what: min(r[name][what] for r in rounds) for what in rounds[0][name]} for name in trees}
    print(f"{options.step} {' '.join(options.numbers)}, CPU s unless said, best of {options.rounds}\n")
    print(f"| | {' | '.join(trees)} |\n|---|{'---|' * len(trees)}")
    for what in best["now"]:
        print(f"| {what} | {' | '.join(f'{best[name][what]:.4g}' for name in trees)} |")


if __name__ == "__main__":
    main()
