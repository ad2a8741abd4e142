"""DIMAP products: the real one against the vendor's own grid, made-up ones against hand calculation."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from starplumb.estimators.gls import Gls
from starplumb.io.campaign.read import load_campaign
from starplumb.io.vendors.dimap import read_dimap
from starplumb.io.vendors.dimap_reach import reaching
from starplumb.io.vendors.product import import_product, read_product
from starplumb.io.vendors.vendor import C_KV
from starplumb.physics import so3
from starplumb.physics.earth import geodetic_to_itrf
from starplumb.physics.errors import InputError
from starplumb.physics.light import Corrections, aberrate, inertial_velocity
from starplumb.physics.units import ARCSEC
from starplumb.table.campaign import Landmarks, Sightings
from starplumb.table.geometry import locate, observe, project

Array = NDArray[np.float64]

MOUNT_ARCSEC = {"filtered": (0.07, -0.38, -6.61), "raw": (0.97, -2.09, -8.11)}
"""Rotation vectors AOCS -> camera, the vendor's axes, found with independent code (README of the product)."""


@pytest.fixture(scope="module")
def pleiades(shared_data: Path) -> Path:
    return next((shared_data / "pleiades1b").glob("PHRDIMAP*.XML"))


@pytest.fixture(scope="module")
def grid(shared_data: Path) -> tuple[Array, Array]:
    """Pixels (n, 2), counted from 0, and their ground points (n, 3) in the vendor's grid, 65 x 65 x 9."""
    rasterio = pytest.importorskip("rasterio")
    with rasterio.open(next((shared_data / "pleiades1b").glob("GRID*.tif"))) as file:
        bands, tags, place = file.read(), file.tags(), file.transform
    n = np.arange(bands.shape[1])
    row, column = np.meshgrid(place.f + 0.5 + n * place.e, place.c + 0.5 + n * place.a, indexing="ij")
    pixel = np.stack([column.ravel(), row.ravel()], axis=-1) - 1.0
    layers = range(0, len(bands), 2)
    ground = [
        geodetic_to_itrf(
            np.radians(bands[b + 1]).ravel(),
            np.radians(bands[b]).ravel(),
            np.full(pixel.shape[0], float(tags[f"ALTITUDE_B{b}"])),
        )
        for b in layers
    ]
    return np.tile(pixel, (len(layers), 1)), np.concatenate(ground)


@pytest.mark.slow
def test_vendor_attitude_reproduces_the_vendors_grid_without_our_light_effects(
    pleiades: Path, grid: tuple[Array, Array]
) -> None:
    campaign = read_dimap(pleiades).campaign(1.0, 1.0)
    assert campaign.corrections == Corrections(light_time=False, aberration=False, refraction=False)
    pixel, p_J = grid
    assert pixel.shape == (65 * 65 * 9, 2)
    found = project(campaign, campaign.C_EK, np.zeros(len(pixel), dtype=np.int64), p_J)
    assert np.abs(found - pixel).max() < 0.0005


@pytest.mark.parametrize(("light_time", "aberration", "metres"), [(True, False, 0.97), (False, True, 18.04)])
def test_a_wrong_switch_moves_the_vendors_grid(
    pleiades: Path, grid: tuple[Array, Array], light_time: bool, aberration: bool, metres: float
) -> None:
    pixel, p_J = (part[: 65 * 65] for part in grid)
    campaign = read_dimap(pleiades).campaign(1.0, 1.0)
    campaign = replace(campaign, corrections=Corrections(light_time, aberration))
    image = np.zeros(len(pixel), dtype=np.int64)
    met = locate(campaign, campaign.C_EK, image, pixel[:, 0], pixel[:, 1], -30.0)
    assert np.sqrt(np.mean(np.sum((met - p_J) ** 2, axis=-1))) == pytest.approx(metres, rel=0.02)


@pytest.mark.parametrize("choice", ["filtered", "raw"])
def test_mount_between_vendor_attitude_and_telemetry(pleiades: Path, choice: str) -> None:
    vendor, satellite = read_dimap(pleiades), read_dimap(pleiades, choice)  # type: ignore[arg-type]
    campaign = satellite.campaign(1.0, 1.0)
    t_ns = satellite.attitude_t_ns
    C_VJ = vendor.campaign(1.0, 1.0).attitude.at(t_ns)[0]
    r_J, v_J = campaign.ephemeris.at(t_ns)
    # the vendor's attitude has the aberration of his boresight in it: turn it back to what the camera saw
    e_J = C_VJ.mT @ np.array([0.0, 0.0, 1.0])
    seen_J = aberrate(e_J, inertial_velocity(r_J, v_J))
    C_VE = C_VJ @ so3.exp(np.cross(seen_J, e_J)) @ campaign.attitude.at(t_ns)[0].mT
    turn = so3.log(C_VE) / ARCSEC
    np.testing.assert_allclose(turn.mean(axis=0), MOUNT_ARCSEC[choice], atol=0.03)
    assert turn.std(axis=0).max() < 0.35


