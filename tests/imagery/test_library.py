"""Libraries of chips: cut out of an orthoimage, read without it, and as good as it."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import tracemalloc
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from on_disk import write_world
from PIL import Image

import starplumb as sp
from command import starplumb
from starplumb.imagery.library.expected import one_a_cell
from starplumb.imagery.scene import Scene
from starplumb.io.imagery.cutting import Cut, chip_id, write_library
from starplumb.io.imagery.library import TABLE, Library, read_library
from starplumb.io.imagery.ortho import Ortho, Tile
from starplumb.io.imagery.rasters import RawImage
from starplumb.physics import so3
from starplumb.physics.earth import C_JT, geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC, DEG

LATITUDE, LONGITUDE = 45.0, -179.999
STEP = 2e-5


def bright(latitude, longitude):
    """Waves some cells long, over degrees."""
    east = np.remainder(longitude - LONGITUDE + 180.0, 360.0) - 180.0
    return 100.0 + 30.0 * np.sin((latitude - LATITUDE) / 3e-4 + east / 5e-4)


def height(latitude, longitude):
    east = np.remainder(longitude - LONGITUDE + 180.0, 360.0) - 180.0
    return 300.0 + 2e4 * (latitude - LATITUDE) - 1e4 * east


@dataclass(frozen=True)
class Drawn:
    """An orthoimage across the date line, from its function."""

    path: Path = Path("ortho.png")
    size: tuple[int, int] = (400, 400)
    affine = (STEP, 0.0, LONGITUDE - 200 * STEP, 0.0, -STEP, LATITUDE + 200 * STEP)
    wkt = None

    def cells(self, column, row, columns, rows):
        a, _, c, _, e, f = self.affine
        x, y = np.meshgrid(c + a * (column + np.arange(columns)), f + e * (row + np.arange(rows)))
        return bright(y, x)


def scene():
    ortho = Ortho([Tile(RawImage(Drawn()), Drawn.affine, None)])
    return Scene(None, (), ortho, lambda lat, lon: height(lat / DEG, lon / DEG), 30.0)


def cut(half_m=60.0, places=((LATITUDE, LONGITUDE),)):
    p_J = np.array([geodetic_to_itrf(y * DEG, x * DEG, height(y, x)) for y, x in places])
    return Cut(p_J, np.full(len(p_J), half_m), (0.5, 0.5, 3.0), 400.0)


def test_a_chip_is_the_orthoimage_and_the_heights_around_its_centre(tmp_path):
    assert write_library(tmp_path / "lib", scene(), cut()) == 1
    library = Library(read_library(tmp_path / "lib" / TABLE))
    p_J = cut().p_J[0]
    east, north = np.meshgrid(np.linspace(-50.0, 50.0, 41), np.linspace(50.0, -50.0, 41))
    at = p_J + np.stack([east, north, 0.0 * east], axis=-1) @ C_JT(LATITUDE * DEG, LONGITUDE * DEG).T
    latitude, longitude, _ = itrf_to_geodetic(at)
    expected = bright(latitude / DEG, longitude / DEG)
    seen = library.sample(latitude, longitude, 1.0)
    # brightness and contrast are its own; a thousandth of a cell would leave 4e-5 of the waves
    gain, offset = np.polyfit(seen.ravel(), expected.ravel(), 1)
    np.testing.assert_allclose(gain * seen + offset, expected, atol=0.02)
    there = library.height_at(latitude.ravel(), longitude.ravel())
    np.testing.assert_allclose(there, height(latitude / DEG, longitude / DEG).ravel(), atol=0.006)
    assert not np.isfinite(library.sample(latitude + 3e-5, longitude, 1.0)[:4]).any()
    (row,) = (tmp_path / "lib" / TABLE).read_text().splitlines()[1:]
    assert row.startswith("N45.00000W179.99900,EPSG:4326,N45.00000W179.99900.png,sha256:")
    assert chip_id(-0.5, 7.25) == "S00.50000E007.25000"


def test_a_library_that_would_fill_the_memory_is_refused(tmp_path, monkeypatch):
    """By the pixels of all its chips, and without reading a file of gigabytes to see that it is no chip."""
    write_library(tmp_path / "lib", scene(), cut())
    table = tmp_path / "lib" / TABLE
    (chip,) = read_library(table)
    monkeypatch.setattr("starplumb.io.imagery.library.MOST_PIXELS", chip.cells)
    assert len(read_library(table)) == 1
    monkeypatch.setattr("starplumb.io.imagery.library.MOST_PIXELS", chip.cells - 1)
    with pytest.raises(InputError, match=r"chips\.csv: found chips of more than [\d,]+ pixels, wanted fewer"):
        read_library(table)
    with (tmp_path / "lib" / "N45.00000W179.99900.png").open("wb") as file:
        file.truncate(300_000_000)
    tracemalloc.start()
    with pytest.raises(InputError, match=r"column sha256: found a digest that is not that of"):
        read_library(table)
    assert tracemalloc.get_traced_memory()[1] < 5e7
    tracemalloc.stop()


def test_a_chip_that_the_reference_hardly_knows_is_left_out_and_nothing_is_replaced(tmp_path):
    beside = LATITUDE, LONGITUDE + 198 * STEP
    assert write_library(tmp_path / "lib", scene(), cut(places=((LATITUDE, LONGITUDE), beside))) == 1
    before = sorted((tmp_path / "lib").iterdir())
    with pytest.raises(InputError, match="wanted a new folder"):
        write_library(tmp_path / "lib", scene(), cut())
    with pytest.raises(InputError, match="no chip of which the reference knows enough"):
        write_library(tmp_path / "none", scene(), cut(places=(beside,)))
    assert sorted((tmp_path / "lib").iterdir()) == before
    assert not (tmp_path / "none").exists()


def test_of_each_cell_the_best_place_is_taken():
    pixel = np.array([[0.0, 0.0], [3.0, 1.0], [10.0, 0.0], [10.0, 10.0], [9.0, 9.0]])
    assert one_a_cell(pixel, np.array([1.0, 2.0, 0.0, 5.0, 5.0]), (2, 2)).tolist() == [1, 2, 3]
    assert one_a_cell(pixel[:0], np.zeros(0), (2, 2)).tolist() == []


@pytest.fixture(scope="module")
def worlds(tmp_path_factory):
    """Two campaigns of the same ground: an orthoimage with the first, the library cut with its help with the other."""
    one, other = (tmp_path_factory.mktemp(name) for name in ("one", "other"))
    write_world(one, np.random.default_rng(11))
    _, rotations = write_world(other, np.random.default_rng(12))
    done = starplumb("measure", one / "campaign.toml", "--no-report", "--chips", other / "lib")
    assert done.status == 0, done.err
    text = (other / "campaign.toml").read_text()
    ortho = other / "ortho.toml"
    ortho.write_text(text)
    sections = re.sub(r"(?s)\[reference\].*?\n\n", '[reference]\nkind = "chips"\nfiles = ["lib"]\n\n', text)
    (other / "campaign.toml").write_text(sections)
    return other, rotations


def measured(settings, out):
    done = starplumb("measure", settings, "--out", out, "--calibrate")
    assert done.status == 0, done.err
    result = json.loads((out / "result.json").read_text())
    return np.array(result["mounting"]["matrix"]), np.array(result["covariance_arcsec2"])


@pytest.mark.slow
def test_a_library_tells_another_campaign_what_the_orthoimage_does(worlds, tmp_path):
    folder, rotations = worlds
    C_ortho, _ = measured(folder / "ortho.toml", tmp_path / "ortho")
    for path in (*folder.glob("ortho_*"), folder / "dem.asc"):
        path.unlink()  # nothing else is read
    C_chips, covariance = measured(folder / "campaign.toml", tmp_path / "chips")
    off = so3.log(C_chips @ rotations[0].T) / ARCSEC
    assert off @ np.linalg.solve(covariance, off) < 11.3
    apart = so3.log(C_chips @ C_ortho.T) / ARCSEC
    assert np.all(np.abs(apart) < np.sqrt(np.diagonal(covariance)))
    document = json.loads((tmp_path / "chips" / "measure.json").read_text())
    assert document["images"][0]["used"] >= 6
    assert set(document["inputs"]) >= {"lib/chips.csv"}
    again = sp.read_campaign(tmp_path / "chips" / "campaign.toml").loaded.campaign.landmarks
    assert again.correlation_length == 300.0
    used = {c["landmark_id"] for c in document["candidates"] if c["role"]}
    assert set(again.ids) == used
    page = (tmp_path / "chips" / "measure.html").read_text(encoding="utf-8")
    assert all(name in page for name in used)


@pytest.mark.slow
def test_a_library_of_another_place_is_told(worlds, tmp_path):
    folder = tmp_path / "world"
    shutil.copytree(worlds[0], folder)
    lines = (folder / "lib" / TABLE).read_text().splitlines()
    column = lines[0].split(",").index("longitude_deg")
    moved = [row.split(",") for row in lines[1:]]
    for row in moved:
        row[column] = str(float(row[column]) + 2.0)
    (folder / "lib" / TABLE).write_text("\n".join([lines[0], *map(",".join, moved)]) + "\n")
    done = starplumb("measure", folder / "campaign.toml")
    assert done.status == 3
    assert "the library has no chip where it looks, about latitude" in done.err


def spoilt(name, change):
    """What rewrites the first row of a column of chips.csv."""

    def spoil(folder):
        table = folder / "lib" / TABLE
        head, first, *rest = table.read_text().splitlines()
        cells = dict(zip(head.split(","), first.split(","), strict=True))
        cells[name] = change(cells[name])
        table.write_text("\n".join([head, ",".join(cells.values()), *rest]) + "\n")

    return spoil


def picture(values):
    """What puts another picture in the place of the first chip's, with its digest."""

    def spoil(folder):
        path = next(p for p in sorted((folder / "lib").glob("*.png")) if "heights" not in p.name)
        old = hashlib.sha256(path.read_bytes()).hexdigest()
        Image.fromarray(values).save(path)
        table = folder / "lib" / TABLE
        new = hashlib.sha256(path.read_bytes()).hexdigest()
        table.write_text(table.read_text().replace(old, new))

    return spoil


