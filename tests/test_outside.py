"""Marks that attitude or orbit do not cover: named and counted, refused, or left out on request."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import starplumb as sp
from helpers import ATTITUDE, CAMPAIGN, EPHEMERIS, FILES, write_good_campaign
from starplumb.cli.app import app
from starplumb.io.campaign.read import load_campaign
from starplumb.table.coverage import covered
from starplumb.table.geometry import stations

ON_REQUEST = 'outside = "skip" (--outside skip) leaves such marks out'


def late(folder, **replaced):
    """The good campaign with an attitude that starts after its first image, which has the marks of rows 2, 3 and 4."""
    return write_good_campaign(folder, attitude=ATTITUDE.replace("00:00:00.000", "00:00:01.800"), **replaced)


def test_the_good_campaign_is_covered(tmp_path):
    loaded = sp.read_campaign(write_good_campaign(tmp_path)).loaded
    assert loaded.coverage.outside.size == 0
    assert loaded.left_out == ()


@pytest.mark.parametrize("call", [sp.calibrate, sp.compare, sp.diagnose])
def test_rows_are_named_and_counted(tmp_path, call):
    with pytest.raises(sp.InputError) as refused:
        call(sp.read_campaign(late(tmp_path)))
    text = str(refused.value)
    assert "observations.csv, row 2: found 3 of 5 marks outside attitude or orbit (rows 2, 3, 4): " in text
    assert "image 'I1': found the epoch 2020-01-01T00:00:01.500000 UTC outside " in text
    assert "the nearest sample is 0.3 s away" in text
    assert text.endswith(ON_REQUEST)
    assert "\n" not in text


def test_they_are_left_out_and_listed(tmp_path):
    path = late(tmp_path)
    campaign = sp.read_campaign(path, outside="skip")
    kept = campaign.loaded.campaign.sightings
    plain = load_campaign(path).campaign.sightings
    np.testing.assert_array_equal(kept.column_px, plain.column_px[3:])
    np.testing.assert_array_equal(kept.landmark, plain.landmark[3:])
    notice = campaign.notices[-1]
    assert "observations.csv: left out 3 of 5 marks outside attitude or orbit (rows 2, 3, 4): " in notice
    result = sp.calibrate(campaign, method="gls")
    left = result.document["left_out"]
    assert [(each["image_id"], each["landmark_id"]) for each in left] == [("I1", f"L{i}") for i in (1, 2, 3)]
    assert [each["where"].split("/")[-1] for each in left] == [
        f"observations.csv, row {i}" for i in (2, 3, 4)
    ]
    assert all("0.3 s away" in each["reason"] for each in left)
    assert notice in result.document["notices"]


@pytest.mark.slow
@pytest.mark.parametrize("command", ["calibrate", "compare", "diagnose"])
def test_the_option_of_the_commands(tmp_path, command):
    path = str(late(tmp_path))
    refused = CliRunner().invoke(app, [command, path])
    assert "3 of 5 marks" in str(refused.exception)
    done = CliRunner().invoke(app, [command, path, "--outside", "skip"])
    assert not isinstance(done.exception, sp.InputError)
    assert "left out 3 of 5 marks" in done.stderr


def test_gaps_count_as_outside(tmp_path):
    """Samples at 0, 0.2 and 4 s: beyond 3.5 median spacings nothing joins them, 1.5 and 2.5 s lie between."""
    rows = ATTITUDE.replace("00:00:02.000", "00:00:00.200")
    path = write_good_campaign(
        tmp_path, attitude=rows, campaign=CAMPAIGN.replace("sigma_arcsec", "max_gap_s = 1.0\nsigma_arcsec")
    )
    with pytest.raises(sp.InputError, match=r"found 5 of 5 marks outside attitude or orbit"):
        sp.read_campaign(path, outside="skip")


def test_an_orbit_without_velocities_needs_four_positions(tmp_path):
    """What :func:`covered` says is what the geometry can do, epoch by epoch."""
    bare = "\n".join(",".join(line.split(",")[:4]) for line in EPHEMERIS.splitlines())
    for text in (bare, "\n".join(bare.splitlines()[:4]), "\n".join(bare.splitlines()[:2]), EPHEMERIS):
        toml = CAMPAIGN + "[corrections]\naberration = true\n"
        for aberration in ("true", "false"):
            path = write_good_campaign(tmp_path, ephemeris=text, campaign=toml.replace("true", aberration))
            c = load_campaign(path).campaign
            t_ns = c.images.t_ns[0] + np.array([-1500, -500, 0, 500, 1500, 2500, 3500]) * 10**6
            c = replace(c, images=replace(c.images, ids=tuple("abcdefg"), t_ns=t_ns))
            found = covered(c, np.arange(7), np.zeros(7))
            for i in range(7):
                if found[i]:
                    stations(c, np.array([i]), np.zeros(1))
                    continue
                with pytest.raises(sp.InputError):
                    stations(c, np.array([i]), np.zeros(1))


def test_a_case_of_rows_before_the_first_sample(shared_cases):
    path = shared_cases / "attitude_starts_late" / "campaign.toml"
    with pytest.raises(sp.InputError, match=r"observations.csv, row 2: found 1 of 3 marks .* 0.004 s away"):
        sp.calibrate(sp.read_campaign(path))
    campaign = sp.read_campaign(path, outside="skip")
    assert campaign.loaded.campaign.sightings.image.size == 2
    assert [each.landmark_id for each in campaign.loaded.left_out] == ["A"]


def test_rows_of_a_grid_are_left_out_too(shared_cases, tmp_path):
    """Rows of 0.1 ms from 59.946 s: the attitude starts 540 rows later, between rows 500 and 600 of every hundredth."""
    path = str(shared_cases / "attitude_starts_late" / "campaign.toml")
    grid = str(tmp_path / "grid.npy")
    asked = ["locate", path, "--image", "I", "--grid", grid, "--every", "100", "--rows", "1001", "--json"]
    refused = CliRunner().invoke(app, asked)
    assert "outside" in str(refused.exception)
    done = CliRunner().invoke(app, [*asked, "--outside", "skip"])
    document = json.loads(done.stdout)
    assert (document["rows_left_out"], document["pixels_without_ground"]) == (6, 0)
    found = np.load(grid)
    np.testing.assert_array_equal(np.isnan(found[0]).all(axis=1), np.arange(11) < 6)
    np.testing.assert_array_equal(np.isnan(found[0]).any(axis=1), np.arange(11) < 6)


def test_detections_are_treated_alike(tmp_path):
    toml = CAMPAIGN.replace("[observations]", "[detections]").replace("observations.csv", "detections.csv")
    header, *rows = (line.split(",") for line in FILES["observations.csv"].split())
    text = "\n".join(",".join([cells[0], *cells[2:5]]) for cells in (header, *rows))
    path = late(tmp_path, campaign=toml)
    (tmp_path / "detections.csv").write_text(text)
    with pytest.raises(sp.InputError, match=r"detections.csv, row 2: found 3 of 5 marks"):
        sp.calibrate(sp.read_campaign(path))
    loaded = sp.read_campaign(path, outside="skip").loaded
    assert loaded.detections.image.size == 2
    assert loaded.left_out[0].landmark_id is None
