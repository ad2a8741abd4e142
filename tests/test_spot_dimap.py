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
        (("_LINE>501<", "_LINE>1e70<"), 'SCENE_CENTER_LINE: found "1e70", wanted a row'),
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


HRS_ORBIT = """\
12:29:27 1372096.296 -2073440.537 -6769226.7226 -6324.271639 3325.37735 -2300.943826
12:29:57 1181968.3237 -1972297.0102 -6835012.5303 -6349.858264 3417.009158 -2084.431893
12:30:27 991168.95999 -1868451.4484 -6894272.9756 -6369.030109 3505.494378 -1865.953952
12:30:57 799890.70129 -1761999.9146 -6946952.1725 -6381.784699 3590.722488 -1645.716564
12:31:27 608326.02248 -1653041.7422 -6993000.4548 -6388.125946 3672.585993 -1423.927765
12:31:57 416667.18582 -1541679.4427 -7032374.4171 -6388.064104 3750.980541 -1200.796873
12:32:27 225106.05159 -1428018.6094 -7065036.9501 -6381.61571 3825.805034 -976.5343046
12:32:57 33833.890323 -1312167.8187 -7090957.2719 -6368.803533 3896.961721 -751.3514136
12:33:27 -156958.80356 -1194238.5283 -7110110.953 -6349.656542 3964.356296 -525.4603474
"""
HRS_ANGLES = """\
03.206912 1.1621635280e-03 -9.5496029568e-04 -1.7549389832e-05
03.456912 1.1623283868e-03 -9.5492219975e-04 -1.7704390877e-05
03.706911 1.1623883717e-03 -9.5475042923e-04 -1.7710977149e-05
04.956908 1.1630594764e-03 -9.5434573648e-04 -1.7678268548e-05
06.081906 1.1632982771e-03 -9.5488830010e-04 -1.6884533236e-05
"""
HRS_QUATERNIONS = """\
03.206912 1.3065856695e-01 8.9903533459e-01 4.1715109348e-01 -2.5486033410e-02
03.456912 1.3054236770e-01 8.9905583858e-01 4.1714018583e-01 -2.5537047535e-02
03.706911 1.3042607903e-01 8.9907634258e-01 4.1712933779e-01 -2.5588031858e-02
04.956908 1.2984478474e-01 8.9917850494e-01 4.1707473993e-01 -2.5842823088e-02
06.081906 1.2932184339e-01 8.9927005768e-01 4.1702568531e-01 -2.6071660221e-02
"""
HRS_TIE_POINT_DEG = (-76.636309, -75.519946)
"""Of the segment of SPOT 5, HRS 1, of 2008-03-04 12:31:03.1 (among the tests of the Ames Stereo Pipeline): positions,
velocities, yaw, pitch and roll, quaternions, and where the vendor's model has column 1 of row 1 at height 0."""


