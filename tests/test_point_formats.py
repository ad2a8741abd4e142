"""Ground points with the names of other programs, and reference systems: no guess, no network, no other file."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from starplumb.cli.app import app
from starplumb.io.gis.heights import Raster
from starplumb.io.gis.vector import read_points
from starplumb.io.points.ground_points import image_id
from starplumb.io.points.read import read_ground_points
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC, DEG

pytest.importorskip("pyproj", reason="needs the extra gis")
rasterio = pytest.importorskip("rasterio", reason="needs the extra gis")
ClickRunner = pytest.importorskip("click.testing", reason="needs the extra gis").CliRunner

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases"
needs_cases = pytest.mark.skipif(not CASES.is_dir(), reason="shared/cases is not beside the checkout")


HOSTILE = "a\x1b[31m\u202eb"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.gcp", f"{HOSTILE} 43.5 4.8 10 1 1 1 a.tif 10 20 1 1\n"),
        ("a.gcp", f"0 43.5 4.8 10 1 1 1 {HOSTILE}.tif 10 20 1 1\n"),
        ("a.txt", f"EPSG:4326\n4.8 43.5 10 10 20 {HOSTILE}.tif b\n"),
        ("a.txt", f"EPSG:4326\n4.8 43.5 10 10 20 a.tif {HOSTILE}\n"),
    ],
)
def test_names_that_a_terminal_obeys_are_refused_from_every_program(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match="wanted text without control characters") as error:
        read_ground_points(tmp_path / name, "EPSG:4326")
    assert str(error.value).isprintable()


def feature(properties, *place):
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "Point", "coordinates": list(place)},
    }


def collection(path, *features, **more):
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features} | more))
    return path


def test_orthority_counts_from_the_centre_of_the_first_pixel(tmp_path):
    one = feature(
        {"id": "plinth", "ji": [821.3, 62.3], "filename": "scene.tif", "info": "x"}, 24.4, -33.6, 214.7
    )
    two = feature({"ji": [5, 6.5], "filename": "other"}, 24.5, -33.5, 210.0)
    found = read_ground_points(collection(tmp_path / "gcps.geojson", one, two))
    assert found.landmark_id == ("plinth", "other-2")
    assert found.image_id == ("scene", "other")
    np.testing.assert_array_equal(found.column_px, [821.3, 5.0])
    np.testing.assert_array_equal(found.row_px, [62.3, 6.5])
    np.testing.assert_allclose(found.longitude / DEG, [24.4, 24.5], rtol=1e-15)
    np.testing.assert_allclose(found.latitude / DEG, [-33.6, -33.5], rtol=1e-15)
    np.testing.assert_array_equal(found.height, [214.7, 210.0])
    assert np.isnan(found.sigma_px).all()


@needs_cases
def test_the_file_of_another_program_becomes_tables(tmp_path):
    arguments = [
        str(CASES / "geojson" / "gcps.geojson"),
        "--out",
        str(tmp_path),
        "--sigma-m",
        "1",
        "--sigma-px",
        "0.5",
    ]
    result = CliRunner().invoke(app, ["points", *arguments])
    assert result.exit_code == 0, result.output
    (seen,) = csv.DictReader((tmp_path / "observations.csv").read_text().splitlines())
    assert seen == {
        "image_id": "scene",
        "landmark_id": "plinth-1",
        "column_px": "821.3",
        "row_px": "62.3",
        "sigma_px": "0.5",
    }
    (place,) = csv.DictReader((tmp_path / "landmarks.csv").read_text().splitlines())
    assert [float(place[name]) for name in ("latitude_deg", "longitude_deg", "height_m")] == [
        -33.6,
        24.4,
        214.7,
    ]


def test_rasterio_counts_from_the_corner_as_json_as_table_and_as_tags(tmp_path):
    """A point half a pixel from the corner both ways is the centre of the first pixel."""
    properties = {"id": "7", "info": "", "row": 0.5, "col": 0.5, "x": 9.0, "y": 45.0, "z": 120.0}
    as_json = read_ground_points(collection(tmp_path / "img.json", feature(properties, 9.0, 45.0, 120.0)))
    (tmp_path / "img.csv").write_text("id,row,col,x,y,z\n7,0.5,0.5,9,45,120\n")
    with pytest.raises(InputError, match="found no reference system of x and y"):
        read_ground_points(tmp_path / "img.csv")
    as_table = read_ground_points(tmp_path / "img.csv", "EPSG:4326")
    point = rasterio.control.GroundControlPoint(row=0.5, col=0.5, x=9.0, y=45.0, z=120.0, id="7")
    profile = {"driver": "GTiff", "width": 2, "height": 2, "count": 1, "dtype": "uint8"}
    with rasterio.open(tmp_path / "img.tif", "w", gcps=[point], crs="EPSG:4326", **profile) as file:
        file.write(np.zeros((1, 2, 2), dtype=np.uint8))
    as_tags = read_ground_points(tmp_path / "img.tif")
    for found in (as_json, as_table, as_tags):
        assert found.image_id == ("img",)
        assert (found.column_px[0], found.row_px[0]) == (0.0, 0.0)
        np.testing.assert_allclose(
            [found.latitude[0] / DEG, found.longitude[0] / DEG], [45.0, 9.0], rtol=1e-15
        )
        np.testing.assert_array_equal(found.height, [120.0])
    assert as_json.landmark_id == as_table.landmark_id == ("7",)


@pytest.mark.parametrize(
    "how", ["", "--collection", "--rs --indent 2", "--projected", "--projected --collection"]
)
def test_what_rasterio_itself_writes_is_read_in_every_form(tmp_path, how):
    """500000 E, 5000000 N of zone 32 is on its meridian, 9 E; features stand one a line by default."""
    rio = pytest.importorskip("rasterio.rio.main").main_group
    points = [
        rasterio.control.GroundControlPoint(row=1.5, col=0.5 + i, x=5e5, y=5e6 + 1e3 * i, z=120.0, id=str(i))
        for i in range(3)
    ]
    profile = {"driver": "GTiff", "width": 4, "height": 4, "count": 1, "dtype": "uint8"}
    with rasterio.open(tmp_path / "img.tif", "w", gcps=points, crs="EPSG:32632", **profile) as file:
        file.write(np.zeros((1, 4, 4), dtype=np.uint8))
    printed = ClickRunner().invoke(rio, ["gcps", *how.split(), str(tmp_path / "img.tif")])
    assert printed.exit_code == 0, printed.output
    (tmp_path / "img.geojson").write_text(printed.stdout)
    found = read_ground_points(tmp_path / "img.geojson")
    assert found.landmark_id == ("1", "2", "3")  # a TIFF keeps no names
    np.testing.assert_allclose(found.longitude / DEG, 9.0, rtol=1e-13)
    meridian = np.diff(found.latitude) * 6_367_400.0  # m: the radius of curvature there
    np.testing.assert_allclose(meridian, 1000.0 / 0.9996, rtol=1e-4)
    np.testing.assert_array_equal(found.column_px, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(found.row_px, [1.0, 1.0, 1.0])


def test_a_sequence_of_two_systems_is_refused(tmp_path):
    properties = {"id": "7", "row": 0.5, "col": 0.5, "x": 9.0, "y": 45.0, "crs": "EPSG:4326"}
    lines = [json.dumps(feature(properties | {"crs": crs}, 9.0, 45.0)) for crs in ("EPSG:4326", "EPSG:32632")]
    (tmp_path / "img.geojsonl").write_text("\n".join(lines))
    with pytest.raises(
        InputError, match=r"feature 2: found another crs than that of feature 1, wanted one for all"
    ):
        read_ground_points(tmp_path / "img.geojsonl")
    (tmp_path / "img.geojsonl").write_text(lines[0] + " {")
    with pytest.raises(InputError, match="found text that is not JSON"):
        read_ground_points(tmp_path / "img.geojsonl")


def test_opendronemap_states_its_system_first(tmp_path):
    """Easting 500 km and northing 0 of UTM zone 33 are 15 deg E, 0 deg N."""
    path = tmp_path / "gcp_list.txt"
    lines = ("500000 0 12.5 3044 2622 IMG_0525.jpg gcp01", "500000\t0\t12.5 4193 1552 IMG_0585.jpg")
    for system in (
        "WGS84 UTM 33N",
        "EPSG:32633",
        "+proj=utm +zone=33 +ellps=WGS84 +datum=WGS84 +units=m +no_defs",
    ):
        path.write_text("\n".join((system, *lines)) + "\n")
        found = read_ground_points(path)
        assert found.image_id == ("IMG_0525", "IMG_0585")
        assert found.landmark_id == ("gcp01", "IMG_0585-3")
        np.testing.assert_array_equal(found.column_px, [3044.0, 4193.0])
        np.testing.assert_array_equal(found.height, [12.5, 12.5])
        np.testing.assert_allclose(found.longitude / DEG, 15.0, atol=1e-9)
        np.testing.assert_allclose(found.latitude / DEG, 0.0, atol=1e-9)
    path.write_text("\n".join(("EPSG:32633", "500000 0 NaN 1 2 a.jpg")) + "\n")
    assert np.isnan(read_ground_points(path).height).all()
    path.write_text("\n".join(("EPSG:32633", "500000 0 NaN 1 2 a.jpg", lines[0])) + "\n")
    with pytest.raises(
        InputError, match=r"gcp_list.txt, line 2: found no height beside points that have one"
    ):
        read_ground_points(path)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="found no reference system in the first line"):
        read_ground_points(path)


@pytest.mark.parametrize(
    ("name", "image"),
    [
        ("scene1.tif", "scene1"),
        ("folder/scene1.TIFF", "scene1"),
        (r"C:\work\scene1.tif", "scene1"),
        ("scene1", "scene1"),
        ("scene1.tif.points", "scene1"),
        ("SAT1_20260320T095902.357Z_L1A", "SAT1_20260320T095902.357Z_L1A"),
        ("SAT1_20260320T095902.357Z_L1A.png", "SAT1_20260320T095902.357Z_L1A"),
    ],
)
def test_images_are_named_by_one_rule(tmp_path, name, image):
    """QGIS files have the name of their image, whose own ending may stand before theirs."""
    assert image_id(name.removesuffix(".points")) == image


def of_airy(latitude_deg, longitude_deg):
    """A place at height 0 on the Airy ellipsoid in WGS 84 by hand: the seven parameters of EPSG 1314."""
    latitude, longitude = latitude_deg * DEG, longitude_deg * DEG
    a, f = 6377563.396, 1.0 / 299.3249646
    e2 = f * (2.0 - f)
    n = a / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    level = n * np.cos(latitude)
    place = np.array(
        [level * np.cos(longitude), level * np.sin(longitude), n * (1.0 - e2) * np.sin(latitude)]
    )
    x, y, z = np.array([0.15, 0.247, 0.842]) * ARCSEC
    turn = np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])
    return itrf_to_geodetic(np.array([446.448, -125.157, 542.06]) + (1.0 - 20.489e-6) * turn @ place)


def test_a_helmert_transformation_is_that_by_hand_and_its_worth_is_told(tmp_path):
    (tmp_path / "gb.points").write_text("#CRS: EPSG:4277\nmapX,mapY,sourceX,sourceY\n-1.5,52.5,10.5,-20.5\n")
    found = read_ground_points(tmp_path / "gb.points")
    latitude, longitude, _ = of_airy(52.5, -1.5)
    np.testing.assert_allclose(found.latitude, latitude, atol=1e-11)
    np.testing.assert_allclose(found.longitude, longitude, atol=1e-11)
    assert abs(found.longitude[0] / DEG + 1.5) > 1e-3, "a shift of a hundred metres must have been made"
    (notice,) = found.notices
    assert "accurate to 2 m; their sigmas must contain it" in notice


def test_asp_names_the_datum_of_its_points(tmp_path):
    """Latitude, longitude and height on the Airy ellipsoid, in the header as a projected system of that datum."""
    from pyproj import CRS

    line = "1 52.5 -1.5 0 1 1 1 img.tif 10 20 1 1\n"
    (tmp_path / "gb.gcp").write_text(f"# WKT: {CRS('EPSG:27700').to_wkt('WKT1_GDAL')}\n# id lat lon\n{line}")
    found = read_ground_points(tmp_path / "gb.gcp")
    latitude, longitude, height = of_airy(52.5, -1.5)
    np.testing.assert_allclose([found.latitude[0], found.longitude[0]], [latitude, longitude], atol=1e-11)
    np.testing.assert_allclose(found.height, height, atol=1e-4)
    moon = 'GEOGCS["Moon",DATUM["D_Moon",SPHEROID["Moon",1737400,0]],PRIMEM["M",0],UNIT["degree",0.0174532925199433]]'
    (tmp_path / "moon.gcp").write_text(f"# WKT: {moon}\n{line}")
    with pytest.raises(InputError, match="wanted a geographic or projected one of the Earth"):
        read_ground_points(tmp_path / "moon.gcp")


QGIS = "mapX,mapY,sourceX,sourceY\n116.4,39.9,100.5,-100.5\n"
REFUSED = {
    "a datum without a known transformation there": (
        "a.points",
        "#CRS: EPSG:4214\n" + QGIS,
        "no known transformation",
    ),
    "a vertical part": ("a.points", "#CRS: EPSG:4326+5773\n" + QGIS, "which has heights of its own"),
    "heights alone": ("a.points", "#CRS: EPSG:5773\n" + QGIS, "which has heights of its own"),
    "Cartesian": ("a.points", "#CRS: EPSG:4978\n" + QGIS, "wanted a geographic or projected one"),
    "an address": (
        "a.points",
        "#CRS: http://127.0.0.1:18765/crs.prj\n" + QGIS,
        "wanted one such as EPSG:32633",
    ),
    "a file of PROJ's": ("a.points", "#CRS: +init=/etc/passwd:x\n" + QGIS, "wanted one such as EPSG:32633"),
    "beyond a projection": ("a.points", "#CRS: EPSG:32633\n" + QGIS.replace("116.4", "1e15"), "a place"),
    "heights on another ellipsoid": (
        "a.txt",
        "EPSG:27700\n430000 280000 100 1 2 a.jpg\n",
        "found heights beside",
    ),
    "not on the Earth": ("a.txt", "EPSG:4326\n430000 280000 100 1 2 a.jpg\n", "wanted a place on the Earth"),
    "five words": ("a.txt", "EPSG:4326\n9 45 100 1 2\n", "a.txt, line 2: found"),
    "no pixel": (
        "a.geojson",
        '{"type":"FeatureCollection","features":[{"type":"Feature"}]}',
        "feature 1: found no",
    ),
    "not JSON": ("a.geojson", "{", "found text that is not JSON"),
    "unknown names": ("a.csv", "a,b\n1,2\n", 'found "a, b", wanted image_name, im_x'),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_would_be_a_guess_is_refused(tmp_path, case, monkeypatch):
    monkeypatch.setenv("PROJ_NETWORK", "ON")
    name, text, message = REFUSED[case]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=r"a\.\w+") as error:
        read_ground_points(tmp_path / name)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_the_network_of_proj_is_off_whatever_the_environment_says(tmp_path, monkeypatch):
    """pyproj asks for the address of a grid only with the network on; what the caller had set comes back."""
    from pyproj.network import is_network_enabled, set_network_enabled

    from starplumb.io.gis import reference_system

    seen = []
    known_way = reference_system._known_way
    monkeypatch.setattr(
        reference_system, "_known_way", lambda *a: (seen.append(is_network_enabled()), known_way(*a))[1]
    )
    set_network_enabled(active=True)
    try:
        (tmp_path / "a.points").write_text("#CRS: EPSG:32633\n" + QGIS.replace("116.4,39.9", "500000,0"))
        read_ground_points(tmp_path / "a.points")
        assert is_network_enabled()
    finally:
        set_network_enabled(active=None)
    assert seen == [False]


def test_a_virtual_raster_is_refused_and_a_vector_file_must_be_what_its_ending_says(tmp_path):
    from test_heights import write

    write(tmp_path / "dem.tif", np.zeros((2, 2)), 9.0, 45.0, 0.1)
    (tmp_path / "dem.vrt").write_text(
        '<VRTDataset rasterXSize="2" rasterYSize="2"><SRS>EPSG:4326</SRS><GeoTransform>9,.1,0,45,0,-.1</GeoTransform>'
        '<VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename relativeToVRT="1">dem.tif'
        "</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"
    )
    (tmp_path / "other.tif").write_bytes((tmp_path / "dem.vrt").read_bytes())
    for name in ("dem.vrt", "other.tif"):
        with pytest.raises(InputError, match="virtual raster, which names other files"):
            Raster.open(tmp_path / name)
    for name in ("a.geojson", "a.gpkg", "a.shp"):
        (tmp_path / name).write_text('<OGRVRTDataSource><OGRVRTLayer name="x"/></OGRVRTDataSource>')
        with pytest.raises(InputError, match="found a file that is not a"):
            read_points(tmp_path / name)


def test_a_grid_in_a_datum_that_nothing_is_known_of_is_refused(tmp_path):
    """Before, its places were taken as WGS 84."""
    from test_heights import write

    path = write(tmp_path / "dem.tif", np.zeros((4, 4)), 20_500_000.0, 4_400_000.0, 1000.0, crs="EPSG:21420")
    with pytest.raises(InputError, match="no known transformation"):
        Raster.open(path).at(np.array([39.7]) * DEG, np.array([117.0]) * DEG)
