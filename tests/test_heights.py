"""Heights from rasters: sampled where the cells are, never guessed, met where the line of sight meets them first."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from helpers import CAMPAIGN, write_good_campaign
from problems import C_EK_TRUE, truth
from starplumb.cli.app import app
from starplumb.ground.terrain import ground_height
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.io.gis.heights import Ground, Raster, surface
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.units import DEG
from starplumb.plan.demo import demo
from starplumb.table.geometry import locate

rasterio = pytest.importorskip("rasterio", reason="needs the extra gis")
# rasterio multiplies its transforms in the old way
pytestmark = pytest.mark.filterwarnings("ignore:Use `@` matmul:PendingDeprecationWarning")


def write(path, values, west, north, step, crs="EPSG:4326", nodata=None):
    """A raster whose first cell's outer corner is (west, north)."""
    values = np.asarray(values, dtype=np.float32)
    profile = {
        "driver": "GTiff",
        "width": values.shape[1],
        "height": values.shape[0],
        "count": 1,
        "dtype": "float32",
        "crs": crs,
        "transform": rasterio.Affine(step, 0.0, west, 0.0, -step, north),
        "nodata": nodata,
    }
    with rasterio.open(path, "w", **profile) as file:
        file.write(values, 1)
    return path


def at(path, latitude_deg, longitude_deg):
    place = np.atleast_1d(np.array(latitude_deg) * DEG), np.atleast_1d(np.array(longitude_deg) * DEG)
    return Raster.open(path).at(*place)


def test_values_stand_at_the_centres_of_cells(tmp_path):
    path = write(tmp_path / "dem.tif", [[10.0, 20.0], [30.0, 40.0]], west=5.0, north=47.0, step=1.0)
    np.testing.assert_allclose(
        at(path, [46.5, 46.5, 45.5, 46.0], [5.5, 6.5, 5.5, 6.0]), [10.0, 20.0, 30.0, 25.0]
    )
    np.testing.assert_allclose(at(path, 46.5, 5.75), 12.5)
    assert np.isnan(at(path, 46.5, 5.25))  # outside the centres nothing is known


def test_a_projected_raster_is_sampled_in_its_own_system(tmp_path):
    """The central meridian of UTM zone 33 is 15 deg E at easting 500 km; 0 deg N is northing 0."""
    easting = 499_000.0 + 100.0 * (np.arange(20) + 0.5)
    path = write(
        tmp_path / "utm.tif", np.tile(easting - 500_000.0, (20, 1)), 499_000.0, 1_000.0, 100.0, "EPSG:32633"
    )
    np.testing.assert_allclose(at(path, 0.0, 15.0), 0.0, atol=1e-3)
    # one arc second of the equator is 30.92 m, times the zone's scale 0.9996
    np.testing.assert_allclose(at(path, 0.0, 15.0 + 10.0 / 3600.0), 309.2 * 0.9996, atol=0.1)


@pytest.mark.parametrize(
    ("unit", "crs", "refused"),
    [
        ("m", "EPSG:4326", False),
        ("ft", "EPSG:4326", True),
        ("US survey foot", "EPSG:4326", True),
        # NAD83 with NAVD88 heights in US survey feet, and in metres
        (None, "EPSG:4269+6360", True),
        (None, "EPSG:4269+5703", False),
        # a grid in feet whose heights nobody says to be so
        (None, "EPSG:2263", False),
    ],
)
def test_heights_that_a_file_says_are_in_feet_are_refused(tmp_path, unit, crs, refused):
    path = write(tmp_path / "dem.tif", np.full((4, 4), 300.0), 5.0, 47.0, 1.0, crs)
    if unit is not None:
        with rasterio.open(path, "r+") as file:
            file.units = (unit,)
    try:
        said = str(surface(path, "geoid", None))
    except InputError as error:
        said = str(error)
    assert ("found heights in feet" in said) == refused
    assert ("wanted the geoid's grid" in said) != refused


@pytest.mark.parametrize("west", [-0.5, -180.5, -180.0])
def test_a_grid_around_the_earth_has_no_seam(tmp_path, west):
    """N = cos(longitude) + latitude, on grids that begin at 0 or at -180, on cell centres or edges."""
    longitude = west + 0.5 + np.arange(360)
    latitude = 89.5 - np.arange(180)
    values = np.cos(longitude * DEG)[None, :] + latitude[:, None]
    path = write(tmp_path / "geoid.tif", values, west, 90.0, 1.0)
    for wanted in (-180.0, -179.9, -0.4, 0.0, 0.3, 179.7, 180.0, 359.6):
        np.testing.assert_allclose(
            at(path, 10.0, wanted), np.cos(wanted * DEG) + 10.0, atol=1e-4, err_msg=str(wanted)
        )