def test_mount_from_thirty_nodes_and_raw_quaternions(
    pleiades: Path, grid: tuple[Array, Array], rng: np.random.Generator
) -> None:
    chosen = rng.choice(len(grid[0]), 30, replace=False)
    pixel, p_J = grid[0][chosen], grid[1][chosen] + 0.3 * rng.standard_normal((30, 3))
    campaign = read_dimap(pleiades, "raw").campaign(0.5, [2.0, 2.0, 4.0])
    zero, n = np.zeros(30, dtype=np.int64), np.arange(30)
    campaign = replace(
        campaign,
        landmarks=Landmarks(tuple(map(str, n)), p_J, np.tile(0.09 * np.eye(3), (30, 1, 1))),
        sightings=Sightings(
            zero, n, pixel[:, 0], pixel[:, 1], np.full(30, 0.1), np.zeros(30, dtype=np.bool_)
        ),
    )
    assert campaign.corrections.aberration

    def rms(C_EK: Array) -> float:
        height = np.array([_height(p) for p in p_J])
        met = locate(campaign, C_EK, zero, pixel[:, 0], pixel[:, 1], height)
        return float(np.sqrt(np.mean(np.sum((met - p_J) ** 2, axis=-1))))

    estimate = Gls()(observe(campaign), campaign.C_EK)
    turn = so3.log(C_KV.mT @ estimate.C_EK.mT) / ARCSEC  # C_VK C_KE: AOCS -> camera in the vendor's axes
    np.testing.assert_allclose(turn[:2], MOUNT_ARCSEC["raw"][:2], atol=0.5)
    # 0.3 m at 725 km and a field of 0.8 deg: 2 arcsec about the line of sight
    assert turn[2] == pytest.approx(MOUNT_ARCSEC["raw"][2], abs=6.0)
    assert rms(campaign.C_EK) == pytest.approx(8.1, abs=1.0)
    assert rms(estimate.C_EK) < 1.3


def _height(p_J: Array) -> float:
    from starplumb.physics.earth import itrf_to_geodetic

    return float(itrf_to_geodetic(p_J)[2])


def test_imported_folder_loads_to_the_same_physics(pleiades: Path, tmp_path: Path) -> None:
    marks = tmp_path / "marks.csv"
    marks.write_text("landmark_id,latitude_deg,longitude_deg,height_m,sigma_m\na,31,2.2,500,1\n")
    seen = tmp_path / "seen.csv"
    seen.write_text("image_id,landmark_id,column_px,row_px,sigma_px\nI,a,20000,20000,0.2\n")
    out = tmp_path / "campaign"
    import_product(
        pleiades,
        out,
        attitude="filtered",
        sigma_m=0.5,
        sigma_arcsec=(1.0, 1.0, 2.0),
        landmarks=marks,
        observations=seen,
        image_id="I",
    )
    again = load_campaign(out / "campaign.toml").campaign
    product = read_dimap(pleiades, "filtered")
    np.testing.assert_array_equal(again.attitude.t_ns, product.attitude_t_ns)
    np.testing.assert_allclose(again.attitude.q_EF, product.q_EF, rtol=0, atol=2e-16)
    np.testing.assert_array_equal(again.ephemeris.r_J, product.r_J)
    np.testing.assert_allclose(again.C_EK, C_KV.T, atol=1e-15)
    np.testing.assert_allclose(again.cov_attitude_E / ARCSEC**2, np.diag([1.0, 1.0, 4.0]))
    assert again.images.t_ns[0] == product.t_ns
    with pytest.raises(InputError, match=r"campaign\.toml: found it there already"):
        import_product(pleiades, out, sigma_m=1.0, sigma_arcsec=1.0)


def test_sigmas_are_never_made_up(pleiades: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="wanted sigma_m and sigma_arcsec stated"):
        import_product(pleiades, tmp_path / "out")
    with pytest.raises(InputError, match="wanted sigma_arcsec stated"):
        import_product(pleiades, tmp_path / "out", sigma_m=1.0)
    with pytest.raises(InputError, match="one number or three, none negative"):
        import_product(pleiades, tmp_path / "out", sigma_m=-1.0, sigma_arcsec=1.0)
    assert not (tmp_path / "out").exists()