def settings(old, new):
    def spoil(folder):
        path = folder / "campaign.toml"
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))

    return spoil


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (
            spoilt("sha256", lambda cell: cell[:-2] + "zz"),
            r"column sha256: found a digest that is not that of N",
        ),
        (spoilt("file", lambda cell: "../" + cell), "wanted the name of a PNG in the folder of the table"),
        (spoilt("file", lambda cell: "none.png"), r'column file: "none.png": found no such file'),
        (spoilt("crs", lambda cell: "EPSG:32633"), 'column crs: found "EPSG:32633", wanted EPSG:4326'),
        (spoilt("gsd_m", lambda cell: "-1"), "column gsd_m: found -1, wanted metres"),
        (spoilt("sigma_up_m", lambda cell: "-3"), "column sigma_up_m"),
        (spoilt("heights_step_m", lambda cell: ""), "column heights_step_m: found"),
        (spoilt("heights_low_m", lambda cell: "1e5"), 'column heights_file: found "heights from'),
        (spoilt("latitude_deg", lambda cell: "89.5"), "column latitude_deg: found 89.5, wanted -89 to 89"),
        (spoilt("correlation_length_m", lambda cell: "7"), r"found several correlation_length_m \(7, 300\)"),
        (picture(np.zeros((60, 61), np.uint16)), 'found "61 x 60 pixels", wanted a square'),
        (
            lambda folder: (folder / "lib" / TABLE).unlink(),
            "found a folder without chips.csv, wanted a library",
        ),
        (settings('"lib"', '"lub"'), r'reference.files: "lub": found no folder of that name'),
        (settings('"chips"', '"chips"\ndem = "dem.asc"'), 'reference.dem: found it beside kind = "chips"'),
    ],
)
def test_a_bad_library_is_refused_in_a_sentence(worlds, tmp_path, spoil, said):
    folder = tmp_path / "world"
    shutil.copytree(worlds[0], folder)
    spoil(folder)
    done = starplumb("measure", folder / "campaign.toml")
    assert done.status == 2
    assert re.search(said, done.err), done.err
    assert len(done.err.strip().splitlines()) == 1
    assert not (folder / "measured").exists()


