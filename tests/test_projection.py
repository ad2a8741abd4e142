"""From the ground to pixels: the inverse of locate, with its sigmas."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import starplumb as sp
from command import demo, starplumb
from starplumb.cli.app import app
from starplumb.physics import so3
from starplumb.physics.earth import C_JT
from starplumb.physics.units import ARCSEC, DEG
from starplumb.session.campaign import write_demo


@pytest.fixture(scope="module")
def frame():
    return sp.demo(images=3)


@pytest.fixture(scope="module")
def scanner():
    return sp.demo("line-scan", images=3)


def there_and_back(campaign, image, column, row, height_m):
    place = sp.locate(campaign, "model", image=image, column=column, row=row, height_m=height_m)
    d = place.document
    return d, sp.project(
        campaign,
        "model",
        image=image,
        latitude_deg=d["latitude_deg"],
        longitude_deg=d["longitude_deg"],
        height_m=d["height_m"],
    )


@pytest.mark.parametrize("kind", ["frame", "scanner"])
@pytest.mark.parametrize(("column", "row"), [(0, 0), (5999.5, 3000.25), (11000.75, 17.5), (-0.4, 8000)])
def test_a_located_pixel_is_where_its_place_appears(request, kind, column, row):
    campaign = request.getfixturevalue(kind)
    d, found = there_and_back(campaign, "image02", column, row, 321.0)
    (point,) = found.document["points"]
    assert point["image_id"] == "image02"
    np.testing.assert_allclose([point["column_px"], point["row_px"]], [column, row], atol=2e-4)
    same = sp.project(campaign, "model", image="image02", itrf_m=d["itrf_m"]).document["points"][0]
    np.testing.assert_allclose(same["row_px"], point["row_px"], atol=2e-4)


def test_a_line_of_detectors_along_y(shared_cases):
    campaign = sp.read_campaign(shared_cases / "detectors_along_y" / "campaign.toml")
    _, found = there_and_back(campaign, "I", 300.0, 700.0, 0.0)
    (point,) = found.document["points"]
    np.testing.assert_allclose([point["column_px"], point["row_px"]], [300.0, 700.0], atol=2e-4)


@pytest.mark.slow
def test_sigmas_are_those_of_the_mounting_the_image_and_the_place(scanner):
    """The pixel moves, by differences, as mounting, attitude, position and place do: ``J P J^T``."""
    loaded = scanner.loaded
    c = replace(loaded.campaign, sigma_mounting=np.array([3.0, 4.0, 50.0]) * ARCSEC)
    campaign = replace(scanner, loaded=replace(loaded, campaign=c))
    place = sp.locate(campaign, "model", image="image01", column=4000, row=900, height_m=100.0).document
    p_J = np.array(place["itrf_m"])
    stated = sp.project(
        campaign, "model", image="image01", itrf_m=p_J.tolist(), sigma_m=2.0, sigma_height_m=5.0
    )
    covariance = np.array(stated.document["points"][0]["covariance_px2"])

    def pixel(campaign, p_J):
        (point,) = sp.project(campaign, "model", image="image01", itrf_m=p_J.tolist()).document["points"]
        return np.array([point["column_px"], point["row_px"]])

    def with_model(d_E):
        turned = replace(c, C_EK=so3.exp(d_E) @ c.C_EK)
        return replace(campaign, loaded=replace(loaded, campaign=turned))

    def moved(d_J):
        orbit = replace(c.ephemeris, r_J=c.ephemeris.r_J + d_J)
        return replace(campaign, loaded=replace(loaded, campaign=replace(c, ephemeris=orbit)))

    def slope(at, h):
        return np.stack([(at(h * axis) - at(-h * axis)) / (2 * h) for axis in np.eye(3)], axis=1)

    turn = slope(lambda d_E: pixel(with_model(d_E), p_J), 1e-5)
    shift = slope(lambda d_J: pixel(moved(d_J), p_J), 50.0)
    step = slope(lambda d_J: pixel(campaign, p_J + d_J), 50.0)
    C = C_JT(place["latitude_deg"] * DEG, place["longitude_deg"] * DEG)
    wanted = turn @ (np.diag(c.sigma_mounting**2) + c.cov_attitude_E) @ turn.T
    wanted += shift @ np.diag(c.sigma_position**2) @ shift.T
    wanted += step @ C @ np.diag([4.0, 4.0, 25.0]) @ C.T @ step.T
    np.testing.assert_allclose(covariance, wanted, rtol=3e-3, atol=1e-3 * np.max(wanted))
    np.testing.assert_allclose(stated.document["points"][0]["sigma_px"], np.sqrt(np.diagonal(covariance)))


def test_landmarks_appear_where_they_were_measured(frame):
    """By the true mounting: within a few sigmas of the demo's own errors, of which attitude's is 5 arcsec or 6 px."""
    loaded = frame.loaded
    true = replace(frame, loaded=replace(loaded, campaign=replace(loaded.campaign, C_EK=loaded.C_EK_true)))
    found = {(p["image_id"], p["landmark_id"]): p for p in sp.project(true, "model").document["points"]}
    s = loaded.campaign.sightings
    for k in range(s.image.size):
        point = found[frame.images[s.image[k]], frame.landmarks[s.landmark[k]]]
        assert np.hypot(point["column_px"] - s.column_px[k], point["row_px"] - s.row_px[k]) < 40.0


def test_places_that_do_not_appear_are_counted_by_why(frame):
    d, _ = there_and_back(frame, "image01", 100.0, 100.0, 0.0)
    latitude, longitude = d["latitude_deg"], d["longitude_deg"]
    table = {
        "landmark_id": ["in", "beside", "far side"],
        "latitude_deg": [latitude, latitude + 1.0, -latitude],
        "longitude_deg": [longitude, longitude, longitude - 180.0],
        "height_m": [0.0, 0.0, 0.0],
    }
    found = sp.project(frame, "model", points=table, image="image01")
    assert [p["landmark_id"] for p in found.document["points"]] == ["in"]
    assert found.document["left_out"] == {"beside_the_image": 1, "below_the_horizon": 1, "not_covered": 0}
    assert found.document["in_no_image"] == ["beside", "far side"]
    assert found.told == (
        "left out: 1 beside the image, 1 below the horizon (pairs of image and place)",
        "in no image: beside, far side",
    )


def test_places_beyond_a_scanners_rows_are_left_out(scanner):
    """Eight rows before the first one of an image of 9000 rows, by the step of the first five."""
    loaded = scanner.loaded
    camera = replace(loaded.campaign.camera, size_px=(loaded.campaign.camera.size_px[0], 9000.0))
    whole = replace(scanner, loaded=replace(loaded, campaign=replace(loaded.campaign, camera=camera)))
    first, fifth = (
        np.array(sp.locate(whole, "model", image="image01", column=500, row=row).document["itrf_m"])
        for row in (0, 5)
    )
    step = (fifth - first) / 5
    for rows, inside in ((-8, False), (8, True)):
        found = sp.project(whole, "model", itrf_m=(first + rows * step).tolist(), image="image01").document
        assert len(found["points"]) == inside
        assert found["left_out"]["beside_the_image"] == (not inside)


@pytest.mark.parametrize("rows", [9000, None])
def test_rows_without_attitude_are_refused_or_left_out(scanner, rows):
    """With an attitude that starts at row 500, the place of row 400 is known to be somewhere before."""
    loaded = scanner.loaded
    c = loaded.campaign
    if rows is not None:
        camera = replace(c.camera, size_px=(c.camera.size_px[0], float(rows)))
        c = replace(c, camera=camera)
    t_ns = c.images.exposed(np.zeros(4, dtype=np.int64), [500.0, 2500.0, 5500.0, 12000.0])
    C_EJ, _ = c.attitude.at(t_ns)
    short = replace(
        c.attitude, t_ns=t_ns, q_EF=so3.to_quaternion(C_EJ), frame="ITRF", orientation=None, gap_s=60.0
    )

    def cut(outside):
        return replace(scanner, loaded=replace(loaded, campaign=replace(c, attitude=short), outside=outside))

    early, late = (
        sp.locate(scanner, "model", image="image01", column=500, row=row).document["itrf_m"]
        for row in (400, 700)
    )
    skip = cut("skip")
    (point,) = sp.project(skip, "model", image="image01", itrf_m=late).document["points"]
    np.testing.assert_allclose([point["column_px"], point["row_px"]], [500, 700], atol=0.05)
    left_out = sp.project(skip, "model", image="image01", itrf_m=early).document["left_out"]
    assert left_out == {"beside_the_image": 0, "below_the_horizon": 0, "not_covered": 1}
    with pytest.raises(sp.InputError, match=r"image 'image01': found the epoch .* never extrapolated"):
        sp.project(cut("refuse"), "model", image="image01", itrf_m=early)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"latitude_deg": 45.0}, "latitude_deg: found without longitude_deg, wanted both"),
        (
            {"latitude_deg": 45.0, "longitude_deg": 9.0},
            "place: found places without heights, wanted a column",
        ),
        (
            {"latitude_deg": 95.0, "longitude_deg": 9.0, "height_m": 0.0},
            "column latitude_deg: found 95, wanted -90",
        ),
        ({"itrf_m": [1.0, 2.0]}, "itrf_m: found 2 numbers, wanted three numbers"),
        (
            {"itrf_m": [1.0, 2.0, 3.0]},
            "place, columns x_m, y_m, z_m: found 3.741657 m, wanted a place on the ground",
        ),
        ({"itrf_m": [6378137.0, 0.0, 0.0], "points": {}}, "points: found beside itrf_m, wanted only one"),
        ({"points": {"x": [1.0]}}, "points: found neither latitude_deg nor x_m"),
        ({"image": "image9"}, "image: found 'image9', wanted one of image01"),
    ],
)
def test_what_cannot_be_projected_is_said(frame, arguments, says):
    with pytest.raises(sp.InputError) as refused:
        sp.project(frame, "model", **arguments)
    assert says in str(refused.value)


# The command ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return str(write_demo(tmp_path_factory.mktemp("demo"), "frame", 2)[0])


def run(*arguments, **more):
    return CliRunner().invoke(app, ["project", *arguments], **more)


@pytest.mark.slow
def test_a_table_of_a_file_is_that_of_standard_input(path):
    table = path.replace("campaign.toml", "landmarks.csv")
    of_file = run(path, table, "--image", "image02")
    of_input = run(path, "-", "--image", "image02", input=Path(table).read_text())
    own = run(path, "--image", "image02")
    assert of_file.stdout == of_input.stdout == own.stdout
    rows = list(csv.DictReader(of_file.stdout.splitlines()))
    assert list(rows[0])[:4] == ["image_id", "landmark_id", "column_px", "row_px"]
    assert {row["image_id"] for row in rows} == {"image02"}
    assert "beside the image (pairs" in of_file.stderr


def test_one_place_south_and_west(path, monkeypatch):
    """A negative number is no option."""
    found = run(path, "-33.5", "-70.25", "500")
    assert "found the place in no image asked for" in str(found.exception)
    found = run(path, "-33.5", "-70.25", "--height-m", "-4.5", "--json")
    assert "found the place in no image asked for" in str(found.exception)


def test_json_is_a_document_with_a_schema(path):
    from starplumb.documents.projection import ProjectionDocument

    document = json.loads(run(path, "--json").stdout)
    assert ProjectionDocument.of(document).to_dict() == document


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["1", "2", "3", "4"], 'places: found "1 2 3 4", wanted latitude, longitude'),
        (["--itrf", "1", "2"], 'places: found "1 2", wanted x, y and z (m)'),
        (["--itrf", "table.csv"], "--itrf: found beside a table"),
        (["north", "2", "3"], 'places: found "north 2 3"'),
        (["missing.csv"], "missing.csv: found no such file"),
    ],
)
def test_wrong_places_are_refused(path, arguments, says):
    assert says in str(run(path, *arguments).exception)


def test_standard_input_is_named_as_such(path):
    found = run(path, "-", input="latitude_deg,longitude_deg,height_m\n1,2,x\n")
    assert str(found.exception).startswith('standard input, row 2, column height_m: found "x"')


def test_an_image_id_asks_for_one_image(path, tmp_path):
    table = tmp_path / "sites.csv"
    table.write_text("image_id,x_m,y_m,z_m\nimage02,6378137,0,0\nimage01,6378137,0,0\nimage9,6378137,0,0\n")
    assert "found 'image9', wanted one of image01, image02" in str(run(path, str(table)).exception)


def test_places_without_end_are_refused_before_they_are_kept(tmp_path, monkeypatch):
    from starplumb.io.campaign.marks import sites
    from starplumb.io.text import files

    campaign = demo(tmp_path / "demo")
    monkeypatch.setattr(files, "MOST_TEXT", 100_000)
    with Path("/dev/zero").open() as endless, monkeypatch.context() as patched:
        patched.setattr("sys.stdin", endless)
        done = starplumb("project", campaign, "-")
    said = "standard input: found more than 100,000 bytes, wanted at most that many"
    assert (done.status, done.err) == (2, f"starplumb: {said}\n")
    table = tmp_path / "y.csv"
    table.write_text("1,2,3,4\n" * 20_000, encoding="utf-8")
    monkeypatch.setattr(sites, "MOST_TEXT", 150_000)
    assert "y.csv: found 160,000 bytes, wanted at most 150,000" in starplumb("project", campaign, table).err
    table.write_text("latitude_deg,longitude_deg,height_m\n45,10,0\n46,10,0\n", encoding="utf-8")
    monkeypatch.setattr(sites, "MOST_SITES", 1)
    assert "y.csv: found 2 places, wanted at most 1 at a time" in starplumb("project", campaign, table).err
