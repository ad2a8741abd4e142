"""What takes a while is said on a terminal, and nowhere else."""

from __future__ import annotations

import sys

import pytest

from starplumb.cli.output import Output


@pytest.mark.parametrize(
    ("terminal", "quiet", "said"), [(True, False, True), (True, True, False), (False, False, False)]
)
def test_work_is_named_on_a_terminal_only(monkeypatch, capsys, terminal, quiet, said):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    monkeypatch.setenv("TERM", "xterm")
    with Output(quiet=quiet).doing("solving"):
        pass
    found = capsys.readouterr()
    assert ("solving" in found.err) is said
    assert found.out == ""
