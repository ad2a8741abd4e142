"""Mistakes planted in the files of good campaigns are named; good campaigns have none named."""

from __future__ import annotations

import csv
import json
import math
import re
import tomllib
from dataclasses import replace
from datetime import datetime, timedelta

import erfa
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from command import starplumb
from problems import C_EK_TRUE, FRAME, LINE, SIGMAS, truth
from starplumb.cli.app import app
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.judge.conventions import shown
from starplumb.judge.conventions.frames_and_times import _of_date, misread_frames_and_times
from starplumb.judge.conventions.mistake import Written
from starplumb.judge.diagnose import diagnose
from starplumb.judge.diagnosis_text import sentences
from starplumb.judge.files.digits import with_rounding
from starplumb.judge.files.evidence import Evidence
from starplumb.judge.trials import tried
from starplumb.physics.camera import FrameCamera, LineScanCamera
from starplumb.physics.errors import InputError
from starplumb.physics.light import Corrections
from starplumb.physics.orientation import C_IF, FRAMES_OF_DATE
from starplumb.physics.timescales import format_iso, tt_julian
from starplumb.physics.units import ARCSEC
from starplumb.plan.demo import demo
from starplumb.plan.scene import measured
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors


@pytest.fixture(scope="module", params=["frame", "line-scan"])
def kind(request):
    return request.param


@pytest.fixture(scope="module")
def good(tmp_path_factory, kind):
    """Folder of a good campaign; tests copy it."""
    folder = tmp_path_factory.mktemp(kind) / "good"
    campaign, _ = demo(kind, 4, 11)
    write_campaign(folder, campaign)
    return folder


class Spoiled:
    """A copy of a campaign's folder whose files a test may spoil."""

    def __init__(self, good, folder):
        self.folder = folder
        for path in good.iterdir():
            (folder / path.name).write_bytes(path.read_bytes())

    @property
    def path(self):
        return self.folder / "campaign.toml"

    def replace(self, old, new):
        text = self.path.read_text()
        assert old in text
        self.path.write_text(text.replace(old, new))

    def rewrite(self, name, change):
        """Rows of a table through ``change`` (a dictionary in, a dictionary out)."""
        path = self.folder / f"{name}.csv"
        with path.open() as file:
            rows = [change(row) for row in csv.DictReader(file)]
        with path.open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)

    def move_times(self, name, seconds):
        def later(row):
            whole, _, fraction = row["time"].partition(".")
            moved = datetime.fromisoformat(whole) + timedelta(seconds=seconds)
            return row | {"time": f"{moved.isoformat()}.{fraction}"}

        self.rewrite(name, later)

    def mounting(self):
        return Rotation.from_quat(tomllib.loads(self.path.read_text())["mounting"]["quaternion_xyzw"])

    def set_mounting(self, q_xyzw):
        text = self.path.read_text()
        line = f"quaternion_xyzw = {[float(x) for x in q_xyzw]}"
        self.path.write_text(re.sub(r"quaternion_xyzw = \[.*?\]", line, text, count=1))

    def diagnose(self):
        return diagnose(load_campaign(self.path).campaign)


@pytest.fixture
def spoiled(good, tmp_path):
    return Spoiled(good, tmp_path)


def scalar_first(row):
    q = dict(zip(("qx", "qy", "qz", "qw"), (row["qw"], row["qx"], row["qy"], row["qz"]), strict=True))
    return row | q


def conjugated(row):
    return row | {name: repr(-float(row[name])) for name in ("qx", "qy", "qz")}


def swapped(row):
    return row | {"column_px": row["row_px"], "row_px": row["column_px"]}


def from_the_right(row):
    return row | {"column_px": repr(11999.0 - float(row["column_px"]))}


def both(row):
    return scalar_first(conjugated(row))


def binned(row):
    """In pixels of 2 x 2."""
    pixel = {name: repr((float(row[name]) + 0.5) / 2 - 0.5) for name in ("column_px", "row_px")}
    return row | pixel | {"sigma_px": repr(float(row["sigma_px"]) / 2)}


