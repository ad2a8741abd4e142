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


def test_a_study_moves_before_its_first_chunk_is_done(monkeypatch, capsys):
    from starplumb.cli.simulate import _progress

    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    with _progress(10_000, quiet=False) as done:
        done(0)  # of an earlier run nothing is kept
        capsys.readouterr()
        done(36)
    assert "36/10000" in capsys.readouterr().err
