"""Is a study the same to the bit however it is run?  Killed ten times and resumed, with two workers, on a Dask cluster.

python benchmarks/kill_and_resume.py --kills 10
"""

from __future__ import annotations

import argparse
import hashlib
import random
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

COMMAND = [
    sys.executable,
    "-c",
    "from starplumb.cli import main; main()",
    "simulate",
    "two-images",
    "--quiet",
]
COMMAND += [
    "--trials",
    "45000",
    "--chunk",
    "1024",
    "--seed",
    "2019",
    "--methods",
    "gls,least-squares,observer",
]


def digest(folder: Path) -> str:
    """SHA-256 of the summary and of the samples."""
    names = ("summary.json", "samples.parquet")
    return " ".join(hashlib.sha256((folder / name).read_bytes()).hexdigest()[:16] for name in names)


def killed(folder: Path, kills: int) -> None:
    """Run with two workers, killed without warning a random time after it has finished a chunk, so many times."""
    pause = random.Random(7)
    for number in range(kills):
        before = finished(folder)
        process = subprocess.Popen(
            [*COMMAND, "--workers", "2", "--out", str(folder)], stderr=subprocess.DEVNULL
        )
        while finished(folder) <= before and process.poll() is None:
            time.sleep(0.01)
        time.sleep(pause.uniform(0.0, 0.5))
        process.kill()
        process.wait()
        print(f"  kill {number + 1}: {finished(folder)} of 44 chunks are there", flush=True)
    subprocess.run([*COMMAND, "--workers", "2", "--out", str(folder)], check=True)


def finished(folder: Path) -> int:
    return len(list(folder.glob("chunks/*.npz")))


def on_cluster(folder: Path) -> None:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1") as cluster:
        subprocess.run([*COMMAND, "--scheduler", cluster.scheduler_address, "--out", str(folder)], check=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=10)
    kills = parser.parse_args().kills
    with tempfile.TemporaryDirectory() as name:
        base = Path(name)
        subprocess.run([*COMMAND, "--workers", "1", "--out", str(base / "one")], check=True)
        subprocess.run([*COMMAND, "--workers", "2", "--out", str(base / "two")], check=True)
        killed(base / "killed", kills)
        if find_spec("distributed"):
            on_cluster(base / "dask")
        found = {folder.name: digest(folder) for folder in sorted(base.iterdir())}
    for name, value in found.items():
        print(f"{name:10s} {value}")
    print("the same to the bit" if len(set(found.values())) == 1 else "DIFFERENT")


if __name__ == "__main__":
    main()