def exchanged(row):
    return row | {"latitude_deg": row["longitude_deg"], "longitude_deg": row["latitude_deg"]}


def west_positive(row):
    return row | {"longitude_deg": repr(-float(row["longitude_deg"]))}


def geocentric(row):
    """(1 - e^2) tan(geodetic) on the ellipsoid, e^2 = 0.00669437999014 of WGS84."""
    tangent = (1.0 - 0.00669437999014) * math.tan(math.radians(float(row["latitude_deg"])))
    return row | {"latitude_deg": repr(math.degrees(math.atan(tangent)))}


def in_feet(row):
    return row | {"height_m": repr(float(row["height_m"]) / 0.3048)}


def above_the_geoid(row):
    return row | {"height_m": repr(float(row["height_m"]) - 60.0)}


TABLES = {
    "landmarks.exchanged": ("landmarks", exchanged),
    "landmarks.longitude_sign": ("landmarks", west_positive),
    "landmarks.geocentric": ("landmarks", geocentric),
    "landmarks.feet": ("landmarks", in_feet),
    "landmarks.height_offset": ("landmarks", above_the_geoid),
    "binning.binned2": ("observations", binned),
    "attitude.order": ("attitude", scalar_first),
    "attitude.direction": ("attitude", conjugated),
    "attitude.order+direction": ("attitude", both),
    "pixels.swapped": ("observations", swapped),
    "pixels.column_px_from_right": ("observations", from_the_right),
}


@pytest.mark.slow
@pytest.mark.parametrize("key", TABLES)
def test_a_misread_table_is_named(spoiled, key):
    spoiled.rewrite(*TABLES[key])
    found = spoiled.diagnose()
    assert found.verdict == "named"
    # a straight line of detectors turned by 180 deg is that line counted from its other end
    assert [key] in [[m.key for m in trial.undone] for trial in (found.best, *found.rivals)]
    assert found.stated.score > 20.0 + found.best.score
    assert 0.5 < found.best.chi2 / found.best.degrees_of_freedom < 1.6


KEYS = {
    "attitude.frame": ('from = "GCRF"', 'from = "ITRF"'),
    "ephemeris.frame": ('frame = "ITRF"', 'frame = "GCRF"'),
}


@pytest.mark.slow
@pytest.mark.parametrize("key", KEYS)
def test_a_wrong_key_is_named(spoiled, key):
    spoiled.replace(*KEYS[key])
    found = spoiled.diagnose()
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == [key]


OPTICS = {
    "camera.unit.1000": (2.2e-3, 5999.5),
    "camera.focal_length": (2.206, 5999.5),
    "window.offset": (2.2, 4499.5),
}
"""Focal length (m) and principal column stated in place of 2.2 and 5999.5."""


@pytest.mark.slow
@pytest.mark.parametrize("key", OPTICS)
def test_optics_that_are_stated_wrong_are_named(kind, key):
    campaign, _ = demo(kind, 4, 11)
    focal_length, column = OPTICS[key]
    if kind == "frame":
        camera = FrameCamera(focal_length, 9e-6, (column, 5999.5), (12000, 12000))
    else:
        camera = LineScanCamera.from_optics(focal_length, 9e-6, (column, 0.0), 12000, rows=12000)
    found = diagnose(replace(campaign, camera=camera))
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == [key]


@pytest.mark.parametrize(("table", "seconds"), [("images", 18), ("attitude", -37), ("ephemeris", 18)])
def test_a_table_in_another_time_scale_is_named(spoiled, table, seconds):
    """18 s: GPS time in a campaign of UTC; -37 s: as if the leap seconds had been taken off twice."""
    spoiled.move_times(table, seconds)
    found = spoiled.diagnose()
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == [f"times.{table}{-seconds:+d}s"]


