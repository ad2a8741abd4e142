"""Scenes of SPOT 1 to 5: made up over the equator at longitude 0, held against the handbook's formulas by hand."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from starplumb.io.vendors.dimap import read_dimap
from starplumb.io.vendors.metadata_files import metadata_files
from starplumb.io.vendors.product import import_product
from starplumb.physics.errors import InputError
from starplumb.physics.light import Corrections
from starplumb.physics.orientation import EarthOrientation
from starplumb.physics.timescales import parse
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import locate

Array = NDArray[np.float64]

RADIUS, RATE = 6_378_137.0 + 830_000.0, 1.03e-3
COLUMNS, ROWS, PERIOD = 2001, 1001, 0.000752
CENTER = "2005-06-01T12:00:00.000000"


def _clock(second: float) -> str:
    return str(np.datetime64("2005-06-01T12:00:00.000000000") + np.timedelta64(round(second * 1e9), "ns"))[
        :26
    ]


def _vector(name: str, values: Array) -> str:
    parts = "".join(f"<{axis}>{value!r}</{axis}>" for axis, value in zip("XYZ", values.tolist(), strict=True))
    return f"<{name}>{parts}</{name}>"


def _points() -> str:
    """Due north in the plane of the meridian of longitude 0, a point every 30 s."""
    text = ""
    for second in range(-120, 121, 30):
        angle = RATE * second
        r = RADIUS * np.array([np.cos(angle), 0.0, np.sin(angle)])
        v = RADIUS * RATE * np.array([-np.sin(angle), 0.0, np.cos(angle)])
        text += (
            f"<Point>{_vector('Location', r)}{_vector('Velocity', v)}<TIME>{_clock(second)}</TIME></Point>"
        )
    return f"<Ephemeris><Points>{text}</Points></Ephemeris>"


def _angles(name: str, pitch: float, roll: float, yaw: float, times: Array, flag: str = "N") -> str:
    return "".join(
        f"<{name}><TIME>{_clock(t)}</TIME><OUT_OF_RANGE>{flag}</OUT_OF_RANGE>"
        f"<YAW>{yaw!r}</YAW><PITCH>{pitch!r}</PITCH><ROLL>{roll!r}</ROLL></{name}>"
        for t in times.tolist()
    )


def _corrected(pitch: float = 0.0, roll: float = 0.0, yaw: float = 0.0) -> str:
    rows = _angles("Angles", pitch, roll, yaw, np.arange(-2.0, 2.01, 0.125))
    return f"<Corrected_Attitudes><Corrected_Attitude>{rows}</Corrected_Attitude></Corrected_Attitudes>"


def _looks(name: str = "", shift: float = 0.0) -> str:
    psi_y = np.arctan(1e-5 * (np.arange(COLUMNS) - 1000.0) + shift)
    rows = "".join(
        f"<Look_Angles><DETECTOR_ID>{i + 1}</DETECTOR_ID><PSI_X>0.0</PSI_X><PSI_Y>{y!r}</PSI_Y></Look_Angles>"
        for i, y in enumerate(psi_y.tolist())
    )
    return (
        f"<Instrument_Look_Angles>{name}<Look_Angles_List>{rows}</Look_Angles_List></Instrument_Look_Angles>"
    )


def scene(
    attitudes: str = "", looks: str = "", processing: str = "<PROCESSING_LEVEL>1A</PROCESSING_LEVEL>"
) -> str:
    """2001 columns whose middle looks down, 1001 rows whose middle is exposed at noon over the equator."""
    return f"""<?xml version="1.0" encoding="ISO-8859-1"?><Dimap_Document>
