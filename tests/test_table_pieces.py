"""Tables too large to be held before they are known to be sound: what will be refused is refused piece by piece."""

from __future__ import annotations

import re

import pytest

from starplumb.io.campaign.config import EphemerisConfig
from starplumb.io.campaign.marks import images as image_tables
from starplumb.io.campaign.marks import landmarks as landmark_tables
from starplumb.io.campaign.marks.images import read_images
from starplumb.io.campaign.marks.landmarks import read_landmarks
from starplumb.io.campaign.marks.markers import Grid, read_detections, read_observations
from starplumb.io.campaign.motion import read_ephemeris
from starplumb.io.tables import csv_tables, pieces
from starplumb.io.tables.read import Frame
from starplumb.physics.errors import InputError

IMAGES, LANDMARKS = [f"i{k}" for k in range(10)], [f"m{k}" for k in range(10)]
SEEN = [f"{i},{m},1.5,2.5,0.3" for i in IMAGES for m in LANDMARKS]
GRID = Grid(10.0, 10.0, 0.0)


def observed(path):
    return read_observations(path, IMAGES, LANDMARKS, GRID, [])


def detected(path):
    return read_detections(path, IMAGES, GRID, [])


def flown(path):
    config = EphemerisConfig.model_validate({"file": "e.csv", "frame": "ITRF", "sigma_m": 1.0})
    return read_ephemeris(path, config, "TAI", None, None, [])


def at(second, x=7e6):
    return f"2020-01-01T00:00:{second:06.3f},{x},0,0"


MARKS = "image_id,landmark_id,column_px,row_px,sigma_px"
ORBIT = "time,x_m,y_m,z_m"
FLOWN = [at(k / 10) for k in range(300)]


@pytest.mark.parametrize(
    ("read", "head", "rows", "said"),
    [
        (
            observed,
            MARKS,
            [*SEEN[:-1], "i9,lost,1,2,3"],
            'row 101, column landmark_id: found "lost", wanted one of',
        ),
        (
            observed,
            MARKS,
            [*SEEN[:-1], "i11,m9,1,2,3"],
            'row 101, column image_id: found "i11", wanted one of',
        ),
        (
            observed,
            MARKS,
            [*SEEN[:-1], "i9,m9,1,12,3"],
            "row 101, column row_px: found 12, wanted -0.5 to 9.5",
        ),
        (
            observed,
            MARKS,
            [*SEEN[:-1], "i9,m9,1,2,-3"],
            "row 101, column sigma_px: found -3, wanted a positive",
        ),
        (
            *(observed, MARKS, [*SEEN, "i2,m7,1,2,3"]),
            'row 102, column landmark_id: found "m7" in image "i2" again (first in row 29), wanted each pair once',
        ),
        (
            *(detected, "image_id,column_px,row_px,sigma_px", ["i1,1,2,3"] * 90 + ["i1,1,12,3"]),
            "row 92, column row_px: found 12, wanted -0.5 to 9.5",
        ),
        (
            flown,
            ORBIT,
            [*FLOWN, at(29.9)],
            'row 302, column time: found "2020-01-01T00:00:29.900" again (row 301)',
        ),
        (
            flown,
            ORBIT,
            [*FLOWN, at(30.0, 7000)],
            "row 302, columns x_m, y_m, z_m: found 7000 m, wanted an orbit",
        ),
    ],
)
@pytest.mark.parametrize("piece", [130, 200, 10**6])
def test_what_does_not_fit_is_refused_before_it_is_held(tmp_path, monkeypatch, read, head, rows, said, piece):
    """In pieces of some rows, so that seams fall anywhere, and as a whole: the sentence is the same."""
    held = []
    if piece < 10**6:
        for module in (pieces, csv_tables):
            monkeypatch.setattr(module, "PIECE", piece)
        monkeypatch.setattr(csv_tables, "MOST_HELD", 300)
        monkeypatch.setattr(csv_tables, "joined", held.append)
    path = tmp_path / "t.csv"
    path.write_text("\n".join([head, *rows, ""]))
    with pytest.raises(InputError, match=rf"t\.csv, {re.escape(said)}"):
        read(path)
    assert held == []


@pytest.mark.parametrize("frame", [False, True])
def test_no_campaign_has_so_many_images_or_landmarks(tmp_path, monkeypatch, frame):
    monkeypatch.setattr(image_tables, "MOST_IMAGES", 3)
    monkeypatch.setattr(landmark_tables, "MOST_LANDMARKS", 3)
    found = {"image_id": list("abcd"), "landmark_id": list("abcd"), "time": ["2020-01-01T00:00:00"] * 4}
    path = tmp_path / "t.csv"
    path.write_text(
        "\n".join(["image_id,landmark_id,time", *map(",".join, zip(*found.values(), strict=True)), ""])
    )
    source = Frame.of("t.csv", found) if frame else path
    with pytest.raises(InputError, match=r"t\.csv: found more than 3 rows, wanted fewer"):
        read_images(source, "TAI", False, [])
    with pytest.raises(InputError, match=r"t\.csv: found more than 3 rows, wanted fewer"):
        read_landmarks(source, [])
