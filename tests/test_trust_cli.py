"""A refuted answer leaves nothing that could be installed by mistake."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

import starplumb as sp
from command import demo, starplumb
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC


def exchange_labels(folder, image):
    """Each label of an image given to its next sighting."""
    path = folder / "observations.csv"
    head, *lines = path.read_text().splitlines()
    column = head.split(",").index("landmark_id")
    cells = [line.split(",") for line in lines]
    mine = [row for row, cell in enumerate(cells) if cell[0] == image]
    labels = [cells[row][column] for row in mine]
    for row, label in zip(mine, labels[1:] + labels[:1], strict=True):
        cells[row][column] = label
    path.write_text("\n".join([head, *map(",".join, cells)]) + "\n")


def test_a_refuted_answer_is_not_valid_anywhere_and_an_older_kernel_goes(tmp_path):
    folder = demo(tmp_path / "campaign", "--images", 8).parent
    out = tmp_path / "out"
    calibrate = ("calibrate", folder / "campaign.toml", "--method", "gls", "--out", out)
    assert starplumb(*calibrate).status == 0
    assert (out / "mounting.tf").exists()
    exchange_labels(folder, "image03")
    done = starplumb(*calibrate)
    assert done.status == 3
    assert "not valid" in done.out
    assert "status refuted" in done.out
    assert not (out / "mounting.tf").exists()
    result = json.loads((out / "result.json").read_text())
    assert result["status"] == "refuted"
    for key in ("sigma_arcsec", "covariance_arcsec2", "interval_95_arcsec", "correction_arcsec"):
        assert result[key] is None
    model = starplumb(
        "locate", folder / "campaign.toml", "--result", out / "result.json", "--image", "image01", 0, 0
    )
    assert model.status == 2
    assert "image03" in result["message"]
    assert "refuted: the data contradict the answer" in (out / "report.html").read_text()


def test_a_good_answer_states_its_interval(tmp_path):
    campaign = demo(tmp_path / "campaign", "--images", 8)
    assert starplumb("calibrate", campaign, "--no-report").status == 0
    result = json.loads((campaign.parent / "result" / "result.json").read_text())
    assert np.all(np.array(result["interval_95_arcsec"]) >= 1.959 * np.array(result["sigma_arcsec"]))


@pytest.mark.parametrize(
    ("name", "method", "statuses", "named"),
    [
        ("weak_but_wrong", "gls", ["refuted"], "image01"),
        ("weak_but_wrong", "robust", ["ok", "weak"], ""),
        ("weak_but_wrong", "default", ["ok", "weak"], ""),
        ("trackers_disagree_49x", "default", ["weak", "refuted"], "--estimate trackers"),
        ("one_bad_tracker_sample", "default", ["weak"], "IMG0002"),
        ("trackers_disagree_49x", "gls", ["weak", "refuted"], "--estimate trackers"),
        ("one_bad_tracker_sample", "gls", ["weak"], "IMG0002"),
    ],
)
def test_campaigns_that_once_ended_wrong(name, method, statuses, named, shared_cases, tmp_path):
    folder = shutil.copytree(shared_cases / name, tmp_path / name)
    out = tmp_path / "out"
    done = starplumb("calibrate", folder / "campaign.toml", "--method", method, "--no-report", "--out", out)
    result = json.loads((out / "result.json").read_text())
    assert result["status"] in statuses
    assert done.status == (3 if result["status"] == "refuted" else 0)
    assert (out / "mounting.tf").exists() == (done.status == 0)
    assert named in result["message"]
    assert 'estimate="' not in done.err
    if name == "weak_but_wrong" and method != "gls":
        truth = sp.read_campaign(folder / "campaign.toml").C_EK_true
        error = so3.log(np.array(result["mounting"]["matrix"]) @ truth.T) / ARCSEC
        assert np.all(np.abs(error) < 4.0 * np.array(result["sigma_arcsec"]))