def _hrs() -> str:
    points = ""
    for time, *state in map(str.split, HRS_ORBIT.splitlines()):
        axes = [f"<{axis}>{value}</{axis}>" for axis, value in zip("XYZXYZ", state, strict=True)]
        location, velocity = "".join(axes[:3]), "".join(axes[3:])
        states = f"<Location>{location}</Location><Velocity>{velocity}</Velocity>"
        points += f"<Point>{states}<TIME>2008-03-04T{time}</TIME></Point>"
    angles = "".join(
        f"<Angles><TIME>2008-03-04T12:31:{t}</TIME><YAW>{yaw}</YAW><PITCH>{pitch}</PITCH><ROLL>{roll}</ROLL></Angles>"
        for t, yaw, pitch, roll in map(str.split, HRS_ANGLES.splitlines())
    )
    rows = ""
    for t, *q in map(str.split, HRS_QUATERNIONS.splitlines()):
        parts = "".join(f"<Q{i}>{value}</Q{i}>" for i, value in enumerate(q))
        rows += f"<Quaternion><Q_TIME>2008-03-04T12:31:{t}</Q_TIME><Q_STATUS>3</Q_STATUS>{parts}</Quaternion>"
    looks = "".join(
        f"<Look_Angles><PSI_X>{x}</PSI_X><PSI_Y>{y}</PSI_Y></Look_Angles>"
        for x, y in (("3.4977750140e-01", "-7.1371362400e-02"), ("3.4977749200e-01", "-7.1359536900e-02"))
    )
    latitude, longitude = HRS_TIE_POINT_DEG
    return f"""<Dimap_Document><Dataset_Id><DATASET_NAME>HRS</DATASET_NAME></Dataset_Id>
<Geoposition><Geoposition_Points><Tie_Point><TIE_POINT_CRS_X>{longitude}</TIE_POINT_CRS_X>
<TIE_POINT_CRS_Y>{latitude}</TIE_POINT_CRS_Y><TIE_POINT_CRS_Z>0.0</TIE_POINT_CRS_Z>
<TIE_POINT_DATA_X>1.0</TIE_POINT_DATA_X><TIE_POINT_DATA_Y>1.0</TIE_POINT_DATA_Y></Tie_Point>
<Tie_Point><TIE_POINT_CRS_X>-71.9</TIE_POINT_CRS_X><TIE_POINT_CRS_Y>-77.4</TIE_POINT_CRS_Y>
<TIE_POINT_CRS_Z>0.0</TIE_POINT_CRS_Z><TIE_POINT_DATA_X>12000</TIE_POINT_DATA_X><TIE_POINT_DATA_Y>1</TIE_POINT_DATA_Y>
</Tie_Point></Geoposition_Points></Geoposition>
<Raster_Dimensions><NCOLS>2</NCOLS><NROWS>3000</NROWS></Raster_Dimensions>
<Data_Processing><PROCESSING_LEVEL>1A</PROCESSING_LEVEL></Data_Processing>
<Data_Strip><Ephemeris><Points>{points}</Points></Ephemeris><Satellite_Attitudes><Raw_Attitudes>
<Star_Tracker_Attitude><Quaternion_List>{rows}</Quaternion_List></Star_Tracker_Attitude></Raw_Attitudes>
<Corrected_Attitudes><Corrected_Attitude>{angles}</Corrected_Attitude></Corrected_Attitudes></Satellite_Attitudes>
<Sensor_Configuration><Time_Stamp><LINE_PERIOD>7.5199705115e-04</LINE_PERIOD>
<SCENE_CENTER_TIME>2008-03-04T12:31:39.349737</SCENE_CENTER_TIME><SCENE_CENTER_LINE>48085</SCENE_CENTER_LINE></Time_Stamp>
<Instrument_Look_Angles_List><Instrument_Look_Angles><Look_Angles_List>{looks}</Look_Angles_List>
</Instrument_Look_Angles></Instrument_Look_Angles_List></Sensor_Configuration></Data_Strip></Dimap_Document>"""


def test_a_real_segment_of_spot_5_is_where_its_vendor_has_it(tmp_path: Path) -> None:
    """Row 1 is 16 ms before the first attitude: the straight line through two later rows leads there to 0.1 m."""
    product = read_dimap(_written(tmp_path, _hrs()))
    campaign = product.campaign(1.0, 1.0)
    rows = np.array([22.0, 40.0])
    first, later = locate(campaign, product.C_EK, np.zeros(2, dtype=np.int64), [0.0, 0.0], rows, 0.0)
    assert product.corners is not None
    assert product.corners.column_px.tolist() == [0.0]
    place = first - rows[0] * (later - first) / (rows[1] - rows[0])
    assert np.linalg.norm(place - product.corners.r_J[0]) < 0.1


def test_the_star_tracker_of_a_real_segment_agrees_with_its_vendor(tmp_path: Path) -> None:
    product = read_dimap(_written(tmp_path, _hrs()), "raw")
    assert product.frame == "GCRF"
    assert "taken as those of GCRF, in which they agree" in product.notices[-1]
    assert float(product.notices[-1].split(" to ")[-1].split()[0]) < 0.3
