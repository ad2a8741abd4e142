"""Whole images on the ground, as files: every pixel where the single one is, and what is beside the terrain."""

from __future__ import annotations

import json
from dataclasses import replace
from xml.sax.saxutils import escape

import numpy as np
import pytest
from typer.testing import CliRunner

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.cli.app import app
from starplumb.ground import geolocation
from starplumb.ground.geolocation import positions, terrain_below
from starplumb.ground.terrain import ground_height, ground_heights
from starplumb.io.campaign.write import write_campaign
from starplumb.io.gis.geolocation import bytes_on_disk, write_grid
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.plan.demo import demo
from starplumb.table.geometry import locate, stations

rasterio = pytest.importorskip("rasterio")
# rasterio multiplies its transforms in the old way
pytestmark = pytest.mark.filterwarnings("ignore:Use `@` matmul:PendingDeprecationWarning")

MIRRORED = replace(LINE, tan_x=-LINE.tan_x)


def turned(deg):
    """The line of detectors turned about the boresight."""
    c, s = np.cos(np.deg2rad(deg)), np.sin(np.deg2rad(deg))
    return replace(LINE, tan_x=c * LINE.tan_x - s * LINE.tan_y, tan_y=s * LINE.tan_x + c * LINE.tan_y)


def hills(latitude, longitude):
    """Heights 200 .. 1000 m, hills some 10 km long."""
    return 600.0 + 400.0 * np.sin(4000.0 * latitude) * np.cos(3000.0 * longitude)


def singly(campaign, row, column, height):
    """Longitude, latitude of one pixel by the geometry of single rays."""
    p_J = locate(campaign, C_EK_TRUE, np.zeros(1, dtype=int), [column], [row], height)
    latitude, longitude, _ = itrf_to_geodetic(p_J)
    return longitude[0], latitude[0]


@pytest.mark.parametrize(
    "camera",
    [FRAME, LINE, turned(90.0), turned(-130.0)],
    ids=["frame", "line", "line along y", "oblique line"],
)
def test_every_pixel_is_where_the_single_one_is(camera, monkeypatch):
    monkeypatch.setattr(geolocation, "BLOCK", 20)
    campaign = truth(camera, 1, 1, tilt_deg=25.0)
    rows, columns = np.arange(0.0, 12000.0, 1500.0), np.arange(0.0, 12000.0, 1700.0)
    blocks = list(positions(campaign, C_EK_TRUE, 0, rows, columns, 350.0))
    assert len(blocks) == geolocation.block_count(rows, columns) > 1
    found = np.concatenate(blocks)
    assert found.shape == (8, 8, 3)
    np.testing.assert_array_equal(found[..., 2], 350.0)
    for i, j in ((0, 0), (3, 5), (7, 7)):
        np.testing.assert_allclose(
            found[i, j, :2], singly(campaign, rows[i], columns[j], 350.0), atol=2e-11, rtol=0
        )


def test_the_terrain_below_is_met_where_the_single_ray_meets_it():
    """Against the walk down a single ray; and it covers all that is seen."""
    campaign = truth(LINE, 1, 1, tilt_deg=25.0)
    rows, columns = np.linspace(0.0, 11999.0, 4), np.linspace(0.0, 11999.0, 5)
    terrain = terrain_below(campaign, C_EK_TRUE, 0, rows, columns, hills, 30.0)
    (found,) = positions(campaign, C_EK_TRUE, 0, rows, columns, terrain)
    assert np.ptp(found[..., 2]) > 300.0
    for i, j in ((0, 0), (1, 4), (3, 2)):
        height = ground_height(campaign, C_EK_TRUE, 0, np.array([columns[j], rows[i]]), hills, 30.0)
        assert found[i, j, 2] == pytest.approx(height, abs=0.3)  # a plane between posts of curved ground
        np.testing.assert_allclose(
            found[i, j, :2], singly(campaign, rows[i], columns[j], found[i, j, 2]), atol=1e-9, rtol=0
        )


