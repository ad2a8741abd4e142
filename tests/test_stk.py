"""STK ephemeris and attitude files: units, frames, times and the sense of the quaternion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bad_cases import AEM, both, put, swap
from helpers import write_good_campaign
from starplumb.io.campaign.read import load_campaign
from starplumb.io.formats.registry import ATTITUDES, ORBITS, recognised
from starplumb.io.formats.stk.series import read_stk_attitude, read_stk_ephemeris
from starplumb.physics.errors import InputError
from starplumb.physics.timescales import format_iso, parse
from starplumb.physics.units import DEG

EPHEMERIS = """stk.v.11.0
# made up
BEGIN Ephemeris
NumberOfEphemerisPoints 2
ScenarioEpoch           1 Jan 2020 00:00:00.000000000
InterpolationMethod     Lagrange
CentralBody             Earth
DistanceUnit            Kilometers
CoordinateSystem        Fixed
EphemerisTimePosVel

0.0 7058.137 0.0 -15.0 0.0 0.0 7.5
4.0 7058.137 0.0 15.0 0.0 0.0 7.5

END Ephemeris
"""
TURNING = """stk.v.5.0
BEGIN Attitude
ScenarioEpoch           1 Jun 2002 12:00:00.000000000
NumberOfAttitudePoints  361
BlockingFactor          20
InterpolationOrder      1
CentralBody             Earth
CoordinateAxes        \tJ2000
AttitudeTimeQuatAngVels
0.000000000000e+000 -2.424118508012e-017 0.000000000000e+000 0.000000000000e+000 1.000000000000e+000 4.798043195447e-017 -4.004914679595e-017 6.000000000000e+000
1.000000000000e+001 -2.097916970074e-017 1.215727082258e-017 5.000000000000e-001 8.660254037844e-001 3.618560369071e-017 2.477422471270e-017 6.000000000000e+000
2.000000000000e+001 -1.198428637670e-017 2.114855211462e-017 8.660254037844e-001 5.000000000000e-001 2.111895113580e-017 -1.161629167034e-017 6.000000000000e+000
END Attitude
"""  # noqa: E501
"""The first rows of the example of the format that the maker publishes: rates in deg/s about the axes of the body."""


def written(tmp_path, text, name="file"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


def test_an_ephemeris_in_kilometres(tmp_path):
    table = read_stk_ephemeris(written(tmp_path, EPHEMERIS))
    np.testing.assert_array_equal(table.r, [[7058137.0, 0.0, -15000.0], [7058137.0, 0.0, 15000.0]])
    np.testing.assert_array_equal(table.v, [[0.0, 0.0, 7500.0]] * 2)
    assert format_iso(table.t_ns, "UTC", 3) == ["2020-01-01T00:00:00.000", "2020-01-01T00:00:04.000"]
    assert table.frame == "ITRF"
    metres = EPHEMERIS.replace("DistanceUnit            Kilometers\n", "").replace("7058.137", "7058137")
    assert read_stk_ephemeris(written(tmp_path, metres)).r[0, 0] == 7058137.0


def test_seconds_of_the_scenario_are_elapsed_ones_across_a_leap_second(tmp_path):
    """The year 2016 ended with one: two seconds after 23:59:59 it is 00:00:00."""
    text = EPHEMERIS.replace("1 Jan 2020 00:00:00.000000000", "31 Dec 2016 23:59:59").replace(
        "\n4.0 ", "\n2.0 "
    )
    assert format_iso(read_stk_ephemeris(written(tmp_path, text)).t_ns, "UTC", 0) == [
        "2016-12-31T23:59:59",
        "2017-01-01T00:00:00",
    ]


def test_dates_in_place_of_seconds(tmp_path):
    text = EPHEMERIS.replace("DistanceUnit", "TimeFormat UTCG\nDistanceUnit")
    text = text.replace("\n0.0 ", "\n1 Jan 2020 00:00:00.25 ").replace("\n4.0 ", "\n1 Jan 2020 00:00:04 ")
    t_ns = read_stk_ephemeris(written(tmp_path, text)).t_ns
    assert t_ns.tolist() == parse(["2020-01-01T00:00:00.25", "2020-01-01T00:00:04"], "UTC").tolist()


@pytest.mark.parametrize(
    ("word", "frame"),
    [
        ("Fixed", "ITRF"),
        ("ICRF", "GCRF"),
        ("J2000", "GCRF"),
        ("TEMEOfDate", "TEME"),
        ("TrueOfDate", "TOD"),
        ("MeanOfDate", "MOD"),
    ],
)
def test_frames_by_the_names_of_stk(tmp_path, word, frame):
    assert read_stk_ephemeris(written(tmp_path, EPHEMERIS.replace("Fixed", word))).frame == frame


def test_arcs_are_parted_where_the_file_says(tmp_path):
    borders = "BEGIN SegmentBoundaryTimes\n0\n2\n4\nEND SegmentBoundaryTimes\nEphemerisTimePosVel\n"
    text = EPHEMERIS.replace("EphemerisTimePosVel\n", borders)
    middle = "2.0 7058.137 0.0 0.0 0.0 0.0 7.5\n2.0 7058.137 0.0 0.0 0.0 0.1 7.5\n4.0 "
    table = read_stk_ephemeris(written(tmp_path, text.replace("4.0 ", middle)))
    assert table.segments == ((0, 2), (2, 3))
    np.testing.assert_array_equal(table.v[:, 1], 0.0)
    assert "its first row was left out" in table.notices[0]
    with pytest.raises(InputError, match="line 14: the time repeats that of the row before"):
        read_stk_ephemeris(written(tmp_path, EPHEMERIS.replace("4.0 ", middle)))


def test_the_published_example_turns_as_its_rates_say(tmp_path):
    """d C_BA / dt = -[w_B x] C_BA: coordinates along a body that turns by w turn by -w."""
    table = read_stk_attitude(written(tmp_path, TURNING))
    C_BA = Rotation.from_quat(table.q_BA_xyzw)
    step = (C_BA[1:] * C_BA[:-1].inv()).as_rotvec() / DEG
    np.testing.assert_allclose(step, [[0.0, 0.0, -60.0]] * 2, atol=1e-9)
    np.testing.assert_allclose(C_BA[1].apply([1.0, 0.0, 0.0]), [0.5, -np.sqrt(0.75), 0.0], atol=1e-12)
    assert table.frame_a == "GCRF"
    assert "rates beside the quaternions are not used" in table.notices[0]


def test_scalar_first_and_scalar_last_are_the_same_attitude(tmp_path):
    rows = {"AttitudeTimeQuaternions": "0.1 0.7 -0.5 0.5", "AttitudeTimeQuatScalarFirst": "0.5 0.1 0.7 -0.5"}
    found = []
    for kind, row in rows.items():
        head = TURNING[: TURNING.index("AttitudeTime")]
        found.append(
            read_stk_attitude(written(tmp_path, f"{head}{kind}\n0 {row}\n1 {row}\nEND Attitude\n")).q_BA_xyzw
        )
    np.testing.assert_array_equal(found[0], [[-0.1, -0.7, 0.5, 0.5]] * 2)
    np.testing.assert_array_equal(found[0], found[1])


def test_a_campaign_of_stk_files_is_that_of_ccsds_messages(tmp_path):
    """CCSDS and STK mean the same quaternion by different words, so the digits are the same."""
    attitude = (
        "stk.v.12.2\nBEGIN Attitude\nScenarioEpoch 1 Jan 2020 00:00:00\nCoordinateAxes Fixed\n"
        "AttitudeTimeQuaternions\n0 -0.5 -0.5 0.5 0.5\n4 -0.5 -0.5 0.5 0.5\nEND Attitude\n"
    )
    one = write_good_campaign(tmp_path / "one")
    swap("campaign.toml", "attitude.csv", "a.aem")(one.parent)
    put("a.aem", AEM)(one.parent)
    two = write_good_campaign(tmp_path / "two")
    both(
        swap("campaign.toml", "attitude.csv", "sat.a"),
        put("sat.a", attitude),
        swap("campaign.toml", "ephemeris.csv", "sat.e"),
        put("sat.e", EPHEMERIS),
    )(two.parent)
    one, two = load_campaign(one).campaign, load_campaign(two).campaign
    t_ns = one.images.t_ns
    np.testing.assert_allclose(two.attitude.at(t_ns)[0], one.attitude.at(t_ns)[0], atol=1e-15)
    np.testing.assert_allclose(two.ephemeris.at(t_ns)[0], one.ephemeris.at(t_ns)[0], atol=1e-6)


def test_files_are_known_by_their_first_lines(tmp_path):
    assert recognised(written(tmp_path, EPHEMERIS, "a.csv"), ORBITS).name == "STK ephemeris"
    assert recognised(written(tmp_path, "\ufeff\n# who\n" + TURNING, "b.x"), ATTITUDES).name == "STK attitude"
    with pytest.raises(InputError, match="found a file of the format STK attitude"):
        recognised(tmp_path / "b.x", ORBITS)


FAULTS = {
    "miles": (
        "Kilometers",
        "NauticalMiles",
        'line 8: DistanceUnit is "NauticalMiles", wanted Meters or Kilometers',
    ),
    "of an epoch": ("Fixed", "TEMEOfEpoch", 'line 9: CoordinateSystem is "TEMEOfEpoch", wanted Fixed'),
    "Mars": ("Earth", "Mars", 'line 7: CentralBody is "Mars", wanted Earth'),
    "no epoch": ("ScenarioEpoch", "Nothing", "found no ScenarioEpoch"),
    "a date that is none": ("1 Jan 2020", "1 Foo 2020", "line 5: found"),
    "a day that is none": ("1 Jan 2020", "31 Feb 2020", "line 5"),
    "other times": (
        "DistanceUnit",
        "TimeFormat YYDDD\nDistanceUnit",
        'TimeFormat is "YYDDD", wanted EpSec or UTCG',
    ),
    "other data": (
        "EphemerisTimePosVel",
        "EphemerisLLATimePos",
        "line 10: found EphemerisLLATimePos, wanted Ephem",
    ),
    "a column less": (" 7.5\n4.0", "\n4.0", "line 12: found 5 numbers after the time, wanted 6"),
    "back in time": ("\n4.0", "\n-4.0", "line 13: the time is earlier than that of the row before"),
    "Arabic digits": ("7058.137 0.0 -15.0", "٧058.137 0.0 -15.0", "line 12: found"),
    "infinite": ("7058.137 0.0 -15.0", "inf 0.0 -15.0", "line 12: found"),
    "a word for a time": ("\n4.0", "\n+x", "line 13: found"),
    "no rows": ("\n0.0 7058.137", "\nEND Ephemeris\n0.0 7058.137", "line 10: found no row below it"),
    "no data": ("EphemerisTimePosVel", "", "found no data of an ephemeris"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_what_cannot_be_used_is_said_with_its_line(tmp_path, case):
    old, new, message = FAULTS[case]
    assert old in EPHEMERIS
    with pytest.raises(InputError) as error:
        read_stk_ephemeris(written(tmp_path, EPHEMERIS.replace(old, new, 1)))
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_an_attitude_that_is_none_is_refused(tmp_path):
    for old, new, message in (
        (
            "QuatAngVels",
            "EulerAngles",
            "line 9: found AttitudeTimeEulerAngles, wanted AttitudeTimeQuaternions",
        ),
        ("CoordinateAxes", "# CoordinateAxes", "found no CoordinateAxes, wanted Fixed"),
        ("8.660254037844e-001 5.0", "8.7e-001 6.0", "line 12: the quaternion has norm"),
    ):
        with pytest.raises(InputError) as error:
            read_stk_attitude(written(tmp_path, TURNING.replace(old, new)))
        assert message in str(error.value)


def test_a_file_that_breaks_off_is_refused_unless_it_has_what_it_announces(tmp_path):
    """Some simulators leave END out; a transfer that broke off leaves rows out, or digits of the last number."""
    broken = EPHEMERIS[: EPHEMERIS.index("\nEND")]
    (notice,) = read_stk_ephemeris(written(tmp_path, broken)).notices
    assert "found no END Ephemeris, but all 2 rows that it announces" in notice
    for text, message in (
        (
            broken.replace("4.0 7058.137 0.0 15.0 0.0 0.0 7.5\n", ""),
            'line 12: found 1 rows of "2" and no END Ephemeris',
        ),
        (broken.replace("NumberOfEphemerisPoints 2", ""), "line 13: found 2 rows and no END Ephemeris below"),
        (broken.rstrip()[:-2], "line 13: found the end of the file within a row"),
    ):
        with pytest.raises(InputError) as error:
            read_stk_ephemeris(written(tmp_path, text))
        assert message in str(error.value)
