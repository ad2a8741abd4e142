"""The same campaign written in other ways gives the same answer; real products come through the commands."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bad_cases import swap
from command import demo, starplumb
from starplumb.physics.earth import geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.orientation import EarthOrientation
from starplumb.physics.timescales import parse
from starplumb.plan import scene

Array = NDArray[np.float64]
Rewrite = Callable[[Path], None]

ARCSEC = np.pi / 648000
OMEGA_EARTH = np.array([0.0, 0.0, 7.292115e-5])
TOML = "campaign.toml"


def calibrated(path: Path) -> dict[str, Any]:
    """result.json of a campaign, which must be usable."""
    out = path.parent / "out"
    spoken = starplumb("calibrate", path, "--out", out, "--no-report")
    assert spoken.status == 0, spoken.err
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert isinstance(result, dict)
    return result


def assert_same(found: dict[str, Any], wanted: dict[str, Any], arcsec: float) -> None:
    """The mounting to ``arcsec``, its sigmas to a ten-thousandth."""
    turn = (
        Rotation.from_matrix(found["mounting"]["matrix"])
        * Rotation.from_matrix(wanted["mounting"]["matrix"]).inv()
    )
    assert turn.magnitude() < arcsec * ARCSEC
    np.testing.assert_allclose(found["sigma_arcsec"], wanted["sigma_arcsec"], rtol=1e-4)
    np.testing.assert_allclose(found["correction_arcsec"], wanted["correction_arcsec"], atol=arcsec)


def read(path: Path) -> tuple[list[str], list[str], Array]:
    """Header, first column and numbers of a table."""
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    return header, [row[0] for row in rows], np.array([[float(cell) for cell in row[1:]] for row in rows])


def write(path: Path, header: list[str], first: list[str], numbers: Array) -> None:
    rows = [",".join([name, *map(repr, row)]) for name, row in zip(first, numbers.tolist(), strict=True)]
    path.write_text("\n".join([",".join(header), *rows]) + "\n", encoding="utf-8")


# Files of other kinds -----------------------------------------------------------------------------------------


def meta(times: list[str], *frames: str) -> str:
    start, stop = f"START_TIME = {times[0]}", f"STOP_TIME = {times[-1]}"
    about = ["OBJECT_NAME = BIRD", "OBJECT_ID = 2020-001A", *frames, "TIME_SYSTEM = UTC", start, stop]
    return "\n".join(["CREATION_DATE = 2025-06-22T00:00:00", "ORIGINATOR = TEST", "META_START", *about])


def as_oem(folder: Path) -> None:
    """Kilometres and kilometres per second."""
    _, times, states = read(folder / "ephemeris.csv")
    rows = [
        " ".join([time, *map(repr, row)]) for time, row in zip(times, (states / 1e3).tolist(), strict=True)
    ]
    head = meta(times, "CENTER_NAME = EARTH", "REF_FRAME = ITRF2014")
    (folder / "orbit.oem").write_text("\n".join(["CCSDS_OEM_VERS = 2.0", head, "META_STOP", *rows]) + "\n")
    swap(TOML, "ephemeris.csv", "orbit.oem")(folder)


def as_aem(folder: Path) -> None:
    """CCSDS's quaternion is the turn of the axes, the inverse of ours, which takes coordinates from A to B."""
    _, times, q = read(folder / "attitude.csv")
    turn = q * [-1.0, -1.0, -1.0, 1.0]
    rows = [" ".join([time, *map(repr, row)]) for time, row in zip(times, turn.tolist(), strict=True)]
    head = meta(times, "REF_FRAME_A = GCRF", "REF_FRAME_B = star_tracker")
    parts = ["CCSDS_AEM_VERS = 2.0", head, "ATTITUDE_TYPE = QUATERNION", "META_STOP", "DATA_START"]
    (folder / "attitude.aem").write_text("\n".join([*parts, *rows, "DATA_STOP"]) + "\n")
    swap(TOML, "attitude.csv", "attitude.aem")(folder)


def as_sp3(folder: Path) -> None:
    """Kilometres to the millimetre and decimetres per second, in GPS time, which is 18 s ahead of UTC in 2025."""
    _, times, states = read(folder / "ephemeris.csv")
    lines = [
        f"#dV2025  6 21 10 30 17.00000000 {len(times):7d} ORBIT IGS20 FIT  ESA",
        "## 2371 556217.00000000     0.12500000 60847 0.4376967592593",
        "+    1   L47" + "  0" * 16,
        "++         0" + "  0" * 16,
        "%c L  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
        "%c cc cc ccc ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
    ]
    for time, row in zip(times, states, strict=True):
        gps = np.datetime64(time) + np.timedelta64(18, "s")
        date, clock = str(gps).split("T")
        year, month, day = map(int, date.split("-"))
        hour, minute, second = clock.split(":")
        lines.append(
            f"*  {year:4d} {month:2d} {day:2d} {int(hour):2d} {int(minute):2d} {float(second):11.8f}"
        )
        for kind, values in (("P", row[:3] / 1e3), ("V", row[3:] * 10.0)):
            lines.append(f"{kind}L47" + "".join(f"{x:14.6f}" for x in values) + f"{999999.999999:14.6f}")
    (folder / "orbit.sp3").write_text("\n".join([*lines, "EOF"]) + "\n")
    swap(TOML, "ephemeris.csv", "orbit.sp3")(folder)