@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
def test_many_rays_end_where_each_first_meets_the_ground(camera, rng):
    """Aslant over ridges: on the ground, and above it all the way down, looked at every metre; some see no ground."""
    campaign = truth(camera, 2, 1, tilt_deg=40.0)
    image, pixel = np.repeat([0, 1], 15), rng.uniform(0.0, 11999.0, (30, 2))

    def ridges(latitude, longitude):
        x = 6.4e6 * np.stack([latitude, longitude])
        height = (
            900.0 + 700.0 * np.sin(x[0] / 2500.0) * np.cos(x[1] / 1900.0) + 30.0 * np.sin(x.sum(0) / 150.0)
        )
        return np.where(latitude < edge, height, np.nan)

    level = itrf_to_geodetic(locate(campaign, C_EK_TRUE, image, *pixel.T, 900.0))
    edge = np.sort(level[0])[-4]
    found = ground_heights(campaign, C_EK_TRUE, image, pixel, ridges, 20.0)
    assert 1 <= np.isnan(found).sum() <= 6
    seen = np.flatnonzero(np.isfinite(found))
    latitude, longitude, _ = itrf_to_geodetic(
        locate(campaign, C_EK_TRUE, image[seen], *pixel[seen].T, found[seen])
    )
    np.testing.assert_allclose(ridges(latitude, longitude), found[seen], atol=1e-6)
    for k in seen:
        down = np.arange(found[k] + 1e-3, 1700.0, 1.0)
        before = np.broadcast_to(pixel[k, :, None], (2, down.size))
        p_J = locate(campaign, C_EK_TRUE, np.full(down.size, image[k]), *before, down)
        latitude, longitude, _ = itrf_to_geodetic(p_J)
        assert not np.any(down - ridges(latitude, longitude) <= 0.0)


def test_heights_that_a_coarse_look_misses_are_covered():
    """Ground 250 m above all that the first, coarse grid of posts found, seen aslant in posts of 10 m."""
    campaign = truth(FRAME, 1, 1, tilt_deg=25.0)
    rows = columns = np.linspace(0.0, 900.0, 4)
    looks = []

    def heights(latitude, longitude):
        looks.append(longitude[1] - longitude[0])
        return np.full(latitude.shape, 100.0 if looks[-1] == looks[0] else 350.0)

    terrain = terrain_below(campaign, C_EK_TRUE, 0, rows, columns, heights, 10.0)
    assert len(set(looks)) == 2
    (found,) = positions(campaign, C_EK_TRUE, 0, rows, columns, terrain)
    np.testing.assert_allclose(found[..., 2], 350.0, atol=1e-6)


def test_ground_that_is_not_known_is_not_a_number():
    campaign = truth(FRAME, 1, 1)
    rows = columns = np.linspace(0.0, 11999.0, 5)
    middle, _ = singly(campaign, 6000.0, 6000.0, 0.0)
    half = terrain_below(
        campaign, C_EK_TRUE, 0, rows, columns, lambda lat, lon: np.where(lon < middle, 100.0, np.nan), 500.0
    )
    (found,) = positions(campaign, C_EK_TRUE, 0, rows, columns, half)
    assert 5 < np.isnan(found[..., 2]).sum() < 20
    np.testing.assert_array_equal(np.isnan(found[..., 0]), np.isnan(found[..., 2]))
    with pytest.raises(InputError, match="found no ground height below it"):
        terrain_below(campaign, C_EK_TRUE, 0, rows, columns, lambda lat, lon: np.full(lat.shape, np.nan), 9.0)
    with pytest.raises(InputError, match="wanted 1e\\+08 at most"):
        terrain_below(campaign, C_EK_TRUE, 0, rows, columns, hills, 0.01)


