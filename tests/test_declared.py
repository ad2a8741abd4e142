"""Tables as they come: a user's own columns, rows, units and times, declared in campaign.toml."""

from __future__ import annotations

import csv
from datetime import datetime, timedelta
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

import starplumb as sp
from helpers import CAMPAIGN, FILES, write_good_campaign
from starplumb.io.campaign.read import LoadedCampaign, load_campaign
from starplumb.io.tables.declared import Times
from starplumb.physics.errors import EpochError, InputError
from starplumb.physics.timescales import parse

INSTANT = "2026-03-20T09:58:56.250000001"
UTC = datetime(2026, 3, 20, 9, 58, 56)
PART = Decimal("0.250000001")
LEAP = 18
"""GPS is so many seconds ahead of UTC in 2026."""


def since(start: datetime, ahead: int = 0) -> Decimal:
    """Seconds from a date to the instant, on a clock so many seconds ahead of UTC."""
    return Decimal(int((UTC + timedelta(seconds=ahead) - start).total_seconds())) + PART


GPS = since(datetime(1980, 1, 6), LEAP)
JD = Decimal(2440587) + Decimal("0.5") + since(datetime(1970, 1, 1)) / 86400
"""JD 2440587.5 is 1970-01-01."""
FORMATS = {
    "iso": (Times(("t",)), [INSTANT]),
    "zulu": (Times(("t",)), [INSTANT + "Z"]),
    "doy": (Times(("t",), "doy"), ["2026-079T09:58:56.250000001"]),
    "unix": (Times(("t",), "unix"), [str(since(datetime(1970, 1, 1)))]),
    "unix with an exponent": (Times(("t",), "unix"), ["1.774000736250000001E9"]),
    "unix_ms": (Times(("t",), "unix_ms"), [str(1000 * since(datetime(1970, 1, 1)))]),
    "gps_seconds": (Times(("t",), "gps_seconds"), [str(GPS)]),
    "gps_week": (Times(("w", "s"), "gps_week"), [str(GPS // 604800), str(GPS % 604800)]),
    "jd": (Times(("t",), "jd"), [str(JD)]),
    "mjd": (Times(("t",), "mjd"), [str(JD - Decimal("2400000.5"))]),
    "seconds_since": (
        Times(("t",), "seconds_since", None, "2026-03-20T00:00:00"),
        [str(since(datetime(2026, 3, 20)))],
    ),
    "seconds_since in GPS": (
        Times(("t",), "seconds_since", "GPS", "2026-03-20T00:00:00"),
        [str(since(datetime(2026, 3, 20), LEAP))],
    ),
    "GPS clock counted as Unix does": (
        Times(("t",), "unix", "GPS"),
        [str(since(datetime(1970, 1, 1), LEAP))],
    ),
}


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("scale", ["UTC", "GPS"])
def test_every_format_says_the_same_instant(name, scale):
    """Formats with a scale of their own do not ask for the campaign's."""
    times, cells = FORMATS[name]
    if (
        scale == "GPS"
        and times.format in ("iso", "doy", "jd", "mjd", "seconds_since")
        and times.scale is None
    ):
        return
    found = times.epochs([[cell] for cell in cells], scale)
    assert abs(int(found[0] - parse([INSTANT], "UTC")[0])) <= (1 if "jd" in name else 0)


def test_leap_seconds_are_not_counted():
    """The last second of 2016 and the first of 2017 have one count between them, and two seconds."""
    unix = Times(("t",), "unix")
    before, after = unix.epochs([["1483228799", "1483228800"]], "UTC")
    assert after - before == 2 * 10**9
    assert after == parse(["2017-01-01T00:00:00"], "UTC")[0]


@pytest.mark.parametrize("cell", ["", "nan", "inf", "1_000", "12:00", "1e30", "\u0661"])
def test_what_is_no_count_is_refused_with_its_row(cell):
    with pytest.raises(EpochError) as refused:
        Times(("t",), "unix").epochs([["0", cell]], "UTC")
    assert refused.value.row == 1


# A campaign ----------------------------------------------------------------------------------------------------

START = 1_577_836_800
"""2020-01-01 as Unix time."""
DECLARED = {
    'file = "attitude.csv"': """file = "attitude.csv"
columns = { qw = "q_s", qx = "q_1", qy = "q_2", qz = "q_3" }
time = { column = "unix_time", format = "unix" }
keep = { mode = ["FINE", "HOLD"], valid = 1 }""",
    'file = "ephemeris.csv"': """file = "ephemeris.csv"
columns = { x_m = "X", y_m = "Y", z_m = "Z", vx_m_s = "VX", vy_m_s = "VY", vz_m_s = "VZ" }
units = { position = "km", velocity = "km/s" }
time = { columns = ["week", "sow"], format = "gps_week" }""",
    'file = "landmarks.csv"': 'file = "landmarks.csv"\ncolumns = { landmark_id = "name", height_m = "h" }',
    'file = "images.csv"': 'file = "images.csv"\ncolumns = { time = "epoch" }',
    'file = "observations.csv"': """file = "observations.csv"
columns = { column_px = "u", row_px = "v" }
keep = { quality = "good" }""",
}


def rows_of(name: str) -> tuple[list[str], list[list[str]]]:
    header, *rows = csv.reader(FILES[name].splitlines())
    return header, rows


def telemetry(folder: Path, **changes: str) -> Path:
    """The good campaign with columns, units, times and rows of somebody else."""
    toml = CAMPAIGN
    for old, new in DECLARED.items():
        toml = toml.replace(old, new)
    for old, new in changes.items():
        toml = toml.replace(old, new)
    files = {}
    _, rows = rows_of("attitude.csv")
    lines = ["mode,valid,q_s,q_1,q_2,q_3,unix_time", "IDLE,1,oops,,,,", "FINE,0,9,9,9,9,9"]
    for mode, (time, x, y, z, w) in zip(("FINE", " HOLD", "FINE"), rows, strict=True):
        lines.append(f"{mode},1.0,{w},{x},{y},{z},{START + float(time[-6:]):.3f}")
        lines.append("IDLE,1,broken")
    files["attitude"] = "\n".join(lines)
    _, rows = rows_of("ephemeris.csv")
    lines = ["week,sow,X,Y,Z,VX,VY,VZ"]
    for time, *state in rows:
        gps = START - 315964800 + 18 + float(time[-6:])
        km = [repr(float(value) / 1e3) for value in state]
        lines.append(",".join([str(int(gps // 604800)), f"{gps % 604800:.3f}", *km]))
    files["ephemeris"] = "\n".join(lines)
    files["landmarks"] = FILES["landmarks.csv"].replace("landmark_id", "name").replace("height_m", "h")
    files["images"] = FILES["images.csv"].replace("time", "epoch")
    _, rows = rows_of("observations.csv")
    lines = ["image_id,landmark_id,u,v,sigma_px,quality", "I9,L9,x,y,z,bad"]
    lines += [",".join([*row, "good"]) for row in rows]
    files["observations"] = "\n".join(lines)
    return write_good_campaign(folder, campaign=toml, **files)


def assert_the_same(found: LoadedCampaign, plain: LoadedCampaign) -> None:
    a, b = found.campaign, plain.campaign
    for x, y in (
        (a.attitude.t_ns, b.attitude.t_ns),
        (a.attitude.q_EF, b.attitude.q_EF),
        (a.ephemeris.t_ns, b.ephemeris.t_ns),
        (a.images.t_ns, b.images.t_ns),
        (a.landmarks.r_J, b.landmarks.r_J),
        (a.sightings.column_px, b.sightings.column_px),
        (a.sightings.landmark, b.sightings.landmark),
    ):
        np.testing.assert_array_equal(x, y)
    np.testing.assert_allclose(a.ephemeris.r_J, b.ephemeris.r_J, rtol=1e-15)
    np.testing.assert_allclose(a.ephemeris.v_J, b.ephemeris.v_J, rtol=1e-15)


def test_a_declared_campaign_is_the_plain_one(tmp_path):
    plain = load_campaign(write_good_campaign(tmp_path / "plain"))
    found = load_campaign(telemetry(tmp_path / "own"))
    assert_the_same(found, plain)
    assert [notice.split("/")[-1] for notice in found.notices] == [
        "observations.csv: left out 1 of 6 rows by observations.keep",
        "attitude.csv: left out 5 of 8 rows by attitude.keep",
    ]


@pytest.mark.parametrize("kind", ["parquet", "feather", "frame"])
def test_so_it_is_from_parquet_arrow_and_data_frames(tmp_path, kind):
    """Numbers are numbers there, times floats, and the rows left out hold nulls."""
    pa = pytest.importorskip("pyarrow")
    from pyarrow import feather, parquet

    plain = load_campaign(write_good_campaign(tmp_path / "plain"))
    path = telemetry(tmp_path / "own")
    times, x, y, z, w = zip(*rows_of("attitude.csv")[1], strict=True)
    q = {f"q_{name}": [None, *map(float, values)] for name, values in zip("123s", (x, y, z, w), strict=True)}
    unix = [None, *(START + float(time[-6:]) for time in times)]
    table = pa.table({"mode": ["IDLE", "FINE", "HOLD", "FINE"], "valid": [1, 1, 1, 1], "unix_time": unix} | q)
    if kind == "frame":
        found = load_campaign(path, {"attitude": table})
    else:
        (parquet if kind == "parquet" else feather).__dict__[
            f"write_{'table' if kind == 'parquet' else 'feather'}"
        ](table, tmp_path / "own" / f"attitude.{kind}")
        path.write_text(path.read_text().replace("attitude.csv", f"attitude.{kind}"))
        found = load_campaign(path)
    assert_the_same(found, plain)


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("attitude.csv", "HOLD,1.0,0.5", "HOLD,1.0,half", 'attitude.csv, row 6, column q_s: found "half"'),
        (
            "attitude.csv",
            "FINE,1.0,0.5,0.5",
            "FINE,1.0,0.5,0.9",
            "attitude.csv, row 4, columns q_1, q_2, q_3, q_s",
        ),
        ("attitude.csv", "1577836802.000", "noon", 'attitude.csv, row 6, column unix_time: found "noon"'),
        ("attitude.csv", "1577836802.000", "1577836700", "attitude.csv, row 6, column unix_time: found"),
        ("attitude.csv", "HOLD", "IDLE", ""),
        ("attitude.csv", "q_s", "q_0", "found the header"),
        ("ephemeris.csv", "VY", "Vy", "wanted the column VY too"),
        ("ephemeris.csv", "7058.137", "7.058137", "ephemeris.csv, row 2, columns X, Y, Z: found 16577.61 m"),
        ("observations.csv", "good", "fair", 'found no row with quality = "good", wanted at least one'),
        ("observations.csv", "8000.3", "-3", "observations.csv, row 3, column u: found -3"),
        ("campaign.toml", "q_s", "mode_s", "wanted the column mode_s too"),
        ("campaign.toml", "qw = ", "qq = ", 'attitude.columns: found "qq", wanted time, qx, qy, qz, qw'),
        ("campaign.toml", 'format = "unix"', 'format = "unxi"', 'attitude.time.format: found "unxi", wanted'),
        (
            "campaign.toml",
            'format = "unix"',
            'format = "unix", seconds_since = "2020-01-01T00:00:00"',
            "found beside",
        ),
        (
            "campaign.toml",
            'columns = ["week", "sow"]',
            'column = "sow"',
            "ephemeris.time.columns: missing, wanted",
        ),
        (
            "campaign.toml",
            '"km/s"',
            '"knots"',
            'ephemeris.units.velocity: found "knots", wanted "m/s" or "km/s"',
        ),
        ("campaign.toml", "valid = 1", "valid = []", "attitude.keep.valid: found []"),
        ("campaign.toml", "valid = 1", "vaild = 1", 'wanted the column vaild too (did you mean "valid"?)'),
    ],
)
def test_what_is_wrong_is_said_in_the_tables_own_words(tmp_path, file, old, new, says):
    path = telemetry(tmp_path)
    text = (tmp_path / file).read_text()
    assert old in text
    (tmp_path / file).write_text(
        text.replace(old, new) if file != "attitude.csv" else text.replace(old, new, 1)
    )
    if not says:
        load_campaign(path)
        return
    with pytest.raises(InputError) as refused:
        load_campaign(path)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


# Times in ids, binned and cut images ---------------------------------------------------------------------------


def named(folder: Path, pattern: str, ids: tuple[str, str], with_table: bool) -> Path:
    """The good campaign whose images carry their times in their ids."""
    renamed = dict(zip(("I1", "I2"), ids, strict=True))
    observations, table = FILES["observations.csv"], "image_id\n" + "\n".join(ids)
    for old, new in renamed.items():
        observations = observations.replace(f"{old},", f"{new},")
    file = 'file = "images.csv"\n' if with_table else ""
    toml = CAMPAIGN.replace('file = "images.csv"\n', f'{file}time_from_id = "{pattern}"\n')
    return write_good_campaign(folder, campaign=toml, images=table, observations=observations)


IDS = ("SAT1_20200101T000001.500Z_L1A", "SAT1_20200101T000002.500Z_L1A")


@pytest.mark.parametrize("with_table", [False, True])
def test_times_are_read_out_of_ids(tmp_path, with_table):
    plain = load_campaign(write_good_campaign(tmp_path / "plain")).campaign
    found = load_campaign(named(tmp_path / "own", "SAT1_%Y%m%dT%H%M%S.%fZ_L1A", IDS, with_table)).campaign
    assert found.images.ids == IDS
    np.testing.assert_array_equal(found.images.t_ns, plain.images.t_ns)
    np.testing.assert_array_equal(found.sightings.image, plain.sightings.image)


@pytest.mark.parametrize(
    ("pattern", "ids", "says"),
    [
        (
            "SAT1_%H%M%S",
            IDS,
            'images.time_from_id: found "SAT1_%H%M%S", wanted a pattern with a whole date and time',
        ),
        ("%Y%m%dT%H%M%S%z", IDS, "images.time_from_id: found"),
        ("S_%Y%m%dT%H%M%S.%f", (IDS[0], "I2"), 'observations.csv, row 2, column image_id: found "SAT1_2020'),
        (
            "SAT1_%Y%m%dT%H%M%S.%fZ_L1A",
            (IDS[0], "I2"),
            'observations.csv, row 5, column image_id: found "I2"',
        ),
    ],
)
def test_ids_that_do_not_fit_are_named(tmp_path, pattern, ids, says):
    with pytest.raises(InputError) as refused:
        load_campaign(named(tmp_path, pattern, ids, False))
    assert says in str(refused.value)


CAMERA = CAMPAIGN[CAMPAIGN.index("[camera]") : CAMPAIGN.index("[mounting]")]


def camera_of(folder: Path, *lines: str, origin: str = "center"):
    toml = CAMPAIGN.replace("[mounting]", "\n".join([f'pixel_origin = "{origin}"', *lines, "", "[mounting]"]))
    marks = "image_id,landmark_id,column_px,row_px,sigma_px\nI1,L1,10,20,0.2\nI2,L2,10,20,0.2\n"
    return load_campaign(write_good_campaign(folder, campaign=toml, observations=marks)).campaign


@pytest.mark.parametrize("origin", ["center", "corner"])
def test_a_binned_and_cut_image_looks_where_its_full_pixels_look(tmp_path, origin):
    """Binned pixel (c, r) of the window is the middle of the full pixels 3 (c + 100) .. 3 (c + 100) + 2."""
    full = camera_of(tmp_path / "full", origin=origin).camera
    cut = camera_of(
        tmp_path / "cut", "binning = [3, 3]", "window_px = [100, 50, 700, 600]", origin=origin
    ).camera
    assert cut.size_px == (700.0, 600.0)
    ours, slope = cut.tan_from_px(10.0, 20.0)
    theirs, fine = full.tan_from_px(3 * 110.0 + 1, 3 * 70.0 + 1)
    np.testing.assert_allclose(ours, theirs, atol=1e-15)
    np.testing.assert_allclose(slope, 3 * fine, rtol=1e-14)
    binned = camera_of(tmp_path / "binned", "binning = [5, 5]", origin=origin).camera
    assert binned.size_px == (2400.0, 2400.0)


def test_look_angles_of_the_full_line_are_binned_and_cut(tmp_path):
    angles = "column_px,tan_x,tan_y\n0,-0.02,0.001\n5999,0.0,0.001\n11999,0.02,0.001\n"
    optics = CAMERA[CAMERA.index("focal") :].strip() + "\n"
    toml = CAMPAIGN.replace('model = "frame"', 'model = "line-scan"')
    images = FILES["images.csv"].replace("time\n", "time,line_period_s\n").replace("00\n", "00,0.0001\n")
    cameras = []
    for name, keys in (("full", ""), ("cut", "binning = [2, 1]\nwindow_px = [1000, 0, 3000, 1]\n")):
        text = toml.replace(optics, f'image_size_px = [12000, 1]\nlook_angles = "detectors.csv"\n{keys}')
        path = write_good_campaign(
            tmp_path / name,
            campaign=text,
            images=images,
            observations=FILES["observations.csv"].replace("8000.", "800.").replace("3598.2", "359.2"),
        )
        (tmp_path / name / "detectors.csv").write_text(angles)
        cameras.append(load_campaign(path).campaign.camera)
    full, cut = cameras
    assert cut.size_px[0] == 3000.0
    np.testing.assert_allclose(
        cut.tan_from_px(7.0, 0.0)[0], full.tan_from_px(2 * 1007 + 0.5, 0.0)[0], atol=1e-15
    )


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("binning = [2, 1]", "camera.binning: found [2, 1], wanted two equal numbers"),
        ("binning = 2", "camera.binning: found 2, wanted two positive whole numbers"),
        (
            "window_px = [0, 0, 12001, 10]",
            "camera.window_px: found [0, 0, 12001, 10], which ends beyond the sensor",
        ),
        ("window_px = [0, 0, 10]", "camera.window_px: found [0, 0, 10], wanted four whole numbers"),
        ("binning = [2, 2]\nwindow_px = [0, 0, 6001, 10]", "wanted it within 6000 x 6000 binned pixels"),
    ],
)
def test_what_cannot_be_read_out_is_refused(tmp_path, line, says):
    with pytest.raises(InputError) as refused:
        camera_of(tmp_path, line)
    assert says in str(refused.value)


TELEMETRY = """
[campaign]
name = "SAT1"
time_scale = "UTC"

[camera]
model = "frame"
focal_length_mm = 580.0
pixel_pitch_um = 5.5
image_size_px = [4096, 3072]
principal_point_px = [2061.25, 1527.5]
pixel_origin = "corner"
binning = [2, 2]
window_px = [224, 168, 1600, 1200]

[mounting]
from = "camera"
to = "body"
matrix = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]

[ephemeris]
file = "gps_eci.csv"
columns = { x_m = "X_km", y_m = "Y_km", z_m = "Z_km", vx_m_s = "VX_kmps", vy_m_s = "VY_kmps", vz_m_s = "VZ_kmps" }
units = { position = "km", velocity = "km/s" }
time = { column = "unix_time", format = "unix" }
frame = "J2000"
sigma_m = 5.0
shared_by = "image"

[attitude]
file = "adcs_tlm.csv"
columns = { qw = "q_s", qx = "q_x", qy = "q_y", qz = "q_z" }
time = { column = "unix_time", format = "unix" }
keep = { mode = "FINE" }
from = "body"
to = "J2000"
sigma_arcsec = [6.0, 6.0, 40.0]
sigma_frame = "str_1"
shared_by = "image"

[frames]
str_1 = { from = "body", quaternion_xyzw = [0.2295752968, 0.8567866720, 0.1195093352, 0.4460149108] }

[landmarks]
file = "landmarks.csv"

[images]
time_from_id = "SAT1_%Y%m%dT%H%M%S.%fZ_L1A"

[observations]
file = "*.points"
sigma_px = 0.3
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Use `@` matmul:PendingDeprecationWarning")
def test_a_small_satellites_telemetry_calibrates_as_it_comes(shared_cases, tmp_path):
    """Sigma and truth are the case's own."""
    for path in (shared_cases / "telemetry").glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "campaign.toml").write_text(TELEMETRY)
    result = sp.calibrate(sp.read_campaign(tmp_path / "campaign.toml"), method="gls")
    sigma = result.sigma_arcsec
    assert result.usable
    np.testing.assert_allclose(sigma, [11.7, 7.1, 18.1], rtol=0.02)
    assert np.all(np.abs(result.correction_arcsec - [-1450.0, 920.0, 2600.0]) < 3.0 * sigma)
    assert {path.name for path in tmp_path.glob("*.points")} < set(result.campaign.loaded.inputs)