def test_a_raster_that_does_not_cover_a_landmark_is_refused_by_name(tmp_path):
    values = np.full((4, 4), 100.0)
    values[0, 0] = -9999.0
    dem = surface(write(tmp_path / "dem.tif", values, 5.0, 47.0, 1.0, nodata=-9999.0), "ellipsoidal", None)
    good = dem.heights(np.array([44.5]) * DEG, np.array([6.5]) * DEG, ("a",))
    assert good == pytest.approx([100.0])
    for latitude, longitude in ((46.4, 5.6), (50.0, 6.0)):
        with pytest.raises(
            InputError,
            match=r'dem.tif: found no height for "b" at latitude .*, wanted a raster that covers it',
        ):
            dem.heights(np.array([44.5, latitude]) * DEG, np.array([6.5, longitude]) * DEG, ("a", "b"))


def test_a_signalling_nan_is_no_data_without_a_warning(tmp_path):
    """A bit of a damaged file makes one: numpy warns where it is made wider."""
    path = write(tmp_path / "dem.tif", [[7.25, 20.0], [30.0, 40.0]], 5.0, 47.0, 1.0)
    data = path.read_bytes()
    assert data.count(np.float32(7.25).tobytes()) == 1
    path.write_bytes(data.replace(np.float32(7.25).tobytes(), bytes.fromhex("0100a07f")))
    np.testing.assert_equal(at(path, [46.5, 45.5], [5.5, 6.5]), [np.nan, 40.0])


def test_an_empty_cell_of_no_weight_does_not_matter(tmp_path):
    values = [[1.0, -9999.0], [3.0, 4.0]]
    path = write(tmp_path / "dem.tif", values, 5.0, 47.0, 1.0, nodata=-9999.0)
    np.testing.assert_allclose(at(path, [46.5, 46.0], [5.5, 5.5]), [1.0, 2.0])


def test_what_heights_are_above_is_never_guessed(tmp_path):
    dem = write(tmp_path / "dem.tif", np.full((3, 3), 50.0), 5.0, 47.0, 1.0)
    geoid = write(tmp_path / "geoid.tif", np.full((3, 3), 48.0), 5.0, 47.0, 1.0)
    place = np.array([45.5]) * DEG, np.array([6.5]) * DEG
    with pytest.raises(InputError, match="heights of a kind not stated"):
        surface(dem, None, None)
    with pytest.raises(InputError, match="wanted the geoid's grid too"):
        surface(dem, "geoid", None)
    assert surface(dem, "ellipsoidal", None).at(*place) == pytest.approx([50.0])
    assert surface(dem, "geoid", geoid).at(*place) == pytest.approx([98.0])
    on_geoid = Ground(heights="geoid", geoid=geoid)
    assert on_geoid.ellipsoidal(dem, np.array([7.0]), *place, ("a",)) == pytest.approx([55.0])
    assert Ground().ellipsoidal(dem, np.array([7.0]), *place, ("a",)) == pytest.approx([7.0])


@pytest.mark.parametrize(
    ("crs", "said"),
    [("EPSG:4326+5773", "ellipsoidal"), ("EPSG:32633+5773", "ellipsoidal"), ("EPSG:4979", "geoid")],
)
def test_a_file_that_says_what_its_heights_are_must_agree(tmp_path, crs, said):
    step = 1.0 if "4326" in crs or "4979" in crs else 1000.0
    dem = write(tmp_path / "dem.tif", np.full((3, 3), 50.0), 5.0, 47.0, step, crs)
    with pytest.raises(InputError, match="by its own reference system"):
        surface(dem, said, dem)


def test_a_file_that_is_no_raster_is_refused(tmp_path):
    (tmp_path / "dem.tif").write_text("heights")
    with pytest.raises(InputError, match="found a file that is not a raster"):
        Raster.open(tmp_path / "dem.tif")
    with pytest.raises(InputError, match="found no such file"):
        Raster.open(tmp_path / "none.tif")


