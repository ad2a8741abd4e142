"""Windows of rasters, tiles of orthoimages and grids of heights: against what was put into the files."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from starplumb.io.imagery.ortho import Ortho, Tile
from starplumb.io.imagery.rasters import RawImage, open_pixels
from starplumb.io.imagery.relief import read_ascii_grid, read_relief
from starplumb.physics.errors import InputError
from starplumb.physics.units import DEG


def png(path, values):
    Image.fromarray(values).save(path)
    return path


@pytest.mark.parametrize(("kind", "most"), [(np.uint8, 255), (np.uint16, 65_535)])
def test_windows_of_a_png_are_its_values_and_beyond_it_there_is_nothing(tmp_path, rng, kind, most):
    values = rng.integers(0, most, (30, 40), endpoint=True).astype(kind)
    values[4, 5] = 7
    raw = RawImage(open_pixels(png(tmp_path / "a.png", values), 1), nodata=7.0)
    assert raw.size_px == (40, 30)
    expected = np.where(values == 7, np.nan, values.astype(float))
    np.testing.assert_array_equal(raw.window(3, 2, 10, 8), expected[2:10, 3:13])
    beyond = raw.window(-2, 25, 5, 8)
    assert np.isnan(beyond[:, :2]).all()
    assert np.isnan(beyond[5:]).all()
    np.testing.assert_array_equal(beyond[:5, 2:], expected[25:, :3])
    above = raw.window(3, -4, 4, 6)
    assert np.isnan(above[:4]).all()
    np.testing.assert_array_equal(above[4:], expected[:2, 3:7])
    assert np.isnan(raw.window(100, 100, 3, 3)).all()


def test_a_band_of_a_colour_png_is_read_and_one_it_has_not_refused(tmp_path, rng):
    values = rng.integers(0, 255, (10, 12, 3)).astype(np.uint8)
    path = png(tmp_path / "a.png", values)
    np.testing.assert_array_equal(open_pixels(path, 2).cells(0, 0, 12, 10), values[..., 1])
    with pytest.raises(InputError, match=r"a\.png: found 3 bands, wanted band 4"):
        open_pixels(path, 4).cells(0, 0, 1, 1)


def test_a_file_that_is_cut_off_or_missing_is_named(tmp_path, rng):
    path = png(tmp_path / "a.png", rng.integers(0, 255, (50, 50)).astype(np.uint8))
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(InputError, match=r"a\.png: found a file that is not a whole PNG"):
        _ = open_pixels(path, 1).size
    with pytest.raises(InputError, match=r"b\.png"):
        open_pixels(tmp_path / "b.png", 1)


WEST, NORTH, DX, DY = 12.0, 50.0, 3e-5, -2e-5


def tiles(tmp_path, values, split):
    found = []
    for k, part in enumerate((slice(0, split), slice(split, None))):
        path = png(tmp_path / f"tile{k}.png", values[:, part])
        west = WEST + DX * (part.start or 0)
        numbers = (DX, 0.0, 0.0, DY, west, NORTH)
        path.with_suffix(".pgw").write_text("".join(f"{x!r}\n" for x in numbers))
        found.append(Tile.of(open_pixels(path, 1), "EPSG:4326", 0.0))
    return Ortho(found)


def places(column, row):
    return (NORTH + DY * row) * DEG, (WEST + DX * column) * DEG


def test_tiles_are_sampled_at_places_and_know_nothing_beyond(tmp_path):
    y, x = np.mgrid[:80, :120]
    values = np.rint(100.0 + 40.0 * np.sin(x / 9.0) + 30.0 * np.cos(y / 7.0)).astype(np.uint8)
    values[30:33, 20:24] = 0
    ortho = tiles(tmp_path, values, 70)
    row, column = np.meshgrid(np.arange(5.3, 75.0, 2.1), np.arange(5.7, 115.0, 3.3), indexing="ij")
    sampled = ortho.sample(*places(column, row), 1.0)
    true = 100.0 + 40.0 * np.sin(column / 9.0) + 30.0 * np.cos(row / 7.0)
    hole = (abs(row - 31.0) < 5.0) & (abs(column - 21.5) < 5.5)
    seam = abs(column - 69.5) < 2.0
    np.testing.assert_allclose(sampled[~hole & ~seam], true[~hole & ~seam], atol=1.2)
    assert np.abs(sampled - true)[seam].max() < 3.0
    assert np.isnan(sampled[(abs(row - 31.0) < 1.0) & (abs(column - 21.5) < 1.5)]).all()
    outside = ortho.sample(*places(np.array([[-3.0, 130.0]]), np.array([[10.0, 10.0]])), 1.0)
    assert np.isnan(outside).all()


def test_what_is_finer_than_asked_for_is_averaged_where_it_lies(tmp_path, rng):
    y, x = np.mgrid[:80, :120]
    values = 128.0 + 40.0 * np.sin(x / 11.0) + 20.0 * np.cos(y / 9.0) + rng.normal(0.0, 15.0, x.shape)
    ortho = tiles(tmp_path, np.clip(np.rint(values), 1, 255).astype(np.uint8), 119)
    cell_m = ortho.tiles[0].cell_m
    assert cell_m == pytest.approx(2e-5 * 111_195.0, rel=0.2)
    row, column = np.meshgrid(np.arange(20.0, 60.0, 1.7), np.arange(20.0, 90.0, 1.7), indexing="ij")
    left = ortho.sample(*places(column, row), 4.05 * cell_m)
    left -= 128.0 + 40.0 * np.sin(column / 11.0) + 20.0 * np.cos(row / 9.0)
    # sixteen cells are averaged, some of which the spline between them gives back
    assert np.std(left) < 0.45 * 15.0
    slope = 40.0 / 11.0 * np.cos(column / 11.0)
    assert abs(np.sum(left * slope) / np.sum(slope**2)) < 0.5


def test_a_raster_that_does_not_say_where_it_lies_is_refused(tmp_path, rng):
    path = png(tmp_path / "a.png", rng.integers(0, 255, (9, 9)).astype(np.uint8))
    with pytest.raises(InputError, match="says where it lies"):
        Tile.of(open_pixels(path, 1), "EPSG:4326", None)
    path.with_suffix(".pgw").write_text("1.0\n0\n0\n-1.0\n500000.0\n5000000.0\n")
    with pytest.raises(InputError, match=r"reference\.crs"):
        Tile.of(open_pixels(path, 1), None, None)
    with pytest.raises(InputError, match="wanted degrees"):
        Tile.of(open_pixels(path, 1), "EPSG:4326", None)
    path.with_suffix(".pgw").write_text("1.0\nno\n")
    with pytest.raises(InputError, match="six lines"):
        Tile.of(open_pixels(path, 1), "EPSG:4326", None)
    for steps in ("0\n0\n0\n0", "1e-30\n0\n0\n1e30", "1e-20\n0\n0\n-1e-20"):
        path.with_suffix(".pgw").write_text(f"{steps}\n9.0\n45.0\n")
        with pytest.raises(InputError, match="found a georeference that is none"):
            Tile.of(open_pixels(path, 1), "EPSG:4326", None)
    path.with_suffix(".pgw").write_text("1_0.0\n0\n0\n-1.0\n9.0\n45.0\n")
    with pytest.raises(InputError, match="six lines"):
        Tile.of(open_pixels(path, 1), "EPSG:4326", None)


def test_a_geotiff_in_another_system_is_sampled_where_its_cells_lie(tmp_path, rng):
    rasterio = pytest.importorskip("rasterio")
    pyproj = pytest.importorskip("pyproj")
    values = rng.integers(1, 4000, (60, 70)).astype(np.uint16)
    transform = rasterio.Affine(3.0, 0.0, 500_000.0, 0.0, -3.0, 5_540_000.0)
    profile = {"driver": "GTiff", "width": 70, "height": 60, "count": 1, "dtype": "uint16"}
    with rasterio.open(tmp_path / "a.tif", "w", transform=transform, crs="EPSG:32633", **profile) as file:
        file.write(values, 1)
    tile = Tile.of(open_pixels(tmp_path / "a.tif", 1), None, None)
    assert tile.cell_m == pytest.approx(3.0)
    row, column = np.mgrid[10:50:7, 10:60:6]
    x, y = 500_001.5 + 3.0 * column, 5_539_998.5 - 3.0 * row
    way = pyproj.Transformer.from_crs("EPSG:32633", "EPSG:4326", always_xy=True)
    longitude, latitude = way.transform(x, y)
    sampled = tile.sample(latitude * DEG, longitude * DEG, 1.0)
    np.testing.assert_allclose(sampled, values[row, column], atol=0.5)


def test_a_damaged_tiff_is_one_sentence_and_no_line_of_gdal(tmp_path, rng, capfd):
    rasterio = pytest.importorskip("rasterio")
    path, values = tmp_path / "a.tif", rng.integers(1, 255, (60, 70)).astype(np.uint8)
    profile = {"driver": "GTiff", "width": 70, "height": 60, "count": 1, "dtype": "uint8", "crs": "EPSG:4326"}
    with rasterio.open(path, "w", transform=rasterio.Affine(1e-5, 0, 9, 0, -1e-5, 45), **profile) as file:
        file.write(values, 1)
    path.write_bytes(path.read_bytes()[:-100])
    pixels = open_pixels(path, 1)
    with pytest.raises(InputError, match=r"a\.tif: found a damaged raster"):
        pixels.cells(0, 0, 70, 60)
    assert capfd.readouterr() == ("", "")


ASC = "ncols 4\nnrows 3\nxllcorner 11.9995\nyllcorner 49.9995\ncellsize 0.001\nNODATA_value -9999\n"
HEIGHTS = "1 2 3 4\n5 6 7 8\n9 10 -9999 12\n"


def test_an_ascii_grid_has_its_first_row_in_the_north(tmp_path):
    path = tmp_path / "dem.asc"
    path.write_text(ASC + HEIGHTS)
    relief = read_relief(path, "EPSG:4326", "ellipsoidal", None)
    latitude, longitude = (
        np.array([50.002, 50.0005, 50.0015, 50.0]),
        np.array([12.0, 12.0005, 12.0005, 12.002]),
    )
    at = relief.at(latitude * DEG, longitude * DEG)
    np.testing.assert_allclose(at[:3], [1.0, 7.5, 3.5], atol=1e-6)
    assert np.isnan(at[3])
    assert np.isnan(relief.at(np.array([51.0]) * DEG, np.array([12.0]) * DEG)).all()
    assert relief.step_m == pytest.approx(111.195 * np.cos(50.002 * DEG), rel=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ASC + "1 2 3", "found 3 heights, wanted 12"),
        (ASC.replace("ncols 4", "ncols four") + HEIGHTS, 'ncols: found "four"'),
        (ASC.replace("NODATA_value", "ncols") + HEIGHTS, "found ncols twice"),
        (ASC.replace("ncols 4", "ncols 1e70") + HEIGHTS, "found 1e.70 x 3 cells"),
        (ASC.replace("cellsize 0.001", "cellsize -0.001") + HEIGHTS, "wanted places on the Earth"),
        (ASC.replace("yllcorner 49.9995", "yllcorner 4999950") + HEIGHTS, "wanted places on the Earth"),
        (ASC + HEIGHTS.replace("7", "32767"), "found the height .32767., wanted a number from -1000"),
        (ASC + HEIGHTS.replace("7", "1_7"), "found the height .1_7."),
        (ASC.replace("cellsize 0.001\n", "") + HEIGHTS, "cellsize"),
        (ASC + HEIGHTS.replace("7", "seven"), 'found the height "seven"'),
        ("a letter", "without cellsize"),
    ],
)
def test_a_bad_ascii_grid_is_refused_in_words(tmp_path, text, said):
    path = tmp_path / "dem.asc"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        read_ascii_grid(path)


def test_an_ascii_grid_must_be_said_to_be_in_degrees(tmp_path):
    path = tmp_path / "dem.asc"
    path.write_text(ASC + HEIGHTS)
    with pytest.raises(InputError, match="EPSG:4326"):
        read_relief(path, "EPSG:32633", "ellipsoidal", None)


def test_complex_values_are_refused(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    path = tmp_path / "radar.tif"
    place = rasterio.Affine(1e-5, 0.0, 9.0, 0.0, -1e-5, 45.0)
    profile = {
        "driver": "GTiff",
        "width": 4,
        "height": 4,
        "count": 1,
        "dtype": "complex64",
        "transform": place,
    }
    with rasterio.open(path, "w", **profile) as file:
        file.write(np.ones((1, 4, 4), np.complex64))
    with pytest.raises(InputError, match="found complex values, wanted real ones"):
        open_pixels(path, 1)


@pytest.mark.parametrize("own", [False, True])
def test_gdal_keeps_few_blocks_unless_the_user_says_how_many(monkeypatch, own):
    rasterio = pytest.importorskip("rasterio", reason="needs the extra gis")
    from starplumb.io.gis.drivers import quiet_gdal

    monkeypatch.delenv("GDAL_CACHEMAX", raising=False)
    if own:
        monkeypatch.setenv("GDAL_CACHEMAX", "512")
    with quiet_gdal():
        kept = rasterio.env.getenv().get("GDAL_CACHEMAX")
    assert kept == (None if own else 64)