<Metadata_Id><METADATA_FORMAT version="1.1">DIMAP</METADATA_FORMAT></Metadata_Id>
<Dataset_Id><DATASET_NAME>SCENE 5 made up</DATASET_NAME></Dataset_Id>
<Dataset_Frame>
<Vertex><FRAME_LON>0.0746</FRAME_LON><FRAME_LAT>0</FRAME_LAT><FRAME_ROW>501</FRAME_ROW><FRAME_COL>1</FRAME_COL></Vertex>
</Dataset_Frame>
<Raster_Dimensions><NCOLS>{COLUMNS}</NCOLS><NROWS>{ROWS}</NROWS><NBANDS>1</NBANDS></Raster_Dimensions>
<Data_Processing>{processing}</Data_Processing>
<Data_Strip>{_points()}<Satellite_Attitudes>{attitudes or _corrected()}</Satellite_Attitudes>
<Sensor_Configuration><Time_Stamp><LINE_PERIOD>{PERIOD}</LINE_PERIOD><SCENE_CENTER_TIME>{CENTER}</SCENE_CENTER_TIME>
<SCENE_CENTER_LINE>501</SCENE_CENTER_LINE><SCENE_CENTER_COL>1001</SCENE_CENTER_COL></Time_Stamp>
<Instrument_Look_Angles_List>{looks or _looks()}</Instrument_Look_Angles_List></Sensor_Configuration></Data_Strip>
</Dimap_Document>"""


def _written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "METADATA.DIM"
    path.write_text(text, encoding="utf-8")
    return path


def _ground(path: Path, column: float, row: float, attitude: str = "vendor") -> Array:
    product = read_dimap(path, attitude)  # type: ignore[arg-type]
    campaign = product.campaign(1.0, 1.0)
    return locate(campaign, product.C_EK, np.zeros(1, dtype=np.int64), [column], [row], 0.0)[0]


def _down(pitch: float = 0.0, roll: float = 0.0, yaw: float = 0.0, psi: float = 0.0) -> Array:
    """Where the handbook's ``M_p M_r M_y (-tan PSI_Y, 0, -1)`` leads, to the right and ahead for each metre down."""
    M_p = np.array([[1, 0, 0], [0, np.cos(pitch), np.sin(pitch)], [0, -np.sin(pitch), np.cos(pitch)]])
    M_r = np.array([[np.cos(roll), 0, -np.sin(roll)], [0, 1, 0], [np.sin(roll), 0, np.cos(roll)]])
    M_y = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    u = M_p @ M_r @ M_y @ np.array([-psi, 0.0, -1.0])
    return u[:2] / -u[2]


def test_axes_rows_and_columns_by_hand(tmp_path: Path) -> None:
    """Flying north the right is east: PSI_Y grows to the west, and so do the columns; rows grow to the north."""
    path = _written(tmp_path, scene())
    np.testing.assert_allclose(_ground(path, 1000.0, 500.0), [6_378_137.0, 0.0, 0.0], atol=1e-3)
    x, y, z = _ground(path, 1100.0, 500.0)
    np.testing.assert_allclose([y, z], [-0.001 * (RADIUS - x), 0.0], atol=1e-3)
    later = _ground(path, 1000.0, 1000.0)[2]
    geocentric = np.arctan2(later, _ground(path, 1000.0, 1000.0)[0])
    assert geocentric == pytest.approx(RATE * 500 * PERIOD, rel=1e-5)


@pytest.mark.parametrize(
    ("pitch", "roll", "yaw"), [(0.002, 0.0, 0.0), (0.0, 0.003, 0.0), (0.0, 0.0, 0.1), (0.001, -0.002, 0.05)]
)
def test_attitude_angles_are_those_of_the_handbook(
    tmp_path: Path, pitch: float, roll: float, yaw: float
) -> None:
    path = _written(tmp_path, scene(_corrected(pitch, roll, yaw)))
    for column, psi in ((1000.0, 0.0), (1800.0, 0.008)):
        x, y, z = _ground(path, column, 500.0)
        right, ahead = _down(pitch, roll, yaw, psi) * (RADIUS - x)
        np.testing.assert_allclose([y, z], [right, ahead], atol=1e-3)


def test_rates_are_added_up_where_there_are_no_corrected_angles(tmp_path: Path) -> None:
    """A constant rate about the roll axis from the one angle that was measured, 1 s before the middle."""
    measured = _angles("Angles", 0.0, 0.001, 0.0, np.array([-1.0]))
    rates = _angles("Angular_Speeds", 0.0, 0.002, 0.0, np.arange(-2.0, 2.01, 0.125))
    path = _written(
        tmp_path,
        scene(
            f"<Raw_Attitudes><Aocs_Attitude><Angles_List>{measured}</Angles_List>"
            f"<Angular_Speeds_List>{rates}</Angular_Speeds_List></Aocs_Attitude></Raw_Attitudes>"
        ),
    )
    x, y, _ = _ground(path, 1000.0, 500.0)
    assert y == pytest.approx(_down(roll=0.001 + 0.002 * 1.0)[0] * (RADIUS - x), abs=1e-3)


