"""The command line as a user meets it: arguments in; exit status, standard output and standard error out."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from starplumb.cli import main


@dataclass(frozen=True)
class Spoken:
    """What a command left behind on its three channels."""

    status: int
    out: str
    err: str


def starplumb(*arguments: object) -> Spoken:
    """Run in this process, which is quick and turns any warning into a failure of the test."""
    out, err = io.StringIO(), io.StringIO()
    argv = ["starplumb", *map(str, arguments)]
    with patch.object(sys, "argv", argv), redirect_stdout(out), redirect_stderr(err):
        try:
            main()
            status: object = 0
        except SystemExit as end:
            status = end.code or 0
    assert isinstance(status, int)
    return Spoken(status, out.getvalue(), err.getvalue())


def process(*arguments: object, cwd: Path | None = None) -> Spoken:
    """Run in a process of its own, with its output in pipes."""
    command = [sys.executable, "-c", "from starplumb.cli import main; main()", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=os.environ, check=False)
    return Spoken(done.returncode, done.stdout, done.stderr)


def demo(folder: Path, *options: object) -> Path:
    """The campaign.toml of a fresh example."""
    assert starplumb("init", folder, "--quiet", *options) == Spoken(0, "", "")
    return folder / "campaign.toml"
