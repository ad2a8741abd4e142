"""DigitalGlobe products: the real one against the published mount, made-up ones against hand calculation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from starplumb.estimators.gls import Gls
from starplumb.io.campaign.read import load_campaign
from starplumb.io.text.pvl import read_pvl
from starplumb.io.vendors.digitalglobe import read_digitalglobe
from starplumb.io.vendors.digitalglobe_geo import Bend, Optics
from starplumb.io.vendors.metadata_files import metadata_files
from starplumb.io.vendors.product import import_product, read_product
from starplumb.io.vendors.vendor import C_KV, Product
from starplumb.physics import so3
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.light import Corrections
from starplumb.physics.units import ARCSEC
from starplumb.table.campaign import Campaign, Landmarks, Sightings
from starplumb.table.geometry import locate, observe, project

Array = NDArray[np.float64]

QUICKBIRD = Optics(principal_distance_mm=8836.202, pitch_mm=0.01191396, origin_mm=(9.54684, 164.02773))
PUBLISHED_XYZW = (-0.0037369299279122, -0.0046602381421084, 0.0017171366422757, 0.9999806843019142)
"""Camera to body, the vendor's own calibration (README of the product)."""


@pytest.fixture(scope="module")
def quickbird(shared_data: Path) -> Product:
    return read_digitalglobe(next((shared_data / "quickbird2").glob("*.IMD")), QUICKBIRD)


def _with_corners(product: Product, keep: list[int], corrections: Corrections | None = None) -> Campaign:
    corners = product.corners
    assert corners is not None
    n = len(keep)
    return replace(
        product.campaign(),
        landmarks=Landmarks(
            tuple(corners.names[i] for i in keep), corners.r_J[keep], np.tile(0.01 * np.eye(3), (n, 1, 1))
        ),
        sightings=Sightings(
            np.zeros(n, dtype=np.int64),
            np.arange(n),
            corners.column_px[keep],
            corners.row_px[keep],
            np.full(n, 0.1),
            np.zeros(n, dtype=np.bool_),
        ),
        corrections=corrections or product.corrections,
    )


def _misses(product: Product, campaign: Campaign, C_EK: Array) -> Array:
    corners = product.corners
    assert corners is not None
    met = locate(
        campaign, C_EK, np.zeros(4, dtype=np.int64), corners.column_px, corners.row_px, corners.height
    )
    return np.asarray(np.linalg.norm(met - corners.r_J, axis=-1))


def test_published_mount_from_the_four_corners(quickbird: Product) -> None:
    campaign = _with_corners(quickbird, [0, 1, 2, 3])
    assert campaign.corrections == Corrections(light_time=True, aberration=True)
    assert np.mean(_misses(quickbird, campaign, campaign.C_EK)) == pytest.approx(5489.0, rel=0.01)
    estimate = Gls()(observe(campaign), campaign.C_EK)
    published = Rotation.from_quat(PUBLISHED_XYZW).as_matrix()
    away = so3.log(estimate.C_EK @ C_KV @ published.T) / ARCSEC
    np.testing.assert_allclose(away, [-0.22, 0.07, 0.06], atol=0.1)
    assert _misses(quickbird, campaign, estimate.C_EK).mean() == pytest.approx(0.08, abs=0.02)


def test_without_aberration_the_mount_is_five_arcsec_off(quickbird: Product) -> None:
    campaign = _with_corners(quickbird, [0, 1, 2, 3], Corrections(light_time=True, aberration=False))
    estimate = Gls()(observe(campaign), campaign.C_EK)
    published = Rotation.from_quat(PUBLISHED_XYZW).as_matrix()
    away = so3.log(estimate.C_EK @ C_KV @ published.T) / ARCSEC
    np.testing.assert_allclose(away, [3.06, -4.01, 0.12], atol=0.3)


@pytest.mark.parametrize("left_out", range(4))
def test_each_corner_is_foretold_by_the_others(quickbird: Product, left_out: int) -> None:
    campaign = _with_corners(quickbird, [i for i in range(4) if i != left_out])
    estimate = Gls()(observe(campaign), campaign.C_EK)
    assert _misses(quickbird, campaign, estimate.C_EK)[left_out] < 0.2


def test_stated_covariances_become_sigmas(quickbird: Product) -> None:
    # by hand from the .EPH: square roots of the diagonal 0.0013682569363, 0.0027674336307, 0.0049859896540
    assert quickbird.sigma_position is not None
    assert quickbird.sigma_attitude is not None
    np.testing.assert_allclose(quickbird.sigma_position, [0.037, 0.0526, 0.0706], rtol=0.05)
    np.testing.assert_allclose(quickbird.sigma_attitude / ARCSEC, [5.0, 5.0, 5.0], rtol=0.01)
    np.testing.assert_allclose(quickbird.campaign(sigma_m=2.0).sigma_position, [2.0, 2.0, 2.0])