@pytest.mark.parametrize("camera", [FRAME, MIRRORED], ids=["frame", "line from right to left"])
@pytest.mark.parametrize("column", [0.0, 5999.5, 11999.0, None])
def test_the_date_line_is_crossed(camera, column):
    """At a column of the middle row, or by the camera: as anywhere else, and longitudes stay within half a turn.

    Where a row begins on it, places at one height lie before it and those at another behind it.
    """
    campaign, row = truth(camera, 1, 1, tilt_deg=25.0), 5999.5
    if column is None:
        r_J = stations(campaign, np.array([0]), np.array([row])).r_J[0]
        longitude = np.arctan2(r_J[1], r_J[0])
    else:
        longitude, _ = singly(campaign, row, column, 600.0)
    turn = np.pi - longitude
    C = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    rows, columns = np.linspace(0.0, 11999.0, 5), np.linspace(0.0, 11999.0, 3)
    found, ground = [], []
    for one, turned_by in ((campaign, 0.0), (_turned(campaign, C), turn)):
        ground.append(
            terrain_below(
                one, C_EK_TRUE, 0, rows, columns, lambda lat, lon, by=turned_by: hills(lat, lon - by), 200.0
            )
        )
        found += positions(one, C_EK_TRUE, 0, rows, columns, ground[-1])
    assert ground[0].height.shape == ground[1].height.shape
    np.testing.assert_allclose(found[1][..., 1:], found[0][..., 1:], atol=1e-6)
    assert np.all(np.abs(found[1][..., 0]) <= np.pi)
    np.testing.assert_allclose(
        np.exp(1j * found[1][..., 0]), np.exp(1j * (found[0][..., 0] + turn)), atol=1e-12
    )


def _turned(campaign, C):
    """The campaign as if the Earth had turned below it."""

    class Turned:
        def __init__(self, series, after):
            self.series, self.after = series, after

        def at(self, *a, **k):
            return self.after(*self.series.at(*a, **k))

    orbit = Turned(campaign.ephemeris, lambda r, v: (r @ C.mT, v if v is None else v @ C.mT))
    attitude = Turned(campaign.attitude, lambda C_EJ, omega: (C_EJ @ C.mT, omega))
    return replace(campaign, ephemeris=orbit, attitude=attitude)


@pytest.fixture
def written(tmp_path):
    campaign, _ = demo("frame", 1, 4)
    return write_campaign(tmp_path / "campaign", campaign), CliRunner()


def point(run, path, column, row):
    told = run.invoke(app, ["locate", str(path), "--image", "image01", str(column), str(row), "--json"])
    document = json.loads(told.stdout)
    return [document[key] for key in ("longitude_deg", "latitude_deg", "height_m")]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
@pytest.mark.parametrize("ending", ["tif", "npy"])
def test_the_command_writes_a_grid(written, tmp_path, ending):
    path, run = written
    out = tmp_path / "new" / f"ground.{ending}"
    told = run.invoke(
        app, ["locate", str(path), "--image", "image01", "--grid", str(out), "--every", "3000", "--json"]
    )
    assert told.exit_code == 0, told.output
    document = json.loads(told.stdout)
    assert (document["rows"], document["columns"], document["pixels_without_ground"]) == (4, 4, 0)
    if ending == "npy":
        grid = np.load(out, allow_pickle=False)
    else:
        with rasterio.open(out) as file:
            assert file.descriptions == ("longitude_deg", "latitude_deg", "height_m")
            tags = [
                file.tags(ns="GEOLOCATION")[f"{axis}_{name}"]
                for name in ("OFFSET", "STEP")
                for axis in ("PIXEL", "LINE")
            ]
            assert tags == ["0.5", "0.5", "3000", "3000"]
            grid = file.read()
    for i, j in ((0, 0), (1, 3), (3, 2)):
        np.testing.assert_allclose(grid[:, i, j], point(run, path, 3000 * j, 3000 * i), atol=2e-9, rtol=0)
    assert [file.name for file in out.parent.iterdir()] == [out.name]


