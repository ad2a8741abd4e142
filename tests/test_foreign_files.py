"""Files that once made a program reach beyond them, die or believe nonsense: each is refused in one sentence."""

from __future__ import annotations

import base64
import json
import re
import threading
import zlib
from http.server import BaseHTTPRequestHandler, HTTPServer

import numpy as np
import pytest

import starplumb as sp
from bad_cases import OEM
from command import demo, starplumb
from helpers import FILES, write_good_campaign
from starplumb.documents.result import ResultDocument
from starplumb.io.campaign.read import load_campaign
from starplumb.io.formats.oem import read_oem
from starplumb.io.formats.registry import ATTITUDES, ORBITS, Asked, recognised
from starplumb.io.formats.sp3 import read_sp3
from starplumb.io.formats.stk.series import read_stk_attitude, read_stk_ephemeris
from starplumb.io.gis import drivers
from starplumb.io.gis.heights import surface
from starplumb.io.gis.vector import read_points
from starplumb.io.points.named import read_geojson_points
from starplumb.io.points.qgis import read_qgis
from starplumb.io.tables.read import read_table
from starplumb.io.text.json_node import JsonNode
from starplumb.io.text.pvl import read_pvl
from starplumb.physics.errors import InputError
from test_orbex import ORBEX
from test_stk import EPHEMERIS as STK_ORBIT


@pytest.fixture
def requests():
    """The port of a server, and the requests that reach it."""
    seen: list[str] = []

    class Counted(BaseHTTPRequestHandler):
        def do_GET(self):
            seen.append(self.path)
            self.send_error(404)

        do_HEAD = do_GET

        def log_message(self, *_):
            pass

    server = HTTPServer(("127.0.0.1", 0), Counted)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_address[1], seen
    server.shutdown()
    server.server_close()


def one_sentence(done, words):
    assert done.status == 2
    assert words in done.err
    assert done.err.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "words"),
    [("net-crs-url.points", "found the reference system"), ("net-landmarks-vrt-remote.geojson", "not JSON")],
)
def test_a_file_that_names_an_address_asks_nobody(shared_cases, requests, name, words, tmp_path):
    pytest.importorskip("rasterio", reason="needs the extra gis")
    port, seen = requests
    copy = tmp_path / name
    copy.write_text((shared_cases / "files" / name).read_text().replace("18765", str(port)))
    one_sentence(
        starplumb("points", copy, "--out", tmp_path / "out", "--sigma-m", 1, "--sigma-px", 0.5), words
    )
    campaign = demo(tmp_path / "demo", "--images", 1)
    text = campaign.read_text()
    campaign.write_text(text.replace('"landmarks.csv"', f'"{copy}"'))
    assert starplumb("check", campaign).status == 2
    assert not seen
    assert not (tmp_path / "out").exists()


def test_points_outside_their_projection_are_refused(shared_cases, tmp_path):
    pytest.importorskip("rasterio", reason="needs the extra gis")
    points = shared_cases / "files" / "points-outside-projection.points"
    one_sentence(
        starplumb("points", points, "--out", tmp_path / "out"), "found a place that the reference system"
    )


@pytest.mark.parametrize("name", ["cov-nan", "cov-negative", "other-schema"])
def test_a_result_that_is_none_is_not_believed(shared_cases, name, tmp_path):
    campaign = demo(tmp_path / "demo", "--images", 1)
    result = shared_cases / "files" / f"result-{name}.json"
    done = starplumb("locate", campaign, 1, 1, "--image", "image01", "--result", result)
    one_sentence(done, "starplumb-result/1")


def test_digits_of_another_script_are_no_numbers(shared_cases):
    with pytest.raises(
        InputError, match=r"oem-arabic-digits\.oem, line 13: found .*, wanted a finite number"
    ):
        read_oem(shared_cases / "files" / "oem-arabic-digits.oem")


def test_text_of_a_hundred_thousand_lines_is_no_metadata(shared_cases):
    """Read in one go: the pattern that it once was matched against needed minutes."""
    with pytest.raises(InputError, match=r"pvl-redos\.IMD, line 1: found "):
        read_pvl(shared_cases / "files" / "pvl-redos.IMD")