def as_inertial_orbit(folder: Path) -> None:
    header, times, states = read(folder / "ephemeris.csv")
    C_IJ = EarthOrientation.load().C_IJ(parse(times, "UTC"))
    r_J, v_J = states[:, :3], states[:, 3:] + np.cross(OMEGA_EARTH, states[:, :3])
    turned = [np.einsum("nij,nj->ni", C_IJ, vector) for vector in (r_J, v_J)]
    write(folder / "ephemeris.csv", header, times, np.concatenate(turned, axis=1))
    swap(TOML, 'frame = "ITRF"', 'frame = "J2000"')(folder)


# Other conventions --------------------------------------------------------------------------------------------


def as_corners(folder: Path) -> None:
    """Coordinates counted from the corner of the first pixel are larger by half a pixel."""
    swap(
        TOML,
        "principal_point_px = [5999.5, 5999.5]",
        'principal_point_px = [6000.0, 6000.0]\npixel_origin = "corner"',
    )(folder)
    with (folder / "observations.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row.update({name: repr(float(row[name]) + 0.5) for name in ("column_px", "row_px")})
    lines = [",".join(rows[0]), *(",".join(row.values()) for row in rows)]
    (folder / "observations.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def as_optics(folder: Path) -> None:
    """A line scanner by its optics in place of its table: tan_x = (column - 5999.5) 9 um / 2.2 m, tan_y = 0."""
    swap(
        TOML,
        'look_angles = "detectors.csv"',
        "focal_length_mm = 2200.0\npixel_pitch_um = 9.0\nprincipal_point_px = [5999.5, 0.0]",
    )(folder)


def as_tracker_to_inertial(folder: Path) -> None:
    header, times, q = read(folder / "attitude.csv")
    write(folder / "attitude.csv", header, times, q * [-1.0, -1.0, -1.0, 1.0])
    swap(TOML, 'from = "GCRF"\nto = "star_tracker"', 'from = "star_tracker"\nto = "GCRF"')(folder)


def as_earth_fixed_attitude(folder: Path) -> None:
    header, times, q = read(folder / "attitude.csv")
    C_IJ = Rotation.from_matrix(EarthOrientation.load().C_IJ(parse(times, "UTC")))
    write(folder / "attitude.csv", header, times, (Rotation.from_quat(q) * C_IJ).as_quat())
    swap(TOML, 'from = "GCRF"', 'from = "ITRF"')(folder)


def as_earth_fixed_attitude_reversed(folder: Path) -> None:
    as_earth_fixed_attitude(folder)
    header, times, q = read(folder / "attitude.csv")
    write(folder / "attitude.csv", header, times, q * [-1.0, -1.0, -1.0, 1.0])
    swap(TOML, 'from = "ITRF"\nto = "star_tracker"', 'from = "star_tracker"\nto = "ITRF"')(folder)


def as_windows_would_write_it(folder: Path) -> None:
    for table in folder.glob("*.csv"):
        text = table.read_text(encoding="utf-8").replace("\n", "\r\n")
        table.write_bytes(text.encode("utf-8-sig"))


def in_gps_time(folder: Path) -> None:
    for name, at in (("ephemeris.csv", 0), ("attitude.csv", 0), ("images.csv", 1)):
        header, *rows = [line.split(",") for line in (folder / name).read_text(encoding="utf-8").splitlines()]
        for row in rows:
            row[at] = str(np.datetime64(row[at]) + np.timedelta64(18, "s"))
        (folder / name).write_text("\n".join(map(",".join, [header, *rows])) + "\n", encoding="utf-8")
    swap(TOML, '"UTC"', '"GPS"')(folder)


def both(*rewrites: Rewrite) -> Rewrite:
    def rewrite(folder: Path) -> None:
        for change in rewrites:
            change(folder)

    return rewrite


ANY_CAMERA: list[tuple[Rewrite, float]] = [
    (as_oem, 1e-5),
    (as_aem, 1e-7),
    (as_sp3, 2e-3),
    (both(as_oem, as_aem), 1e-5),
    (as_inertial_orbit, 1e-5),
    (as_tracker_to_inertial, 1e-9),
    (as_earth_fixed_attitude, 1e-4),
    (as_earth_fixed_attitude_reversed, 1e-4),
    (as_windows_would_write_it, 1e-9),
    (in_gps_time, 1e-9),
]


@pytest.fixture(scope="module", params=["frame", "line-scan"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def plain(kind: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The answer from the campaign as ``init`` writes it."""
    return calibrated(demo(tmp_path_factory.mktemp("plain") / "demo", "--camera", kind, "--images", 2))


@pytest.mark.slow
@pytest.mark.parametrize(("rewrite", "arcsec"), ANY_CAMERA)
def test_other_files_and_frames_give_the_same_answer(
    rewrite: Rewrite, arcsec: float, kind: str, plain: dict[str, Any], tmp_path: Path
) -> None:
    path = demo(tmp_path / "demo", "--camera", kind, "--images", 2)
    rewrite(path.parent)
    assert_same(calibrated(path), plain, arcsec)


@pytest.mark.slow
def test_pixels_may_be_counted_from_their_corner(tmp_path: Path) -> None:
    plain = calibrated(demo(tmp_path / "plain", "--images", 2))
    path = demo(tmp_path / "corner", "--images", 2)
    as_corners(path.parent)
    assert_same(calibrated(path), plain, 1e-6)
    tables = (path.parent / "observations.csv", path.parent / "out" / "residuals.csv")
    texts = [table.read_text(encoding="utf-8").splitlines() for table in tables]
    counted = [[float(row["column_px"]) for row in csv.DictReader(lines)] for lines in texts]
    np.testing.assert_allclose(counted[0], counted[1], rtol=1e-12, err_msg="as the user counts them")


@pytest.mark.slow
def test_look_angles_and_optics_of_a_line_scanner_agree(tmp_path: Path) -> None:
    plain = calibrated(demo(tmp_path / "table", "--camera", "line-scan", "--images", 2))
    path = demo(tmp_path / "optics", "--camera", "line-scan", "--images", 2)
    as_optics(path.parent)
    assert_same(calibrated(path), plain, 1e-6)


def mounting_forms(q_xyzw: list[float]) -> dict[str, str]:
    """Every way to write the rotation of a quaternion, by SciPy."""
    turn = Rotation.from_quat(q_xyzw)
    x, y, z, w = q_xyzw
    angles = turn.as_euler("ZYX", degrees=True).tolist()
    fixed = turn.as_euler("xzy", degrees=True).tolist()
    return {
        "xyzw": f"quaternion_xyzw = {q_xyzw}",
        "wxyz": f"quaternion_wxyz = {[w, x, y, z]}",
        "negative": f"quaternion_xyzw = {[-x, -y, -z, -w]}",
        "matrix": f"matrix = {turn.as_matrix().tolist()}",
        "vector": f"rotation_vector_deg = {np.degrees(turn.as_rotvec()).tolist()}",
        "turned axes": f'euler_deg = {angles}\neuler_order = "ZYX"',
        "fixed axes": f'euler_deg = {fixed}\neuler_order = "xzy"',
    }


@pytest.mark.slow
@pytest.mark.parametrize("form", list(mounting_forms([0.0, 0.0, 0.0, 1.0])))
@pytest.mark.parametrize("reverse", [False, True])
def test_the_mounting_may_be_written_in_every_form_and_direction(
    form: str, reverse: bool, tmp_path: Path
) -> None:
    path = demo(tmp_path / "demo", "--images", 2)
    plain = calibrated(path)
    lines = path.read_text(encoding="utf-8").splitlines()
    at = lines.index("[mounting]") + 3
    q = np.array(json.loads(lines[at].split("=")[1].split("#")[0]))
    wanted = (q * [-1.0, -1.0, -1.0, 1.0] if reverse else q).tolist()
    lines[at] = mounting_forms(wanted)[form]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if reverse:
        swap(TOML, 'from = "camera"\nto = "star_tracker"', 'from = "star_tracker"\nto = "camera"')(
            path.parent
        )
    found = calibrated(path)
    assert_same(found, plain, 1e-6)
    assert (found["mounting"]["from"], found["mounting"]["to"]) == ("camera", "star_tracker")


# Light --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["frame", "line-scan"])
@pytest.mark.parametrize("right", [True, False])
def test_a_wrong_aberration_switch_is_noticed_aloud(
    kind: str, right: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    precise = scene.Sigmas(np.full(3, 0.3 * ARCSEC), np.full(3, 0.5), np.full(3, 0.3), 0.1)
    monkeypatch.setattr("starplumb.plan.demo.SIGMAS", precise)
    path = demo(tmp_path / "demo", "--camera", kind)
    if not right:
        swap(TOML, "aberration = true", "aberration = false")(path.parent)
    spoken = starplumb("calibrate", path, "--no-report")
    result = json.loads((path.parent / "result" / "result.json").read_text(encoding="utf-8"))
    assert spoken.status == 0
    assert (result["status"], "aberration" in result["message"]) == (
        ("ok", False) if right else ("weak", True)
    )
    assert right or "note: the switch aberration = false looks wrong" in spoken.out


# Real products ------------------------------------------------------------------------------------------------


def test_quickbird_from_its_metadata_to_the_published_mount(shared_data: Path, tmp_path: Path) -> None:
    product = next((shared_data / "quickbird2").glob("*.IMD"))
    optics = ["--principal-distance-mm", 8836.202, "--detector-pitch-mm", 0.01191396]
    origin = ["--detector-origin-mm", "9.54684,164.02773"]
    done = starplumb("import", product, tmp_path / "qb", "--corners", "0.5,0.3", *optics, *origin)
    assert done.status == 0
    result = calibrated(tmp_path / "qb" / "campaign.toml")
    assert (result["status"], result["fit"]["observations"]) == ("weak", 4)
    assert result["geolocation"]["after"]["rmse_m"] < 0.1
    published = Rotation.from_quat(
        [-0.0037369299279122, -0.0046602381421084, 0.0017171366422757, 0.9999806843019142]
    )
    # the vendor's camera has x along the track where ours has y: a quarter turn about the boresight
    wanted = published * Rotation.from_euler("z", -90.0, degrees=True)
    off = (Rotation.from_matrix(result["mounting"]["matrix"]) * wanted.inv()).as_rotvec() / ARCSEC
    assert np.abs(off).max() < 0.4


@pytest.mark.slow
def test_pleiades_from_its_metadata_and_ground_points_to_its_mount(
    shared_data: Path, tmp_path: Path, rng: np.random.Generator
) -> None:
    rasterio = pytest.importorskip("rasterio")
    with rasterio.open(next((shared_data / "pleiades1b").glob("GRID*.tif"))) as file:
        bands, tags, place = file.read(), file.tags(), file.transform
    n = rng.integers(0, bands.shape[1], (30, 2))
    layer = rng.permutation(np.arange(30) % (len(bands) // 2))
    longitude, latitude = (np.radians(bands[2 * layer + i, n[:, 0], n[:, 1]]) for i in (0, 1))
    height = np.array([float(tags[f"ALTITUDE_B{2 * i}"]) for i in layer])
    p_J = geodetic_to_itrf(latitude, longitude, height) + 0.3 * rng.standard_normal((30, 3))
    ids = [f"P{i}" for i in range(30)]
    surveyed = np.stack(itrf_to_geodetic(p_J), axis=-1) * [180 / np.pi, 180 / np.pi, 1.0]
    places = ["latitude_deg", "longitude_deg", "height_m", "sigma_m"]
    write(tmp_path / "land.csv", ["landmark_id", *places], ids, np.column_stack([surveyed, np.full(30, 0.3)]))
    column = place.c + 0.5 + n[:, 1] * place.a - 1.0  # the grid counts from 1
    row = place.f + 0.5 + n[:, 0] * place.e - 1.0
    seen = ["image_id", "landmark_id", "column_px", "row_px", "sigma_px"]
    rows = [
        f"I,{name},{c!r},{r!r},0.05" for name, c, r in zip(ids, column.tolist(), row.tolist(), strict=True)
    ]
    (tmp_path / "seen.csv").write_text("\n".join([",".join(seen), *rows]) + "\n")
    product = next((shared_data / "pleiades1b").glob("PHRDIMAP*.XML"))
    markers = [
        "--landmarks",
        tmp_path / "land.csv",
        "--observations",
        tmp_path / "seen.csv",
        "--image-id",
        "I",
    ]
    sigmas = ["--sigma-m", 0.5, "--sigma-arcsec", "2,2,4"]
    done = starplumb("import", product, tmp_path / "raw", "--attitude", "raw", *sigmas, *markers)
    assert done.status == 0, done.err
    result = calibrated(tmp_path / "raw" / "campaign.toml")
    assert result["geolocation"]["before"]["rmse_m"] == pytest.approx(8.1, rel=0.15)
    assert result["geolocation"]["after"]["rmse_m"] < 1.4
    # AOCS to camera in the vendor's axes, as found with independent code from the vendor's own attitude
    turn = (
        Rotation.from_euler("z", -90.0, degrees=True)
        * Rotation.from_matrix(result["mounting"]["matrix"]).inv()
    )
    np.testing.assert_allclose(turn.as_rotvec()[:2] / ARCSEC, [0.97, -2.09], atol=0.5)
    swap(TOML, "aberration = true", "aberration = false")(tmp_path / "raw")
    other = calibrated(tmp_path / "raw" / "campaign.toml")
    assert any("aberration" in sentence for sentence in (other["message"], *other["notices"]))
