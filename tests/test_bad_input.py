"""Every wrong input is refused with one line that says where, what was found and what is wanted; nothing is written."""

from __future__ import annotations

from pathlib import Path

import pytest

from bad_cases import BAD_CASES, BadCase
from helpers import write_good_campaign
from starplumb.io.campaign.read import load_campaign
from starplumb.physics.errors import InputError
from starplumb.table.geometry import observe


def contents(folder: Path) -> dict[str, bytes | None]:
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


def test_good_campaign_is_accepted(tmp_path: Path) -> None:
    loaded = load_campaign(write_good_campaign(tmp_path))
    assert observe(loaded.campaign).n == 5
    assert loaded.notices == ()


def read_and_observe(path: Path) -> None:
    """What every calibration begins with."""
    loaded = load_campaign(path)
    loaded.coverage.require()
    observe(loaded.campaign)


@pytest.mark.parametrize("case", BAD_CASES, ids=lambda case: case.name)
def test_refused_in_one_line(case: BadCase, tmp_path: Path) -> None:
    if case.name.startswith("bsp"):
        pytest.importorskip("spiceypy", reason="the extra spice is not installed")
    path = write_good_campaign(tmp_path)
    case.spoil(tmp_path)
    before = contents(tmp_path)
    with pytest.raises(InputError) as caught:
        read_and_observe(path)
    message = str(caught.value)
    assert message.isprintable(), "one line, no control characters"
    assert [piece for piece in case.says if piece not in message] == [], message
    assert contents(tmp_path) == before


def test_case_names_are_distinct() -> None:
    names = [case.name for case in BAD_CASES]
    assert len(set(names)) == len(names) >= 45


def test_every_case_says_something() -> None:
    assert all(case.says for case in BAD_CASES)