def test_an_image_cut_out_of_its_scene(tmp_path: Path) -> None:
    cut = (
        "<PROCESSING_LEVEL>1A</PROCESSING_LEVEL><Regions_Of_Interest><Region_Of_Interest>"
        "<COL_MIN>101</COL_MIN><ROW_MIN>201</ROW_MIN></Region_Of_Interest></Regions_Of_Interest>"
    )
    text = scene(processing=cut).replace(f"<NCOLS>{COLUMNS}<", "<NCOLS>1501<")
    path = _written(tmp_path, text)
    np.testing.assert_allclose(_ground(path, 900.0, 300.0), [6_378_137.0, 0.0, 0.0], atol=1e-3)


def test_look_angles_of_fewer_detectors_are_spread_over_the_columns_and_said(tmp_path: Path) -> None:
    path = _written(tmp_path, scene().replace(f"<NCOLS>{COLUMNS}<", "<NCOLS>4001<"))
    assert "look angles of 2001 detectors are spread over 4001 columns" in read_dimap(path).notices[0]
    np.testing.assert_allclose(_ground(path, 2000.0, 500.0), [6_378_137.0, 0.0, 0.0], atol=1e-3)


def test_one_band_of_several_must_be_named(tmp_path: Path) -> None:
    looks = _looks("<BAND_INDEX>1</BAND_INDEX>") + _looks("<BAND_INDEX>2</BAND_INDEX>", 0.001)
    info = "<Spectral_Band_Info><BAND_INDEX>2</BAND_INDEX><BAND_DESCRIPTION>XS2</BAND_DESCRIPTION></Spectral_Band_Info>"
    path = _written(tmp_path, scene(looks=looks).replace("<Data_Strip>", info + "<Data_Strip>"))
    with pytest.raises(InputError, match="found the bands 1, 2, wanted one of them as band"):
        read_dimap(path)
    for name in ("2", "XS2"):
        assert read_dimap(path, band=name).detectors.tan_x[1000] == pytest.approx(0.001, rel=1e-9)