# --- made-up products: over the equator at longitude 0, 700 km high, flying north, looking straight down ---

RADIUS, RATE = 6_378_137.0 + 700_000.0, 1.06e-3
START = "2020-06-01T12:00:00"
DOWN = "0.7071067811865476 0.0 -0.7071067811865476 0.0"
"""V to ITRF, scalar first: x_V = z_J (north), y_V = y_J (east), z_V = -x_J (down)."""


def _orbit(position: str, time: str) -> str:
    points = []
    for second in range(-5, 6):
        angle = RATE * second
        place = f"{RADIUS * np.cos(angle)!r} 0 {RADIUS * np.sin(angle)!r}".replace("np.float64(", "").replace(
            ")", ""
        )
        clock = f"2020-06-01T12:00:{second:02d}Z" if second >= 0 else f"2020-06-01T11:59:{60 + second:02d}Z"
        points.append(f'<Point><{position} unit="m">{place}</{position}><{time}>{clock}</{time}></Point>')
    return "<Point_List>" + "".join(points) + "</Point_List>"


def _polynomials() -> str:
    return "".join(
        f"<Q{i}><DEGREE>3</DEGREE><COEFFICIENTS>{q} 0 0 0</COEFFICIENTS></Q{i}>"
        for i, q in enumerate(DOWN.split())
    )


def delivered() -> str:
    """A product of version 2: 2001 columns, 1001 rows of 1 ms."""
    return f"""<?xml version="1.0" encoding="UTF-8"?><Dimap_Document>
<Metadata_Identification><METADATA_PROFILE>S6_SENSOR</METADATA_PROFILE></Metadata_Identification>
<Dataset_Identification><DATASET_NAME>made up</DATASET_NAME></Dataset_Identification>
<Dataset_Content><Dataset_Extent>
<Vertex><LON>0.06290</LON><LAT>0</LAT><H>0</H><COL>1</COL><ROW>1</ROW></Vertex>
<Center><LON>0</LON><LAT>0</LAT><H>0</H><COL>1001</COL><ROW>1</ROW></Center></Dataset_Extent></Dataset_Content>
<Geoposition><Raster_CRS><PIXEL_ORIGIN>1</PIXEL_ORIGIN></Raster_CRS></Geoposition>
<Processing_Information><Product_Settings><PROCESSING_LEVEL>SENSOR</PROCESSING_LEVEL></Product_Settings>
</Processing_Information>
<Raster_Data><Raster_Dimensions><NROWS>1001</NROWS><NCOLS>2001</NCOLS></Raster_Dimensions></Raster_Data>
<Geometric_Data><Refined_Model>
<Coordinate_Reference_System><Temporal_CRS><TEMPORAL_CRS_NAME>UTC</TEMPORAL_CRS_NAME></Temporal_CRS>
</Coordinate_Reference_System>
<Time><Time_Range><START>{START}.000Z</START><END>2020-06-01T12:00:01.000Z</END></Time_Range>
<Time_Stamp><LINE_PERIOD unit="ms">1.0</LINE_PERIOD></Time_Stamp></Time>
<Ephemeris>{_orbit("LOCATION_XYZ", "TIME")}</Ephemeris>
<Attitudes><Polynomial_Quaternions><OFFSET>43200.5</OFFSET><SCALE>1.0</SCALE>{_polynomials()}
</Polynomial_Quaternions></Attitudes>
<Geometric_Calibration><Instrument_Calibration><Swath_Range><FIRST_COL>1</FIRST_COL></Swath_Range>
<Polynomial_Look_Angles><XLOS_0>-0.01</XLOS_0><XLOS_1>1e-05</XLOS_1><YLOS_0>0.0</YLOS_0></Polynomial_Look_Angles>
</Instrument_Calibration></Geometric_Calibration></Refined_Model>
<Use_Area><Located_Geometric_Values><ROW>501</ROW><TIME>2020-06-01T12:00:00.500Z</TIME></Located_Geometric_Values>
</Use_Area></Geometric_Data></Dimap_Document>"""


