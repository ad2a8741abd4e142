"""Ground points of QGIS and the Ames Stereo Pipeline, read and turned into a campaign's tables."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from command import starplumb
from starplumb.cli.app import app
from starplumb.estimators.gls import Gls
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.io.points.asp import read_asp
from starplumb.io.points.qgis import read_qgis
from starplumb.io.points.read import read_ground_points
from starplumb.judge.calibrate import calibrate
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.units import DEG
from starplumb.plan.demo import demo

pytest.importorskip("rasterio", reason="needs the extra gis")
# rasterio multiplies its transforms in the old way
pytestmark = pytest.mark.filterwarnings("ignore:Use `@` matmul:PendingDeprecationWarning")

WGS84 = (
    '#CRS: GEOGCRS["WGS 84",DATUM["World Geodetic System 1984",ELLIPSOID["WGS 84",6378137,298.257223563,'
    'LENGTHUNIT["metre",1]]],CS[ellipsoidal,2],AXIS["geodetic latitude (Lat)",north],'
    'AXIS["geodetic longitude (Lon)",east],ANGLEUNIT["degree",0.0174532925199433],ID["EPSG",4326]]\n'
)
QGIS = (
    "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual\n"
    "9.25,45.5,100.5,-200.5,1,0,0,0\n"
    "9.5,45.75,0,0,0,0,0,0\n"
    "9.75,45.25,300.0,-4.0,1,0,0,0\n"
)


def test_qgis_points_count_pixels_from_the_corner_and_rows_upwards(tmp_path):
    path = tmp_path / "scene7.points"
    path.write_text(WGS84 + QGIS)
    found = read_qgis(path)
    np.testing.assert_allclose(found.column_px, [100.0, 299.5])
    np.testing.assert_allclose(found.row_px, [200.0, 3.5])
    np.testing.assert_allclose(found.latitude / DEG, [45.5, 45.25])
    np.testing.assert_allclose(found.longitude / DEG, [9.25, 9.75])
    assert found.image_id == ("scene7", "scene7")
    assert np.isnan(found.height).all()
    assert "left out 1 point that QGIS has switched off" in found.notices[0]


def test_qgis_points_in_a_projection_are_turned_into_degrees(tmp_path):
    """Easting 500 km and northing 0 of UTM zone 33 are 15 deg E, 0 deg N."""
    path = tmp_path / "old.points"
    path.write_text("mapX,mapY,pixelX,pixelY,enable\n500000,0,1,-1,1\n")
    with pytest.raises(InputError, match="found no line #CRS:"):
        read_qgis(path)
    found = read_qgis(path, "EPSG:32633")
    np.testing.assert_allclose([found.longitude[0] / DEG, found.latitude[0] / DEG], [15.0, 0.0], atol=1e-9)


ASP = (
    '# WKT: GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],'
    'UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]]\n'
    "5 23.7 160.1 427.1 1.5 1.5 1.5 folder/image1.tif 124.5 19.7 0.5 0.5 image2.tif 254.3 73.9 1.0 1.0\n"
)


@pytest.mark.parametrize("separator", [" ", ",", ", "])
def test_asp_points_are_seen_in_several_images(tmp_path, separator):
    path = tmp_path / "control.gcp"
    head, line = ASP.split("\n", 1)
    path.write_text(head + "\n" + line.replace(" ", separator))
    found = read_asp(path)
    assert found.landmark_id == ("5", "5")
    assert found.image_id == ("image1", "image2")
    np.testing.assert_allclose(found.latitude / DEG, 23.7)
    np.testing.assert_allclose(found.longitude / DEG, 160.1)
    np.testing.assert_allclose(found.height, 427.1)
    np.testing.assert_allclose(found.column_px, [124.5, 254.3])
    np.testing.assert_allclose(found.row_px, [19.7, 73.9])
    np.testing.assert_allclose(found.sigma_enu, 1.5)
    np.testing.assert_allclose(found.sigma_px, [0.5, 1.0])


BAD = {
    "ten fields": (
        "a.gcp",
        "5 23.7 160.1 427.1 1 1 1 image1.tif 1 2\n",
        "line 1: found 10 fields, wanted id",
    ),
    "text": ("a.gcp", "\n5 x 160.1 427.1 1 1 1 i.tif 1 2 1 1\n", 'line 2: found "x", wanted a finite number'),
    "unequal sigmas": ("a.gcp", "5 23.7 160.1 427.1 1 1 2 i.tif 1 2 1 1\n", "sigmas that differ"),
    "unequal pixel sigmas": ("a.gcp", "5 23.7 160.1 427.1 1 1 1 i.tif 1 2 1 3\n", "pixel sigmas that differ"),
    "no sighting": ("a.gcp", "5 23.7 160.1 427.1 1 1 1\n", "found no point seen in an image"),
    "comments only": ("a.gcp", "# nothing\n", "found no point"),
    "another ending": ("a.las", "x", 'found the ending ".las"'),
    "no such column": (
        "a.points",
        WGS84 + "mapX,mapY\n1,2\n",
        "wanted the columns pixelX, pixelY too",
    ),
    "rows downwards": (
        "a.points",
        WGS84 + "mapX,mapY,sourceX,sourceY\n9,45,10,20\n",
        "row 3, column sourceY: found 20",
    ),
    "all off": (
        "a.points",
        WGS84 + "mapX,mapY,sourceX,sourceY,enable\n9,45,10,-20,0\n",
        "no point that is switched on",
    ),
    "unknown system": (
        "a.points",
        "#CRS: EPSG:0\nmapX,mapY,sourceX,sourceY\n9,45,10,-20\n",
        "the reference system",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_used_is_said_in_one_line(tmp_path, case):
    name, text, message = BAD[case]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=r"(?s)a\.(gcp|points|las)") as error:
        read_ground_points(tmp_path / name)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def run(*arguments):
    return CliRunner().invoke(app, ["points", *map(str, arguments)])


def as_asp(campaign):
    """The campaign's markers as another program would write them."""
    s, lines = campaign.sightings, []
    latitude, longitude, height = (x.tolist() for x in itrf_to_geodetic(campaign.landmarks.r_J))
    for i in range(len(campaign.landmarks.ids)):
        fields = [i, latitude[i] / DEG, longitude[i] / DEG, height[i], 0.8, 0.8, 0.8]
        for k in np.flatnonzero(s.landmark == i):
            pixel = (float(s.column_px[k]), float(s.row_px[k]), *[float(s.sigma_px[k])] * 2)
            fields += [f"{campaign.images.ids[s.image[k]]}.tif", *pixel]
        lines.append(" ".join(map(str, fields)))
    return "\n".join(lines) + "\n"