def test_an_orbit_second_below_zero_or_too_many_words_are_no_epoch(shared_cases):
    for name in ("sp3-second-minus-half", "sp3-seven-words"):
        with pytest.raises(InputError, match=rf"{name}\.sp3, line 1\d: found .*, wanted \* year month day"):
            read_sp3(shared_cases / "files" / f"{name}.sp3")


TWICE = {
    "a.oem": (OEM.replace("META_STOP", "CCSDS_OEM_VERS = 2.0\nMETA_STOP"), "CCSDS_OEM_VERS a second time"),
    "b.oem": (OEM.replace("META_STOP", "REF_FRAME = GCRF\nMETA_STOP"), "found REF_FRAME a second time"),
    "a.e": (STK_ORBIT.replace("CoordinateSystem ", "DistanceUnit Meters\nCoordinateSystem "), "again"),
    "a.obx": (ORBEX.replace(" FRAME_TYPE ", " FRAME_TYPE ECI\n FRAME_TYPE "), "found FRAME_TYPE again"),
    "a.geojson": (
        '{"type": "FeatureCollection", "type": "X", "features": []}',
        'the key "type" stands twice',
    ),
    "a.json": ('{"a": 1, "b": {"c": 1, "c": 2}}', 'the key "c" stands twice'),
}


def read_whatever(path):
    if path.suffix == ".geojson":
        return read_geojson_points(path)
    if path.suffix == ".json":
        return JsonNode.of(path, path.read_text())
    attitude = path.suffix == ".obx"
    return recognised(path, ATTITUDES if attitude else ORBITS).read(path, Asked("L47" if attitude else None))


@pytest.mark.parametrize("name", TWICE)
def test_a_key_given_twice_leaves_open_which_is_meant(tmp_path, name):
    text, says = TWICE[name]
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=re.escape(says)) as error:
        read_whatever(path)
    assert str(error.value).startswith(str(path))


@pytest.mark.parametrize(
    "text",
    [
        "/etc/passwd",
        "http://127.0.0.1:9/crs.prj",
        "WGS 84",
        "+proj=utm +zone=33 +nadgrids=/etc/passwd",
        "+proj=pipeline +step +proj=utm",
        "+init=/etc/passwd:x",
        'BOUNDCRS[SOURCECRS[GEOGCRS["x"]],ABRIDGEDTRANSFORMATION["x",PARAMETERFILE["x","/etc/passwd"]]]',
        'PROJCS["x",EXTENSION["PROJ4","+proj=merc +nadgrids=http://127.0.0.1:9/x"]]',
    ],
)
def test_a_reference_system_names_no_file(tmp_path, text):
    pytest.importorskip("pyproj", reason="needs the extra gis")
    path = tmp_path / "scene.points"
    path.write_text(f"#CRS: {text}\nmapX,mapY,sourceX,sourceY,enable\n9.25,45.5,100.5,-200.5,1\n")
    with pytest.raises(InputError, match=r"scene\.points: found the reference system "):
        read_qgis(path)


def dem(folder, cells="5.0 5.0 5.0 5.0", rows=2, after=""):
    """A grid of 2 x 2 cells about latitude 0, longitude 0."""
    text = f"ncols 2\nnrows {rows}\nxllcorner -1\nyllcorner -1\ncellsize 1\n{cells}\n{after}"
    (folder / "dem.asc").write_text(text)
    (folder / "dem.prj").write_text(
        'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
        'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]'
    )
    return folder / "dem.asc"


def heights(path):
    return surface(path, "ellipsoidal", None).heights(np.zeros(1), np.zeros(1), ("L1",))


@pytest.mark.parametrize("cell", ["-9999", "-32768", "9501", "1e30", "-1001"])
def test_a_cell_that_no_ground_has_is_refused(tmp_path, cell):
    pytest.importorskip("rasterio", reason="needs the extra gis")
    assert heights(dem(tmp_path)) == 5.0
    with pytest.raises(
        InputError, match=r"dem\.asc: found a cell of .*, wanted -1000 to 9500 m, or a mark of no"
    ):
        heights(dem(tmp_path, f"5.0 5.0 5.0 {cell}"))