@pytest.mark.slow
def test_all_times_in_gps_are_told_from_the_turn_of_the_earth(spoiled):
    """UTC called GPS: all tables agree, only the Earth has turned by 270 arcsec, seen where images are turned."""
    spoiled.replace('time_scale = "UTC"', 'time_scale = "GPS"')
    found = spoiled.diagnose()
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == ["times.all+18s"]


@pytest.mark.slow
@pytest.mark.parametrize("mistake", ["direction", "order"])
def test_a_misread_mounting_is_named(spoiled, mistake):
    """It leaves no residual, but a correction of many degrees."""
    q = spoiled.mounting().as_quat()
    spoiled.set_mounting(np.roll(q, 1) if mistake == "order" else q * [-1.0, -1.0, -1.0, 1.0])
    found = spoiled.diagnose()
    assert found.verdict == "named"
    assert found.stated.chi2 == pytest.approx(found.best.chi2)
    assert f"mounting.{mistake}" in [t.undone[0].key for t in (found.best, *found.rivals)]
    assert found.best.correction < np.deg2rad(1.5)


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "angle"), [("x", 90), ("y", -90), ("z", 180)])
def test_axes_off_by_a_quarter_turn_are_named(spoiled, axis, angle):
    turned = spoiled.mounting() * Rotation.from_euler(axis, -angle, degrees=True)
    spoiled.set_mounting(turned.as_quat())
    found = spoiled.diagnose()
    assert found.verdict == "named"
    assert f"axes.camera.{axis}{angle:+d}" in [t.undone[0].key for t in (found.best, *found.rivals)]
    assert found.best.correction < np.deg2rad(1.5)


@pytest.mark.slow
def test_a_direction_written_from_the_tracker_is_undone_in_its_own_terms(spoiled):
    """With from = star tracker the file holds inverse quaternions: scalar first is another mistake than else."""
    spoiled.rewrite("attitude", conjugated)
    spoiled.replace('from = "GCRF"\nto = "star_tracker"', 'from = "star_tracker"\nto = "GCRF"')
    spoiled.rewrite("attitude", scalar_first)
    result = CliRunner().invoke(app, ["diagnose", str(spoiled.path), "--json"])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["verdict"] == "named"
    assert [m["key"] for m in document["best"]["undone"]] == ["attitude.order"]


@pytest.mark.slow
def test_two_mistakes_at_once_are_both_named(spoiled):
    spoiled.rewrite("attitude", scalar_first)
    spoiled.move_times("images", 18)
    found = spoiled.diagnose()
    assert found.verdict == "named"
    assert {m.key for m in found.best.undone} == {"attitude.order", "times.images-18s"}


@pytest.mark.slow
@pytest.mark.parametrize("in_data", [True, False])
def test_a_wrong_aberration_switch_is_named(kind, in_data, rng):
    """Sharp attitude and images turned to one another: the switch cannot hide in the mounting."""
    camera, yaw = (FRAME, 90.0) if kind == "frame" else (LINE, 180.0)
    sharp = replace(SIGMAS, attitude=np.full(3, 1.0 * ARCSEC))
    scene = truth(camera, 8, 6, yaw_deg=yaw, corrections=Corrections(aberration=in_data), sigmas=sharp)
    campaign = measured(scene, Errors.draw(observe(scene), rng), C_EK_TRUE)
    wrong = replace(campaign, corrections=replace(campaign.corrections, aberration=not in_data))
    assert diagnose(campaign).verdict == "none"
    found = diagnose(wrong)
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == ["corrections.aberration"]