def production() -> str:
    """The same in the layout of production, with telemetry: AOCS and camera axes alike."""
    rows = "".join(
        f"<Quaternion><TAI_TIME>2020-06-01T12:00:{t:06.3f}</TAI_TIME><Q_VALUES>{DOWN}</Q_VALUES>"
        f"<Q_STATUS>{status}</Q_STATUS></Quaternion>"
        for t, status in ((36.9, "NOMINAL"), (37.5, "DEGRADED"), (38.1, "NOMINAL"), (38.2, "NOMINAL"))
    )
    return f"""<PHR_Dimap_Document>
<Dataset_Identification><DATASET_NAME>made up</DATASET_NAME></Dataset_Identification>
<Product_Characteristics><PROCESSING_LEVEL>SENSOR</PROCESSING_LEVEL></Product_Characteristics>
<Raster_Dimensions><NROWS>1001</NROWS><NCOLS>2001</NCOLS></Raster_Dimensions>
<Data_Strip><Sensor_Configuration><Time_Stamp><TAI_UTC unit="s">37</TAI_UTC></Time_Stamp></Sensor_Configuration>
<Satellite_Attitudes><Raw_Attitudes><Quaternion_List>{rows}</Quaternion_List></Raw_Attitudes></Satellite_Attitudes>
</Data_Strip>
<Geometric_Data><Sensor_Model_Characteristics>
<UTC_Sensor_Model_Range><START>{START}</START><END>2020-06-01T12:00:01.001</END></UTC_Sensor_Model_Range>
<Sensor_Ephemeris>{_orbit("LOCATION_VALUES", "UTC_TIME")}</Sensor_Ephemeris>
<Sensor_Attitudes><Polynomial_Models>{_polynomials()}</Polynomial_Models><OFFSET>43200.5</OFFSET><SCALE>1</SCALE>
</Sensor_Attitudes><SENSOR_LINE_PERIOD>1.0</SENSOR_LINE_PERIOD>
<Sensor_Viewing_Model><Position_In_Retina><FIRST_COL>1</FIRST_COL></Position_In_Retina><Viewing_Directions>
<PsiX_Model><COEFFICIENTS>-0.01 1e-05</COEFFICIENTS></PsiX_Model><PsiY_Model><COEFFICIENTS>0</COEFFICIENTS></PsiY_Model>
</Viewing_Directions></Sensor_Viewing_Model></Sensor_Model_Characteristics></Geometric_Data></PHR_Dimap_Document>"""


def _written(tmp_path: Path, text: str, *changes: tuple[str, str]) -> Path:
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / "DIM.XML"
    path.write_text(text, encoding="utf-8")
    return path


def _ground(path: Path, column: float, row: float) -> Array:
    campaign = read_dimap(path).campaign(1.0, 1.0)
    return locate(campaign, campaign.C_EK, np.zeros(1, dtype=np.int64), [column], [row], 0.0)[0]


@pytest.mark.parametrize("layout", [delivered, production])
def test_axes_rows_and_columns_by_hand(tmp_path: Path, layout: Callable[[], str]) -> None:
    """Straight down from (R, 0, 0): rows grow to the north with time, columns against y_V, to the west."""
    path = _written(tmp_path, layout())
    np.testing.assert_allclose(_ground(path, 1000.0, 0.0), [6_378_137.0, 0.0, 0.0], atol=1e-3)
    for row in (1.0, 1000.0):
        assert _ground(path, 1000.0, row)[2] == pytest.approx(RADIUS * np.sin(RATE * 1e-3 * row), abs=1e-3)
    x, y, _ = _ground(path, 1100.0, 0.0)
    assert y == pytest.approx(-0.001 * (RADIUS - x), rel=1e-9)


@pytest.mark.parametrize(
    ("directions", "column", "offset"),
    [
        ("<XLOS_0>0.01</XLOS_0><XLOS_1>-1e-05</XLOS_1><YLOS_0>0.0</YLOS_0>", 1100.0, (0.001, 0.0)),
        ("<XLOS_0>0</XLOS_0><YLOS_0>-0.01</YLOS_0><YLOS_1>1e-05</YLOS_1>", 1100.0, (0.0, 0.001)),
    ],
)
def test_detectors_may_lie_in_any_direction(
    tmp_path: Path, directions: str, column: float, offset: tuple[float, float]
) -> None:
    """Against the usual count, and along the flight: east and north of the middle, tangents of the angle."""
    usual = "<XLOS_0>-0.01</XLOS_0><XLOS_1>1e-05</XLOS_1><YLOS_0>0.0</YLOS_0>"
    path = _written(tmp_path, delivered(), (usual, directions))
    x, y, z = _ground(path, column, 0.0)
    np.testing.assert_allclose([y, z], np.array(offset) * (RADIUS - x), rtol=1e-9, atol=1e-6)


def test_sizes_may_stand_with_the_bands(tmp_path: Path) -> None:
    size = "<NROWS>1001</NROWS><NCOLS>2001</NCOLS>"
    each = "<Band_Dimensions><BAND_ID>{}</BAND_ID>{}</Band_Dimensions>"
    alike = each.format("R", size) + each.format("G", size)
    product = read_dimap(_written(tmp_path, delivered(), (size, alike)))
    assert (product.rows, product.columns) == (1001, 2001)
    other = each.format("R", size) + each.format("P", size.replace("2001", "8001"))
    path = _written(tmp_path, delivered(), (size, f"<Band_Dimensions_List>{other}</Band_Dimensions_List>"))
    with pytest.raises(InputError, match="found bands of different sizes, R, P, wanted one of them as band"):
        read_dimap(path)