@pytest.mark.parametrize("name", ["rows", "cut", "tiff", "sidecar"])
def test_a_damaged_raster_is_one_sentence_and_no_line_of_gdal(tmp_path, name, capfd):
    rasterio = pytest.importorskip("rasterio", reason="needs the extra gis")
    path = tmp_path / "dem.tif"
    profile = {
        "driver": "GTiff",
        "width": 64,
        "height": 64,
        "count": 1,
        "dtype": "float32",
        "crs": "EPSG:4326",
    }
    turn = rasterio.Affine(0.1, 0.0, -3.2, 0.0, -0.1, 3.2)
    with rasterio.open(path, "w", **profile, transform=turn, compress="deflate") as file:
        file.write(np.random.default_rng(1).random((1, 64, 64), dtype=np.float32))
    data = path.read_bytes()
    assert 0.0 < heights(path)[0] < 1.0
    if name == "rows":
        path = dem(tmp_path, rows=999999)
    elif name == "cut":
        path.write_bytes(data[:-2000])
    elif name == "tiff":
        path.write_bytes(data[:4] + b"\xff\x00\x00\x00" + data[8:])
    else:
        path = tmp_path / "other.tif"
        path.write_bytes(b"not a raster at all")
    with pytest.raises(InputError, match=r"(dem|other)\.(tif|asc): found ") as error:
        heights(path)
    assert str(error.value).isprintable()
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_values_that_gdal_reads_otherwise_than_they_stand_are_refused(tmp_path, recwarn):
    pytest.importorskip("pyogrio", reason="needs the extra gis")
    place = '"geometry": {"type": "Point", "coordinates": [9.0, 1, 45.0, 100.0]}'
    one = f'{{"type": "Feature", "properties": {{"landmark_id": "L1"}}, {place}}}'
    text = f'{{"type": "FeatureCollection", "features": [{one}]}}'
    (tmp_path / "a.geojson").write_text(text)
    with pytest.raises(
        InputError, match=r"a\.geojson: found values that are not what they should be .*too many"
    ):
        read_points(tmp_path / "a.geojson")
    assert not recwarn.list


def test_arrow_files_that_lie_about_their_memory_are_refused(tmp_path):
    """An offset of a text far beyond its buffer: read as it stands, the process would end."""
    pa = pytest.importorskip("pyarrow", reason="needs the extra fast")
    table = pa.table({"image_id": ["first", "second"], "x": [1.0, 2.0]})
    with pa.OSFile(str(tmp_path / "t.arrow"), "wb") as sink, pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)
    data = (tmp_path / "t.arrow").read_bytes()
    offsets = np.array([0, 5, 11], dtype="<i4").tobytes()
    assert data.count(offsets) == 1
    (tmp_path / "t.arrow").write_bytes(data.replace(offsets, np.array([0, 5, 2**30], dtype="<i4").tobytes()))
    with pytest.raises(InputError, match=r"t\.arrow: found a damaged Arrow file"):
        read_table(tmp_path / "t.arrow", texts=("image_id",))


def test_letters_that_a_terminal_acts_upon_are_escaped():
    assert str(InputError("a\x1b[31m\nb.csv: found \x00")) == "a\\x1b[31m\\nb.csv: found \\x00"


def test_numbers_of_thousands_of_digits_are_none(tmp_path):
    """Python itself gives up on them, with an error of its own."""
    many = "1" * 5000
    cases = {
        "a.obx": ORBEX.replace("00 18.000000000000", f"{many} 18.0"),
        "a.oem": OEM.replace("7058.137", many, 1),
        "a.e": STK_ORBIT.replace("7058.137", many, 1),
        "b.e": STK_ORBIT.replace("4.0 7058.137", f"{many} 7058.137"),
    }
    for name, text in cases.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match=rf"{name}, line \d+: found ") as error:
            read_whatever(tmp_path / name)
        assert len(str(error.value)) < 400


def test_a_result_of_numbers_that_no_quantity_has_is_not_believed(shared_cases, tmp_path):
    good = json.loads((shared_cases / "files" / "result-cov-nan.json").read_text().replace("NaN", "1"))
    good["mounting"]["matrix"][0][0] = 1e200
    with pytest.raises(InputError, match=r"matrix\.0\.0: found 1e\+200|a number that no quantity has"):
        ResultDocument.from_json(json.dumps(good), "result.json")


