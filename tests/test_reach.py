"""What reading a campaign opens: the files that it names and what belongs to them, nothing else, and no connection."""

from __future__ import annotations

import os
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bad_cases import AEM, OEM
from helpers import FILES, write_good_campaign
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from test_stk import EPHEMERIS

_seen: list[tuple[str, str]] | None = None
_OF_PYTHON = tuple(
    os.path.realpath(place)
    for place in {
        sys.prefix,
        sys.base_prefix,
        *sysconfig.get_paths().values(),
        str(Path(__file__).parents[1]),
        "/proc",
        "/sys",
        "/etc",
        "/usr",
        "/dev",
    }
)


def _hook(event: str, arguments: tuple[object, ...]) -> None:
    if _seen is not None and (event == "open" or event.startswith("socket.")):
        _seen.append((event, str(arguments[0])))


sys.addaudithook(_hook)


@pytest.fixture
def opened() -> Iterator[list[tuple[str, str]]]:
    """Events of files and sockets while a test runs; those of Python itself and of the package left out afterwards."""
    global _seen
    _seen = []
    yield _seen
    _seen = None


def names(events: list[tuple[str, str]], folder: Path) -> set[str]:
    """The user's files among the events, by their names in the folder; any socket is a failure."""
    sockets = [event for event in events if event[0] != "open"]
    assert not sockets
    paths = [os.path.realpath(path) for _, path in events if not path.isdigit()]
    others = {path for path in paths if not path.startswith(_OF_PYTHON) or path.startswith(str(folder))}
    return {os.path.relpath(path, folder) for path in others}


def plain(folder: Path) -> Path:
    return write_good_campaign(folder)


def standard(orbit: str, attitude: str, content: tuple[str, str]) -> object:
    """The campaign with orbit and attitude of other formats."""

    def make(folder: Path) -> Path:
        toml = FILES["campaign.toml"].replace("ephemeris.csv", orbit).replace("attitude.csv", attitude)
        path = write_good_campaign(folder, campaign=toml)
        (folder / orbit).write_text(content[0])
        (folder / attitude).write_text(content[1])
        return path

    return make


def scanned(folder: Path) -> Path:
    """A line scanner with tables of detectors and rows."""
    toml = FILES["campaign.toml"].replace('model = "frame"', 'model = "line-scan"')
    optics = toml[toml.index("focal_length_mm") : toml.index("\n[mounting]")]
    toml = toml.replace(optics, 'look_angles = "detectors.csv"\n')
    images = "image_id,time,row_times\nI1,2020-01-01T00:00:01.000,rows.csv\n"
    path = write_good_campaign(
        folder, campaign=toml, images=images, observations=FILES["observations.csv"].split("I2", 1)[0]
    )
    (folder / "detectors.csv").write_text("column_px,tan_x,tan_y\n0,-0.02,0.001\n11999,0.02,0.001\n")
    (folder / "rows.csv").write_text("row,time\n0,2020-01-01T00:00:01.000\n12000,2020-01-01T00:00:02.400\n")
    return path


AEM_FILE, OEM_FILE = AEM.replace("STR_1", "star_tracker"), OEM
CAMPAIGNS = {
    "tables": plain,
    "messages": standard("orbit.oem", "attitude.aem", (OEM_FILE, AEM_FILE)),
    "STK": standard("orbit.e", "attitude.aem", (EPHEMERIS, AEM_FILE)),
    "line scanner": scanned,
}


@pytest.mark.parametrize("kind", CAMPAIGNS)
def test_only_what_a_campaign_names_is_opened_and_all_of_it_has_its_digest(tmp_path, kind, opened):
    path = CAMPAIGNS[kind](tmp_path)
    opened.clear()
    loaded = load_campaign(path)
    assert names(opened, tmp_path) == set(loaded.inputs)


