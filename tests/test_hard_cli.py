"""The options of ``calibrate`` for hard campaigns, through the door a user takes."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from command import starplumb as run
from problems import C_EK_TRUE, FRAME, truth
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.physics import so3
from starplumb.physics.series import Attitude
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from test_labelling import unnamed


def earth_fixed(campaign):
    """The same with its attitude from ITRF, so that no table of Earth orientation is needed."""
    series = campaign.attitude
    q = so3.to_quaternion(series.at(series.t_ns)[0])
    return replace(campaign, attitude=Attitude(series.t_ns, q, "ITRF", None, series.gap_s), orientation=None)


@pytest.fixture
def folder(tmp_path, rng):
    campaign = earth_fixed(truth(FRAME, 6, 8))
    model = so3.exp(np.array([900.0, -700.0, 1200.0]) * ARCSEC) @ C_EK_TRUE
    s = campaign.sightings
    noisy = replace(
        s,
        column_px=s.column_px + 0.3 * rng.standard_normal(s.column_px.size),
        row_px=s.row_px + 0.3 * rng.standard_normal(s.row_px.size),
    )
    write_campaign(tmp_path, replace(campaign, C_EK=model, sightings=noisy))
    return tmp_path


def result(folder):
    return json.loads((folder / "result" / "result.json").read_text(encoding="utf-8"))


def test_a_wrong_label_is_rejected_and_listed(folder):
    lines = (folder / "observations.csv").read_text(encoding="utf-8").splitlines()
    first, second = (line.split(",") for line in lines[1:3])
    first[1], second[1] = second[1], first[1]
    lines[1:3] = ",".join(first), ",".join(second)
    (folder / "observations.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    done = run("calibrate", str(folder / "campaign.toml"), "--no-report")
    assert done.status == 0
    assert "rejected 2 sightings: see result.json" in done.out
    document = result(folder)
    assert document["method"] == "default"
    assert {r["image_id"] for r in document["rejected"]} == {first[0]}
    assert all(r["statistic"] > 100.0 for r in document["rejected"])
    with (folder / "result" / "residuals.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["role"] for row in rows[:3]] == ["rejected", "rejected", "control"]
    assert float(rows[5]["redundancy"]) > 0.5
    error = so3.log(np.array(document["mounting"]["matrix"]) @ C_EK_TRUE.T) / ARCSEC
    assert np.all(np.abs(error / document["sigma_arcsec"]) < 4.0)


def test_parameters_are_published_with_their_covariance(folder):
    done = run(
        "calibrate", str(folder / "campaign.toml"), "--no-report", "-e", "focal_length,principal_point=2px"
    )
    assert done.status == 0
    assert "focal_length:" in done.out
    document = result(folder)
    names = [p["name"] for p in document["parameters"]]
    assert names == ["focal_length", "principal_column", "principal_row"]
    assert [p["prior_sigma"] for p in document["parameters"]] == [None, 2.0, 2.0]
    assert document["parameter_covariance"]["names"][3:] == [
        "focal_length_mm",
        "principal_column_px",
        "principal_row_px",
    ]
    matrix = np.array(document["parameter_covariance"]["matrix"])
    np.testing.assert_allclose(matrix[:3, :3], document["covariance_arcsec2"], rtol=1e-12)
    assert document["parameters"][0]["sigma"] == pytest.approx(np.sqrt(matrix[3, 3]))
    assert "add nothing to what was known of the principal point's column" in document["message"]


def test_what_cannot_be_known_is_null(folder):
    run("calibrate", str(folder / "campaign.toml"), "--no-report", "-e", "principal_point")
    document = result(folder)
    assert document["status"] == "weak"
    assert [p["known"] for p in document["parameters"]] == [False, False]
    assert [p["correction"] for p in document["parameters"]] == [None, None]
    assert "cannot separate" in document["message"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["-e", "time_offset", "--method", "wahba"], "wanted default, gls or robust"),
        (["-e", "focal"], "wanted one or more of focal_length"),
        (["--method", "robuts"], "did you mean robust"),
    ],
)
def test_a_wrong_option_ends_with_a_sentence(folder, options, words):
    done = run("calibrate", str(folder / "campaign.toml"), *options)
    assert done.status == 2
    assert words in done.err
    assert "Traceback" not in done.err


def test_unnamed_markers_are_named_and_written_out(tmp_path, rng):
    campaign, detections, named = unnamed(earth_fixed(truth(FRAME, 6, 8)), rng)
    write_campaign(tmp_path, campaign, detections=detections)
    done = run("calibrate", str(tmp_path / "campaign.toml"), "--no-report")
    assert done.status == 0
    with (tmp_path / "result" / "labels.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    ids = campaign.landmarks.ids
    for row, landmark in zip(rows, named, strict=True):
        assert row["landmark_id"] in ("", ids[landmark] if landmark >= 0 else "")
    assert sum(row["label"] == "labelled" for row in rows) == result(tmp_path)["labels"]["labelled"] >= 46
    # the named ones are a campaign of their own
    text = (tmp_path / "campaign.toml").read_text(encoding="utf-8").replace("detections", "observations")
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    (tmp_path / "observations.csv").write_text(
        (tmp_path / "result" / "observations.csv").read_text(encoding="utf-8"), encoding="utf-8"
    )
    again = load_campaign(tmp_path / "campaign.toml").campaign
    assert observe(again).n == sum(row["label"] == "labelled" for row in rows)


def test_names_that_cannot_be_found_are_refused_with_a_result(tmp_path, rng):
    campaign, detections, _ = unnamed(earth_fixed(truth(FRAME, 6, 8)), rng)
    noise = replace(detections, column_px=rng.uniform(0.0, 11999.0, detections.image.size))
    write_campaign(tmp_path, campaign, detections=noise)
    done = run("calibrate", str(tmp_path / "campaign.toml"))
    assert done.status == 3
    document = result(tmp_path)
    assert document["status"] == "not_converged"
    assert document["message"] in done.err
    assert document["labels"]["labelled"] == 0
    assert not (tmp_path / "result" / "mounting.tf").exists()


def test_two_trackers_in_the_table_of_images(tmp_path):
    campaign = earth_fixed(truth(FRAME, 6, 8))
    write_campaign(tmp_path, campaign)
    lines = (tmp_path / "images.csv").read_text(encoding="utf-8").splitlines()
    tagged = [lines[0] + ",tracker", *(f"{line},{'AB'[i % 2]}" for i, line in enumerate(lines[1:]))]
    (tmp_path / "images.csv").write_text("\n".join(tagged) + "\n", encoding="utf-8")
    done = run("calibrate", str(tmp_path / "campaign.toml"), "--no-report", "-e", "trackers")
    assert done.status == 0
    assert [p["name"] for p in result(tmp_path)["parameters"]] == [f"tracker_B_{axis}" for axis in "xyz"]