def test_a_folder_is_enough_where_it_holds_one_image(tmp_path: Path) -> None:
    """As delivered: the volume's index, and in the image's folder its metadata among other XML files."""
    image = tmp_path / "volume" / "IMG_1"
    image.mkdir(parents=True)
    (tmp_path / "volume" / "VOL.XML").write_text("<Dimap_Document><Dataset_Content/></Dimap_Document>")
    (image / "RPC.XML").write_text("<Dimap_Document><Rational_Function_Model/></Dimap_Document>")
    (image / "other.xml").write_text("<metadata/>")
    (image / "DIM_1.XML").write_text(delivered())
    assert read_product(tmp_path / "volume").path == image / "DIM_1.XML"
    (image / "DIM_2.XML").write_text(delivered())
    with pytest.raises(
        InputError, match=r"found 2 files of images, \[\"IMG_1/DIM_1\.XML\", .* wanted the one"
    ):
        read_product(tmp_path / "volume")


def test_rows_dated_later_than_the_sensor_model_are_said(tmp_path: Path, shared_cases: Path) -> None:
    path = _written(tmp_path, delivered(), ("12:00:00.500Z", "12:00:00.521Z"))
    assert "Use_Area dates rows 21 ms later than START" in read_dimap(path).notices[0]
    products = [
        read_dimap(shared_cases / "spot6" / f"{name}.xml") for name in ("as_delivered", "same_without_offset")
    ]
    assert [len(product.notices) for product in products] == [1, 0]
    assert products[0].t_ns == products[1].t_ns
    assert products[0].line_period_s == products[1].line_period_s == pytest.approx(230e-6, rel=1e-12)


def test_refraction_is_counted_where_the_vendor_counts_it(tmp_path: Path) -> None:
    """On Pleiades Neo over Marseille his rational model is met within 0.06 px with it and 0.6 px without."""
    level = "<PROCESSING_LEVEL>SENSOR</PROCESSING_LEVEL>"
    stated = f"{level}<Geometric_Settings>%s</Geometric_Settings>"
    on = "<ATMOSPHERIC_REFRACTION_SETTING>true</ATMOSPHERIC_REFRACTION_SETTING>"
    off = "<LIGHT_SPEED_SETTING>false</LIGHT_SPEED_SETTING>"
    without = read_dimap(_written(tmp_path, delivered()))
    product = read_dimap(_written(tmp_path, delivered(), (level, stated % (on + off))))
    assert (without.corrections.refraction, product.corrections.refraction) == (False, True)
    assert not product.corrections.light_time
    assert not product.notices
    light = read_dimap(_written(tmp_path, delivered(), (level, stated % off.replace("false", "true"))))
    assert "LIGHT_SPEED_SETTING is true" in light.notices[0]


def test_an_orthorectified_product_is_refused_for_what_it_is(tmp_path: Path) -> None:
    path = _written(tmp_path, delivered(), ("Refined_Model>", "Other>"), (">SENSOR<", ">ORTHO<"))
    with pytest.raises(InputError, match=r"PROCESSING_LEVEL.*found \"ORTHO\", wanted \"SENSOR\""):
        read_dimap(path)


def test_first_detector_of_a_cut_line(tmp_path: Path) -> None:
    """Column 1 is detector FIRST_COL: the middle detector, 1001, is then column 1001 - 500, counted from 0."""
    path = _written(tmp_path, delivered(), ("<FIRST_COL>1<", "<FIRST_COL>501<"))
    assert _ground(path, 500.0, 0.0)[1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    "period", [' unit="ms">1.0', ' unit="microsecond">1000', ' unit="us">1000', ">1.0", ">1000"]
)
def test_line_period_in_the_units_vendors_use(tmp_path: Path, period: str) -> None:
    path = _written(tmp_path, delivered(), (' unit="ms">1.0', period))
    assert read_dimap(path).line_period_s == pytest.approx(1e-3, rel=1e-12)


def test_look_directions_of_pleiades_neo_count_from_the_image(tmp_path: Path) -> None:
    changes = ("<FIRST_COL>1<", "<FIRST_COL>501<"), ("S6_SENSOR", "PNEO_SENSOR")
    assert _ground(_written(tmp_path, delivered(), *changes), 1000.0, 0.0)[1] == pytest.approx(0.0, abs=1e-6)