@pytest.mark.slow
def test_half_a_pixel_shows_against_a_well_known_mounting_only(rng):
    """A constant shift of all pixels is a turn of the camera: only what is known of the mounting can tell."""
    exact = replace(SIGMAS, attitude=np.full(3, 0.02 * ARCSEC), position=np.full(3, 0.05), pixel=0.1)
    scene = truth(FRAME, 8, 6, sigmas=exact)
    campaign = measured(scene, Errors.draw(observe(scene), rng), C_EK_TRUE)
    s = campaign.sightings
    corner = replace(campaign, sightings=replace(s, column_px=s.column_px + 0.5, row_px=s.row_px + 0.5))
    assert diagnose(corner).verdict == "none"
    surveyed = replace(corner, sigma_mounting=np.full(3, 0.05 * ARCSEC))
    found = diagnose(surveyed)
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == ["pixels.origin-0.5"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_named_on_good_campaigns(kind, seed):
    campaign, _ = demo(kind, 2 + seed % 5, 100 + seed)
    found = diagnose(campaign)
    assert found.best is None
    assert found.verdict == "none"


@pytest.mark.slow
def test_what_no_usual_mistake_explains_is_said_to_be_so(spoiled, rng):
    """Every sighting is off by tens of pixels: nothing is left to agree."""
    spoiled.rewrite("observations", lambda row: row | {"column_px": repr(rng.uniform(0.0, 11999.0))})
    found = spoiled.diagnose()
    assert found.verdict == "unexplained"
    assert found.best is None
    assert not any("explains the residuals" in sentence for sentence in sentences(found))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.1, 0.33])
def test_sightings_that_carry_the_misfit_are_proposed_for_rejection(spoiled, rng, share):
    wrong = set()

    def blunder(row):
        if rng.random() > share or row.get("role") == "check":
            return row
        wrong.add((row["image_id"], row["landmark_id"]))
        return row | {
            "column_px": repr(min(max(float(row["column_px"]) + rng.normal(0.0, 400.0), 0.0), 11999.0))
        }

    spoiled.rewrite("observations", blunder)
    found = spoiled.diagnose()
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == ["sightings"]
    assert f"{len(wrong)} of the" in found.best.undone[0].what
    assert "calibrate leaves them out" in found.best.undone[0].remedy


@pytest.mark.slow
def test_a_gross_mistake_is_named_among_blunders(spoiled):
    rows = iter(range(1000))

    def blunder(row):
        return row | {"row_px": repr(6000.0)} if next(rows) % 9 == 4 else row

    spoiled.rewrite("observations", blunder)
    spoiled.rewrite("attitude", scalar_first)
    found = spoiled.diagnose()
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == ["attitude.order", "sightings"]


# Single culprits ----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("arcsec", [80.0, 2000.0])
def test_one_image_with_another_attitude_is_named(good, tmp_path, kind, rng, arcsec):
    campaign, _ = demo(kind, 6, 21)
    near = np.abs(campaign.attitude.t_ns - campaign.images.t_ns[4]) < 8_000_000_000

    def turned(a):
        turn = Rotation.from_rotvec(arcsec * ARCSEC * np.array([0.6, -0.8, 0.0]))
        q = np.where(near[:, None], (turn * Rotation.from_quat(a.q_EF)).as_quat(), a.q_EF)
        return replace(a, q_EF=q)

    found = diagnose(campaign.with_attitude(turned))
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == [f"image.{campaign.images.ids[4]}"]
    assert "2025-06-21T10:31:" in found.best.undone[0].what


@pytest.mark.slow
def test_one_image_with_exchanged_labels_is_named(kind):
    campaign, _ = demo(kind, 5, 22)
    s = campaign.sightings
    mine = np.flatnonzero((s.image == 2) & ~s.check)
    landmark = s.landmark.copy()
    landmark[mine] = np.roll(landmark[mine], 3)
    found = diagnose(replace(campaign, sightings=replace(s, landmark=landmark)))
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == [f"image.{campaign.images.ids[2]}"]