@pytest.mark.slow
def test_a_campaign_from_asp_points_gives_the_same_answer(tmp_path):
    campaign, _ = demo("frame", 3, 8)
    path = write_campaign(tmp_path, campaign)
    (tmp_path / "control.gcp").write_text(as_asp(campaign))
    wanted = calibrate(load_campaign(path).campaign, Gls())
    for table in ("landmarks.csv", "observations.csv"):
        (tmp_path / table).unlink()
    result = run(tmp_path / "control.gcp", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    found = calibrate(load_campaign(path).campaign, Gls())
    # the checks of the example are control points now and the sigmas other ones
    assert found.observations.n == wanted.observations.n
    np.testing.assert_allclose(found.correction_E, wanted.correction_E, atol=3e-5)
    assert found.chi2_p > 1e-4


@pytest.mark.slow
def test_points_of_qgis_get_heights_from_a_dem_and_meet_in_one_landmark(tmp_path):
    from test_heights import write

    for name, column in (("one", 10), ("two", 700)):
        text = f"mapX,mapY,sourceX,sourceY,enable\n9.5,45.5,{column},-20,1\n9.{column},45.2,{column},-50,1\n"
        (tmp_path / f"{name}.points").write_text(WGS84 + text)
    dem = write(tmp_path / "dem.tif", np.full((30, 30), 120.0), 8.0, 47.0, 0.1)
    geoid = write(tmp_path / "geoid.tif", np.full((30, 30), 45.0), 8.0, 47.0, 0.1)
    files = (tmp_path / "one.points", tmp_path / "two.points", "--out", tmp_path / "out")
    sigmas = ("--sigma-m", "1,2,3", "--sigma-px", "0.5")
    kind = ("--dem", dem, "--heights", "geoid", "--geoid", geoid)
    result = run(*files, *sigmas, *kind, "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout) == {"landmarks": 3, "observations": 4, "images": ["one", "two"]}
    with (tmp_path / "out" / "landmarks.csv").open() as file:
        landmarks = list(csv.DictReader(file))
    assert {float(row["height_m"]) for row in landmarks} == {165.0}
    assert [row["sigma_up_m"] for row in landmarks] == ["3.0"] * 3
    with (tmp_path / "out" / "observations.csv").open() as file:
        seen = list(csv.DictReader(file))
    assert seen[0]["landmark_id"] == seen[2]["landmark_id"]
    assert [row["image_id"] for row in seen] == ["one", "one", "two", "two"]
    missing = {
        "wanted a DEM": (*files, *sigmas),
        "kind not stated": (*files, *sigmas, "--dem", dem),
        "no sigmas of the places": (*files, "--sigma-px", "0.5", *kind),
        "no sigmas of the pixels": (*files, "--sigma-m", "1", *kind),
        '--sigma-m: found "x"': (*files, "--sigma-m", "x", *kind),
    }
    for message, arguments in missing.items():
        result = run(*arguments)
        assert isinstance(result.exception, InputError), message
        assert message in str(result.exception)


def test_heights_of_asp_above_a_geoid_are_raised_by_it(tmp_path):
    from test_heights import write

    (tmp_path / "a.gcp").write_text("1 45.5 9.5 100 1 1 1 i.tif 1 2 1 1\n")
    geoid = write(tmp_path / "geoid.tif", np.full((30, 30), 45.0), 8.0, 47.0, 0.1)
    result = run(tmp_path / "a.gcp", "--out", tmp_path, "--heights", "geoid", "--geoid", geoid)
    assert result.exit_code == 0, result.output
    assert "145.0" in (tmp_path / "landmarks.csv").read_text()
    for more, message in (
        (("--heights", "geoid"), "wanted its grid"),
        (("--dem", geoid, "--heights", "ellipsoidal"), "found heights beside a DEM"),
        (("--sigma-m", "1"), "found sigmas of the places beside --sigma-m"),
    ):
        result = run(tmp_path / "a.gcp", "--out", tmp_path, *more)
        assert isinstance(result.exception, InputError)
        assert message in str(result.exception)


def test_one_name_at_two_places_is_refused(tmp_path):
    (tmp_path / "a.gcp").write_text(
        "1 45.5 9.5 100 1 1 1 i.tif 1 2 1 1\n1 45.6 9.5 100 1 1 1 j.tif 1 2 1 1\n"
    )
    result = run(tmp_path / "a.gcp", "--out", tmp_path)
    assert isinstance(result.exception, InputError)
    assert 'the point "1" at another place' in str(result.exception)


@pytest.mark.slow
def test_residuals_are_a_layer_of_points(tmp_path):
    raw = pytest.importorskip("pyogrio", reason="needs the extra gis").raw
    campaign, _ = demo("frame", 2, 8)
    path = write_campaign(tmp_path, campaign)
    result = CliRunner().invoke(app, ["calibrate", str(path), "--gpkg", "--no-report", "--quiet"])
    assert result.exit_code == 0, result.output
    assert not (tmp_path / "result" / "report.html").exists()
    layer = tmp_path / "result" / "residuals.gpkg"
    first = layer.read_bytes()
    meta, _, geometry, fields = raw.read(layer)
    with (tmp_path / "result" / "residuals.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(meta["fields"]) == list(rows[0])
    assert meta["crs"] == "EPSG:4326"
    at = list(meta["fields"]).index("after_east_m")
    np.testing.assert_allclose(fields[at], [float(row["after_east_m"]) for row in rows])
    x, y = np.frombuffer(geometry[0][-16:], dtype=np.float64)
    latitude, longitude, _ = itrf_to_geodetic(campaign.landmarks.r_J[campaign.sightings.landmark[0]])
    np.testing.assert_allclose([x, y], [longitude / DEG, latitude / DEG])
    CliRunner().invoke(app, ["calibrate", str(path), "--gpkg", "--no-report", "--quiet"])
    assert layer.read_bytes() == first
    CliRunner().invoke(app, ["calibrate", str(path), "--no-report", "--quiet"])
    assert not layer.exists(), "a map of an earlier result must not stand beside this one"


def test_without_the_library_of_maps_nothing_is_begun(tmp_path, monkeypatch):
    campaign, _ = demo("frame", 2, 8)
    path = write_campaign(tmp_path, campaign)
    monkeypatch.setattr("starplumb.io.gis.geopackage.find_spec", lambda name: None)
    result = CliRunner().invoke(app, ["calibrate", str(path), "--gpkg"])
    assert isinstance(result.exception, InputError)
    assert "starplumb[gis]" in str(result.exception)
    assert not (tmp_path / "result").exists()


def test_no_table_is_replaced_that_the_command_has_not_written(shared_cases, tmp_path):
    """A campaign's own landmarks stay; the same points once more are written once more."""
    points = shared_cases / "points" / "image_names.gcp"
    once = starplumb("points", points, "--out", tmp_path / "new")
    again = starplumb("points", points, "--out", tmp_path / "new")
    assert (once.status, again.status) == (0, 0)
    for name in ("landmarks.csv", "observations.csv"):
        folder = tmp_path / name[:-4]
        folder.mkdir()
        (folder / name).write_text("mine,by,hand\n", encoding="utf-8")
        refused = starplumb("points", points, "--out", folder)
        assert refused.status == 2
        assert f"{folder / name}: found a file that holds something else" in refused.err
        assert refused.err.count("\n") == 1
        assert (folder / name).read_text(encoding="utf-8") == "mine,by,hand\n"
        assert [path.name for path in folder.iterdir()] == [name]