WARPED = """<VRTDataset rasterXSize="5" rasterYSize="5" subClass="VRTWarpedDataset">
<GeoTransform>10.095, 0.01, 0, 49.905, 0, -0.01</GeoTransform>
<VRTRasterBand dataType="Float64" band="1" subClass="VRTWarpedRasterBand"/><BlockXSize>5</BlockXSize>
<BlockYSize>5</BlockYSize><GDALWarpOptions><ResampleAlg>Bilinear</ResampleAlg>
<WorkingDataType>Float64</WorkingDataType><SourceDataset>{image}</SourceDataset><Transformer><GenImgProjTransformer>
<SrcGeoLocTransformer><GeoLocTransformer><Reversed>0</Reversed><Metadata>{tags}</Metadata></GeoLocTransformer>
</SrcGeoLocTransformer><DstGeoTransform>10.095, 0.01, 0, 49.905, 0, -0.01</DstGeoTransform>
<DstInvGeoTransform>-1009.5, 100, 0, 4990.5, 0, -100</DstInvGeoTransform></GenImgProjTransformer></Transformer>
<BandList><BandMapping src="1" dst="1"/></BandList></GDALWarpOptions></VRTDataset>"""
"""An image brought by its geolocation array to 5 x 5 pixels of 0.01 degrees, the first at 10.1 E, 49.9 N."""


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
@pytest.mark.parametrize("every", [1, 4])
def test_gdal_finds_the_pixels_by_the_grid(tmp_path, every):
    """An image whose pixel (j, i) lies at 10 + 0.01 j E, 50 - 0.01 i N and has the value j + 100 i."""
    pixel, grid, image = np.arange(41.0), tmp_path / "grid.tif", tmp_path / "image.tif"
    latitude, longitude = np.meshgrid(
        50.0 - 0.01 * pixel[::every], 10.0 + 0.01 * pixel[::every], indexing="ij"
    )
    place = np.stack([np.deg2rad(longitude), np.deg2rad(latitude), np.zeros(latitude.shape)], axis=-1)
    assert write_grid(grid, [place], latitude.shape, every) == 0
    with rasterio.open(image, "w", driver="GTiff", width=41, height=41, count=1, dtype="float64") as file:
        file.write(pixel + 100.0 * pixel[:, None], 1)
    with rasterio.open(grid) as file:
        given = file.tags(ns="GEOLOCATION") | {
            "X_DATASET": grid,
            "Y_DATASET": grid,
            "SRS": rasterio.crs.CRS.from_epsg(4326).to_wkt(),
        }
    tags = "".join(f'<MDI key="{key}">{escape(str(value))}</MDI>' for key, value in given.items())
    (tmp_path / "warped.vrt").write_text(WARPED.format(image=image, tags=tags))
    with rasterio.open(tmp_path / "warped.vrt") as file:
        found = file.read(1)
    np.testing.assert_allclose(
        found, np.arange(10.0, 15.0) + 100.0 * np.arange(10.0, 15.0)[:, None], atol=0.02
    )


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
@pytest.mark.parametrize(("height", "flat"), [(120.3, True), (None, False)])
def test_a_geotiff_is_a_fraction_of_the_array_and_loses_less_than_is_known(tmp_path, rng, height, flat):
    """A tenth of a millimetre is known of a place: 9e-10 degrees; a height that is stated stays what is stated."""
    row, column = np.meshgrid(np.arange(400.0), np.arange(500.0), indexing="ij")
    longitude = 10.0 + 2.7e-5 * column + 3e-6 * row + 1e-10 * column * row
    latitude = 45.0 - 2.5e-5 * row + 1e-10 * row**2
    up = np.full(row.shape, height) if flat else 300.0 + np.cumsum(rng.normal(0.0, 3.0, row.shape), axis=1)
    place = np.stack([np.deg2rad(longitude), np.deg2rad(latitude), up], axis=-1)
    for name in ("g.tif", "g.npy"):
        assert write_grid(tmp_path / name, [place[:150], place[150:]], row.shape, 1) == 0
    with rasterio.open(tmp_path / "g.tif") as file:
        found = file.read()
    assert np.max(np.abs(found[:2] - [longitude, latitude])) < 5e-10
    assert np.max(np.abs(found[2] - up)) <= (0.0 if flat else 5e-5)
    small, whole = ((tmp_path / name).stat().st_size for name in ("g.tif", "g.npy"))
    assert small < bytes_on_disk(tmp_path / "g.tif", row.shape, flat) * 1.3
    assert whole == pytest.approx(bytes_on_disk(tmp_path / "g.npy", row.shape, flat), rel=1e-3)


