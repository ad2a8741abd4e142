"""SP3 orbits: a low orbiter's file with its columns written out by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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
    with pytest.raises(InputError, match=r"holds no satellite 'L48', name one of G01, L47"):
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
    "another format": ("time,x_m\n1,2\n", "line 1: found 'time,x_m', wanted an SP3 header"),
    "version a": (sp3(version="a"), "line 1: this is SP3-a, wanted SP3-c or SP3-d"),
    "inertial": (sp3(frame="J2000"), "line 1: the coordinate system is 'J2000', wanted an Earth-fixed"),
    "undefined frame": (sp3(frame="UNDEF"), "the coordinate system is 'UNDEF'"),
    "no frame": (sp3(frame=""), "the coordinate system is ''"),
    "GLONASS time": (sp3(scale="GLO"), "line 5: the time system is 'GLO', wanted one of GPS, UTC, TAI"),
    "no time system": (sp3().replace("%c", "/*"), "found no %c line"),
    "no satellite": (sp3(satellites=()), "the header lists no satellite"),
    "no EOF": (sp3(end=""), "the closing EOF is missing"),
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
