"""What the tests of an answer cost: all of ``calibrate`` beside the same with some of them switched off.

    python benchmarks/added.py 80 10000 1000000

Campaigns of so many sightings, each of a landmark of its own, 100 to an image (20 in small ones), errors as stated.
CPU seconds of the judged estimate in a process of its own that holds the campaign (set OPENBLAS_NUM_THREADS=1), the
least of ``--rounds`` and of as many calls as take a second; the memory of the campaign, and the most that the process
had from then on (Linux).  Markdown on stdout.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

Off = dict[str, Callable[..., Any]]
NOTHING: Callable[..., Any] = lambda *_args, **_keys: []  # noqa: E731
NONE: Callable[..., Any] = lambda *_args, **_keys: None  # noqa: E731
SOURCES: Off = {"scatter_of": NONE, "findings_of_sources": NOTHING}
MOTION: Off = {"moves": NONE}
MODEL: Off = {"rests_on": lambda *_: (), "_unmodelled": NOTHING}
FILES: Off = {"_evidence": lambda *_: ()}
TESTS: dict[str, tuple[str, Off]] = {
    "everything": ("default", {}),
    "without sources and variances": ("default", SOURCES),
    "without motion": ("default", MOTION),
    "without what it rests on and what is not modelled": ("default", MODEL),
    "without the evidence of the files": ("default", FILES),
    "without rejection (gls)": ("gls", {}),
    "without any of them": ("gls", SOURCES | MOTION | MODEL | FILES),
}
"""What is switched off: the method, and the functions of ``judge.calibrate`` that find nothing instead."""


def peak_mb() -> float:
    """The most memory that the process had since :func:`forget_peak`."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return float(status.partition("VmHWM:")[2].split()[0]) / 1024.0


def forget_peak() -> None:
    """From now on, not since the campaign was drawn."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def held_mb() -> float:
    """The memory that the process has."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2.0**20


def one(size: int, name: str) -> dict[str, float]:
    """Figures of one variant, in this process."""
    from felt import campaign_of

    from starplumb.estimators import METHODS
    from starplumb.judge import calibrate as judge

    method, off = TESTS[name]
    before = held_mb()
    campaign = campaign_of(*((size // 100, 100) if size >= 2000 else (size // 20, 20)))
    loaded = held_mb() - before
    forget_peak()
    for function, instead in off.items():
        if not hasattr(judge, function):
            raise SystemExit(f"judge.calibrate has no {function} any more")
        setattr(judge, function, instead)
    estimator, least, begun = METHODS[method](), float("inf"), process_time()
    while True:
        start = process_time()
        judge.calibrate(campaign, estimator)
        least = min(least, process_time() - start)
        if process_time() - begun > 1.0:
            break
    return {"seconds": least, "loaded": loaded, "peak": peak_mb() - before}


def in_a_process(size: int, name: str) -> dict[str, float]:
    command = [sys.executable, __file__, str(size), "--one", name]
    done = subprocess.run(command, env=os.environ, stdout=subprocess.PIPE, text=True, check=True)
    return dict(json.loads(done.stdout))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sizes", type=int, nargs="+")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--only", nargs="+", choices=TESTS, default=list(TESTS))
    parser.add_argument("--one", choices=TESTS, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        print(json.dumps(one(asked.sizes[0], asked.one)))
        return
    print("| sightings | | CPU s | over none of them | loaded MB | most MB over its start |")
    print("|---|---|---|---|---|---|")
    for size in asked.sizes:
        rounds = [{name: in_a_process(size, name) for name in asked.only} for _ in range(asked.rounds)]
        seconds = {name: min(r[name]["seconds"] for r in rounds) for name in asked.only}
        last = seconds[asked.only[-1]]
        for name in asked.only:
            memory = " | ".join(f"{rounds[0][name][what]:.0f}" for what in ("loaded", "peak"))
            times = f"+{seconds[name] - last:.3f} ({seconds[name] / last:.2f} times)"
            print(f"| {size} | {name} | {seconds[name]:.3f} | {times} | {memory} |", flush=True)


if __name__ == "__main__":
    main()