@pytest.mark.slow
def test_a_grid_on_a_dem_says_what_it_lacks(written, tmp_path):
    path, run = written
    longitude, latitude, _ = point(run, path, 6000, 6000)
    dem = tmp_path / "dem.tif"
    transform = rasterio.transform.from_origin(longitude - 1.0, latitude + 1.0, 0.01, 0.01)
    profile = {
        "driver": "GTiff",
        "width": 100,
        "height": 200,
        "count": 1,
        "dtype": "float64",
        "crs": "EPSG:4326",
    }
    with rasterio.open(dem, "w", transform=transform, **profile) as file:
        file.write(np.full((200, 100), 250.0), 1)
    out = tmp_path / "ground.npy"
    arguments = ["locate", str(path), "--image", "image01", "--grid", str(out), "--every", "1000"]
    told = run.invoke(app, [*arguments, "--dem", str(dem), "--heights", "ellipsoidal", "--json"])
    assert told.exit_code == 0, told.output
    grid = np.load(out, allow_pickle=False)
    missing = json.loads(told.stdout)["pixels_without_ground"]
    assert 40 < missing == np.isnan(grid[2]).sum() < 104
    np.testing.assert_allclose(grid[2][~np.isnan(grid[2])], 250.0, atol=1e-6)
    west = grid[0][~np.isnan(grid[0])]
    assert west.size
    assert np.all(west < longitude)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--grid", "ground.csv"], "ground.csv: found the ending '.csv', wanted .tif, .tiff, .npy"),
        (["1", "2", "--grid", "ground.npy"], "found them and --grid, wanted one"),
        ([], "found neither them nor --grid, wanted one"),
        (["1"], "COLUMN ROW: found a COLUMN alone, wanted its ROW too"),
    ],
)
def test_wrong_options_are_refused_in_a_sentence(written, more, says):
    path, run = written
    told = run.invoke(app, ["locate", str(path), "--image", "image01", *more])
    assert isinstance(told.exception, InputError)
    assert says in str(told.exception)
    assert "\n" not in str(told.exception)


@pytest.mark.parametrize(("kind", "says"), [("frame", "wanted only these"), ("line", "wanted --rows")])
def test_rows_are_told_where_the_camera_does_not(tmp_path, kind, says):
    """A line scanner goes on as long as it is switched on, a frame ends."""
    campaign, _ = demo(kind, 1, 4)
    path = write_campaign(tmp_path / "campaign", campaign)
    arguments = [
        "locate",
        str(path),
        "--image",
        "image01",
        "--grid",
        str(tmp_path / "g.npy"),
        "--every",
        "500",
    ]
    with_rows = [*arguments, "--rows", "2001"]
    wrong, right = (with_rows, arguments) if kind == "frame" else (arguments, with_rows)
    refused = CliRunner().invoke(app, wrong)
    assert isinstance(refused.exception, InputError)
    assert says in str(refused.exception)
    told = CliRunner().invoke(app, [*right, "--json"])
    assert told.exit_code == 0, told.output
    assert json.loads(told.stdout)["rows"] == (24 if kind == "frame" else 5)


def test_a_folder_in_the_way_is_said(written, tmp_path):
    path, run = written
    (tmp_path / "ground.npy").mkdir()
    told = run.invoke(
        app,
        [
            "locate",
            str(path),
            "--image",
            "image01",
            "--every",
            "6000",
            "--grid",
            str(tmp_path / "ground.npy"),
        ],
    )
    assert isinstance(told.exception, InputError)
    assert "ground.npy: found something there that this command has not written" in str(told.exception)