def test_a_result_with_a_time_scale_that_is_none_is_refused_by_its_name():
    text = json.loads(json.dumps(sp.calibrate(sp.demo(images=4)).document))
    text["orbit"]["time_scale"] = ""
    with pytest.raises(
        InputError, match=r"result\.json: orbit: .*time scale '' is unknown, wanted one of UTC"
    ):
        ResultDocument.from_json(json.dumps(text), "result.json")


@pytest.mark.parametrize(
    "key", ["focal_length_mm = 2200.0", "sigma_m = 3.0", "sigma_arcsec = [5.0, 5.0, 12.0]"]
)
@pytest.mark.parametrize("value", ["1e200", "1e-300", "-1.0", "1e80"])
def test_extreme_values_of_a_campaign_meet_bounds(tmp_path, key, value):
    name = key.split(" ")[0]
    path = write_good_campaign(tmp_path, campaign=FILES["campaign.toml"].replace(key, f"{name} = {value}"))
    with pytest.raises(InputError, match=rf"{name}: found .*, wanted .*e.*") as error:
        load_campaign(path)
    assert str(error.value).isprintable()


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", [("--sigma-px", "inf"), ("--sigma-height-m", "1e300"), ("--height-m", "1e9")]
)
def test_extreme_options_are_refused(tmp_path, options):
    campaign = demo(tmp_path / "demo", "--images", 1)
    done = starplumb("locate", campaign, 1, 1, "--image", "image01", *options)
    one_sentence(done, f"{options[0]}: found ")


def test_more_trials_than_anyone_computes_are_refused_at_once():
    done = starplumb("simulate", "cubesat-6u", "--trials", 10**18)
    assert done.status == 2
    assert "--trials" in done.err


@pytest.mark.parametrize("letters", [499, 20_000])
def test_no_word_of_a_file_is_repeated_whole(tmp_path, letters):
    path = tmp_path / "attitude.a"
    path.write_text(f"stk.v.11.0\nBEGIN Attitude\nAttitudeTimeQu{'x' * letters}\nEND Attitude\n")
    with pytest.raises(InputError) as refused:
        read_stk_attitude(path)
    assert len(str(refused.value)) < 1000 + len(str(tmp_path))


@pytest.mark.parametrize("odd", ["\x0b", "\x0c", "\x1c", "\x85", "\u2028"])
def test_a_line_ends_where_editors_end_it(tmp_path, odd):
    """With its unit on a line of its own the orbit would be a thousand times too near."""
    text = (
        "stk.v.11.0\nBEGIN Ephemeris\nNumberOfEphemerisPoints 2\nScenarioEpoch 1 Jan 2020 00:00:00.0\n"
        f"CentralBody Earth\nDistanceUnit{odd} Kilometers\nCoordinateSystem Fixed\nEphemerisTimePosVel\n"
        "0.0 7058.137 0.0 -15.0 0.0 0.0 7.5\n4.0 7058.137 0.0 15.0 0.0 0.0 7.5\nEND Ephemeris\n"
    )
    (tmp_path / "orbit.e").write_text(text, encoding="utf-8")
    np.testing.assert_array_equal(read_stk_ephemeris(tmp_path / "orbit.e").r[0], [7058137.0, 0.0, -15000.0])


def test_blocks_far_larger_than_their_raster_are_refused(tmp_path):
    """GDAL would take a gigabyte for one block of a damaged ERDAS raster of 9 x 8 cells."""
    rasterio = pytest.importorskip("rasterio", reason="needs the extra gis")
    path = tmp_path / "dem.img"
    profile = {"driver": "HFA", "width": 9, "height": 8, "count": 1, "dtype": "float32", "crs": "EPSG:4326"}
    with rasterio.open(
        path, "w", **profile, transform=rasterio.Affine(0.01, 0.0, 9.0, 0.0, -0.01, 45.0)
    ) as file:
        file.write(np.ones((1, 8, 9), dtype=np.float32))
    data = path.read_bytes()
    # width, height, type, width and height of a block: the record Eimg_Layer
    at = data.index(np.array([9, 8], "<i4").tobytes())
    assert np.frombuffer(data, "<i4", 2, at + 12).tolist() == [64, 64]
    path.write_bytes(data[: at + 12] + np.array([1 << 24, 64], "<i4").tobytes() + data[at + 20 :])
    with pytest.raises(
        InputError, match=r"dem\.img: found blocks of 16777216 x 64 cells in a raster of 9 x 8"
    ):
        heights(path)


