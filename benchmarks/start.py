"""CPU seconds to start: a bare import of typer and rich, ``import starplumb``, ``starplumb --help``, a small campaign
without and with its report.

    python benchmarks/start.py [--rounds 5] [--src OTHER/src ...]

Each is a process of its own, taken in turn, so that a busy machine slows all alike; other source trees beside this one
are compared in the same rounds.  The least of the rounds is shown, and its ratio to the bare import.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parents[1] / "src"
COMMAND = "import sys; sys.argv = ['starplumb', *{arguments}]\nfrom starplumb.cli import main\n"
RUN = "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code, end.code\n"


def command(*arguments: str) -> str:
    """A program that runs one command."""
    return COMMAND.format(arguments=list(arguments)) + RUN


def cpu_s(code: str, source: Path, folder: Path) -> float:
    """CPU seconds of a process that runs the code."""
    # compiled modules are kept as an installed package keeps them, whatever the environment says
    environment = {**os.environ, "PYTHONPATH": str(source), "PYTHONPYCACHEPREFIX": str(folder / "compiled")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--src", type=Path, nargs="*", default=[], help="other source trees to compare")
    options = parser.parse_args()
    programs = {
        "import starplumb": "import starplumb",
        "starplumb --help": command("--help"),
        "starplumb calibrate --no-report": command("calibrate", "demo/campaign.toml", "--no-report"),
        "starplumb calibrate": command("calibrate", "demo/campaign.toml"),
    }
    with tempfile.TemporaryDirectory() as name:
        folders = {source: Path(name) / str(k) for k, source in enumerate((HERE, *options.src))}
        for source, folder in folders.items():
            folder.mkdir()
            cpu_s(command("init", "demo"), source, folder)
        runs = [("import typer, rich", "import typer, rich", HERE)]
        runs += [(title, code, source) for title, code in programs.items() for source in (HERE, *options.src)]
        least = [float("inf")] * len(runs)
        for _ in range(options.rounds):
            least = [
                min(t, cpu_s(code, source, folders[source]))
                for t, (_, code, source) in zip(least, runs, strict=True)
            ]
    for t, (title, _, source) in zip(least, runs, strict=True):
        print(f"{title:34} {t:6.3f} s  {t / least[0]:5.2f}  {source}")


if __name__ == "__main__":
    main()
