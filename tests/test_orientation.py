"""Earth orientation against ERFA, assembled here on its own, and tables a user may get wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import erfa
import numpy as np
import pytest
from astropy_iers_data import IERS_A_FILE
from scipy.interpolate import lagrange

from starplumb.physics import orientation as module
from starplumb.physics.earth import OMEGA_EARTH
from starplumb.physics.errors import EpochError, InputError
from starplumb.physics.orientation import C_IF, EarthOrientation, FrameOfDate
from starplumb.physics.timescales import format_iso, parse, tt_julian, utc_minus_tai

MAS = erfa.DAS2R / 1000
SECOND = 1_000_000_000
DAY = 86_400 * SECOND
Edit = Callable[[list[str]], None]


@pytest.fixture(scope="module")
def orientation() -> EarthOrientation:
    return EarthOrientation.load()


@pytest.fixture(scope="module")
def lines() -> list[str]:
    return Path(IERS_A_FILE).read_text(encoding="ascii").splitlines()


def epochs(rng: np.random.Generator, n: int) -> np.ndarray:
    start, stop = parse(["2016-01-01T00:00:00", "2026-09-01T00:00:00"], "UTC")
    return rng.integers(start, stop, n)


def angle_mas(C: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Angle of C D^T; its skew part, since the arc cosine cannot see 1e-11 rad."""
    R = C @ D.mT
    skew = np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1
    )
    return np.linalg.norm(skew, axis=-1) / 2 / MAS


def rotation(axis: int, angle: float) -> np.ndarray:
    """R_axis of the IERS Conventions: turns the frame by ``angle``."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = s, -s
    return R


def by_the_book(t_ns: int, lines: list[str]) -> np.ndarray:
    """Equations 5.1 to 5.15 of the IERS Conventions, one epoch, table cells read and interpolated here."""
    text = format_iso(t_ns, "UTC", 9)[0]
    date, clock = text.split("T")
    fields = (*map(int, date.split("-")), *map(int, clock.split(":")[:2]), float(clock.split(":")[2]))
    utc = erfa.dtf2d("UTC", *fields)
    tai = erfa.utctai(*utc)
    tt = erfa.taitt(*tai)
    mjd = (utc[0] - erfa.DJM0) + utc[1]
    first = int(mjd) - int(float(lines[0][7:15])) - 1
    rows = lines[first : first + 4]
    leap = [erfa.dat(int(f"20{r[:2]}"), int(r[2:4]), int(r[4:6]), 0.0) for r in rows]

    def cell(start: int, stop: int) -> np.ndarray:
        return np.array([float(row[start - 1 : stop]) for row in rows])

    def at_epoch(values: np.ndarray) -> float:
        return float(lagrange(np.arange(-1.0, 3.0), values)(mjd % 1))

    ut1 = erfa.taiut1(*tai, at_epoch(cell(59, 68) - leap))
    x_pole, y_pole = at_epoch(cell(19, 27)) * erfa.DAS2R, at_epoch(cell(38, 46)) * erfa.DAS2R
    X, Y, s = erfa.xys06a(*tt)
    X, Y = X + at_epoch(cell(98, 106)) * MAS, Y + at_epoch(cell(117, 125)) * MAS
    a = 1 / (1 + np.sqrt(1 - X * X - Y * Y))
    Q = np.array(
        [[1 - a * X * X, -a * X * Y, X], [-a * X * Y, 1 - a * Y * Y, Y], [-X, -Y, 1 - a * (X * X + Y * Y)]]
    )
    W = rotation(2, -erfa.sp00(*tt)) @ rotation(1, x_pole) @ rotation(0, y_pole)
    return Q @ rotation(2, s) @ rotation(2, -erfa.era00(*ut1)) @ W


@pytest.mark.slow
def test_agrees_with_the_conventions_at_random_epochs(
    orientation: EarthOrientation, lines: list[str], rng: np.random.Generator
) -> None:
    t_ns = epochs(rng, 300)
    expected = np.stack([by_the_book(t, lines) for t in t_ns])
    assert angle_mas(orientation.C_IJ(t_ns), expected).max() < 0.002  # s' alone is 0.01


def test_agrees_with_erfa_c2t06a_without_pole_offsets(
    orientation: EarthOrientation, rng: np.random.Generator
) -> None:
    t_ns = np.sort(epochs(rng, 200))
    x, y, ut1_minus_tai = (np.interp(t_ns, orientation.t_ns, orientation.values[:, k]) for k in range(3))
    smooth = replace(
        orientation,
        t_ns=t_ns,
        values=np.stack([x, y, ut1_minus_tai, 0 * x, 0 * x], axis=-1),
        is_predicted=np.zeros(200, dtype=bool),
    )
    tai = (np.full(200, erfa.DJ00), t_ns / DAY)
    C_JI = erfa.c2t06a(*erfa.taitt(*tai), *erfa.taiut1(*tai, ut1_minus_tai), x, y)
    assert angle_mas(smooth.C_IJ(t_ns), np.swapaxes(C_JI, -1, -2)).max() < 0.02


def test_a_matrix_takes_the_greenwich_meridian_to_its_right_ascension(orientation: EarthOrientation) -> None:
    """Mean sidereal time by the almanac's short formula, less precession since J2000 (nutation: 1e-4)."""
    t_ns = parse(["2017-08-02T16:00:00"], "UTC")[0]
    days = 2457968 - 2451545 + 4 / 24  # since 2000-01-01 12:00 UT
    sidereal = np.radians((280.46062 + 360.98564737 * days) % 360)
    x_I = orientation.C_IJ(t_ns)[:, 0]
    precession = np.radians(4612.16 / 3600 * days / 36525)  # in right ascension at the equator
    assert np.arctan2(x_I[1], x_I[0]) % (2 * np.pi) == pytest.approx(sidereal - precession, abs=2e-4)