def test_a_block_holds_the_cells_of_all_bands_that_lie_together(tmp_path, monkeypatch):
    rasterio = pytest.importorskip("rasterio", reason="needs the extra gis")
    monkeypatch.setattr(drivers, "_MOST_BLOCK", 600)
    profile = {"driver": "GTiff", "width": 4, "height": 4, "count": 3, "dtype": "float32", "tiled": True}
    profile["transform"] = rasterio.Affine(1.0, 0.0, 9.0, 0.0, -1.0, 45.0)
    for interleave in ("band", "pixel"):
        with rasterio.open(
            tmp_path / f"{interleave}.tif",
            "w",
            **profile,
            blockxsize=16,
            blockysize=16,
            interleave=interleave,
        ) as file:
            file.write(np.zeros((3, 4, 4), np.float32))
    drivers.open_raster(tmp_path / "band.tif").close()
    with pytest.raises(InputError, match=r"pixel\.tif: found blocks of 16 x 16 cells in a raster of 4 x 4"):
        drivers.open_raster(tmp_path / "pixel.tif")


STRANGE_UNITS = (
    "eNrz9NRi4GBgYBBiYGBkZmAEsjiBmBHKBskwQdkKQMyMJM4GZYOwKBJbBolti8R2grIFgNgZie3CyAJmTwISrlD2cSAOhqphBmK+"
    "Zh4w/QyIm1p4GNiA9D8gXt/ODHaXHlDhxnYmBjkgOw/IblzCBFbTAzIABhz6HVBoAqAgVs4RRJsxBTvCxBjBLmJnYGCBsBmhNBPL"
    "xnYxkDzHxnZ2BjEGNg6InxnqQXRFPQsPiNZUDncPVrAwUdBXCA3xVajKz0tVMDbyq4GI1jDoWgIBQ8Wct+cU9Y8Uyhz/GC7A4ijg"
    "4ggic+ru+wu1cDcpxAgcAZJ3zrxpunn2zJmW7kUacSKuH+WaNKT4D/xn/HBu/vVvHy8XsPdekzBT681MvhZQl7v0hkbURe1fRxdI"
    "iC1OuvNQ/Wjwx5g9Ipcfba3Qvtcd2f5fw26/eaLemfbWDRLTDhVZ/Wu/ukHs2mG3GzzRidZb+PZLf3PSf9PeXCDx66GGTPkPRwvO"
    "5Q91eA5X7uCYnnjl4fpDpRLtswuk3x2qreDol/23f/8d8aIFBuEAgDR/yA=="
)
"""A GeoTIFF of 9 x 8 cells, packed, whose reference system has a unit of length that no table knows."""


def test_proj_prints_nothing_itself(tmp_path, capfd):
    pytest.importorskip("rasterio", reason="needs the extra gis")
    (tmp_path / "dem.tif").write_bytes(zlib.decompress(base64.b64decode(STRANGE_UNITS)))
    with pytest.raises(InputError, match=r"dem\.tif: found a place that the reference system"):
        heights(tmp_path / "dem.tif")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "turn", [(1000.0, -3.5e-310), (4.3e-306, -1000.0), (1e300, -1000.0), (1e-11, -1e-11)]
)
def test_a_georeference_of_no_raster_is_refused(tmp_path, turn):
    rasterio = pytest.importorskip("rasterio", reason="needs the extra gis")
    path, (a, e) = tmp_path / "dem.tif", turn
    profile = {
        "driver": "GTiff",
        "width": 9,
        "height": 8,
        "count": 1,
        "dtype": "float32",
        "crs": "EPSG:32632",
    }
    with rasterio.open(
        path, "w", **profile, transform=rasterio.Affine(a, 0.0, 497500.0, 0.0, e, 4983000.0)
    ) as file:
        file.write(np.ones((1, 8, 9), dtype=np.float32))
    with pytest.raises(InputError, match=r"dem\.tif: found a georeference that is none"):
        heights(path)
