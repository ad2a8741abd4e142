"""SP3 orbits: a low orbiter's file with its columns written out by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from starplumb.io.formats.registry import ORBITS, Asked, recognised
from starplumb.io.formats.sp3 import read_sp3
from starplumb.physics.errors import InputError

S = 1_000_000_000


def line(kind: str, name: str, x: float, y: float, z: float, flags: str = "") -> str:
    """A position or velocity record: A1 A3 3F14.6 and the clock, flags in columns 75-80."""
    fields = "".join(f"{value:14.6f}" for value in (x, y, z, 999999.999999))
    return f"{kind}{name}{fields}".ljust(74) + flags.rjust(6)


def epoch(second: float) -> str:
    return f"*  2000  1  1 12  0 {second:11.8f}"


ROWS = [
    epoch(0.0),
    line("P", "L47", -6816.123456, 12.5, -0.000001),
    line("V", "L47", 10.0, -75000.5, 0.25),
    epoch(30.5),
    line("P", "L47", -6810.0, -213.0, 5.0),
    line("V", "L47", 11.0, -75000.0, 0.5),
]


def sp3(
    rows: list[str] | None = None,
    satellites: tuple[str, ...] = ("L47",),
    version: str = "d",
    frame: str = "IGb14",
    scale: str = "GPS",
    end: str = "EOF",
) -> str:
    listed = "".join(satellites).ljust(51, "0").replace("0" * 3, "  0")
    head = [
        f"#{version}V2000  1  1 12  0  0.00000000       2 ORBIT {frame:5} FIT  ESA",
        "## 1042 561600.00000000    30.50000000 51544 0.5000000000000",
        f"+  {len(satellites):3d}   {listed}",
        "++         0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0",
        f"%c L  cc {scale:3} ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
        "%c cc cc ccc ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
        "%f  1.2500000  1.025000000  0.00000000000  0.000000000000000",
        "%i    0    0    0    0      0      0      0      0         0",
        "/* A COMMENT",
    ]
    return "\n".join([*head, *(ROWS if rows is None else rows), end]) + "\n"


@pytest.fixture
def put(tmp_path: Path):
    def write(text: str) -> Path:
        path = tmp_path / "orbit.sp3"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("version", ["c", "d"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_kilometres_and_decimetres_per_second(put, version, ends):
    table = read_sp3(put(sp3(version=version).replace("\n", ends)))
    assert table.r.tolist() == [[-6816123.456, 12500.0, -0.001], [-6810000.0, -213000.0, 5000.0]]
    assert table.v is not None
    assert table.v.tolist() == [[1.0, -7500.05, 0.025], [1.1, -7500.0, 0.05]]
    assert (table.frame, table.frame_text, table.object_name) == ("ITRF", "IGb14", "L47")
    assert (table.segments, table.notices) == (((0, 2),), ())


@pytest.mark.parametrize(("scale", "noon_ns"), [("GPS", 19 * S), ("UTC", 32 * S), ("TAI", 0)])
def test_time_systems(put, scale, noon_ns):
    table = read_sp3(put(sp3(scale=scale)))
    assert table.t_ns.tolist() == [noon_ns, noon_ns + 30 * S + S // 2]
    assert table.time_scale == scale


@pytest.mark.parametrize("frame", ["ITRF", "ITR97", "IGS14", "IGb08", "IGS20", "SLR08", "WGS84"])
def test_frames(put, frame):
    assert read_sp3(put(sp3(frame=frame))).frame == "ITRF"


def test_several_satellites_need_a_name(put):
    rows = [ROWS[0], line("P", "G 1", 1.0, 2.0, 3.0), *ROWS[1:4], line("P", "G 1", 4.0, 5.0, 6.0), *ROWS[4:]]
    path = put(sp3(rows, satellites=("G 1", "L47")))
    assert read_sp3(path, "G01").r.tolist() == [[1e3, 2e3, 3e3], [4e3, 5e3, 6e3]]
    assert read_sp3(path, "G01").v is None
    assert read_sp3(path, "L47").r[0, 0] == -6816123.456
    with pytest.raises(InputError, match=r"orbit.sp3: holds 2 satellites, name one of G01, L47"):
        read_sp3(path)
    with pytest.raises(InputError, match=r'holds no satellite "L48", name one of G01, L47'):
        read_sp3(path, "L48")


@pytest.mark.parametrize("absent", [(0.0, 0.0, 0.0), (999999.999999,) * 3, (1.0, 2.0, 999999.999999)])
def test_missing_positions_are_left_out_aloud(put, absent):
    table = read_sp3(
        put(sp3([*ROWS, epoch(59.0), line("P", "L47", *absent), line("V", "L47", 1.0, 2.0, 3.0)]))
    )
    assert len(table.t_ns) == 2
    assert table.v is not None
    assert table.v[1, 0] == 1.1
    assert any("1 epochs of L47 have no position" in notice for notice in table.notices)


def test_one_missing_velocity_takes_all_aloud(put):
    table = read_sp3(put(sp3([*ROWS, epoch(59.0), line("P", "L47", 1.0, 2.0, 3.0)])))
    assert len(table.t_ns) == 3
    assert table.v is None
    assert any("1 of 3 epochs lack them" in notice for notice in table.notices)


def test_predicted_and_manoeuvre_flags_are_said(put):
    rows = [ROWS[0], line("P", "L47", 1.0, 2.0, 3.0, "P"), ROWS[3], line("P", "L47", 1.0, 2.0, 3.0, "M ")]
    notices = read_sp3(put(sp3(rows))).notices
    assert [notice.split(": ")[1] for notice in notices] == [
        "1 epochs of L47 are predicted",
        "1 epochs of L47 are marked as manoeuvre",
    ]


BAD = {
    "another format": ("time,x_m\n1,2\n", 'line 1: found "time,x_m", wanted an SP3 header'),
    "version e": (sp3(version="e"), "line 1: this is SP3-e, wanted SP3-a, -b, -c or -d"),
    "undefined frame": (sp3(frame="UNDEF"), 'the coordinate system is "UNDEF"'),
    "no frame": (sp3(frame=""), 'the coordinate system is ""'),
    "GLONASS time": (sp3(scale="GLO"), 'line 5: the time system is "GLO", wanted one of GPS, UTC, TAI'),
    "no time system": (sp3().replace("%c", "/*"), "found no %c line"),
    "no satellite": (sp3(satellites=()), "the header lists no satellite"),
    "no EOF": (sp3(ROWS[:3], end=""), "the file breaks off, the closing EOF is missing"),
    "last line cut": (sp3(end="").rstrip("\n")[:-25], "line 15: the file breaks off"),
    "no time system in version c": (sp3(scale="ccc"), 'the time system is "ccc"'),
    "seven words": (
        sp3(["*  2000  1  1 12  0  1 30.5", *ROWS[1:]]),
        "line 10: found .*wanted . year month day",
    ),
    "second below zero": (
        sp3(["*  2000  1  1 12  0 -0.50000000", *ROWS[1:]]),
        "line 10: found .*wanted . year",
    ),
    "hour 25": (sp3(["*  2000  1  1 25  0  0.00000000", *ROWS[1:]]), "line 10: found .*wanted hours to 24"),
    "field shifted": (
        sp3([ROWS[0], ROWS[1].replace("L47", "L47 ")]),
        "line 11: found .*three numbers in fields",
    ),
    "underscore": (
        sp3([ROWS[0], ROWS[1].replace("12.500000", "1_2.50000")]),
        "line 11: found .*three numbers",
    ),
    "other digits": (sp3([ROWS[0], ROWS[1].replace("12.5", "1\u0662.5")]), "line 11: found .*three numbers"),
    "no records": (sp3([]), "satellite L47 has no position at any epoch"),
    "not a number": (
        sp3([*ROWS[:1], ROWS[1].replace("12.500000", "12.50000x")]),
        "line 11: found .*three numbers",
    ),
    "nan": (sp3([*ROWS[:1], ROWS[1].replace("12.500000", "      nan")]), "line 11: found .*three numbers"),
    "short": (sp3([ROWS[0], ROWS[1][:30]]), "line 11: found .*three numbers"),
    "epoch": (sp3(["*  2000  1  1 12  0"]), "line 10: found .*wanted . year month"),
    "no such day": (sp3([ROWS[0].replace("1  1 12", "2 30 12"), ROWS[1]]), "line 11: found '2000-02-30T"),
    "repeated": (sp3(ROWS[:3] * 2), "line 14: epoch .* is not later than the one before"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files(put, case):
    text, message = BAD[case]
    with pytest.raises(InputError, match=message) as caught:
        read_sp3(put(text))
    assert "orbit.sp3" in str(caught.value)


def test_a_circular_orbit_moves_as_its_velocities_say(put):
    """Positions and velocities of one motion: their units must be those of each other."""
    rate, radius = 0.001, 7000.0
    rows = []
    for second in range(0, 50, 10):
        angle = rate * second
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        rows += [
            epoch(second),
            line("P", "L47", x, y, 0.0),
            line("V", "L47", -rate * y * 1e4, rate * x * 1e4, 0.0),  # km/s in dm/s
        ]
    table = read_sp3(put(sp3(rows)))
    assert table.v is not None
    moved = (table.r[2:] - table.r[:-2]) / 20.0
    np.testing.assert_allclose(moved, table.v[1:-1], atol=0.2)


@pytest.mark.parametrize("frame", ["ECF", "ECEF"])
def test_a_frame_that_only_turns_with_the_earth_is_itrf_and_said(put, frame):
    table = read_sp3(put(sp3(frame=frame)), frame="GCRF")
    assert table.frame == "ITRF"
    says = f'line 1: the coordinate system is "{frame}", which turns with the Earth: taken for ITRF'
    assert [notice.partition(", ")[2] for notice in table.notices] == [says]


@pytest.mark.parametrize("word", ["UNDEF", "", "ABCDE"])
@pytest.mark.parametrize("stated", ["ITRF", "GCRF"])
def test_the_campaigns_frame_decides_where_the_file_says_none(put, word, stated):
    table = read_sp3(put(sp3(frame=word)), frame=stated)
    assert table.frame == stated
    assert f"{stated} is taken, as ephemeris.frame says" in table.notices[0]


def test_an_inertial_frame_is_itself(put):
    assert read_sp3(put(sp3(frame="J2000")), frame="ITRF").frame == "GCRF"


@pytest.mark.parametrize("version", ["a", "b"])
def test_the_first_versions_keep_gps_time_and_number_their_satellites(put, version):
    rows = [row.replace("L47", "  7") for row in ROWS]
    table = read_sp3(put(sp3(rows, satellites=("  7",), version=version, scale="ccc")))
    assert (table.object_name, table.time_scale, table.t_ns[0]) == ("G07", "GPS", 19 * S)
    assert table.r.tolist() == [[-6816123.456, 12500.0, -0.001], [-6810000.0, -213000.0, 5000.0]]


@pytest.mark.parametrize("scale", ["GAL", "QZS"])
def test_time_systems_that_keep_gps_time(put, scale):
    assert read_sp3(put(sp3(scale=scale))).time_scale == "GPS"


@pytest.mark.parametrize(
    ("written", "seconds"),
    [
        ("2000  1  1 12 10 60.00000000", 660.0),
        ("2000  1  1 12 60  0.00000000", 3600.0),
        ("2000  1  1 24  0  0.00000000", 43200.0),
        ("2000  1  1 23 60  0.00000000", 43200.0),
        ("2000  1  1 23 59 60.00000000", 43200.0),
    ],
)
def test_full_minutes_hours_and_days_of_the_one_before(put, written, seconds):
    table = read_sp3(put(sp3([*ROWS[:3], f"*  {written}", *ROWS[4:]])))
    assert table.t_ns[1] - table.t_ns[0] == round(seconds * S)


def test_a_leap_second_is_one(put):
    rows = [row.replace("2000  1  1 12  0", "2016 12 31 23 59") for row in ROWS]
    rows[3] = "*  2016 12 31 23 59 60.50000000"
    table = read_sp3(put(sp3(rows, scale="UTC")))
    assert table.t_ns[1] - table.t_ns[0] == 60 * S + S // 2
    rows[3] = "*  2016 12 30 23 59 60.50000000"
    rows[0] = "*  2016 12 30 23 59  0.00000000"  # on another day it is half a second of the next
    assert np.diff(read_sp3(put(sp3(rows, scale="UTC"))).t_ns) == 60 * S + S // 2


def test_a_closing_line_may_lack_behind_the_epochs_that_the_header_announces(put):
    table = read_sp3(put(sp3(end="").rstrip("\n") + "\n"))
    assert len(table.t_ns) == 2
    assert any("the closing EOF is missing" in notice for notice in table.notices)


JASON_2 = """\
#cV2008  8 30 21  0  0.00000000       4 DORIS ITR05 FIT  LCA
## 1494 594000.00000000    60.00000000 54708 0.8750000000000
+    1   L27  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
++         0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
%c L  cc TAI ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
*  2008  8 30 21  0  0.00000000
PL27   4568.999996  -1248.011684  -6092.098073 999999.999999
VL27   5265.229178   3131.587619   3304.883158 999999.999999
*  2008  8 30 21  1  0.00000000
PL27   4878.501723  -1059.644822  -5884.398993 999999.999999
VL27   5048.845983   3146.004870   3616.627407 999999.999999
*  2008  8 30 21  2  0.00000000
PL27   5174.549706   -870.646484  -5658.327478 999999.999999
VL27   4816.874073   3152.653548   3917.138048 999999.999999
*  2008  8 30 21  3  0.00000000
PL27   5456.227658   -681.479589  -5414.585933 999999.999999
VL27   4569.956049   3151.642997   4205.474629 999999.999999
EOF
"""
"""The first minutes of Jason-2 by the analysis centre LCA (grgja203.b08243.e08247), whose velocities are m/s."""
SPOT_5 = """\
#cV2010  6 19 23 56  0.00000000       4 ORBIT ITRF  FIT CNES
## 1588 604560.00000000    60.00000000 55366 0.9972222222222
+    1   L94  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
++
%c L  cc TAI ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
*  2010  6 19 23 56  0.00000000
PL94  -4725.967326   1019.808587   5332.755907 999999.999999
VL94 -48262.822364  31238.402030 -48626.052415 999999.999999
*  2010  6 19 23 57  0.00000000
PL94  -5005.518622   1206.410004   5030.927264 999999.999999
VL94 -44891.634855  30937.332391 -51951.309383 999999.999999
*  2010  6 19 23 58  0.00000000
PL94  -5264.329598   1390.759516   4709.739082 999999.999999
VL94 -41351.796570  30487.754840 -55077.147471 999999.999999
*  2010  6 19 23 59  0.00000000
PL94  -5501.432454   1571.966563   4370.424626 999999.999999
VL94 -37658.115481  29889.949931 -57991.446327 999999.999999
EOF
"""
"""The first minutes of SPOT 5 by the analysis centre SSA (ssasp501.b10170.e10181), by the standard."""
LAGEOS_2 = """\
#cV2016  3 13  0  0  0.00000000       3   SLR ITRF97 FIT JCET
## 1888      0.00000000   120.00000000 57460 0.0000000000000
+   1    L52  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
++         0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
%c L  cc UTC ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
%/* ilrsb.orb.lageos2.160319.v35.sp3 Reference TRF: SLRF2008
* 2016  3 13  0 58  0.00000000
PL52   8024.680213  -2846.742884   8612.805540
VL52  -4454.711774  47629.536968  20940.752925
* 2016  3 13  0 60  0.00000000
PL52   7963.644771  -2270.494153   8850.056481
VL52  -5712.153021  48390.122332  18591.331435
* 2016  3 13  1  2  0.00000000
PL52   7887.728731  -1685.907400   9058.779676
VL52  -6934.553324  49018.858518  16187.459795
"""
"""LAGEOS-2 around one o'clock by the centre ILRSB (ilrsb.orb.lageos2.160319.v35), with minute 60."""


@pytest.mark.parametrize(("text", "used"), [(JASON_2, False), (SPOT_5, True), (LAGEOS_2, True)])
def test_velocities_of_real_orbits_are_used_where_they_are_those_of_the_positions(put, text, used):
    form = recognised(put(text), ORBITS)
    assert form is not None
    table = form.read(put(text), Asked(frame="ITRF"))
    assert (table.v is not None) == used
    said = [notice for notice in table.notices if "the velocities are not used" in notice]
    assert len(said) == (not used)
    assert all("they are 0.1 times that motion: another unit?" in notice for notice in said)
    step = np.diff(table.t_ns)
    assert np.all(step == step[0])


def test_cases_that_centres_write(shared_cases):
    right = read_sp3(shared_cases / "sp3" / "min60.sp3")
    assert np.all(np.diff(right.t_ns) == 60 * S)
    ecf = read_sp3(shared_cases / "sp3" / "ecf.sp3")
    np.testing.assert_array_equal(ecf.r, right.r)
    assert ecf.frame == "ITRF"
    for name in ("sp3-seven-words.sp3", "sp3-second-minus-half.sp3"):
        with pytest.raises(InputError, match=rf"{name}, line 1\d: found"):
            read_sp3(shared_cases / "files" / name)