def test_import_of_a_folder_with_its_corners(shared_data: Path, tmp_path: Path) -> None:
    notices = import_product(
        shared_data / "quickbird2", tmp_path / "out", optics=QUICKBIRD, corners=(0.5, 0.1)
    )
    assert any("its own corners are met within 55" in notice for notice in notices)
    campaign = load_campaign(tmp_path / "out" / "campaign.toml").campaign
    estimate = Gls()(observe(campaign), campaign.C_EK)
    published = Rotation.from_quat(PUBLISHED_XYZW).as_matrix()
    assert np.abs(so3.log(estimate.C_EK @ C_KV @ published.T)).max() < 0.4 * ARCSEC


# --- made-up products: over the equator at longitude 0, 700 km high, flying north, looking straight down ---

RADIUS, RATE = 6_378_137.0 + 700_000.0, 1.06e-3
DOWN = Rotation.from_matrix([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
"""Body to ITRF: x_V = z_J (north), y_V = y_J (east), z_V = -x_J (down)."""
SIGMAS = np.array([2e-5, 3e-5, 7e-5])
STEP, FIRST, N = 0.1, -2.0, 41


def _att(q: Array | None = None) -> list[list[float]]:
    """Rows of the attitude: a covariance whose small angles about the body's axes have SIGMAS, by differences."""
    value = DOWN.as_quat() if q is None else q
    h = 1e-6
    turns = [Rotation.from_rotvec(-h * axis) for axis in np.eye(3)]
    slope = np.stack([((DOWN * turn).as_quat() - DOWN.as_quat()) / h for turn in turns])
    P = slope.T @ np.diag(SIGMAS**2) @ slope
    return [[i + 1.0, *value, *P[np.triu_indices(4)]] for i in range(N)]


def _eph() -> list[list[float]]:
    rows = []
    for i in range(N):
        angle = RATE * (FIRST + STEP * i)
        place = RADIUS * np.array([np.cos(angle), 0.0, np.sin(angle)])
        speed = RATE * RADIUS * np.array([-np.sin(angle), 0.0, np.cos(angle)])
        rows.append([i + 1.0, *place, *speed, 4.0, 0.0, 0.0, 9.0, 0.0, 16.0])
    return rows


SERIES = {"startTime": "2020-06-01T11:59:58.000000Z", "numPoints": str(N), "timeInterval": str(STEP)}
FORWARD = ("2020-06-01T12:00:00.000000Z", [[0.0, 0.0], [1001.0, 1.001]])
GEO: dict[str, object] = {
    "PRINCIPAL_DISTANCE": {"pd": "10000.0"},
    "OPTICAL_DISTORTION": {"polyOrder": "-1", "aList": [[0.0]], "bList": [[0.0]]},
    "PERSPECTIVE_CENTER": {"cx": "0.0", "cy": "0.0", "cz": "0.0"},
    "CAMERA_ATTITUDE": {"qcs1": "0", "qcs2": "0", "qcs3": "0", "qcs4": "1"},
    "DETECTOR_MOUNTING": {
        "BAND_P": {
            "bandId": "P",
            "DETECTOR_ARRAY_1": {
                "detArrId": "1",
                "detOriginX": "0.0",
                "detOriginY": "100.0",
                "detRotAngle": "0.0",
                "detPitch": "0.1",
            },
        }
    },
}


def _imd(
    first_line: str = FORWARD[0], tlc: list[list[float]] = FORWARD[1], scan: str = "Forward"
) -> dict[str, object]:
    corner = {f"{name}{key}": "0.0" for name in ("UL", "UR", "LR", "LL") for key in ("Lon", "Lat", "HAE")}
    return {
        "bandId": '"P"',
        "numRows": "1001",
        "numColumns": "2001",
        "BAND_P": corner,
        "IMAGE_1": {
            "satId": '"WV09"',
            "scanDirection": f'"{scan}"',
            "catId": '"ABC"',
            "TLCTime": FORWARD[0],
            "numTLC": str(len(tlc)),
            "TLCList": tlc,
            "firstLineTime": first_line,
            "avgLineRate": "1000.0",
            "positionKnowledgeSrc": '"R"',
            "attitudeKnowledgeSrc": '"P"',
        },
    }


def _parts() -> dict[str, dict[str, object]]:
    return {
        "IMD": _imd(),
        "ATT": {**SERIES, "attList": _att()},
        "EPH": {**SERIES, "ephemList": _eph()},
        "GEO": GEO,
    }


def _pvl(group: dict[str, object]) -> str:
    lines = []
    for key, value in group.items():
        if isinstance(value, dict):
            lines.append(f"BEGIN_GROUP = {key}\n{_pvl(value)}END_GROUP = {key}\n")
        elif isinstance(value, list):
            rows = ",\n".join("(" + ", ".join(map(repr, map(float, row))) + ")" for row in value)
            lines.append(f"{key} = (\n{rows});\n")
        else:
            lines.append(f"\t{key} = {value};\n")
    return "".join(lines)


def _xml(group: dict[str, object]) -> str:
    text = ""
    for name, value in group.items():
        key = name.upper().removesuffix("_1")
        if isinstance(value, dict):
            text += f"<{key}>{_xml(value)}</{key}>"
        elif isinstance(value, list):
            rows = "".join(f"<{key}>{' '.join(map(repr, map(float, row)))}</{key}>" for row in value)
            text += f"<{key}List>{rows}</{key}List>"
        else:
            text += f"<{key}>{str(value).strip(chr(34))}</{key}>"
    return text


def _write(tmp_path: Path, parts: dict[str, dict[str, object]], form: str = "text") -> Path:
    if form == "xml":
        path = tmp_path / "scene.XML"
        path.write_text(f"<isd>{_xml(parts)}</isd>", encoding="utf-8")
        return path
    for suffix, part in parts.items():
        (tmp_path / f"scene.{suffix}").write_text(_pvl(part) + "END;\n", encoding="utf-8")
    return tmp_path / "scene.IMD"


def _ground(product: Product, column: float, row: float) -> Array:
    campaign = replace(product.campaign(), corrections=Corrections(False, False))
    return locate(campaign, product.C_EK, np.zeros(1, dtype=np.int64), [column], [row], 0.0)[0]


@pytest.mark.parametrize("form", ["text", "xml"])
def test_axes_rows_and_columns_by_hand(tmp_path: Path, form: str) -> None:
    """Straight down from (R, 0, 0): rows grow to the north with time, columns against y_V, to the west."""
    product = read_product(_write(tmp_path, _parts(), form))
    assert product.name == {"text": "scene", "xml": "ABC"}[form]
    np.testing.assert_allclose(_ground(product, 1000.0, 0.0), [6_378_137.0, 0.0, 0.0], atol=1e-3)
    for row in (1.0, 1000.0):
        assert _ground(product, 1000.0, row)[2] == pytest.approx(RADIUS * np.sin(RATE * 1e-3 * row), abs=1e-3)
    x, y, _ = _ground(product, 1100.0, 0.0)
    assert y == pytest.approx(-0.1 * 100 / 10_000 * (RADIUS - x), rel=1e-9)
    assert product.notices == (
        f"{product.path}: {'ATTITUDEKNOWLEDGESRC' if form == 'xml' else 'attitudeKnowledgeSrc'} is P, not R (refined)",
    )


def test_covariances_of_quaternions_become_small_angles_about_the_body(tmp_path: Path) -> None:
    product = read_digitalglobe(_write(tmp_path, _parts()))
    np.testing.assert_allclose(product.sigma_attitude, SIGMAS, rtol=1e-5)
    np.testing.assert_allclose(product.sigma_position, [2.0, 3.0, 4.0])
    parts = _parts()
    parts["ATT"]["attList"] = [[*row[:5], *np.zeros(10)] for row in _att()]
    product = read_digitalglobe(_write(tmp_path, parts))
    with pytest.raises(InputError, match="wanted sigma_arcsec stated"):
        product.campaign()


def test_scan_against_the_count_of_the_rows(tmp_path: Path) -> None:
    """Row 1000 is exposed first: the campaign has a negative line period and the same ground."""
    parts = _parts()
    parts["IMD"] = _imd("2020-06-01T12:00:01.000000Z", [[0.0, 1.0], [1000.0, 0.0]], "Reverse")
    path = _write(tmp_path, parts)
    product = read_digitalglobe(path)
    for row in (0.0, 250.0):
        z = _ground(product, 1000.0, row)[2]
        assert z == pytest.approx(RADIUS * np.sin(RATE * 1e-3 * (1000.0 - row)), abs=1e-3)
    marks, seen = tmp_path / "marks.csv", tmp_path / "seen.csv"
    marks.write_text("landmark_id,latitude_deg,longitude_deg,height_m,sigma_m\na,0,0,0,1\n")
    seen.write_text("image_id,landmark_id,column_px,row_px,sigma_px\nI,a,1000,1000,0.2\n")
    import_product(path, tmp_path / "out", landmarks=marks, observations=seen, image_id="I")
    campaign = load_campaign(tmp_path / "out" / "campaign.toml").campaign
    image = np.zeros(1, dtype=np.int64)
    p_J = locate(campaign, campaign.C_EK, image, [700.0], [300.0], 100.0)
    found = project(campaign, campaign.C_EK, image, p_J, np.array([[1000.0, 500.0]]))
    np.testing.assert_allclose(found, [[700.0, 300.0]], atol=1e-5)


def test_rows_of_an_uneven_scan_have_the_times_of_their_table(tmp_path: Path) -> None:
    parts = _parts()
    parts["IMD"] = _imd(tlc=[[0.0, 0.0], [500.0, 0.53], [1001.0, 1.001]])
    product = read_digitalglobe(_write(tmp_path, parts))
    for row, second in ((250.0, 0.265), (500.0, 0.53), (750.5, 0.7655)):
        z = _ground(product, 1000.0, row)[2]
        assert z == pytest.approx(RADIUS * np.sin(RATE * second), abs=1e-3)
    assert any("not evenly spaced in time" in notice for notice in product.notices)
    import_product(tmp_path / "scene.IMD", tmp_path / "out")
    assert (tmp_path / "out" / "row_times_0.csv").read_text().splitlines()[
        2
    ] == "500.0,2020-06-01T12:00:00.530000000"


@pytest.mark.parametrize(("scan", "way"), [("Forward", 1.0), ("Reverse", -1.0)])
def test_one_dated_row_goes_on_at_the_rate_of_the_scan(tmp_path: Path, scan: str, way: float) -> None:
    parts = _parts()
    parts["IMD"] = _imd(tlc=[[0.0, 0.0]], scan=scan)
    z = _ground(read_digitalglobe(_write(tmp_path, parts)), 1000.0, 500.0)[2]
    assert z == pytest.approx(way * RADIUS * np.sin(RATE * 0.5), abs=1e-3)


def test_a_tile_begins_within_its_strip(tmp_path: Path) -> None:
    """R2C1 of a strip of 1001 rows: its row 0 is the strip's row 500, as its first line's time says."""
    parts = _parts()
    parts["IMD"] = {**_imd("2020-06-01T12:00:00.500000Z"), "numRows": "400"}
    product = read_digitalglobe(_write(tmp_path, parts))
    assert any("begins at row 500 of its strip" in notice for notice in product.notices)
    assert _ground(product, 1000.0, 100.0)[2] == pytest.approx(RADIUS * np.sin(RATE * 0.6), abs=1e-3)


def test_microseconds_without_their_zeros(tmp_path: Path) -> None:
    """As programs that join tiles write them: .5000 is 5 ms."""
    parts = _parts()
    parts["IMD"] = _imd("2020-06-01T12:00:00.5000Z", [[0.0, 0.005], [1001.0, 1.006]])
    product = read_digitalglobe(_write(tmp_path, parts))
    assert _ground(product, 1000.0, 0.0)[2] == pytest.approx(RADIUS * np.sin(RATE * 0.005), abs=1e-3)


def test_sizes_padded_to_blocks_of_nitf(tmp_path: Path, shared_cases: Path) -> None:
    parts = _parts()
    parts["IMD"] = {**_imd(), "numRows": "1024", "numColumns": "2048", "outputFormat": '"NITF21NCDRD"'}
    product = read_digitalglobe(_write(tmp_path, parts))
    assert (product.rows, product.columns) == (1001, 2048)
    assert "numRows, 1024, is padded to blocks; 1001 rows have times" in product.notices[0]
    assert "may be padded to blocks too" in product.notices[1]
    parts["RPB"] = {"IMAGE": {"lineOffset": "499", "sampOffset": "999"}}
    product = read_digitalglobe(_write(tmp_path, parts))
    assert (product.rows, product.columns) == (1001, 2000)
    assert product.corners is not None
    assert product.corners.column_px[1] == 1999.0
    assert product.corners.row_px[2] == 1000.0
    parts["TIL"] = {"bandId": "P", "numTiles": "1", "tileSizeX": "2001", "tileSizeY": "1001"}
    assert read_digitalglobe(_write(tmp_path, parts)).columns == 2001
    folder = shared_cases / "worldview_nitf"
    for name, rows in (("padded", 6244), ("true_size", 6244)):
        assert read_digitalglobe(folder / f"{name}.xml").rows == rows
    import_product(folder / "true_size.xml", tmp_path / "true", corners=(1.0, 0.3))
    with pytest.raises(
        InputError, match=r"padded\.xml: found corners that the product's own geometry misses by"
    ):
        import_product(folder / "padded.xml", tmp_path / "padded", corners=(1.0, 0.3))


def _cornered(product: Product, group: dict[str, object], height: float, off: float = 0.0) -> None:
    """Corners where the product's own geometry has them, the last ``off`` metres farther up than said."""
    right, low = product.columns - 1.0, product.rows - 1.0
    pixels = {"UL": (0.0, 0.0), "UR": (right, 0.0), "LR": (right, low), "LL": (0.0, low)}
    for name, (column, row) in pixels.items():
        campaign = product.campaign()
        high = height + off * (name == "LL")
        p_J = locate(campaign, product.C_EK, np.zeros(1, dtype=np.int64), [column], [row], high)[0]
        latitude, longitude, _ = itrf_to_geodetic(p_J)
        group |= {
            f"{name}Lat": repr(float(np.degrees(latitude))),
            f"{name}Lon": repr(float(np.degrees(longitude))),
        }
        group[f"{name}HAE"] = repr(height)


@pytest.mark.parametrize("geo", [True, False])
def test_corners_with_made_up_heights_are_none_to_calibrate_by(tmp_path: Path, geo: bool) -> None:
    """10 mrad off the vertical a wrong height of 4 km moves a corner by 40 m, whatever the mounting."""
    optics = None if geo else Optics(10_000.0, 0.1, (0.0, 100.0))
    for off, usable in ((0.0, True), (4000.0, False)):
        folder = tmp_path / f"{off:g}"
        folder.mkdir()
        parts = _parts() if geo else {key: part for key, part in _parts().items() if key != "GEO"}
        corners: dict[str, object] = {}
        _cornered(read_digitalglobe(_write(folder, parts), optics), corners, 300.0, off)
        parts["IMD"] = {**_imd(), "BAND_P": corners}
        path = _write(folder, parts)
        if usable:
            import_product(path, folder / "out", corners=(1.0, 0.1), optics=optics)
            continue
        with pytest.raises(InputError, match="found corners that the product's own geometry misses by"):
            import_product(path, folder / "out", corners=(1.0, 0.1), optics=optics)
        assert not (folder / "out").exists()


def test_a_joined_strip_may_have_no_corners(tmp_path: Path) -> None:
    parts = _parts()
    parts["IMD"] = {key: value for key, value in _imd().items() if key != "BAND_P"}
    assert read_digitalglobe(_write(tmp_path, parts)).corners is None


def test_a_line_of_detectors_that_is_rotated(tmp_path: Path) -> None:
    """By 1 deg of detRotAngle: column s is at (p s sin 1 deg, -p s cos 1 deg) from the origin."""
    parts = _parts()
    _set("GEO", "DETECTOR_MOUNTING/BAND_P/DETECTOR_ARRAY_1/detRotAngle", "1.0")(parts)
    x, y, z = _ground(read_digitalglobe(_write(tmp_path, parts)), 1500.0, 0.0)
    angle = np.radians(1.0)
    expected = np.array([100.0 - 150.0 * np.cos(angle), 150.0 * np.sin(angle)]) / 10_000.0 * (RADIUS - x)
    np.testing.assert_allclose([y, z], expected, atol=1e-3)


@pytest.mark.parametrize(("sign", "y_first"), [(1.0, False), (-1.0, True)])
def test_a_distortion_is_taken_in_the_sense_that_meets_the_corners(
    tmp_path: Path, sign: float, y_first: bool
) -> None:
    """Terms 1, x, y, x^2, xy, y^2: 1e-5 y^2 mm moves the ends of the line, at 100 mm, by one pixel of 0.1 mm."""
    parts = _parts()
    place = [0.0, 0.0, 0.0, 1e-5, 0.0, 0.0] if y_first else [0.0, 0.0, 0.0, 0.0, 0.0, 1e-5]
    lens = {"polyOrder": "2", "aList": [[0.0] * 6], "bList": [place]}
    parts["GEO"] = {**GEO, "OPTICAL_DISTORTION": lens}
    path = _write(tmp_path, parts)
    with pytest.raises(
        InputError, match=r"whose convention is not published, and corners .* away in any sense"
    ):
        read_digitalglobe(path)
    bend = Bend((0.0,) * 6, tuple(place), sign, y_first)
    true = read_digitalglobe(path, Optics(10_000.0, 0.1, (0.0, 100.0), bend=bend))
    assert true.detectors.tan_x[0] == pytest.approx(-(100.0 + sign * 0.1) / 10_000.0, rel=1e-12)
    corners: dict[str, object] = {}
    _cornered(true, corners, 300.0)
    parts["IMD"] = {**_imd(), "BAND_P": corners}
    product = read_digitalglobe(_write(tmp_path, parts))
    np.testing.assert_allclose(product.detectors.tan_x, true.detectors.tan_x, rtol=0, atol=1e-15)
    assert "the corners are met within" in product.notices[-1]


def test_a_distortion_that_the_corners_do_not_tell_is_refused(tmp_path: Path) -> None:
    """A term that is nothing at both ends of the line, and 25 pixels in its middle half-way out."""
    parts = _parts()
    terms = [0.0] * 10
    terms[2], terms[9] = 2.5e-3, -2.5e-7  # y and y^3, which cancel at 100 mm
    parts["GEO"] = {**GEO, "OPTICAL_DISTORTION": {"polyOrder": "3", "aList": [[0.0] * 10], "bList": [terms]}}
    path = _write(tmp_path, parts)
    corners: dict[str, object] = {}
    bend = Bend((0.0,) * 10, tuple(terms))
    _cornered(read_digitalglobe(path, Optics(10_000.0, 0.1, (0.0, 100.0), bend=bend)), corners, 300.0)
    parts["IMD"] = {**_imd(), "BAND_P": corners}
    with pytest.raises(InputError, match="and corners that do not tell it, wanted the optics stated"):
        read_digitalglobe(_write(tmp_path, parts))


def test_mount_and_perspective_centre_of_the_geo(tmp_path: Path) -> None:
    """A camera 50 m below the body's origin, 0.01 rad nose up: x_V tips towards -z_V, the boresight ahead."""
    turn = Rotation.from_rotvec([0.0, 0.01, 0.0])
    parts = _parts()
    q = dict(zip(("qcs1", "qcs2", "qcs3", "qcs4"), map(repr, map(float, turn.as_quat())), strict=True))
    parts["GEO"] = {**GEO, "CAMERA_ATTITUDE": q, "PERSPECTIVE_CENTER": {"cx": "0", "cy": "0", "cz": "50.0"}}
    product = read_digitalglobe(_write(tmp_path, parts))
    north = _ground(product, 1000.0, 0.0)
    latitude, _, _ = itrf_to_geodetic(north)
    assert latitude > 0.0
    assert north[2] == pytest.approx(np.tan(0.01) * (RADIUS - 50.0 - north[0]), rel=1e-6)
    centre = int(np.argmin(np.abs(product.orbit_t_ns - product.t_ns)))
    np.testing.assert_allclose(product.r_J[centre], [RADIUS - 50.0, 0.0, 0.0], atol=1e-6)
    # the arm turns with a body that does not turn: the velocity is the spacecraft's
    assert product.v_J is not None
    np.testing.assert_allclose(product.v_J[centre], [0.0, 0.0, RATE * RADIUS], atol=1e-6)


def test_perspective_centre_of_a_turning_body_moves_as_its_positions_do(tmp_path: Path) -> None:
    parts = _parts()
    parts["GEO"] = {**GEO, "PERSPECTIVE_CENTER": {"cx": "50.0", "cy": "0", "cz": "0"}}
    turned = [(DOWN * Rotation.from_rotvec([0.0, 0.02 * STEP * i, 0.0])).as_quat() for i in range(N)]
    parts["ATT"]["attList"] = [[i + 1.0, *q, *np.zeros(10)] for i, q in enumerate(turned)]
    product = read_digitalglobe(_write(tmp_path, parts))
    assert product.v_J is not None
    moved = (product.r_J[2:] - product.r_J[:-2]) / (2.0 * STEP)
    np.testing.assert_allclose(moved, product.v_J[1:-1], atol=2e-5)  # 1 m/s comes from the turn


def test_table_of_lines_that_begins_elsewhere_than_at_row_0(tmp_path: Path) -> None:
    parts = _parts()
    parts["IMD"] = _imd(tlc=[[100.0, 0.1], [1001.0, 1.001]])
    product = read_digitalglobe(_write(tmp_path, parts))
    assert _ground(product, 1000.0, 0.0)[2] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("optics", [(0.0, 0.1), (10.0, -0.1), (float("nan"), 0.1)])
def test_optics_that_cannot_be(optics: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="wanted a positive number of millimetres"):
        Optics(*optics, (0.0, 0.0))


def test_rotated_line_of_the_users_optics(tmp_path: Path) -> None:
    parts = _parts()
    del parts["GEO"]
    path = _write(tmp_path, parts)
    with pytest.raises(
        InputError, match=r"found no \.GEO beside it, wanted it or the camera's optics stated"
    ):
        read_digitalglobe(path)
    product = read_digitalglobe(path, Optics(10_000.0, 0.1, (0.0, 0.0), rotation_deg=90.0))
    x, y, z = _ground(product, 100.0, 0.0)
    assert z == pytest.approx(0.001 * (RADIUS - x), rel=1e-9)
    assert y == pytest.approx(0.0, abs=1e-6)


Change = Callable[[dict[str, dict[str, object]]], None]


def _set(part: str, keys: str, value: object) -> Change:
    def change(parts: dict[str, dict[str, object]]) -> None:
        import copy

        parts[part] = copy.deepcopy(parts[part])
        group: dict[str, object] = parts[part]
        *above, last = keys.split("/")
        for key in above:
            inner = group[key]
            assert isinstance(inner, dict)
            group = inner
        if value is None:
            del group[last]
        else:
            group[last] = value

    return change


BAD: list[tuple[Change, str]] = [
    (_set("IMD", "numRows", None), "found no numRows"),
    (_set("IMD", "numRows", "lots"), 'numRows: found "lots", wanted a number'),
    (_set("IMD", "BAND_P/ULLon", None), "BAND_P: found no ULLon"),
    (
        _set("IMD", "IMAGE_1/TLCList", [[0, 0], [500, 0.501], [600, 0.4], [1001, 1.001]]),
        "found rows that do not increase, or times that turn back",
    ),
    (_set("IMD", "IMAGE_1/TLCList", [[1001, 0], [0, 1.001]]), "found rows that do not increase"),
    (_set("IMD", "IMAGE_1/avgLineRate", "6900.0"), "avgLineRate: found 6900 rows a second"),
    (_set("IMD", "IMAGE_1/firstLineTime", "2020-06-01T12:00:00.5Z"), "0.5 s after row 0 of the TLCList"),
    (_set("IMD", "IMAGE_1/TLCTime", "noon"), 'TLCTime: found "noon", wanted a time'),
    (_set("ATT", "numPoints", "40"), "attListList: found 41 rows, wanted 40 as numPoints says"),
    (_set("ATT", "attList", _att(np.array([0.3, 0.0, 0.3, 0.3]))), "norm 0.519615, wanted norm 1"),
    (_set("ATT", "attList", [[1, 0, 0, 0, 1], [2, 0, 0, 0, 1]]), "wanted 41 as numPoints|found 2 rows"),
    (_set("ATT", "attList", [row[:-1] for row in _att()]), r"attList\[1\]: found .*, wanted 15 numbers"),
    (_set("EPH", "ephemList", list(reversed(_eph()))), "found the index 41, wanted rows counted from 1"),
    (_set("EPH", "timeInterval", "-0.02"), 'timeInterval: found "-0.02", wanted a positive number'),
    (_set("EPH", "startTime", None), "found no startTime"),
    (
        _set("GEO", "DETECTOR_MOUNTING/BAND_P/DETECTOR_ARRAY_1/detRotAngle", "much"),
        'detRotAngle: found "much", wanted a number',
    ),
    (
        _set("GEO", "DETECTOR_MOUNTING/BAND_P/DETECTOR_ARRAY_2", {"detPitch": "1"}),
        "found 2 times DETECTOR_ARRAY",
    ),
    (_set("GEO", "DETECTOR_MOUNTING", {"BAND_R": {"x": "1"}}), "found the bands BAND_R, wanted BAND_P"),
    (_set("GEO", "OPTICAL_DISTORTION/aList", [[0.0, 1e-9]]), "an optical distortion of 2 and 1 terms"),
    (_set("GEO", "CAMERA_ATTITUDE/qcs4", "0.5"), "found a quaternion of norm 0.5"),
    (_set("GEO", "PRINCIPAL_DISTANCE/pd", "0"), 'pd: found "0", wanted a positive number'),
]


@pytest.mark.parametrize(("change", "says"), BAD, ids=[f"{i}" for i in range(len(BAD))])
def test_bad_products_are_refused_in_one_sentence(tmp_path: Path, change: Change, says: str) -> None:
    parts = _parts()
    change(parts)
    with pytest.raises(InputError, match=says) as error:
        read_digitalglobe(_write(tmp_path, parts))
    assert "\n" not in str(error.value)
    assert "scene." in str(error.value)


def test_a_missing_file_and_unsound_text(tmp_path: Path) -> None:
    path = _write(tmp_path, _parts())
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("numRows = 1001;", "numRows 1001;"), encoding="utf-8")
    with pytest.raises(InputError, match=r'scene\.IMD, line 2: found "numRows 1001;", wanted key = value;'):
        read_digitalglobe(path)
    path.write_text(text.removesuffix("END;\n"), encoding="utf-8")
    with pytest.raises(InputError, match="found its end without END;"):
        read_digitalglobe(path)
    path.write_text(text.replace("END_GROUP = IMAGE_1", "END_GROUP = IMAGE_2"), encoding="utf-8")
    with pytest.raises(InputError, match=r"line \d+: found \"END_GROUP = IMAGE_2\""):
        read_digitalglobe(path)
    path.write_text(text, encoding="utf-8")
    (tmp_path / "scene.ATT").unlink()
    with pytest.raises(InputError, match=r"found no \.ATT of that name beside it"):
        read_digitalglobe(path)


def test_text_that_is_none_is_refused_in_one_go(tmp_path: Path) -> None:
    """A key without a value's end, and a list without one, that took minutes to be tried in every way."""
    for text in ("a =" + " " * 30_000, "a = (" + ") " * 30_000, "END" + " " * 30_000 + "x"):
        (tmp_path / "a.IMD").write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=r"a\.IMD, line 1: found|found its end without END"):
            read_pvl(tmp_path / "a.IMD")


