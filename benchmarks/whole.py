"""The whole command on a large campaign: ``starplumb calibrate`` from files to results.

    python benchmarks/whole.py 1000000

A simulated campaign of so many sightings, each of a landmark of its own, 100 to an image, is written to a temporary
folder; a second one has one in twenty of its pixels wrong by up to 1000.  CPU seconds and largest memory of each
process (set OPENBLAS_NUM_THREADS=1), the second without what reading needs, and the sizes of the files.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from calibrate import write

MARKERS = 100
COMMAND = "import sys; from starplumb.cli import main; sys.exit(main())"
RUNS = {
    "--no-report": ("campaign", ["--no-report"]),
    "with its report": ("campaign", []),
    "--estimate focal_length,distortion --no-report": (
        "campaign",
        ["--estimate", "focal_length,distortion", "--no-report"],
    ),
    "--robust --no-report, 5 % of the pixels wrong": ("wrong", ["--robust", "--no-report"]),
}


def spoil(good: Path, bad: Path) -> int:
    """A copy of a campaign with one in twenty pixels of its observations wrong; returns how many."""
    bad.mkdir()
    for file in good.iterdir():
        if file.name != "observations.csv" and file.is_file():
            os.link(file, bad / file.name)
    rng, wrong = np.random.default_rng(2), 0
    with (good / "observations.csv").open() as source, (bad / "observations.csv").open("w") as target:
        head = next(source)
        target.write(head)
        column = head.strip().split(",").index("column_px")
        for line in source:
            cells = line.rstrip("\n").split(",")
            if rng.random() < 0.05:
                cells[column] = repr(
                    float(np.clip(float(cells[column]) + rng.uniform(-1e3, 1e3), 0.0, 11999.0))
                )
                wrong += 1
            target.write(",".join(cells) + "\n")
    return wrong


def run(folder: Path, options: list[str]) -> tuple[float, float]:
    """CPU seconds and largest memory, MB, of one command."""
    arguments = ["calibrate", str(folder / "campaign.toml"), "--quiet", *options]
    child = os.spawnv(os.P_NOWAIT, sys.executable, [sys.executable, "-c", COMMAND, *arguments])
    _, status, used = os.wait4(child, 0)
    if status:
        raise SystemExit(f"starplumb {' '.join(arguments)} ended with {status}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("size", type=int, nargs="?", default=1_000_000)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(folder / "campaign", arguments.size // MARKERS, MARKERS)
        wrong = spoil(folder / "campaign", folder / "wrong")
        files = sum(file.stat().st_size for file in (folder / "campaign").iterdir()) / 1e6
        print(
            f"{arguments.size} sightings, {files:.0f} MB of files\n\n| calibrate | CPU s | memory MB |\n|---|---|---|"
        )
        for words, (where, options) in RUNS.items():
            seconds, memory = run(folder / where, options)
            print(f"| {words} | {seconds:.1f} | {memory:.0f} |", flush=True)
        rejected = json.loads((folder / "wrong" / "result" / "result.json").read_text())["rejected"]
        print(f"\n{len(rejected)} sightings rejected, {wrong} wrong.  Files of the result, MB:")
        for file in sorted((folder / "campaign" / "result").iterdir()):
            print(f"{file.name} {file.stat().st_size / 1e6:.1f}")


if __name__ == "__main__":
    main()