def _quaternions(frame: str, inverse: bool, mount: Rotation, axes: Rotation) -> str:
    """Those of a satellite that keeps to the local frame: axes of its own, a small mounting, 10 Hz."""
    times = np.arange(-1.5, 1.51, 0.1)
    t_ns = parse([_clock(t) for t in times.tolist()], "UTC")
    C_IJ = (
        EarthOrientation.load().C_IJ(t_ns)
        if frame == "GCRF"
        else np.broadcast_to(np.eye(3), (t_ns.size, 3, 3))
    )
    rows = ""
    for second, turn in zip(times.tolist(), C_IJ, strict=True):
        angle = RATE * second
        ahead, down = (
            np.array([-np.sin(angle), 0.0, np.cos(angle)]),
            -np.array([np.cos(angle), 0.0, np.sin(angle)]),
        )
        C_VJ = Rotation.from_matrix(np.stack([ahead, np.cross(down, ahead), down]))
        C_EF = axes.inv() * mount.inv() * C_VJ * Rotation.from_matrix(turn).inv()
        x, y, z, w = (C_EF.inv() if inverse else C_EF).as_quat().tolist()
        rows += (
            f"<Quaternion><TIME>{_clock(second)}</TIME><Q0>{w!r}</Q0><Q1>{x!r}</Q1><Q2>{y!r}</Q2><Q3>{z!r}</Q3>"
            "</Quaternion>"
        )
    inner = f"<Star_Tracker_Attitude><Quaternion_List>{rows}</Quaternion_List></Star_Tracker_Attitude>"
    return f"<Raw_Attitudes>{inner}</Raw_Attitudes>{_corrected()}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frame", "inverse", "axes"),
    [
        ("GCRF", False, [0.0, 0.0, 0.0]),
        ("GCRF", True, [180.0, 0.0, 0.0]),
        ("GCRF", True, [0.0, 90.0, 90.0]),
        ("ITRF", True, [0.0, 0.0, 0.0]),
        ("GCRF, scalar last", False, [0.0, 90.0, 0.0]),
    ],
)
def test_quaternions_of_the_star_tracker_in_any_convention(
    tmp_path: Path, frame: str, inverse: bool, axes: list[float]
) -> None:
    """100 arcsec about the flight direction: 402 m to the right of the line straight down, light effects off."""
    mount = Rotation.from_rotvec([100.0 * ARCSEC, 0.0, 0.0])
    text = scene(_quaternions(frame[:4], inverse, mount, Rotation.from_euler("xyz", axes, degrees=True)))
    if "last" in frame:
        frame, text = (
            "GCRF",
            re.sub("<(/?)Q([0-3])>", lambda tag: f"<{tag[1]}Q{(int(tag[2]) - 1) % 4}>", text),
        )
    path = _written(tmp_path, text)
    product = read_dimap(path, "raw")
    assert product.corrections == Corrections(light_time=False, aberration=False, refraction=False)
    assert product.frame == frame
    assert f"taken as those of {frame}, in which they agree" in product.notices[-1]
    assert float(product.notices[-1].split(" to ")[-1].split()[0]) == pytest.approx(100.0, rel=0.02)
    x, y, z = _ground(path, 1000.0, 500.0, "raw")
    away = np.tan(100.0 * ARCSEC) * (RADIUS - x)
    np.testing.assert_allclose([abs(y), z], [away, 0.0], atol=0.05)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("1A</PROC", "2A</PROC"), 'PROCESSING_LEVEL: found "2A", wanted "1A"'),
        (("<Points>", "<Point_List>"), "found no Points|not well formed"),
        (("<OUT_OF_RANGE>N", "<OUT_OF_RANGE>Y"), "found 33 Angles and none of use"),
        ((f"<NCOLS>{COLUMNS}<", "<NCOLS>many<"), 'NCOLS: found "many", wanted a number'),
        (("<PSI_Y>0.0</PSI_Y>", "<PSI_Y>nan</PSI_Y>"), "wanted a number"),
        ((f"<LINE_PERIOD>{PERIOD}", "<LINE_PERIOD>0"), 'LINE_PERIOD: found "0", wanted a positive'),
    ],
)
def test_bad_scenes_are_refused_in_one_sentence(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    text = scene()
    assert change[0] in text
    with pytest.raises(InputError, match=says) as error:
        read_dimap(_written(tmp_path, text.replace(*change)))
    assert "METADATA.DIM" in str(error.value)
    assert "\n" not in str(error.value)


def test_choices_that_a_scene_does_not_have(tmp_path: Path) -> None:
    path = _written(tmp_path, scene())
    with pytest.raises(InputError, match='found attitude "filtered"'):
        read_dimap(path, "filtered")
    with pytest.raises(InputError, match="found no quaternions of a star tracker"):
        read_dimap(path, "raw")
    turned = _quaternions("GCRF", False, Rotation.from_rotvec([0.03, 0.0, 0.0]), Rotation.identity())
    with pytest.raises(InputError, match=r"differ by 1\.7. deg from the vendor's attitude in any frame"):
        read_dimap(_written(tmp_path, scene(turned)), "raw")


@pytest.mark.slow
def test_quaternions_that_fit_either_way_are_refused(tmp_path: Path) -> None:
    """With axes turned by half a turn this flight in the plane of z and x looks alike from both sides."""
    text = _quaternions(
        "ITRF",
        False,
        Rotation.from_rotvec([100.0 * ARCSEC, 0.0, 0.0]),
        Rotation.from_rotvec([np.pi, 0.0, 0.0]),
    )
    with pytest.raises(InputError, match="fit the vendor's attitude from either frame to the other"):
        read_dimap(_written(tmp_path, scene(text)), "raw")


def test_a_scene_becomes_a_campaign(tmp_path: Path) -> None:
    path = _written(tmp_path, scene())
    assert metadata_files(tmp_path) == [path]
    notices = import_product(tmp_path, tmp_path / "out", sigma_m=1.0, sigma_arcsec=1.0)
    assert (tmp_path / "out" / "campaign.toml").is_file()
    assert not any("covers the rows" in notice for notice in notices)