def test_choices_that_a_product_does_not_have(tmp_path: Path) -> None:
    path = _write(tmp_path, _parts())
    with pytest.raises(InputError, match='found attitude "raw", wanted "vendor"'):
        read_product(path, "raw")
    (tmp_path / "scene.txt").write_text("hello", encoding="utf-8")
    with pytest.raises(InputError, match=r"found the ending \"\.txt\""):
        read_product(tmp_path / "scene.txt")
    for suffix in ("IMD", "ATT", "EPH"):
        (tmp_path / f"other.{suffix}").write_text("END;", encoding="utf-8")
    with pytest.raises(InputError, match=r"found 2 files of images, \[\"other\.IMD\", \"scene\.IMD\"\]"):
        read_product(tmp_path)
    (tmp_path / "scene.EPH").unlink()
    (tmp_path / "scene.xml").write_text("<isd><EPH><EPHEMLIST>1</EPHEMLIST></EPH></isd>", encoding="utf-8")
    assert metadata_files(tmp_path) == [tmp_path / "other.IMD", tmp_path / "scene.xml"]
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match=r"found a folder without \.IMD, and without \.XML or \.DIM"):
        read_product(empty)


WV2_STATES = """\
1677197.914405888 -1607556.568123679 6748357.801548503 -7004.669156366486 1801.536913448006 2165.131455360872
1677057.82067616 -1607520.53682114 6748401.102708912 -7004.70037994612 1801.592380480377 2164.983504815644
1676917.726323496 -1607484.504409681 6748444.400909781 -7004.73160058854 1801.647847157137 2164.835552127879
1676777.631347852 -1607448.470889282 6748487.696151122 -7004.762818136837 1801.703313693499 2164.687597605288
1676637.535749495 -1607412.436260009 6748530.988432857 -7004.794032952873 1801.758779468202 2164.5396406484
1676497.439528388 -1607376.400521852 6748574.277754991 -7004.825244112523 1801.814244296119 2164.391684362263
1676357.342684502 -1607340.363674802 6748617.564117546 -7004.856451792703 1801.869708425535 2164.243727963475
1676217.245218091 -1607304.325718916 6748660.847520436 -7004.887138144977 1801.924156038479 2164.098322801484
"""
WV2_QUATERNIONS = """\
-0.3219990940477899 -0.9022891109830017 -0.2120775528418085 0.1929094482251634
-0.321998920943691 -0.9022748781365021 -0.2121197716167088 0.1929298880011449
-0.3219987458231221 -0.9022606417196934 -0.212161997003694 0.1929503281140202
-0.3219985682318666 -0.9022464031349754 -0.2122042232091 0.1929707691305861
-0.3219983866222483 -0.9022321619362654 -0.2122464516514974 0.192991214157096
-0.3219982006929841 -0.9022179165275296 -0.2122886835641528 0.1930116697969421
-0.3219980131986101 -0.9022036658216323 -0.2123309171351906 0.1930321385227991
-0.3219978297178937 -0.9021894101088561 -0.2123731492472831 0.1930526130959946
"""
WV2_CORNERS_DEG_M = {"UL": (72.55587169, -38.14998154, 3231.41), "UR": (72.54679814, -38.68863101, 3205.21)}
"""Around the first line of WorldView-2 1030010021309100, 2013-05-08 (among the tests of the Ames Stereo Pipeline)."""