def test_bent_look_directions_are_tabulated(tmp_path: Path) -> None:
    path = _written(
        tmp_path, delivered(), ("<YLOS_0>0.0</YLOS_0>", "<XLOS_2>1e-9</XLOS_2><YLOS_0>0.0</YLOS_0>")
    )
    table = read_dimap(path).detectors
    assert table.column_px[-1] == 2000.0
    # chord of c s^2 over 16 columns: c 8^2, in units of the slope 1e-5 rad a column
    tan = np.interp(1000.0 + 8.0, table.column_px, table.tan_x)
    assert tan == pytest.approx(-0.01 + 1e-5 * 1008 + 1e-9 * 1008**2, abs=0.01 * 1e-5)


def test_quaternion_list_and_bands_of_a_delivered_product(tmp_path: Path) -> None:
    q = "".join(f"<Q{i}>{value}</Q{i}>" for i, value in enumerate(DOWN.split()))
    listed = "".join(
        f"<Quaternion>{q}<TIME>2020-06-01T12:00:0{t}Z</TIME></Quaternion>" for t in ("0.1", "0.5", "0.8")
    )
    tangents = "<XLOS_0>{}</XLOS_0><XLOS_1>1e-05</XLOS_1><YLOS_0>0</YLOS_0>"
    angles = f"<Polynomial_Look_Angles>{tangents}</Polynomial_Look_Angles>"
    bands = "".join(
        f"<Band_Calibration><BAND_ID>{name}</BAND_ID>{angles.format(x)}</Band_Calibration>"
        for name, x in (("P", -0.01), ("R", -0.02))
    )
    text = delivered()
    for element, new in (
        ("Polynomial_Quaternions", f"<Quaternion_List>{listed}</Quaternion_List>"),
        ("Polynomial_Look_Angles", f"<Band_Calibration_List>{bands}</Band_Calibration_List>"),
    ):
        start, end = text.index(f"<{element}>"), text.index(f"</{element}>") + len(element) + 3
        text = text[:start] + new + text[end:]
    path = _written(tmp_path, text)
    with pytest.raises(InputError, match="found the bands P, R, wanted one of them as band"):
        read_dimap(path)
    assert read_dimap(path, band="R").detectors.tan_x[0] == pytest.approx(-0.02)
    notices = import_product(path, tmp_path / "out", sigma_m=1.0, sigma_arcsec=1.0, band="P")
    assert any("its attitude covers the rows 100 to 800 of 0 to 1000 only" in notice for notice in notices)


def test_samples_that_end_milliseconds_short_of_the_image_are_continued(tmp_path: Path) -> None:
    """Of steps of 4 ms, those before 1.5 ms after the first row and after 3 ms before the last lack."""
    whole = read_dimap(_written(tmp_path, delivered()))
    t_ns = whole.t_ns + np.arange(1_500_000, 998_000_000, 4_000_000)
    angle = RATE * (t_ns - whole.t_ns) * 1e-9
    r_J = RADIUS * np.stack([np.cos(angle), 0.0 * angle, np.sin(angle)], axis=-1)
    every, more, far = reaching(t_ns, r_J, whole.t_ns, whole.t_ns + 1_000_000_000)
    assert every[0] <= whole.t_ns
    assert every[-1] >= whole.t_ns + 1_000_000_000
    assert far == whole.t_ns + 1_000_000_000 - t_ns[-1]
    angle = RATE * (every - whole.t_ns) * 1e-9
    np.testing.assert_allclose(
        more, RADIUS * np.stack([np.cos(angle), 0.0 * angle, np.sin(angle)], axis=-1), rtol=0.0, atol=1e-3
    )
    for first, last in (
        (t_ns[0] - 20_000_001, t_ns[-1]),
        (t_ns[0], t_ns[-1] + 16_000_001),
        (t_ns[0], t_ns[-1]),
    ):
        assert reaching(t_ns, r_J, int(first), int(last))[2] == 0
        assert reaching(t_ns, r_J, int(first), int(last))[0].size == t_ns.size
    q = (
        np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        * np.where(np.arange(angle.size) % 2, -1.0, 1.0)[:, None]
    )
    step = every[1] - every[0]
    _, turned, _ = reaching(every, q, int(every[0] - step), int(every[-1]))
    assert abs(turned[0] @ q[0]) == pytest.approx(np.cos(RATE * 4e-3), abs=1e-9)


