"""Tables on a terminal of 80 columns: nothing is cut, and no word is broken that has room."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

import starplumb as sp
from starplumb.cli.output import drawn
from starplumb.report.page import Table


def shown(table: Table, width: int = 80) -> str:
    """What a terminal shows of a table."""
    console = Console(file=io.StringIO(), width=width, highlight=False, markup=False, emoji=False)
    console.print(drawn(table, width))
    return console.file.getvalue()


def test_times_and_names_go_on_below_at_their_spaces():
    head = ("id", "campaign", "first image (UTC)", "status", "sigma x y z", "ground, m")
    row = ("77ef7ce5e851", "starplumb demo", "2025-06-21T10:30:00.125", "not_converged", "32.2  12.9  61.5")
    text = shown(Table("m.db", head, [(*row, "145")], text_columns=4))
    assert max(map(len, text.splitlines())) <= 80
    words = text.split()
    for word in ("77ef7ce5e851", "starplumb", "2025-06-21", "10:30:00.125", "not_converged", "61.5", "145"):
        assert word in words


def test_what_was_read_is_told_whole():
    (series, *_) = sp.check(sp.demo()).tables
    words = shown(series).replace("│", " ").split()
    assert {word for row in series.rows for cell in row for word in cell.replace("T1", " 1").split()} <= set(
        words
    )


@pytest.mark.parametrize("scenario", ["two-images", "cubesat-6u"])
def test_a_budget_fits(scenario):
    for table in sp.budget(sp.scenario(scenario), "gls,wahba").tables:
        text = shown(table)
        assert max(map(len, text.splitlines())) <= 80
        assert "…" not in text
        cells = [cell for row in table.rows for cell in row if cell]
        assert all(cell in text for cell in cells)  # each on a line of its own


def test_what_has_no_room_is_broken_but_not_cut():
    text = shown(Table("narrow", ("a", "b"), [("x" * 60, "y" * 60)], text_columns=1))
    assert text.count("x") == text.count("y") == 60
    assert max(map(len, text.splitlines())) <= 80