@pytest.mark.slow
def test_one_attitude_sample_off_is_named_with_its_time(kind):
    campaign, _ = demo(kind, 6, 23)
    t_ns = campaign.attitude.t_ns
    row = int(np.argmin(np.abs(t_ns - campaign.images.t_ns[3])))

    def spoil(a):
        q = a.q_EF.copy()
        q[row] = (Rotation.from_rotvec([0.0, 60.0 * ARCSEC, 0.0]) * Rotation.from_quat(q[row])).as_quat()
        return replace(a, q_EF=q)

    found = diagnose(campaign.with_attitude(spoil))
    (named,) = found.best.undone if found.best else found.shown
    assert named.key == f"sample.{format_iso(t_ns[[row]], 'UTC', 3)[0]}"
    assert "60 arcsec" in named.what


@pytest.mark.slow
def test_a_landmark_elsewhere_is_named():
    scene = truth(FRAME, 6, 9, shared_site=True)
    campaign = measured(scene, Errors.draw(observe(scene), np.random.default_rng(5)), C_EK_TRUE)
    r_J = campaign.landmarks.r_J.copy()
    r_J[4] += [60.0, -40.0, 30.0]
    found = diagnose(replace(campaign, landmarks=replace(campaign.landmarks, r_J=r_J)))
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == [f"landmark.{campaign.landmarks.ids[4]}"]


# What the files show -------------------------------------------------------------------------------------------


def decimals(places, *columns):
    return lambda row: row | {name: f"{float(row[name]):.{places}f}" for name in columns}


@pytest.mark.slow
def test_places_of_too_few_digits_are_named(spoiled):
    spoiled.rewrite("landmarks", decimals(3, "latitude_deg", "longitude_deg"))
    found = spoiled.diagnose()
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == ["digits.files"]
    assert "whole multiples of 0.001 deg" in " ".join(sentences(found))


@pytest.mark.slow
def test_quaternions_of_too_few_digits_are_named():
    campaign, _ = demo("frame", 6, 25)
    found = diagnose(
        campaign.with_attitude(lambda a: replace(a, q_EF=np.round(a.q_EF, 4), quaternion_step=1e-4))
    )
    assert found.verdict == "named"
    assert [m.key for m in found.best.undone] == ["digits.files"]


def test_rounding_is_stated_as_an_error_by_hand():
    """Uniform over a step: 2 step / sqrt(12) of a quaternion's turn, 11.9 arcsec of four decimals."""
    campaign, _ = demo("frame", 2, 25)
    s, half = campaign.sightings, np.full(campaign.sightings.image.size, 0.5)
    coarse = replace(
        campaign.with_attitude(lambda a: replace(a, quaternion_step=1e-4)),
        sightings=replace(s, column_px=np.rint(s.column_px), row_px=np.rint(s.row_px), sigma_px=half),
    )
    found = with_rounding(coarse)
    added = np.diagonal(found.cov_attitude_E - campaign.cov_attitude_E, axis1=-2, axis2=-1)
    np.testing.assert_allclose(np.sqrt(added) / ARCSEC, 2e-4 / np.sqrt(12.0) / ARCSEC, rtol=1e-6)
    np.testing.assert_allclose(found.sightings.sigma_px, np.sqrt(0.25 + 1.0 / 12.0))
    np.testing.assert_array_equal(found.landmarks.covariance_J, campaign.landmarks.covariance_J)
    exact = with_rounding(campaign)
    np.testing.assert_array_equal(exact.cov_attitude_E, campaign.cov_attitude_E)
    np.testing.assert_array_equal(exact.sightings.sigma_px, campaign.sightings.sigma_px)


@pytest.mark.parametrize("told", [(), ("sample",)])
def test_a_kind_that_is_told_already_is_not_told_again(monkeypatch, told):
    evidence = [
        Evidence("sample", "s1", "r1"),
        Evidence("same place", "s2", "r2", weakens=False),
        Evidence("shared errors", "s3", "r3"),
        Evidence("trackers", "s4", "r4", weakens=False, refuses=True),
    ]
    monkeypatch.setattr(shown, "findings_of_files", lambda *_: evidence)
    campaign, _ = demo("frame", 2, 25)
    found = [(m.key, m.evidence, m.remedy) for m in shown.shown_by_files(campaign, told)]
    expected = [("sample.files", "s1", "r1"), ("tracker.files", "s4", "r4")]
    assert found == expected[len(told) :]