def oblique():
    """An image tilted by 25 deg, and the geodetic place its centre sees at height 0."""
    scene = truth(images=1, markers=4, tilt_deg=25.0)
    p_J = locate(scene, C_EK_TRUE, np.array([0]), [6000.0], [6000.0], 0.0)
    latitude, longitude, _ = itrf_to_geodetic(p_J)
    return scene, float(latitude[0]), float(longitude[0])


def test_level_ground_is_met_at_its_height():
    scene, _, _ = oblique()
    found = ground_height(
        scene, C_EK_TRUE, 0, np.array([6000.0, 6000.0]), lambda lat, lon: np.full(lat.shape, 812.25), 30.0
    )
    assert found == pytest.approx(812.25, abs=1e-6)


def test_the_first_ground_on_the_way_is_met():
    """A ridge of 2000 m a third of a kilometre wide stands between the satellite and the place it would see at 0 m."""
    scene, latitude, longitude = oblique()
    pixel = np.array([6000.0, 6000.0])
    high = locate(scene, C_EK_TRUE, np.array([0]), pixel[:1], pixel[1:], 1500.0)
    ridge_lat, ridge_lon, _ = (float(x[0]) for x in itrf_to_geodetic(high))
    across = np.array([ridge_lat - latitude, (ridge_lon - longitude) * np.cos(latitude)])
    across /= np.linalg.norm(across)

    def ground(lat, lon):
        east_north = np.stack([lat - ridge_lat, (lon - ridge_lon) * np.cos(latitude)])
        return np.where(np.abs(across @ east_north) * 6.37e6 < 160.0, 2000.0, 0.0)

    found = ground_height(scene, C_EK_TRUE, 0, pixel, ground, 30.0)
    heights = np.linspace(3000.0, -100.0, 100_001)
    column, row = np.full(heights.size, 6000.0), np.full(heights.size, 6000.0)
    p_J = locate(scene, C_EK_TRUE, np.zeros(heights.size, dtype=int), column, row, heights)
    lat, lon, _ = itrf_to_geodetic(p_J)
    first = heights[np.argmax(heights <= ground(lat, lon))]
    assert 1000.0 < first < 2000.0
    assert found == pytest.approx(first, abs=0.1)


def test_unknown_ground_is_not_a_number():
    scene, _, _ = oblique()
    nowhere = ground_height(
        scene, C_EK_TRUE, 0, np.zeros(2), lambda lat, lon: np.full(lat.shape, np.nan), 30.0
    )
    assert np.isnan(nowhere)


def test_ground_known_only_far_below_the_ray_is_not_met():
    """Beside the ground that the ray meets; it passes over what is known, thousands of metres above."""
    scene, _, _ = oblique()
    pixel = np.array([6000.0, 6000.0])
    over = locate(scene, C_EK_TRUE, np.array([0]), pixel[:1], pixel[1:], 6000.0)
    known = itrf_to_geodetic(over)

    def patch(lat, lon):
        near = np.hypot(lat - known[0][0], (lon - known[1][0]) * np.cos(lat)) * 6.37e6 < 500.0
        return np.where(near, 100.0, np.nan)

    assert np.isfinite(patch(known[0], known[1])).all()
    assert np.isnan(ground_height(scene, C_EK_TRUE, 0, pixel, patch, 30.0))


@pytest.mark.slow
def test_locate_on_a_dem(tmp_path):
    campaign, _ = demo("frame", 1, 4)
    path = write_campaign(tmp_path / "campaign", campaign)
    run = CliRunner()
    arguments = ["locate", str(path), "--image", "image01", "6000", "6000", "--json"]

    def located(*more):
        result = run.invoke(app, [*arguments, *more])
        assert result.exit_code == 0, result.output
        return json.loads(result.stdout)

    level = located("--height-m", "340")
    west, north = np.floor(level["longitude_deg"]) - 1.0, np.ceil(level["latitude_deg"]) + 1.0
    dem = write(tmp_path / "dem.tif", np.full((40, 40), 300.0), west, north, 0.1)
    geoid = write(tmp_path / "geoid.tif", np.full((40, 40), 40.0), west, north, 0.1)
    on_dem = located("--dem", str(dem), "--heights", "geoid", "--geoid", str(geoid))
    for key in ("latitude_deg", "longitude_deg", "height_m"):
        assert on_dem[key] == pytest.approx(level[key], abs=1e-6)
    both = run.invoke(app, [*arguments, "--dem", str(dem), "--height-m", "1"])
    assert isinstance(both.exception, InputError)
    unstated = run.invoke(app, [*arguments, "--dem", str(dem)])
    assert isinstance(unstated.exception, InputError)
    assert "kind not stated" in str(unstated.exception)