def test_corners_are_checked_and_told(tmp_path: Path) -> None:
    path = _written(tmp_path, delivered())
    notices = import_product(path, tmp_path / "out", sigma_m=1.0, sigma_arcsec=1.0)
    # 0.01 * 700 km is 7000 m on the plane, 0.06288 deg on the sphere
    assert any("its own corners are met within" in notice for notice in notices)
    path = _written(tmp_path, delivered(), ("<LON>0.06290<", "<LON>1.5<"))
    with pytest.raises(InputError, match=r"its corners 1\d\d km away"):
        import_product(path, tmp_path / "other", sigma_m=1.0, sigma_arcsec=1.0)


def test_telemetry_is_tai_and_drops_what_is_not_nominal(tmp_path: Path) -> None:
    product = read_dimap(_written(tmp_path, production()), "raw")
    assert product.frame == "GCRF"
    np.testing.assert_array_equal((product.attitude_t_ns - product.t_ns) / 1e9, [-0.1, 1.1, 1.2])
    assert "left out 1 quaternions" in product.notices[0]
    assert product.corrections == Corrections(light_time=True, aberration=True, refraction=False)


def test_polynomial_across_midnight(tmp_path: Path) -> None:
    """OFFSET counts from the midnight before: of the day before, where the image begins just after one."""
    text = (
        delivered()
        .replace("2020-06-01T12:00:", "2020-06-02T00:00:")
        .replace("2020-06-01T11:59:", "2020-06-01T23:59:")
    )
    path = _written(tmp_path, text, ("<OFFSET>43200.5<", "<OFFSET>86399.5<"))
    product = read_dimap(path)
    assert product.attitude_t_ns[0] - product.t_ns == -1_500_000_000


@pytest.mark.parametrize(("left", "usable"), [(8, True), (7, False)])
def test_positions_must_be_as_many_as_the_vendors_interpolation_needs(
    tmp_path: Path, left: int, usable: bool
) -> None:
    """Lagrange interpolation of degree 7 takes eight nodes; the list has eleven."""
    path = _written(tmp_path, re.sub("<Point>.*?</Point>", "", delivered(), count=11 - left))
    if usable:
        assert read_dimap(path).orbit_t_ns.size == 8
    else:
        with pytest.raises(InputError, match="Point_List: found 7 positions, wanted at least 8"):
            read_dimap(path)


@pytest.mark.parametrize("code", ["urn:ogc:def:crs:EPSG::4978", "urn:ogc:def:crs:EPSG::4936"])
def test_positions_must_be_in_wgs_84(tmp_path: Path, code: str) -> None:
    """EPSG 4978 is geocentric WGS 84, 4936 that of ETRS89."""
    stated = f"<Geodetic_CRS><GEODETIC_CRS_CODE>{code}</GEODETIC_CRS_CODE></Geodetic_CRS>"
    end = "</Coordinate_Reference_System>"
    path = _written(tmp_path, delivered(), (end, stated + end))
    if code.endswith("4978"):
        assert read_dimap(path).frame == "ITRF"
    else:
        with pytest.raises(InputError, match=r"GEODETIC_CRS_CODE: found .*4936.*, wanted EPSG 4978"):
            read_dimap(path)


def test_landmarks_come_with_observations_and_without_corners(tmp_path: Path) -> None:
    path = _written(tmp_path, delivered())
    marks, seen = tmp_path / "marks.csv", tmp_path / "seen.csv"
    stated = {"sigma_m": 1.0, "sigma_arcsec": 1.0}
    for alone in ({"landmarks": marks}, {"observations": seen}):
        with pytest.raises(
            InputError, match=r"\.csv: found landmarks or observations alone, wanted both tables"
        ):
            import_product(path, tmp_path / "out", **stated, **alone)
    both = {"landmarks": marks, "observations": seen}
    with pytest.raises(InputError, match=r"marks\.csv: found landmarks beside the product's corners"):
        import_product(path, tmp_path / "out", corners=(1.0, 0.1), **stated, **both)
    assert not (tmp_path / "out").exists()


def test_corners_need_positive_sigmas(tmp_path: Path) -> None:
    path = _written(tmp_path, delivered())
    for corners, name in (((0.0, 0.1), "sigma_m 0"), ((1.0, -1.0), "sigma_px -1")):
        with pytest.raises(InputError, match=f"corners: found the {name}, wanted a positive number"):
            import_product(path, tmp_path / "out", corners=corners, sigma_m=1.0, sigma_arcsec=1.0)
    assert not (tmp_path / "out").exists()