def test_the_earth_turns_on_through_a_leap_second(orientation: EarthOrientation) -> None:
    start = parse(["2016-12-31T23:59:58"], "UTC")[0]
    C = orientation.C_IJ(start + np.arange(0, 5 * SECOND, SECOND // 4))
    turned = angle_mas(C[1:], C[:-1]) * MAS
    np.testing.assert_allclose(turned, OMEGA_EARTH / 4, rtol=1e-7)


def test_ut1_has_no_jump_at_leap_seconds(orientation: EarthOrientation) -> None:
    assert np.abs(np.diff(orientation.values[:, 2])).max() < 0.006  # seconds a day
    row = int(np.searchsorted(orientation.t_ns, parse(["2017-01-01T00:00:00"], "UTC")[0]))
    ut1_minus_utc = orientation.values[row - 1 : row + 1, 2] - utc_minus_tai(
        orientation.t_ns[row - 1 : row + 1]
    )
    np.testing.assert_allclose(ut1_minus_utc, [-0.4078, 0.5913], atol=1e-4)  # IERS, January 2017


def test_any_shape_and_each_epoch_alone(orientation: EarthOrientation, rng: np.random.Generator) -> None:
    t_ns = epochs(rng, 12).reshape(3, 4)
    C = orientation.C_IJ(t_ns)
    assert C.shape == (3, 4, 3, 3)
    one = orientation.C_IJ(t_ns[1, 2])
    assert one.shape == (3, 3)
    np.testing.assert_array_equal(C[1, 2], one)
    assert orientation.C_IJ(np.empty((0,), dtype=np.int64)).shape == (0, 3, 3)
    np.testing.assert_allclose(C @ C.mT, np.broadcast_to(np.eye(3), C.shape), atol=2e-15)
    np.testing.assert_allclose(np.linalg.det(C), 1.0, atol=2e-15)


def test_a_dense_day_has_no_steps_between_nodes(orientation: EarthOrientation) -> None:
    t_ns = parse(["2020-03-04T00:00:00"], "UTC")[0] + np.arange(0, 2 * DAY, 30 * SECOND)
    pole_I = orientation.C_IJ(t_ns)[..., 2]
    assert np.abs(np.diff(pole_I, n=2, axis=0)).max() < 0.02 * MAS


def test_predictions_and_the_source_are_told(orientation: EarthOrientation, lines: list[str]) -> None:
    first = next(line for line in lines if "P" in (line[16], line[57]))
    date = f"20{first[:2]}-{int(first[2:4]):02d}-{int(first[4:6]):02d}"
    midnight = parse([f"{date}T00:00:00"], "UTC")[0]
    offsets = np.array([[-2 * DAY, -DAY - 1], [-DAY, 5]])
    np.testing.assert_array_equal(orientation.predicted(midnight + offsets), [[False, False], [True, True]])
    assert orientation.source.startswith("finals2000A.all, 1973-01-02 to ")
    assert orientation.source.endswith(f", predicted from {date}")


def test_an_epoch_outside_is_named(orientation: EarthOrientation) -> None:
    last = orientation.t_ns[-1]
    assert orientation.C_IJ(orientation.t_ns[[0, -1]]).shape == (2, 3, 3)
    for ask in (orientation.C_IJ, orientation.predicted):
        with pytest.raises(
            EpochError, match=r"TAI, wanted an epoch within the table of Earth orientation \(finals"
        ) as caught:
            ask(np.array([0, last, last + 1, 0]))
        assert caught.value.row == 2
    with pytest.raises(EpochError, match="1973-01-02T00:00:12 TAI"):
        orientation.C_IJ(orientation.t_ns[0] - 1)  # 0h UTC is 00:00:12 TAI


def write(folder: Path, lines: list[str], ending: str = "\n") -> Path:
    path = folder / "mine.all"
    path.write_bytes(ending.join([*lines, ""]).encode("latin-1"))
    return path


def test_a_user_table_of_a_few_days_serves(
    tmp_path: Path, orientation: EarthOrientation, lines: list[str], rng: np.random.Generator
) -> None:
    """Trailing blanks cut, CRLF, as editors leave them."""
    mine = EarthOrientation.load(write(tmp_path, [line.rstrip() for line in lines[16000:16010]], "\r\n"))
    assert mine.source == "mine.all, 2016-10-23 to 2016-11-01"
    inner = rng.integers(mine.t_ns[1], mine.t_ns[-2], 50)
    np.testing.assert_array_equal(mine.C_IJ(inner), orientation.C_IJ(inner))
    edge = np.array([mine.t_ns[0] + DAY // 2, mine.t_ns[-1] - DAY // 2])
    assert angle_mas(mine.C_IJ(edge), orientation.C_IJ(edge)).max() < 1.0


def put(row: int, column: int, text: str) -> Edit:
    def edit(lines: list[str]) -> None:
        lines[row] = lines[row][: column - 1] + text + lines[row][column - 1 + len(text) :]

    return edit


def drop(row: int) -> Edit:
    return lambda lines: lines.__delitem__(row)


def cut(row: int, columns: int) -> Edit:
    return lambda lines: lines.__setitem__(row, lines[row][:columns])


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (put(3, 19, " 0.12x456"), "mine.all, line 4: polar motion x in columns 19 to 27 is ' 0.12x456'"),
        (put(3, 38, " " * 9), "line 4: polar motion y in columns 38 to 46 is '         '"),
        (put(5, 59, "       nan"), "line 6: UT1-UTC in columns 59 to 68 is '       nan'"),
        (put(5, 59, "-1.5000000"), "line 6: UT1-UTC .* wanted a number up to 1 "),
        (put(2, 98, "  -92.123"), "line 3: dX .* wanted a number up to 10 as in a finals2000A table"),
        (put(2, 8, "abcdefgh"), "line 3: MJD in columns 8 to 15 is 'abcdefgh'"),
        (put(2, 17, "B"), "line 3: the flag of polar motion in column 17 is 'B', wanted I"),
        (put(2, 58, " "), "line 3: the flag of UT1-UTC in column 58 is ' '"),
        (drop(4), "line 5: MJD .* follows .*, wanted every day once"),
        (cut(9, 64), "line 10: UT1-UTC in columns 59 to 68 is '.*  '"),
        (lambda lines: lines.clear(), "found no line with UT1-UTC"),
        (lambda lines: lines.__delitem__(slice(3, None)), "found 3 usable days, wanted at least 4"),
        (lambda lines: lines.__setitem__(slice(None), ["time,x,y" + "," * 80] * 5), "line 1: MJD"),
    ],
)
def test_a_malformed_table_is_named_with_its_line(
    tmp_path: Path, lines: list[str], edit: Edit, message: str
) -> None:
    mine = lines[16000:16010]
    edit(mine)
    with pytest.raises(InputError, match=message):
        EarthOrientation.load(write(tmp_path, mine))


def test_an_unreadable_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.all: cannot be read \(No such file"):
        EarthOrientation.load(tmp_path / "absent.all")
    with pytest.raises(InputError, match="cannot be read"):
        EarthOrientation.load(tmp_path)


def test_far_predictions_lack_pole_offsets_and_take_zero(
    orientation: EarthOrientation, lines: list[str]
) -> None:
    blank = [i for i, line in enumerate(lines[: len(orientation.t_ns)]) if not line[97:125].strip()]
    assert blank
    np.testing.assert_array_equal(orientation.values[blank, 3:], 0.0)
    given = np.abs(orientation.values[: blank[0], 3:]).max() / MAS
    assert 0.1 < given < 10.0


# Inertial frames of date ------------------------------------------------------------------------------------------

VALLADO = "2004-04-06T07:51:28.386009"
"""UTC of the example in D. A. Vallado, Fundamentals of Astrodynamics and Applications, 4th ed., example 3-15, and in
AIAA 2006-6753, appendix C; positions in km."""
PUBLISHED = {
    "ITRF": np.array([-1033.4793830, 7901.2952754, 6380.3565958]),
    "TEME": np.array([5094.18016210, 6127.64465950, 6380.34453270]),
    "TOD": np.array([5094.51620300, 6127.36527840, 6380.34453270]),
    "MOD": np.array([5094.02837450, 6127.87081640, 6380.24851640]),
    "GCRF": np.array([5102.508958, 6123.011401, 6378.136928]),
}


def test_teme_is_that_of_the_published_example(orientation: EarthOrientation) -> None:
    """In GCRF to 2 cm; in ITRF to the 0.3 m by which the pole of the packaged table differs from the example's."""
    t = parse([VALLADO], "UTC")
    C_JF = orientation.C_IJ(t).mT @ C_IF("TEME", t)
    assert 1e3 * (C_JF[0] @ PUBLISHED["TEME"]) == pytest.approx(1e3 * PUBLISHED["ITRF"], abs=0.5)
    assert 1e3 * (C_IF("TEME", t)[0] @ PUBLISHED["TEME"]) == pytest.approx(1e3 * PUBLISHED["GCRF"], abs=0.02)


@pytest.mark.parametrize(("frame", "metres"), [("TOD", 2.2), ("MOD", 1.1)])
def test_frames_of_date_are_those_of_the_published_example(frame: FrameOfDate, metres: float) -> None:
    """The example has the models IAU 1976 and 1980 without their corrections, 52 and 27 mas: 2 and 1 m."""
    t = parse([VALLADO], "UTC")
    assert 1e3 * np.linalg.norm(C_IF(frame, t)[0] @ PUBLISHED[frame] - PUBLISHED["GCRF"]) < metres


def test_teme_is_turned_into_the_earth_by_the_sidereal_time_of_1982(
    orientation: EarthOrientation, rng: np.random.Generator
) -> None:
    """``r_PEF = R3(GMST82) r_TEME`` with UT1 of the table and the polar motion of ERFA's own chain."""
    for t_ns in epochs(rng, 20):
        x, y, ut1 = orientation._values_at(np.array([t_ns]))[0, :3]
        tt_day, tt_rest = tt_julian(np.array([t_ns]))
        ut1_rest = tt_rest + (ut1 - erfa.TTMTAI) / erfa.DAYSEC
        turned = rotation(2, float(erfa.gmst82(tt_day, ut1_rest)[0]))
        polar = erfa.pom00(x, y, erfa.sp00(tt_day, tt_rest))[0]
        C_JF = (orientation.C_IJ(np.array([t_ns])).mT @ C_IF("TEME", np.array([t_ns])))[0]
        assert angle_mas(C_JF, polar @ turned) < 1.0  # the pole's offsets dX, dY are not part of TEME


def test_frames_of_date_differ_by_precession_and_nutation(rng: np.random.Generator) -> None:
    """Matrices of the older models, IAU 1976 and 1980: the same to a tenth of an arcsecond."""
    t = epochs(rng, 50)
    day, rest = tt_julian(t)
    bias = erfa.bp06(day, rest)[0]
    precession = erfa.pmat76(day, rest)
    assert np.all(angle_mas(C_IF("MOD", t).mT, precession @ bias) < 100)
    nutation = erfa.nutm80(day, rest)
    assert np.all(angle_mas(C_IF("TOD", t).mT, nutation @ precession @ bias) < 200)
    equinox = erfa.eqeq94(day, rest)
    teme = np.stack([rotation(2, float(angle)) for angle in equinox]) @ C_IF("TOD", t).mT
    assert np.all(angle_mas(C_IF("TEME", t).mT, teme) < 200)


def test_a_table_is_parsed_once_until_its_file_changes(tmp_path, monkeypatch):
    lines = Path(IERS_A_FILE).read_bytes().splitlines(keepends=True)
    path, parsed = tmp_path / "finals.all", []
    read = module._read_finals
    monkeypatch.setattr(module, "_read_finals", lambda path: parsed.append(path) or read(path))
    path.write_bytes(b"".join(lines[16000:16020]))
    first = EarthOrientation.load(path)
    assert EarthOrientation.load(path) is first
    assert len(parsed) == 1
    path.write_bytes(b"".join(lines[16000:16025]))
    assert EarthOrientation.load(path).t_ns.size == first.t_ns.size + 5
    with pytest.raises(ValueError, match="read-only"):
        first.values[0, 0] = 1.0
