"""What the commands promise: files, exit statuses, one line for a mistake, and answers that hold."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bad_cases import BAD_CASES, BadCase, swap
from command import Spoken, demo, process, starplumb
from helpers import write_good_campaign
from starplumb.physics import so3

FILES = {"result.json", "residuals.csv", "mounting.tf", "normals.json"}
INTERFACE: dict[str, Any] = {
    "schema": "starplumb-result/1",
    "status": "ok",
    "message": "",
    "method": "default",
    "mounting": {
        "from": "camera",
        "to": "star_tracker",
        "matrix": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0],
    },
    "correction_arcsec": [0.0, 0.0, 0.0],
    "sigma_arcsec": [0.0, 0.0, 0.0],
    "covariance_arcsec2": [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
    "fit": {
        "images": 0,
        "observations": 0,
        "degrees_of_freedom": 0,
        "chi2": 0.0,
        "chi2_p": 0.0,
        "rms_px": 0.0,
        "iterations": 0,
    },
    "geolocation": {
        "before": {"rmse_m": 0.0, "ce90_m": 0.0},
        "after": {"rmse_m": 0.0, "ce90_m": 0.0},
        "check": {"rmse_m": 0.0, "ce90_m": 0.0},
    },
    "rejected": [],
    "inputs": {"campaign.toml": "sha256:..."},
    "software": {"starplumb": "0.2.0"},
}
"""``result.json`` as the interface writes it down: at least these keys, of these types."""


def assert_shape(found: Any, wanted: Any, where: str = "result") -> None:
    assert type(found) is type(wanted), where
    if isinstance(wanted, dict):
        for key, value in wanted.items():
            assert key in found, f"{where}.{key}"
            assert_shape(found[key], value, f"{where}.{key}")
    elif isinstance(wanted, list) and wanted:
        assert len(found) == len(wanted), where
        for item in found:
            assert_shape(item, wanted[0], where)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def document(folder: Path) -> Any:
    return json.loads((folder / "result.json").read_text(encoding="utf-8"))


def assert_refused(spoken: Spoken, *says: str) -> None:
    """Exit status 2 and one line on standard error, nothing else."""
    assert (spoken.status, spoken.out) == (2, "")
    assert spoken.err.startswith("starplumb: ")
    assert spoken.err.count("\n") == 1
    assert [piece for piece in says if piece not in spoken.err] == [], spoken.err


# The whole way, each command in a process of its own ------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("camera", ["frame", "line-scan"])
def test_from_nothing_to_a_position_on_the_ground(camera: str, tmp_path: Path) -> None:
    made = process("init", "demo", "--camera", camera, cwd=tmp_path)
    assert (made.status, made.err) == (0, "")
    done = process("calibrate", "demo/campaign.toml", cwd=tmp_path)
    assert (done.status, done.err) == (0, "")
    assert max(map(len, done.out.splitlines())) <= 120
    assert {"correction", "sigma", "known truth", "error / sigma"} <= {
        line.strip("│ ").split("│")[0].strip() for line in done.out.splitlines()
    }
    assert names(tmp_path / "demo" / "result") == {*FILES, "report.html"}
    place = ["--image", "image01", 6000, 5000, "--height-m", 120]
    result = ["--result", "demo/result/result.json"]
    found = process("locate", "demo/campaign.toml", *place, *result, "--json", cwd=tmp_path)
    assert (found.status, found.err) == (0, "")
    assert json.loads(found.out)["height_m"] == pytest.approx(120.0, abs=1e-6)


def test_help_and_version_of_every_command() -> None:
    listed = process("--help")
    assert (listed.status, listed.err) == (0, "")
    for command in ("init", "import", "calibrate", "compare", "locate"):
        assert command in listed.out
        spoken = starplumb(command, "--help")
        assert (spoken.status, spoken.err) == (0, "")
        assert spoken.out.startswith("Usage: starplumb")
    assert starplumb("--version").out.startswith("starplumb ")


# Files --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("camera", ["frame", "line-scan"])
def test_result_has_every_key_of_the_interface_with_its_type(camera: str, tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--camera", camera)
    assert starplumb("calibrate", path, "--out", tmp_path / "out", "--no-report").status == 0
    result = document(tmp_path / "out")
    assert_shape(result, INTERFACE)
    assert (result["schema"], result["status"], result["method"]) == ("starplumb-result/1", "ok", "default")
    C_EK = np.array(result["mounting"]["matrix"])
    np.testing.assert_allclose(C_EK @ C_EK.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(so3.from_quaternion(result["mounting"]["quaternion_xyzw"]), C_EK, atol=1e-14)
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(result["covariance_arcsec2"])), result["sigma_arcsec"], rtol=1e-12
    )
    assert result["fit"]["images"] == 8
    assert result["fit"]["observations"] == 80
    assert result["fit"]["degrees_of_freedom"] == 157
    files = set(result["inputs"]) - {"campaign.toml"}
    assert files == names(path.parent) - {"campaign.toml", "campaign.schema.json"}
    assert all(digest.startswith("sha256:") and len(digest) == 71 for digest in result["inputs"].values())


def test_residuals_have_a_row_for_every_sighting_and_agree_with_the_fit(tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 2)
    starplumb("calibrate", path, "--out", tmp_path, "--no-report")
    with (tmp_path / "residuals.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    with (path.parent / "observations.csv").open(encoding="utf-8", newline="") as file:
        sighted = [(row["image_id"], row["landmark_id"], row["role"]) for row in csv.DictReader(file)]
    assert [(row["image_id"], row["landmark_id"], row["role"]) for row in rows] == sighted
    used = [row for row in rows if row["role"] == "control"]
    left = [float(row[name]) for row in used for name in ("after_column_px", "after_row_px")]
    assert document(tmp_path)["fit"]["rms_px"] == pytest.approx(np.sqrt(np.mean(np.square(left))), rel=1e-9)


def test_mounting_kernel_gives_the_same_rotation_in_spice(tmp_path: Path) -> None:
    spiceypy = pytest.importorskip("spiceypy")
    starplumb("calibrate", demo(tmp_path / "demo", "--images", 2), "--out", tmp_path, "--no-report")
    spiceypy.kclear()
    spiceypy.furnsh(str(tmp_path / "mounting.tf"))
    try:
        C_EK = spiceypy.pxform("CAMERA", "STAR_TRACKER", 0.0)
    finally:
        spiceypy.kclear()
    np.testing.assert_allclose(C_EK, document(tmp_path)["mounting"]["matrix"], atol=1e-15)


@pytest.mark.slow
def test_files_of_an_earlier_result_do_not_stay_beside_a_failed_one(tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 1)
    assert starplumb("calibrate", path, "--quiet").status == 0
    out = path.parent / "result"
    assert names(out) == {*FILES, "report.html"}
    keep_rows(path.parent / "observations.csv", 1)
    assert starplumb("calibrate", path, "--no-report").status == 3
    assert names(out) == {"result.json", "residuals.csv"}


# Answers ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("camera", ["frame", "line-scan"])
def test_the_truth_lies_within_four_sigma_whatever_the_seed(camera: str, tmp_path: Path) -> None:
    ratios = []
    for seed in range(6):
        path = demo(tmp_path / str(seed), "--camera", camera, "--seed", seed, "--images", 4)
        starplumb("calibrate", path, "--out", tmp_path / "out", "--no-report", "--quiet")
        result = document(tmp_path / "out")
        C_true = so3.from_quaternion(result["truth"]["quaternion_xyzw"])
        error = so3.log(np.array(result["mounting"]["matrix"]) @ C_true.T) * 180 / np.pi * 3600
        ratios.append(error / result["sigma_arcsec"])
    assert np.abs(ratios).max() < 4.0
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 1.7, "18 values whose root mean square is 1"


def test_methods_are_named_and_a_wrong_name_is_told_the_right_ones(tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 2)
    assert starplumb("calibrate", path, "--method", "wahba", "--out", tmp_path, "--no-report").status == 0
    result = document(tmp_path)
    assert (result["method"], result["sigma_arcsec"]) == ("wahba", None)
    assert_refused(starplumb("calibrate", path, "--method", "glz"), "--method", "'glz'", "did you mean gls?")


@pytest.mark.slow
def test_location_of_a_marker_is_where_it_was_surveyed(tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 2)
    starplumb("calibrate", path, "--quiet", "--no-report")
    with (path.parent / "observations.csv").open(encoding="utf-8", newline="") as file:
        seen = next(iter(csv.DictReader(file)))
    with (path.parent / "landmarks.csv").open(encoding="utf-8", newline="") as file:
        mark = next(row for row in csv.DictReader(file) if row["landmark_id"] == seen["landmark_id"])
    place = [seen["column_px"], seen["row_px"], "--image", seen["image_id"], "--height-m", mark["height_m"]]
    result = ["--result", path.parent / "result" / "result.json"]
    found = json.loads(starplumb("locate", path, *place, *result, "--sigma-px", 0.3, "--json").out)
    metres = [
        (found[key] - float(mark[key])) * 111e3 * (np.cos(np.radians(found["latitude_deg"])) if i else 1.0)
        for i, key in enumerate(("latitude_deg", "longitude_deg"))
    ]
    east, north, up = found["sigma_east_north_up_m"]
    assert np.hypot(*metres) < 4.0 * np.hypot(east, north) < 120.0
    assert up < 1e-3
    unknown = json.loads(starplumb("locate", path, *place, "--result", "model", "--json").out)
    assert "model" in unknown["mounting"]
    assert unknown["sigma_east_north_up_m"] is None


# Output -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("command", ["calibrate", "compare"])
def test_json_is_all_that_standard_output_carries(command: str, tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 2)
    slow = ["--no-report"] if command == "calibrate" else []
    spoken = starplumb(command, path, "--out", tmp_path, "--json", *slow)
    assert (spoken.status, spoken.err) == (0, "")
    file = "result.json" if command == "calibrate" else "compare.json"
    written = json.loads((tmp_path / file).read_text(encoding="utf-8"))
    written.pop("files", None)  # they say what lies beside it
    assert json.loads(spoken.out) == written


@pytest.mark.slow
def test_quiet_commands_say_nothing(tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 2)
    swap("images.csv", "image_id,time\n", "image_id,time,remark\n")(path.parent)
    swap("images.csv", "000\n", "000,x\n", 2)(path.parent)
    nothing = Spoken(0, "", "")
    loud = starplumb("calibrate", path, "--no-report")
    assert loud.err.startswith("starplumb: note: ")
    assert starplumb("calibrate", path, "--quiet", "--no-report") == nothing
    assert starplumb("locate", path, 1, 1, "--image", "image01", "--quiet") == nothing


@pytest.mark.slow
def test_tables_are_whole_in_a_pipe_and_names_are_shown_as_they_are(tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 2)
    swap("campaign.toml", "starplumb demo", "[/b] :star: [x]")(path.parent)
    for command in (["calibrate", "--no-report"], ["compare"]):
        spoken = starplumb(*command, path)
        assert spoken.status == 0
        assert "[/b] :star: [x]" in spoken.out
        assert "…" not in spoken.out
    lines = [line.rstrip() for line in spoken.out.split("gls:")[0].splitlines()]
    times = [line.split()[-1] for line in lines if line.split()[1:2] == ["x"]]
    assert max(map(len, lines)) - max(map(len, times)) <= 75  # however many milliseconds they are
    rows = [line.split() for line in spoken.out.splitlines() if line.startswith((" gls ", " projective "))]
    assert [(row[0], row[1], len(row)) for row in rows] == [("gls", "x", 7), ("projective", "x", 7)]


# Mistakes -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("case", BAD_CASES, ids=lambda case: case.name)
def test_wrong_input_is_refused_in_one_line_and_nothing_is_written(case: BadCase, tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path / "campaign")
    case.spoil(path.parent)
    before = names(path.parent)
    # calibrate labels detections itself; the other commands want landmarks
    command = "compare" if case.name == "detections-only" else "calibrate"
    assert_refused(starplumb(command, path, "--out", tmp_path / "out"), *case.says)
    assert names(path.parent) == before
    assert names(tmp_path) == {"campaign"}


@pytest.mark.slow
def test_a_mistake_ends_with_status_2_and_no_traceback(tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 2)
    (tmp_path / "taken").write_text("a file")
    swap("images.csv", "image02,2025-06", "image02,2025-07")(path.parent)
    place = ("--image", "image01")
    cases = [
        (("calibrate", path), "images.csv, image 'image02': found the epoch 2025-07-21"),
        (("compare", path), "images.csv, image 'image02'"),
        (("calibrate", "absent.toml"), "absent.toml: found no such file"),
        (("init", path.parent), "wanted a new or empty folder"),
        (("init", tmp_path / "taken"), "taken"),
        (("locate", path, 1, 1, "--image", "x"), "--image: found 'x', wanted one of image01"),
        (("locate", path, 12000, 1, *place), "COLUMN: found 12000, wanted -0.5 to 11999.5"),
        (("locate", path, 1, "nan", *place), 'ROW: found "nan"'),
        (("locate", path, 1, 1, *place, "--height-m", "inf"), '--height-m: found "inf"'),
        (("locate", path, 1, 1, *place, "--result", "absent.json"), "absent.json"),
        (("import", tmp_path / "absent", tmp_path / "new"), "absent: "),
    ]
    for arguments, says in cases:
        assert_refused(starplumb(*arguments), says)
    for at in (0, 3, -2, -1):
        assert_refused(process(*cases[at][0]), cases[at][1])
    assert names(tmp_path) == {"demo", "taken"}
    assert "result" not in names(path.parent)


@pytest.mark.slow
def test_wrong_usage_ends_with_status_2() -> None:
    for arguments in (["calibrate"], ["calibrate", "--colour"], ["paint"], ["init", "x", "--images", "0"]):
        spoken = starplumb(*arguments)
        assert (spoken.status, spoken.out) == (2, "")
        assert spoken.err.startswith("starplumb: ")
        assert spoken.err.count("\n") == 1


@pytest.mark.parametrize("place", ["file", "below a file", "locked"])
def test_a_folder_that_cannot_be_written_is_named(place: str, tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 2)
    (tmp_path / "file").write_text("here first")
    out = {
        "file": tmp_path / "file",
        "below a file": tmp_path / "file" / "out",
        "locked": tmp_path / "locked",
    }
    if place == "locked":
        if os.geteuid() == 0:
            pytest.skip("the superuser may write anywhere")
        out[place].mkdir(mode=0o500)
    refused = starplumb("calibrate", path, "--no-report", "--out", out[place])
    assert_refused(refused, str(out[place]), "can be written")
    assert (tmp_path / "file").read_text() == "here first"


def keep_rows(table: Path, count: int) -> None:
    """Only the header and the last ``count`` rows stay (the first ones are check points)."""
    lines = table.read_text(encoding="utf-8").splitlines(keepends=True)
    table.write_text("".join([lines[0], *lines[-count:]]), encoding="utf-8")


@pytest.mark.slow
def test_one_marker_is_singular_and_the_result_says_why(tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 1)
    keep_rows(path.parent / "observations.csv", 1)
    spoken = process("calibrate", path, "--quiet")
    assert (spoken.status, spoken.out, spoken.err.count("\n")) == (3, "", 1)
    result = document(path.parent / "result")
    assert result["status"] == "singular"
    assert result["message"]
    assert result["message"] in spoken.err
    assert "mounting.tf" not in names(path.parent / "result")
    kept = ["--result", path.parent / "result" / "result.json"]
    assert_refused(starplumb("locate", path, 1, 1, "--image", "image01", *kept), "status", "singular")
    assert starplumb("compare", path, "--quiet").status == 3


@pytest.mark.slow
def test_a_result_of_another_campaign_is_not_taken(tmp_path: Path) -> None:
    path = demo(tmp_path / "demo", "--images", 2)
    starplumb("calibrate", path, "--quiet", "--no-report")
    kept = path.parent / "result" / "result.json"
    swap("campaign.toml", 'to = "star_tracker"', 'to = "str_2"', 2)(path.parent)
    place = ["locate", path, 1, 1, "--image", "image01", "--result", kept]
    assert_refused(starplumb(*place), "camera to star_tracker", "wanted camera to str_2")
    kept.write_text("{}")
    assert_refused(starplumb(*place), "result.json", "starplumb-result/1")
