"""XML read and TOML written: lines, prefixes, refusals, and that another reader finds what was written."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from starplumb.io.campaign.toml_text import document_text
from starplumb.io.text.xml_tree import parse_xml
from starplumb.physics.errors import InputError


def test_elements_know_their_line_and_lose_their_prefix() -> None:
    root = parse_xml("f.xml", b'<?xml version="1.0"?>\n<n:a xmlns:n="u">\n\n<b/><n:c\n x="1">t</n:c>\n</n:a>')
    assert [(element.tag, element.line) for element in root.elements()] == [("a", 2), ("b", 4), ("c", 4)]
    assert (root[1].text, root[1].get("x")) == ("t", "1")


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (
            b"<a>\n<b></a>",
            "^f.xml, line 2: found XML that is not well formed .mismatched tag., wanted well-formed XML$",
        ),
        (b"<a>\n", "^f.xml, line 2: found XML that is not well formed"),
        (b'<?xml version="1.0" encoding="KLINGON"?><a/>', "^f.xml.*: found XML"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]>\n<a>&b;</a>', "^f.xml, line 1: found a DOCTYPE, wanted none"),
        (b"\n<!DOCTYPE a SYSTEM 'file:///etc/passwd'><a/>", "^f.xml, line 2: found a DOCTYPE, wanted none"),
    ],
    ids=["tags", "end", "encoding", "entities", "external"],
)
def test_unsafe_or_broken_xml(data: bytes, says: str) -> None:
    with pytest.raises(InputError, match=says):
        parse_xml("f.xml", data)


FLOAT = st.floats(allow_nan=False)
VALUE = st.one_of(st.booleans(), st.integers(-(2**60), 2**60), FLOAT, st.text(), st.lists(FLOAT, max_size=4))
KEYS = st.dictionaries(st.text("abc_xyz", min_size=1, max_size=8), VALUE, max_size=4)


@pytest.mark.slow
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(sections=st.dictionaries(st.sampled_from(["campaign", "camera", "mounting"]), KEYS, max_size=3))
def test_toml_is_read_back_by_another_reader(sections: dict[str, Any]) -> None:
    assert tomllib.loads(document_text(list(sections.items()), "a comment\nof two lines")) == sections


def test_toml_of_arrays_and_tables() -> None:
    turn = {"from": "a", "quaternion_xyzw": np.array([0.0, 0.0, 0.0, 1.0])}
    text = document_text(
        [
            ("camera", {"image_size_px": [10, 20], "k": (1.0, 2.0), "x": np.float64(0.1)}),
            ("[trackers]", {"file": "1.csv"}),
            ("[trackers]", {"file": "2.csv", "mounting": turn}),
            ("fusion", {"frame": "body"}),
        ],
        "by hand",
    )
    assert tomllib.loads(text) == {
        "camera": {"image_size_px": [10, 20], "k": [1.0, 2.0], "x": 0.1},
        "trackers": [
            {"file": "1.csv"},
            {"file": "2.csv", "mounting": {"from": "a", "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}},
        ],
        "fusion": {"frame": "body"},
    }
    assert text.startswith("# by hand\n\n[camera]\nimage_size_px = [10, 20] # columns, rows\n")