def test_chips_are_cut_out_of_an_orthoimage_into_a_new_folder_only(worlds, tmp_path):
    done = starplumb("measure", worlds[0] / "campaign.toml", "--chips", tmp_path / "new")
    assert done.status == 2
    assert 'found reference.kind = "chips", wanted "ortho"' in done.err
    (tmp_path / "note.txt").write_text("mine")
    done = starplumb("measure", worlds[0] / "ortho.toml", "--chips", tmp_path)
    assert done.status == 2
    assert "wanted a new folder for the library" in done.err


def test_the_same_chip_in_two_libraries_is_one(worlds, tmp_path):
    from starplumb.io.campaign.read import load_images
    from starplumb.session.imagery.library import open_library

    folder = tmp_path / "world"
    shutil.copytree(worlds[0], folder)
    shutil.copytree(folder / "lib", folder / "lib2")
    settings('["lib"]', '["lib", "lib2"]')(folder)
    loaded = load_images(folder / "campaign.toml")
    loaded, scene = open_library("campaign.toml", loaded)
    assert len(loaded.campaign.landmarks.ids) == len(scene.reference.chips)
    assert len(set(loaded.campaign.landmarks.ids)) == len(scene.reference.chips)
    spoilt("latitude_deg", lambda cell: str(float(cell) + 1e-3))(folder)
    with pytest.raises(InputError, match=r"in two libraries, .* m apart"):
        open_library("campaign.toml", replace(loaded, config=load_images(folder / "campaign.toml").config))