LANDMARKS = (
    "landmark_id,latitude_deg,longitude_deg,sigma_m\nL1,0.05,0.05,0.5\nL2,-0.05,0.05,0.5\nL3,0.0,-0.06,0.5\n"
)
KEYS = 'file = "landmarks.csv"\n'


def campaign_with(folder, keys, **tables):
    path = write_good_campaign(folder, campaign=CAMPAIGN.replace(KEYS, KEYS + keys), **tables)
    write(folder / "dem.tif", np.full((10, 10), 33.0), -0.5, 0.5, 0.1)
    write(folder / "geoid.tif", np.full((10, 10), 17.0), -0.5, 0.5, 0.1)
    return path


def heights_of(path):
    loaded = load_campaign(path)
    return itrf_to_geodetic(loaded.campaign.landmarks.r_J)[2], loaded.inputs


def test_landmarks_take_their_heights_from_a_dem(tmp_path):
    keys = 'dem = "dem.tif"\nheights = "geoid"\ngeoid = "geoid.tif"\n'
    heights, inputs = heights_of(campaign_with(tmp_path, keys, landmarks=LANDMARKS))
    np.testing.assert_allclose(heights, 50.0, atol=1e-6)
    assert {"dem.tif", "geoid.tif"} <= set(inputs)


def test_landmarks_above_a_geoid_are_raised_by_it(tmp_path):
    keys = 'heights = "geoid"\ngeoid = "geoid.tif"\n'
    heights, _ = heights_of(campaign_with(tmp_path, keys))
    np.testing.assert_allclose(heights, [27.0, 37.0, 47.0], atol=1e-6)


def test_landmarks_of_a_vector_file_need_no_heights_beside_a_dem(tmp_path):
    pytest.importorskip("pyogrio", reason="needs the extra gis")
    keys = 'dem = "dem.tif"\nheights = "ellipsoidal"\n'
    features = [
        {
            "type": "Feature",
            "properties": {"landmark_id": f"L{i + 1}", "sigma_m": 0.5},
            "geometry": {"type": "Point", "coordinates": place},
        }
        for i, place in enumerate(([0.05, 0.05], [0.05, -0.05], [-0.06, 0.0]))
    ]
    path = campaign_with(tmp_path, keys)
    path.write_text(path.read_text().replace("landmarks.csv", "landmarks.geojson"))
    (tmp_path / "landmarks.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    heights, _ = heights_of(path)
    np.testing.assert_allclose(heights, 33.0, atol=1e-6)


CARTESIAN = "landmark_id,x_m,y_m,z_m,sigma_m\nL1,6378137,0,0,1\nL2,6378137,100,0,1\nL3,6378137,0,100,1\n"
REFUSED = {
    "kind not said": (
        'dem = "dem.tif"\n',
        {},
        "landmarks.heights: missing, wanted what the heights of the DEM are above",
    ),
    "no geoid": ('heights = "geoid"\n', {}, "landmarks.geoid: missing"),
    "geoid alone": ('geoid = "geoid.tif"\n', {}, 'landmarks.geoid: found it without heights = "geoid"'),
    "heights twice": (
        'dem = "dem.tif"\nheights = "ellipsoidal"\n',
        {},
        "found heights beside a DEM (landmarks.dem)",
    ),
    "no heights": ("", {"landmarks": LANDMARKS}, "wanted all of them or none"),
    "no such file": ('dem = "no.tif"\nheights = "ellipsoidal"\n', {}, "landmarks.dem"),
    "Cartesian": (
        'dem = "dem.tif"\nheights = "ellipsoidal"\n',
        {"landmarks": CARTESIAN},
        "found Cartesian places beside landmarks.dem",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_heights_of_landmarks_that_are_not_told_are_refused(tmp_path, case):
    keys, tables, message = REFUSED[case]
    with pytest.raises(InputError) as error:
        load_campaign(campaign_with(tmp_path, keys, **tables))
    assert message in str(error.value)
    assert "\n" not in str(error.value)