def test_a_real_padded_product_meets_its_own_corners(tmp_path: Path) -> None:
    """NITF, 35840 x 22528 as stated, 35180 x 21756 in truth; of its samples those around the first line."""
    start, step = "2013-05-08T00:03:30.458844Z", "0.02"
    corners = {f"{name}{key}": 0.0 for name in ("LR", "LL") for key in ("Lat", "Lon", "HAE")}
    for name, place in WV2_CORNERS_DEG_M.items():
        corners |= dict(zip((f"{name}Lat", f"{name}Lon", f"{name}HAE"), place, strict=True))
    imd = _imd("2013-05-08T00:03:30.536775Z", [[0.0, 0.0], [21756.0, 1.0878]])
    image = {**imd["IMAGE_1"], "TLCTime": "2013-05-08T00:03:30.536775Z", "avgLineRate": "20000.0"}  # type: ignore[dict-item]
    size = {"numRows": "22528", "numColumns": "35840", "outputFormat": '"NITF21NCDRD"'}
    series = {"startTime": start, "numPoints": "8", "timeInterval": step}
    orbit, attitude = (
        [[i, *map(float, line.split())] for i, line in enumerate(text.splitlines(), 1)]
        for text in (WV2_STATES, WV2_QUATERNIONS)
    )
    array = {
        "detOriginX": "-0.259",
        "detOriginY": "140.7276907149051",
        "detRotAngle": "0",
        "detPitch": "0.008",
    }
    parts: dict[str, dict[str, object]] = {
        "IMD": {**imd, **size, "BAND_P": corners, "IMAGE_1": image},
        "ATT": {**series, "attList": [[*row, *np.eye(4)[np.triu_indices(4)] * 1e-11] for row in attitude]},
        "EPH": {**series, "ephemList": [[*row, 1e-2, 0, 0, 1e-2, 0, 1e-2] for row in orbit]},
        "GEO": {
            **GEO,
            "PRINCIPAL_DISTANCE": {"pd": "13246.139"},
            "DETECTOR_MOUNTING": {"BAND_P": {"DETECTOR_ARRAY_1": array}},
        },
        "RPB": {"IMAGE": {"lineOffset": "10877", "sampOffset": "17589"}},
    }
    product = read_digitalglobe(_write(tmp_path, parts))
    assert (product.rows, product.columns) == (21756, 35180)
    assert product.corners is not None
    campaign, image_of = product.campaign(), np.zeros(2, dtype=np.int64)
    met = locate(campaign, product.C_EK, image_of, [0.0, 35179.0], [0.0, 0.0], product.corners.height[:2])
    assert np.linalg.norm(met - product.corners.r_J[:2], axis=-1).max() < 1.0