BAD: list[tuple[Callable[[], str], tuple[str, str], str]] = [
    (delivered, ("<?xml", '<!DOCTYPE a [<!ENTITY b "c">]><?xml'), "not well formed|DOCTYPE"),
    (delivered, ("<Dimap_Document>", '<!DOCTYPE a [<!ENTITY b "c">]><Dimap_Document>'), "found a DOCTYPE"),
    (delivered, ("</Dimap_Document>", ""), r"line \d+: found XML that is not well formed"),
    (delivered, ("Refined_Model", "Other_Model"), "without a sensor model, wanted a DIMAP product"),
    (delivered, (">SENSOR<", ">ORTHO<"), 'PROCESSING_LEVEL: found "ORTHO", wanted "SENSOR"'),
    (delivered, (">UTC<", ">GPS<"), 'TEMPORAL_CRS_NAME: found "GPS", wanted "UTC"'),
    (delivered, ("<PIXEL_ORIGIN>1", "<PIXEL_ORIGIN>0"), 'found "0", wanted rows and columns counted from 1'),
    (delivered, ("<NROWS>1001<", "<NROWS>many<"), 'NROWS: found "many", wanted a number'),
    (delivered, ("<NCOLS>2001<", "<NCOLS>2001.5<"), "found .*, wanted a whole number"),
    (delivered, ('unit="ms">1.0', 'unit="ms">nan'), 'LINE_PERIOD: found "nan", wanted a number'),
    (
        delivered,
        ('unit="ms">1.0', 'unit="us">1.0'),
        "LINE_PERIOD: found .* us for 1001 rows .*, wanted 0.000999",
    ),
    (delivered, ('unit="ms">1.0', 'unit="line">1.0'), 'the unit "line", wanted one of s, ms'),
    (delivered, ('unit="ms">1.0', ">-1.0"), "wanted a positive number"),
    (delivered, (f"<START>{START}.000Z", "<START>yesterday"), 'START: found "yesterday", wanted a time'),
    (delivered, ("00.500Z", "01.600Z"), "for row 501, wanted 2020-06-01T12:00:00.500000"),
    (delivered, ("<ROW>501<", "<ROW>1e70<"), 'ROW: found "1e70", wanted a row of the image'),
    (delivered, ("<OFFSET>43200.5<", "<OFFSET>1e70<"), 'OFFSET: found "1e70", wanted the middle'),
    (delivered, ('LOCATION_XYZ unit="m"', 'LOCATION_XYZ unit="km"'), 'the unit "km", wanted one of m'),
    (delivered, ("LOCATION_XYZ", "PLACE"), r"Point\[1\]: found no LOCATION_XYZ"),
    (delivered, ("12:00:03Z", "12:00:02Z"), r"Point\[9\]: found a time not later"),
    (delivered, ("<SCALE>1.0<", "<SCALE>0<"), 'SCALE: found "0", wanted a positive number'),
    (delivered, ("<OFFSET>43200.5<", "<OFFSET>432.5<"), "OFFSET: found .* s from the image"),
    (delivered, ("<SCALE>1.0<", "<SCALE>9e11<"), "SCALE: found 9e[+]11 s, wanted half the duration"),
    (delivered, ("<COEFFICIENTS>0.7071067811865476", "<COEFFICIENTS>0.3"), "found a quaternion of norm 0.76"),
    (delivered, ("<XLOS_1>1e-05<", "<XLOS_1>0<"), "look directions that do not turn"),
    (production, ("-0.01 1e-05<", "-0.01<"), "look directions that do not turn"),
    (delivered, ("<XLOS_0>", '<XLOS_0 unit="deg">'), 'XLOS_0: found the unit "deg"'),
    (delivered, ("<YLOS_0>0.0</YLOS_0>", ""), "found no YLOS_0, wanted the key YLOS_0"),
    (
        production,
        ('<TAI_UTC unit="s">37<', '<TAI_UTC unit="s">36<'),
        'TAI_UTC: found "36", wanted TAI - UTC = 37 s',
    ),
    (production, (f"{DOWN}</Q_VALUES>", "0 1 0</Q_VALUES>"), "Q_VALUES: found .*, wanted 4 numbers"),
    (production, (">NOMINAL<", ">LOST<"), "found 0 usable quaternions"),
]


@pytest.mark.parametrize(
    ("layout", "change", "says"), BAD, ids=[f"{i}-{bad[1][1][:24]}" for i, bad in enumerate(BAD)]
)
def test_bad_products_are_refused_in_one_sentence(
    tmp_path: Path, layout: Callable[[], str], change: tuple[str, str], says: str
) -> None:
    path = _written(tmp_path, layout(), change)
    choice = "raw" if layout is production else "vendor"
    with pytest.raises(InputError, match=says) as error:
        read_dimap(path, choice)  # type: ignore[arg-type]
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_telemetry_of_a_delivered_product_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='wanted attitude "vendor"'):
        read_dimap(_written(tmp_path, delivered()), "raw")