@pytest.mark.slow
def test_the_parts_of_a_raster_and_of_a_shapefile_have_their_digests(tmp_path, opened):
    """GDAL opens files that Python does not see: what it lists of a raster, and the parts of a shapefile."""
    rasterio = pytest.importorskip("rasterio", reason="needs the extra gis")
    pyogrio = pytest.importorskip("pyogrio", reason="needs the extra gis")
    grid = "ncols 20\nnrows 20\nxllcorner -0.1\nyllcorner -0.1\ncellsize 0.01\n" + 20 * (20 * "5.0 " + "\n")
    (tmp_path / "dem.asc").write_text(grid)
    (tmp_path / "dem.prj").write_text(rasterio.crs.CRS.from_epsg(4326).to_wkt(version="WKT1_ESRI"))
    places = np.array([[0.05, 0.05], [0.05, -0.05], [-0.06, 0.0]])
    wkb = np.array([b"\x01\x01\x00\x00\x00" + place.tobytes() for place in places], dtype=object)
    columns = [np.array(["L1", "L2", "L3"], dtype=object), np.full(3, 0.5)]
    pyogrio.raw.write(
        tmp_path / "marks.shp",
        wkb,
        columns,
        ["landmark_i", "sigma_m"],
        driver="ESRI Shapefile",
        geometry_type="Point",
        crs="EPSG:4326",
    )
    toml = FILES["campaign.toml"].replace(
        '"landmarks.csv"', '"marks.shp"\ndem = "dem.asc"\nheights = "ellipsoidal"'
    )
    path = write_good_campaign(tmp_path, campaign=toml)
    opened.clear()
    loaded = load_campaign(path)
    parts = {f"marks{end}" for end in (".shp", ".shx", ".dbf", ".prj", ".cpg")} | {"dem.asc", "dem.prj"}
    assert parts <= set(loaded.inputs)
    assert names(opened, tmp_path) <= set(loaded.inputs)


@pytest.mark.slow
def test_measuring_opens_what_the_campaign_names_and_all_of_it_has_its_digest(tmp_path, opened):
    sys.path.insert(0, str(Path(__file__).parent / "imagery"))
    from on_disk import write_world

    import starplumb as sp

    write_world(tmp_path, np.random.default_rng(11), size=120)
    (tmp_path / "more.csv").write_text("1")
    opened.clear()
    found = sp.measure(tmp_path / "campaign.toml")
    assert names(opened, tmp_path) == set(found.loaded.inputs)
    assert {"ortho_0.png", "ortho_1.pgw", "dem.asc"} <= set(found.loaded.inputs)


def test_an_archive_a_prediction_and_a_prior_open_a_result_and_what_is_beside_it(tmp_path, opened):
    import starplumb as sp

    write_campaign(tmp_path / "demo", sp.demo(images=3).loaded.campaign)
    sp.calibrate(sp.read_campaign(tmp_path / "demo" / "campaign.toml"), method="gls").save(
        tmp_path / "demo" / "result", report=False
    )
    archive = sp.open_archive(tmp_path / "m.db", create=True)
    result, parts = "demo/result/result.json", {"demo/result/normals.json", "demo/result/residuals.csv"}
    opened.clear()
    sp.predict(tmp_path / result, at="2026-03-21T00:00:00")
    assert names(opened, tmp_path) == {result}
    opened.clear()
    archive.add(tmp_path / "demo" / "result")
    seen = {name for name in names(opened, tmp_path) if not name.startswith((".starplumb-", "m.db.files"))}
    tables = {f"demo/{name}" for name in sp.read_campaign(tmp_path / "demo" / "campaign.toml").loaded.inputs}
    assert seen - {".", "m.db"} <= {result, *parts, *tables}


def test_the_hook_sees_what_it_should(tmp_path, opened):
    """It is no test that cannot fail: a further file, and a socket that is made, are told."""
    import socket

    (tmp_path / "more.csv").write_text("1\n")
    assert names(opened, tmp_path) == {"more.csv"}
    socket.socket().close()
    with pytest.raises(AssertionError):
        names(opened, tmp_path)
