"""What ``starplumb check`` tells of a campaign, nothing solved; the expected numbers are counted by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import starplumb as sp
from helpers import ATTITUDE, CAMPAIGN, EPHEMERIS, FILES, write_good_campaign
from starplumb.cli.app import app
from starplumb.documents.check import CheckDocument


def checked(folder, outside="refuse", **replaced):
    return sp.check(sp.read_campaign(write_good_campaign(folder, **replaced), outside=outside))


def test_spans_rates_and_counts_are_those_of_the_files(tmp_path):
    """Five positions a second apart, 7500 m/s northwards in the turning frame, and three attitudes that are all one."""
    found = checked(tmp_path)
    d = found.document
    orbit, attitude = d["series"]
    assert (orbit["kind"], orbit["frame"], orbit["samples"], orbit["step_s"]) == ("ephemeris", "ITRF", 5, 1.0)
    assert (orbit["first"], orbit["last"]) == ("2020-01-01T00:00:00.000", "2020-01-01T00:00:04.000")
    assert (attitude["kind"], attitude["samples"], attitude["step_s"], attitude["gaps"]) == (
        "attitude",
        3,
        2.0,
        [],
    )
    assert d["images"]["count"] == 2
    assert (d["images"]["first"], d["images"]["last"]) == (
        "2020-01-01T00:00:01.500",
        "2020-01-01T00:00:02.500",
    )
    np.testing.assert_allclose(d["images"]["speed_m_s"], 7500.0, rtol=1e-6)
    np.testing.assert_allclose(d["images"]["rate_deg_s"], 0.0, atol=1e-6)
    assert (d["marks"]["control"], d["marks"]["check"], d["marks"]["outside"]) == (5, 0, 0)
    assert (d["marks"]["fewest_in_an_image"], d["marks"]["most_in_an_image"]) == (2, 3)
    assert d["frames"] == {
        "ephemeris": "ITRF",
        "attitude": "ITRF to star_tracker",
        "mounting": "camera to star_tracker",
    }
    assert found.problems == ()
    assert found.verdict.startswith("usable")


def test_gaps_are_between_the_samples_that_nothing_joins(tmp_path):
    """Samples 2 s apart are more than one second apart: two gaps."""
    toml = CAMPAIGN.replace("sigma_arcsec", "max_gap_s = 1.0\nsigma_arcsec")
    series = checked(tmp_path, campaign=toml).document["series"][1]
    times = [f"2020-01-01T00:00:0{t}.000" for t in (0, 2, 4)]
    assert series["gaps"] == [times[:2], times[1:]]


def test_digits_are_held_against_the_sigmas(tmp_path):
    """Pixels of one decimal: 0.1 / sqrt(12) px beside 0.05 px."""
    text = FILES["observations.csv"].replace(",0.2", ",0.05")
    found = checked(tmp_path, observations=text)
    (pixels,) = [each for each in found.document["digits"] if each["column"] == "pixels"]
    assert pixels["step"] == 0.1
    np.testing.assert_allclose([pixels["sigma"], pixels["stated"]], [0.1 / np.sqrt(12), 0.05])
    assert any(
        text.startswith("pixels: the last digit is 0.1 px, 0.029 px rms beside") for text in found.warnings
    )
    assert not any("pixels" in text for text in checked(tmp_path).warnings)


def test_who_is_not_seen_is_named(tmp_path):
    landmarks = (
        FILES["landmarks.csv"].rstrip() + "\n" + FILES["landmarks.csv"].split()[-1].replace("L3", "L9")
    )
    images = FILES["images.csv"].rstrip() + "\nI3,2020-01-01T00:00:03.000\n"
    d = checked(tmp_path, landmarks=landmarks, images=images).document
    assert d["landmarks"]["not_seen"] == ["L9"]
    assert d["images"]["without_marks"] == ["I3"]
    assert d["marks"]["fewest_in_an_image"] == 0


def test_marks_outside_are_a_problem_until_they_are_skipped(tmp_path):
    late = ATTITUDE.replace("00:00:00.000", "00:00:01.800")
    found = checked(tmp_path, attitude=late)
    assert "row 2: found 3 of 5 marks outside attitude or orbit" in found.problems[0]
    assert found.document["images"]["not_covered"] == ["I1"]
    assert found.document["marks"]["outside"] == 3
    with pytest.raises(sp.InputError, match="3 of 5 marks"):
        found.raise_if_unusable()
    skipped = checked(tmp_path, "skip", attitude=late)
    assert skipped.problems == ()
    assert skipped.document["marks"]["control"] == 2


def test_a_frame_read_the_other_way_is_something_to_look_at(tmp_path):
    """A quaternion of 120 degrees read as its inverse."""
    assert not any("mounting" in text for text in checked(tmp_path).warnings)
    toml = CAMPAIGN.replace('from = "ITRF"\nto = "star_tracker"', 'from = "star_tracker"\nto = "ITRF"')
    assert toml != CAMPAIGN
    (told,) = [text for text in checked(tmp_path, campaign=toml).warnings if "mounting" in text]
    assert "starplumb diagnose tries the usual ones" in told


def test_check_marks_alone_calibrate_nothing(tmp_path):
    header, *rows = FILES["observations.csv"].split()
    text = "\n".join([f"{header},role", *(f"{row},check" for row in rows)])
    found = checked(tmp_path, observations=text)
    assert "found only check points, wanted some with the role control" in found.problems[0]


def run(path, *more):
    return CliRunner().invoke(app, ["check", str(path), *more])


@pytest.mark.parametrize("camera", ["frame", "line-scan"])
def test_the_document_has_its_schema(tmp_path, camera):
    CliRunner().invoke(app, ["init", str(tmp_path / "demo"), "--camera", camera, "--images", "2"])
    done = run(tmp_path / "demo" / "campaign.toml", "--json")
    document = json.loads(done.stdout)
    assert done.exit_code == 0
    assert CheckDocument.of(document).to_dict() == document
    assert document["schema"] == "starplumb-check/1"


def test_the_command_tells_all_and_then_refuses(tmp_path):
    path = write_good_campaign(tmp_path, ephemeris="\n".join(EPHEMERIS.split()[:3]))
    done = run(path)
    assert isinstance(done.exception, sp.InputError)
    assert "not usable as it is" in done.stdout
    assert "problem: " in done.stdout
    assert run(write_good_campaign(tmp_path)).exit_code == 0


def test_a_campaign_that_cannot_be_read_is_refused_as_everywhere(tmp_path):
    path = write_good_campaign(tmp_path, images="image_id,time\nI1,noon\n")
    assert "images.csv, row 2, column time" in str(run(path).exception)


def test_an_image_of_another_day_is_not_covered(tmp_path):
    """Its rows, of which no number is stated, do not go on until the attitude begins."""
    CliRunner().invoke(app, ["init", str(tmp_path / "demo"), "--camera", "line-scan", "--images", "2"])
    path = tmp_path / "demo" / "images.csv"
    header, first, second = path.read_text().split()
    name, _, period = second.split(",")
    path.write_text("\n".join([header, first, f"{name},2025-06-20T10:30:00,{period}"]) + "\n")
    found = sp.check(sp.read_campaign(tmp_path / "demo" / "campaign.toml", outside="skip"))
    assert found.document["images"]["not_covered"] == [name]
    assert found.document["marks"]["control"] > 0