def test_two_steps_tell_what_fits_from_what_does_not(kind):
    """A right change scores after two steps as after all, a wrong one far from it."""
    campaign, _ = demo(kind, 4, 26)
    wrong = campaign.with_attitude(lambda a: replace(a, q_EF=np.roll(a.q_EF, 1, axis=-1)))
    mistakes = {m.key: m for m in misread_frames_and_times(wrong, Written())}
    right, other = (mistakes[key] for key in ("attitude.order", "attitude.order+direction"))
    rough, full = (tried(wrong, (right,), roughly=roughly) for roughly in (True, False))
    assert rough.score == pytest.approx(full.score, abs=0.01)
    assert tried(wrong, (other,), roughly=True).score > 1e3 * full.score


def test_a_frame_of_date_between_whole_hours_is_that_of_its_series(rng):
    t_ns = rng.integers(600 * 10**15, 800 * 10**15, 200)
    for frame in FRAMES_OF_DATE:
        apart = np.abs(_of_date(frame, t_ns) - C_IF(frame, t_ns)).max()
        assert apart < 5e-5 * ARCSEC


# Frames of date -----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("frame", ["TEME", "TOD", "MOD"])
def test_an_attitude_of_date_is_named(kind, frame):
    """Planted by ERFA's matrices of the models of 1976 and 1980."""
    campaign, _ = demo(kind, 6, 24)
    day, rest = tt_julian(campaign.attitude.t_ns)
    C_FI = erfa.pmat76(day, rest) if frame == "MOD" else erfa.pnm80(day, rest)
    if frame == "TEME":
        C_FI = erfa.rz(erfa.eqeq94(day, rest), C_FI)

    def of_date(a):  # the file's numbers take the frame of date to the tracker
        C_EI = Rotation.from_quat(a.q_EF).as_matrix()
        return replace(a, q_EF=Rotation.from_matrix(C_EI @ C_FI.mT).as_quat())

    found = diagnose(campaign.with_attitude(of_date))
    assert found.verdict == "named"
    assert f"frames.attitude.{frame}" in [t.undone[0].key for t in (found.best, *found.rivals)]


# Cases as users hold them ---------------------------------------------------------------------------------------

CASES = {
    "one_bad_tracker_sample": ("sample.", "IMG0002"),
    "geoid_heights_28deg": ("landmarks.height_offset", "geoid"),
    "weak_but_wrong": ("image.image01", "image01"),
    "slew_2s_silent": ("sampling.attitude", "sampled too coarsely"),
    "image_times_10ms": ("digits.images", "--estimate time_offset=10ms"),
    "trackers_disagree_49x": ("tracker.st2", "--estimate trackers"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_case_is_told_by_its_cause(name, shared_cases):
    spoken = starplumb("diagnose", shared_cases / name / "campaign.toml", "--json")
    assert spoken.status == 0
    document = json.loads(spoken.out)
    key, words = CASES[name]
    assert document["verdict"] == "named"
    (undone,) = document["best"]["undone"]
    assert undone["key"].startswith(key)
    assert words in document["message"]


@pytest.mark.slow
def test_the_command_names_it_in_words(spoiled):
    spoiled.rewrite("attitude", scalar_first)
    result = CliRunner().invoke(app, ["diagnose", str(spoiled.path)])
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    assert "the attitude's quaternions are written scalar first but named scalar last" in text
    assert "explains the residuals" in text
    quiet = CliRunner().invoke(app, ["diagnose", str(spoiled.path), "--quiet"])
    assert (quiet.exit_code, quiet.stdout) == (0, "")


def test_a_campaign_of_check_points_only_is_refused():
    campaign, _ = demo("frame", 2, 1)
    s = campaign.sightings
    with pytest.raises(InputError, match="has no control points"):
        diagnose(replace(campaign, sightings=replace(s, check=np.ones_like(s.check))))
