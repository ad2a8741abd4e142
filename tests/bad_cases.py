"""Wrong input, one fault a case: what is spoiled in the good campaign of ``helpers`` and what must be said about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

Spoil = Callable[[Path], None]


@dataclass(frozen=True)
class BadCase:
    """``spoil`` changes one thing in the folder; the error must hold all of ``says``."""

    name: str
    spoil: Spoil
    says: tuple[str, ...]


def swap(file: str, old: str, new: str, count: int = 1) -> Spoil:
    """``old`` becomes ``new``."""

    def spoil(folder: Path) -> None:
        text = (folder / file).read_text(encoding="utf-8")
        assert old in text, f"{old!r} is not in {file}"
        (folder / file).write_text(text.replace(old, new, count), encoding="utf-8")

    return spoil


def put(file: str, content: str | bytes) -> Spoil:
    """The file holds ``content`` instead."""

    def spoil(folder: Path) -> None:
        data = content.encode() if isinstance(content, str) else content
        (folder / file).write_bytes(data)

    return spoil


def recode(file: str, encoding: str) -> Spoil:
    """The file is stored in another encoding."""

    def spoil(folder: Path) -> None:
        (folder / file).write_bytes((folder / file).read_text(encoding="utf-8").encode(encoding))

    return spoil


def drop_column(file: str, column: str) -> Spoil:
    """A table without one of its columns."""

    def spoil(folder: Path) -> None:
        rows = [line.split(",") for line in (folder / file).read_text(encoding="utf-8").splitlines()]
        at = rows[0].index(column)
        lines = [",".join(row[:at] + row[at + 1 :]) for row in rows]
        (folder / file).write_text("\n".join(lines) + "\n", encoding="utf-8")

    return spoil


def remove(file: str) -> Spoil:
    """The file is not there."""
    return lambda folder: (folder / file).unlink()


def folder_instead(file: str) -> Spoil:
    """A folder has the file's name."""

    def spoil(folder: Path) -> None:
        (folder / file).unlink()
        (folder / file).mkdir()

    return spoil


def many_rows(folder: Path) -> None:
    """A hundred thousand sightings of one landmark in one image."""
    row = "I1,L1,8000.3,2658.1,0.2\n"
    (folder / "observations.csv").write_text(
        "image_id,landmark_id,column_px,row_px,sigma_px\n" + 100_000 * row
    )


def both(*spoils: Spoil) -> Spoil:
    """Several changes that make one fault."""

    def spoil(folder: Path) -> None:
        for change in spoils:
            change(folder)

    return spoil


TOML, EPH, ATT = "campaign.toml", "ephemeris.csv", "attitude.csv"
LAND, IMG, OBS = "landmarks.csv", "images.csv", "observations.csv"
IDENTITY = "quaternion_xyzw = [0.0, 0.0, 0.0, 1.0]"
LINE_SCAN = swap(TOML, 'model = "frame"', 'model = "line-scan"')
NO_OPTICS = swap(
    TOML,
    "focal_length_mm = 2200.0\npixel_pitch_um = 9.0\nimage_size_px = [12000, 12000]\n"
    "principal_point_px = [5999.5, 5999.5]\n",
    'look_angles = "detectors.csv"\n',
)
DETECTORS = "column_px,tan_x,tan_y\n0,-0.02,0.001\n5999,0.0,0.001\n11999,0.02,0.001\n"

SPICE = [
    (
        "name",
        'camera = { name = "SAT 1" }',
        "spice.camera.name",
        'found "SAT 1"',
        "letters, digits and underscores",
    ),
    ("name-long", f'camera = {{ name = "{27 * "A"}" }}', "spice.camera.name", "at most 26"),
    ("name-known", 'tracker = { name = "itrf93" }', "spice.tracker.name", "SPICE has a frame of that name"),
    ("names", 'camera = { name = "Star_Tracker" }', "spice.tracker.name", "STAR_TRACKER for the camera"),
    ("id", "camera = { id = 17 }", "spice.camera.id", "found 17", "1400000 to 2000000"),
    ("id-text", 'camera = { id = "-999101" }', "spice.camera.id", "wanted a whole number"),
    (
        "ids",
        "camera = { id = 1400002 }",
        "spice.tracker.id",
        "found 1400002 for the camera and the star tracker",
    ),
    ("spacecraft", "spacecraft_id = 7", "spice.spacecraft_id", "found 7", "a negative whole number"),
    (
        "of-another",
        "spacecraft_id = -999\ntracker = { id = -82361 }",
        "spice.tracker.id: found -82361",
        "belongs to the satellite -82, wanted one of -999",
    ),
    ("key", "camera = { nmae = 'X' }", "spice.camera.nmae: unknown key", "name"),
]
"""Sections [spice] with one fault each, and what must be said."""

KEYS = [
    BadCase("toml-missing", remove(TOML), ("campaign.toml", "no such file")),
    BadCase("toml-empty", put(TOML, b""), ("campaign.toml", "empty file")),
    BadCase("toml-blank", put(TOML, "\n \n"), ("campaign.toml", "empty file")),
    BadCase("toml-folder", folder_instead(TOML), ("campaign.toml", "found a folder", "wanted a file")),
    BadCase(
        "toml-endless-integer",
        swap(TOML, "[camera]", "endless = " + "9" * 5000 + "\n[camera]"),
        ("campaign.toml, line ", "found a whole number of 5000 digits", "wanted one that a double holds"),
    ),
    BadCase("toml-utf16", recode(TOML, "utf-16"), ("campaign.toml", "UTF-16", "wanted UTF-8")),
    BadCase("toml-utf16-unmarked", recode(TOML, "utf-16-le"), ("campaign.toml", "UTF-16", "wanted UTF-8")),
    BadCase(
        "toml-latin1",
        put(TOML, '[campaign]\nname = "Z\u00fcrich"\n'.encode("latin-1")),
        ("campaign.toml, line 2", "0xFC"),
    ),
    BadCase(
        "toml-syntax", swap(TOML, 'name = "by hand"', "name = by hand"), ("campaign.toml, line 2", "TOML")
    ),
    BadCase(
        "toml-key-twice",
        swap(TOML, "[camera]", '[camera]\nmodel = "frame"'),
        ("campaign.toml, line 7", "TOML"),
    ),
    BadCase("toml-unclosed", swap(TOML, "[12000, 12000]", "[12000, 12000"), ("campaign.toml, line", "TOML")),
    BadCase(
        "unknown-key",
        swap(TOML, "focal_length_mm", "focal_lenght_mm"),
        ("campaign.toml: camera.focal_lenght_mm: unknown key", "nearest known one is focal_length_mm"),
    ),
    BadCase(
        "unknown-section", swap(TOML, "[images]", "[image]"), ("campaign.toml: image: unknown key", "images")
    ),
    BadCase(
        "section-missing", swap(TOML, '[images]\nfile = "images.csv"', ""), ("images: missing", "[images]")
    ),
    BadCase(
        "section-is-value",
        both(
            swap(TOML, '[images]\nfile = "images.csv"', ""),
            swap(TOML, "[campaign]", "images = 3\n[campaign]"),
        ),
        ("images: found 3", "wanted a section"),
    ),
    BadCase(
        "text-for-number",
        swap(TOML, "2200.0", '"2200"'),
        ("camera.focal_length_mm", 'found "2200"', "positive finite number"),
    ),
    BadCase(
        "number-nan",
        swap(TOML, "2200.0", "nan"),
        ("camera.focal_length_mm", "found nan", "positive finite number"),
    ),
    BadCase("number-inf", swap(TOML, "sigma_m = 3.0", "sigma_m = inf"), ("ephemeris.sigma_m", "found inf")),
    BadCase(
        "number-negative",
        swap(TOML, "pixel_pitch_um = 9.0", "pixel_pitch_um = -9.0"),
        ("camera.pixel_pitch_um", "found -9.0", "positive finite number"),
    ),
    BadCase(
        "truth-for-number",
        swap(TOML, "sigma_m = 3.0", "sigma_m = true"),
        ("ephemeris.sigma_m", "found true", "one finite number or three"),
    ),
    BadCase(
        "number-for-truth",
        swap(TOML, "[landmarks]", "[corrections]\naberration = 1\n[landmarks]"),
        ("corrections.aberration", "found 1", "wanted true or false"),
    ),
    BadCase("number-for-name", swap(TOML, '"by hand"', "7"), ("campaign.name", "found 7")),
    BadCase(
        "size-fractional",
        swap(TOML, "[12000, 12000]", "[12000.5, 12000]"),
        ("camera.image_size_px", "12000.5", "whole numbers"),
    ),
    BadCase(
        "principal-point-long",
        swap(TOML, "[5999.5, 5999.5]", "[1.0, 2.0, 3.0]"),
        ("camera.principal_point_px", "[1.0, 2.0, 3.0]", "two finite numbers"),
    ),
    BadCase(
        "sigma-two",
        swap(TOML, "[5.0, 5.0, 12.0]", "[5.0, 5.0]"),
        ("attitude.sigma_arcsec", "found [5.0, 5.0]", "one finite number or three"),
    ),
    BadCase(
        "sigma-negative",
        swap(TOML, "[5.0, 5.0, 12.0]", "[5.0, -5.0, 12.0]"),
        ("attitude.sigma_arcsec", "-5.0", "none negative"),
    ),
    BadCase(
        "sigma-position-missing",
        swap(TOML, "sigma_m = 3.0\n", ""),
        ("ephemeris.sigma_m: missing", "solution needs"),
    ),
    BadCase(
        "sigma-attitude-missing",
        swap(TOML, "sigma_arcsec = [5.0, 5.0, 12.0]\n", ""),
        ("campaign.toml: attitude.sigma_arcsec: missing", "sigma_x_arcsec"),
    ),
    BadCase(
        "prior-zero",
        swap(TOML, IDENTITY, IDENTITY + "\nsigma_arcsec = 0"),
        ("mounting.sigma_arcsec", "found 0", "positive"),
    ),
    BadCase("scale-unknown", swap(TOML, '"UTC"', '"UT1"'), ("campaign.time_scale", 'found "UT1"', '"UTC"')),
    BadCase(
        "scale-lower-case",
        swap(TOML, '"UTC"', '"utc"'),
        ("campaign.time_scale", 'found "utc"', 'wanted "UTC"'),
    ),
    BadCase(
        "camera-model",
        swap(TOML, '"frame"', '"pushbroom"'),
        ("camera.model", 'found "pushbroom"', '"line-scan"'),
    ),
    BadCase(
        "focal-length-missing",
        swap(TOML, "focal_length_mm = 2200.0\n", ""),
        ("camera.focal_length_mm: missing", "millimetres"),
    ),
    BadCase(
        "pixel-origin",
        swap(TOML, "[mounting]", 'pixel_origin = "centre"\n[mounting]'),
        ("camera.pixel_origin", 'found "centre"', '"center"'),
    ),
    BadCase(
        "distortion-short",
        swap(TOML, "[mounting]", 'distortion = {model = "brown-conrady", k = [0.1]}\n[mounting]'),
        ("camera.distortion.k", "found [0.1]", "three finite numbers"),
    ),
    BadCase(
        "look-angles-for-frame",
        swap(TOML, "[mounting]", 'look_angles = "detectors.csv"\n[mounting]'),
        ("camera.look_angles", "line-scan"),
    ),
    BadCase(
        "frame-unknown",
        swap(TOML, '"ITRF"', '"LVLH"'),
        ("ephemeris.frame", 'found "LVLH"', '"ITRF", "GCRF", "TEME", "TOD" or "MOD"'),
    ),
    BadCase(
        "format-unknown",
        both(swap(TOML, "ephemeris.csv", "ephemeris.nc"), put("ephemeris.nc", "CDF")),
        ("ephemeris.nc", 'begins with "CDF"', "wanted a table or CCSDS OEM, SP3, SPICE SPK"),
    ),
    BadCase("file-empty-name", swap(TOML, '"landmarks.csv"', '""'), ("landmarks.file", 'found ""')),
    BadCase(
        "attitude-no-earth",
        swap(TOML, 'from = "ITRF"', 'from = "body"'),
        ("attitude.from", '"body"', "ITRF on exactly one side"),
    ),
    BadCase(
        "attitude-both-earth",
        swap(TOML, 'from = "ITRF"\nto = "star_tracker"', 'from = "ITRF"\nto = "GCRF"'),
        ("attitude.from", "exactly one side"),
    ),
    *(
        BadCase(f"spice-{name}", swap(TOML, "[landmarks]", f"[spice]\n{text}\n[landmarks]"), says)
        for name, text, *says in SPICE
    ),
    BadCase(
        "spice-tracker-is-camera",
        swap(TOML, "star_tracker", "Camera", -1),
        ("campaign.toml: spice.tracker.name: found CAMERA", "two names that differ in capitals"),
    ),
    BadCase(
        "spice-tracker-of-spice",
        swap(TOML, "star_tracker", "iau earth", -1),
        ("spice.tracker.name: missing, and SPICE has a frame IAU_EARTH", 'another name for "iau earth"'),
    ),
    BadCase(
        "mounting-other-tracker",
        swap(TOML, 'to = "star_tracker"', 'to = "str_1"'),
        ("mounting.to", 'found "str_1"', 'wanted "star_tracker"'),
    ),
    BadCase(
        "mounting-no-camera",
        swap(TOML, 'from = "camera"', 'from = "payload"'),
        ("mounting.from", 'found "payload"', 'wanted "camera"'),
    ),
    BadCase(
        "mounting-none",
        swap(TOML, IDENTITY + "\n", ""),
        ("mounting.quaternion_xyzw: missing", "exactly one of", "euler_deg"),
    ),
    BadCase(
        "mounting-two",
        swap(TOML, IDENTITY, IDENTITY + "\nrotation_vector_deg = [0, 0, 0]"),
        ("mounting.rotation_vector_deg", "beside quaternion_xyzw", "exactly one"),
    ),
    BadCase(
        "quaternion-half",
        swap(TOML, IDENTITY, "quaternion_xyzw = [0.0, 0.0, 0.0, 0.5]"),
        ("mounting.quaternion_xyzw", "0.5", "norm 1"),
    ),
    BadCase(
        "quaternion-zero",
        swap(TOML, IDENTITY, "quaternion_wxyz = [0.0, 0.0, 0.0, 0.0]"),
        ("mounting.quaternion_wxyz", "norm is 0"),
    ),
    BadCase(
        "quaternion-three",
        swap(TOML, IDENTITY, "quaternion_xyzw = [0.0, 0.0, 1.0]"),
        ("mounting.quaternion_xyzw", "[0.0, 0.0, 1.0]", "four finite numbers"),
    ),
    BadCase(
        "quaternion-nan",
        swap(TOML, IDENTITY, "quaternion_xyzw = [0.0, 0.0, 0.0, nan]"),
        ("mounting.quaternion_xyzw", "nan", "four finite numbers"),
    ),
    BadCase(
        "matrix-mirror",
        swap(TOML, IDENTITY, "matrix = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]"),
        ("mounting.matrix", "determinant +1"),
    ),
    BadCase(
        "matrix-sheared",
        swap(TOML, IDENTITY, "matrix = [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]"),
        ("mounting.matrix", "a rotation matrix", "off the identity by 0.1"),
    ),
    BadCase(
        "matrix-ragged",
        swap(TOML, IDENTITY, "matrix = [[1, 0, 0], [0, 1], [0, 0, 1]]"),
        ("mounting.matrix", "three numbers"),
    ),
    BadCase(
        "euler-without-order",
        swap(TOML, IDENTITY, "euler_deg = [1, 2, 3]"),
        ("mounting.euler_order: missing", '"ZYX"'),
    ),
    BadCase(
        "euler-mixed-case",
        swap(TOML, IDENTITY, 'euler_deg = [1, 2, 3]\neuler_order = "zyX"'),
        ("mounting.euler_order", 'found "zyX"'),
    ),
    BadCase(
        "observations-missing",
        swap(TOML, '[observations]\nfile = "observations.csv"\n', ""),
        ("observations: missing", "[detections]"),
    ),
    BadCase(
        "both-kinds",
        swap(TOML, "[images]", '[detections]\nfile = "d.csv"\n[images]'),
        ("detections: found beside [observations]", "exactly one"),
    ),
    BadCase(
        "detections-only",
        both(swap(TOML, "[observations]", "[detections]"), drop_column(OBS, "landmark_id")),
        ("campaign.toml: detections", "landmarks are not known", "wanted [observations]"),
    ),
    BadCase(
        "three-at-once",
        both(
            swap(TOML, "2200.0", '"2200"'),
            swap(TOML, '"UTC"', '"GMT"'),
            swap(TOML, "sigma_m = 3.0", "sigma = 3.0"),
        ),
        (
            "campaign.toml: 3 problems: ",
            "campaign.time_scale",
            "camera.focal_length_mm",
            "ephemeris.sigma: unknown key",
        ),
    ),
    BadCase(
        "files-missing",
        both(remove(LAND), remove(IMG)),
        ("2 problems", "landmarks.file", "landmarks.csv", "images.file", "no such file"),
    ),
    BadCase(
        "file-is-folder", folder_instead(OBS), ("observations.file", "observations.csv", "found a folder")
    ),
]

TABLES = [
    BadCase("table-empty", put(EPH, b""), ("ephemeris.csv", "empty file")),
    BadCase(
        "header-only",
        put(LAND, "landmark_id,latitude_deg,longitude_deg,height_m,sigma_m\n"),
        ("landmarks.csv", "without rows", "at least one row"),
    ),
    BadCase("comment-only", put(LAND, "# nothing here\n"), ("landmarks.csv", "no header")),
    BadCase("header-missing", swap(IMG, "image_id,time\n", ""), ("images.csv, row 1", "image_id, time")),
    BadCase("table-utf16", recode(ATT, "utf-16"), ("attitude.csv", "UTF-16", "wanted UTF-8")),
    BadCase(
        "table-nul", put(IMG, b"image_id,time\nI1,2020-01-01T00:00:01\x00\n"), ("images.csv, line 2", "NUL")
    ),
    BadCase(
        "table-latin1",
        put(
            LAND,
            "landmark_id,latitude_deg,longitude_deg,height_m,sigma_m\nM\u00fchle,0,0,0,1\n".encode("latin-1"),
        ),
        ("landmarks.csv, line 2", "0xFC", "UTF-8"),
    ),
    BadCase("table-binary", put(OBS, bytes(range(1, 256))), ("observations.csv", "wanted")),
    BadCase(
        "column-missing",
        drop_column(OBS, "sigma_px"),
        ("observations.csv, row 1", "wanted the column sigma_px"),
    ),
    BadCase(
        "column-misspelt",
        swap(OBS, "column_px", "colum_px"),
        ("observations.csv, row 1", "wanted the column column_px", '"colum_px"'),
    ),
    BadCase(
        "column-twice",
        swap(OBS, "row_px", "column_px"),
        ("observations.csv, row 1", '"column_px" more than once'),
    ),
    BadCase("semicolons", swap(LAND, ",", ";", -1), ("landmarks.csv, row 1", "semicolons", "wanted commas")),
    BadCase(
        "decimal-comma",
        swap(OBS, "8000.3,", "8000,3,"),
        ("observations.csv, row 2", "found 6 cells", "wanted 5", "decimal commas"),
    ),
    BadCase(
        "decimal-comma-quoted",
        swap(OBS, "8000.3,", '"8000,3",'),
        ("observations.csv, row 2, column column_px", '"8000,3"', "decimal point"),
    ),
    BadCase(
        "row-short",
        swap(OBS, "I2,L1,8000.4,5353.8,0.2", "I2,L1,8000.4,5353.8"),
        ("observations.csv, row 5", "found 4 cells", "wanted 5"),
    ),
    BadCase("quote-open", swap(LAND, "L3", '"L3'), ("landmarks.csv", "not CSV", "quotes closed")),
    BadCase(
        "cell-text",
        swap(OBS, "6632.7", "n/a"),
        ("observations.csv, row 3, column row_px", '"n/a"', "finite number"),
    ),
    BadCase(
        "cell-nan",
        swap(OBS, "6632.7", "NaN"),
        ("observations.csv, row 3, column row_px", '"NaN"', "finite number"),
    ),
    BadCase(
        "cell-inf",
        swap(EPH, "-7500.0", "-inf"),
        ("ephemeris.csv, row 3, column z_m", '"-inf"', "finite number"),
    ),
    BadCase(
        "cell-overflow",
        swap(EPH, "-7500.0", "1e999"),
        ("ephemeris.csv, row 3, column z_m", '"1e999"', "finite number"),
    ),
    BadCase(
        "cell-underscore",
        swap(OBS, "6632.7", "6_632.7"),
        ("observations.csv, row 3, column row_px", '"6_632.7"', "finite number"),
    ),
    BadCase(
        "cell-other-digits",
        swap(OBS, "6632.7", "\u0666\u0666"),
        ("observations.csv, row 3, column row_px", "finite number"),
    ),
    BadCase(
        "cell-empty",
        swap(OBS, "6632.7", ""),
        ("observations.csv, row 3, column row_px", "an empty cell", "finite number"),
    ),
    BadCase("id-empty", swap(IMG, "I2,", ","), ("images.csv, row 3, column image_id", "an empty cell")),
]

SERIES = [
    BadCase(
        "ephemeris-unsorted",
        swap(EPH, "T00:00:02.000", "T00:00:00.500"),
        ("ephemeris.csv, row 4, column time", "2020-01-01T00:00:00.500", "(row 3)", "increase"),
    ),
    BadCase(
        "ephemeris-repeated",
        swap(EPH, "T00:00:02.000", "T00:00:01.000"),
        ("ephemeris.csv, row 4, column time", "again (row 3)", "increase"),
    ),
    BadCase(
        "ephemeris-kilometres",
        put(
            EPH,
            "time,x_m,y_m,z_m\n"
            + "".join(f"2020-01-01T00:00:0{i},7058.137,0.0,{7.5 * i}\n" for i in range(5)),
        ),
        ("ephemeris.csv, row 2", "found 7058.137 m", "6500 to 50000 km", "kilometres?"),
    ),
    BadCase(
        "ephemeris-underground",
        swap(EPH, "7058137.0,0.0,7500.0", "7058.0,0.0,7500.0"),
        ("ephemeris.csv, row 5, columns x_m, y_m, z_m", "an orbit"),
    ),
    BadCase(
        "velocity-one",
        drop_column(EPH, "vz_m_s"),
        ("ephemeris.csv", "vx_m_s without vz_m_s", "all of them or none"),
    ),
    BadCase(
        "velocity-kilometres", swap(EPH, ",7500.0\n", ",7.5\n", 5), ("ephemeris.csv", "velocities", "m/s")
    ),
    BadCase(
        "time-words",
        swap(EPH, "2020-01-01T00:00:02.000", "two o'clock"),
        ("ephemeris.csv, row 4, column time", "two o'clock", "ISO 8601"),
    ),
    BadCase(
        "time-no-such-day",
        swap(EPH, "2020-01-01T00:00:02.000", "2020-02-30T00:00:02"),
        ("ephemeris.csv, row 4, column time", "2020-02-30", "wanted"),
    ),
    BadCase(
        "time-american",
        swap(IMG, "2020-01-01T00:00:01.500", "01/01/2020 00:00:01.5"),
        ("images.csv, row 2, column time", "01/01/2020", "ISO 8601"),
    ),
    BadCase(
        "time-empty",
        swap(IMG, "2020-01-01T00:00:01.500", ""),
        ("images.csv, row 2, column time", "an empty cell"),
    ),
    BadCase(
        "time-offset",
        swap(IMG, "2020-01-01T00:00:01.500", "2020-01-01T01:00:01.500+01:00"),
        ("images.csv, row 2, column time", "offset"),
    ),
    BadCase(
        "time-wrong-scale",
        both(swap(TOML, '"UTC"', '"GPS"'), swap(IMG, "01.500", "01.500Z")),
        ("images.csv, row 2, column time", "Z", "GPS"),
    ),
    BadCase(
        "leap-second-that-was-not",
        swap(EPH, "T00:00:04.000", "T23:59:60.000"),
        ("ephemeris.csv, row 6, column time", ":60", "leap second"),
    ),
    BadCase(
        "attitude-unsorted",
        swap(ATT, "T00:00:04.000", "T00:00:01.000"),
        ("attitude.csv, row 4, column time", "(row 3)", "increase"),
    ),
    BadCase(
        "attitude-repeated",
        swap(ATT, "T00:00:02.000", "T00:00:00.000"),
        ("attitude.csv, row 3, column time", "again (row 2)"),
    ),
    BadCase(
        "attitude-half-norm",
        swap(ATT, "02.000,0.5,0.5,-0.5,0.5", "02.000,0.25,0.25,-0.25,0.25"),
        ("attitude.csv, row 3", "qx, qy, qz, qw", "norm 0.5", "wanted norm 1"),
    ),
    BadCase(
        "attitude-zero",
        swap(ATT, "02.000,0.5,0.5,-0.5,0.5", "02.000,0,0,0,0"),
        ("attitude.csv, row 3", "norm 0,", "wanted norm 1"),
    ),
    BadCase(
        "attitude-sigma-partly",
        swap(ATT, "qw\n", "qw,sigma_x_arcsec\n"),
        ("attitude.csv, row 2", "found 5 cells", "wanted 6"),
    ),
    BadCase(
        "attitude-sigma-zero",
        put(
            ATT,
            "time,qx,qy,qz,qw,sigma_x_arcsec,sigma_y_arcsec,sigma_z_arcsec\n2020-01-01T00:00:00,0.5,0.5,-0.5,0.5,5,0,5\n",
        ),
        ("attitude.csv, row 2, column sigma_y_arcsec", "found 0", "positive"),
    ),
    BadCase(
        "orientation-before-table",
        both(swap(TOML, '"ITRF"', '"GCRF"'), swap(EPH, "2020-01-01T00:00:00.000", "1972-07-01T00:00:00.000")),
        ("ephemeris.csv, sample 1", "1972-07-01", "Earth orientation"),
    ),
    BadCase(
        "orientation-file-missing",
        swap(TOML, "[images]", '[earth]\norientation_file = "finals.all"\n[images]'),
        ("earth.orientation_file", "finals.all", "no such file"),
    ),
    BadCase(
        "ephemeris-before-1972",
        swap(EPH, "2020-01-01T00:00:00.000", "1960-01-01T00:00:00.000"),
        ("ephemeris.csv, row 2, column time", "1960-01-01", "leap-second table"),
    ),
    BadCase(
        "image-after-ephemeris",
        swap(IMG, "2020-01-01T00:00:02.500", "2020-01-01T00:00:04.500"),
        ("images.csv, image 'I2': found", "2020-01-01T00:00:04.5", "wanted", "0.5 s away"),
    ),
    BadCase(
        "image-before-attitude",
        swap(ATT, "2020-01-01T00:00:00.000", "2020-01-01T00:00:01.900"),
        ("images.csv, image 'I1': found", "2020-01-01T00:00:01.5", "attitude.csv", "0.4 s away"),
    ),
    BadCase(
        "image-in-gap",
        swap(TOML, 'file = "attitude.csv"', 'file = "attitude.csv"\nmax_gap_s = 1.0'),
        ("images.csv, image 'I1': found", "gap", "attitude.csv", "1 s apart", "wanted"),
    ),
]

MARKERS = [
    BadCase(
        "latitude-95",
        swap(LAND, "0.05,0.05,10.0", "95,0.05,10.0"),
        ("landmarks.csv, row 2, column latitude_deg", "found 95", "wanted -90 to 90"),
    ),
    BadCase(
        "longitude-361",
        swap(LAND, "0.05,0.05,10.0", "0.05,361,10.0"),
        ("landmarks.csv, row 2, column longitude_deg", "found 361", "-180 to 360"),
    ),
    BadCase(
        "height-feet",
        swap(LAND, "0.05,0.05,10.0", "0.05,0.05,29032"),
        ("landmarks.csv, row 2, column height_m", "found 29032", "-1000 to 9500"),
    ),
    BadCase(
        "landmark-twice",
        swap(LAND, "L3", "L1"),
        ("landmarks.csv, row 4, column landmark_id", '"L1" again (first in row 2)', "once"),
    ),
    BadCase(
        "landmark-no-place", drop_column(LAND, "height_m"), ("landmarks.csv", "latitude_deg without height_m")
    ),
    BadCase(
        "landmark-two-places",
        put(
            LAND,
            "landmark_id,latitude_deg,longitude_deg,height_m,x_m,y_m,z_m,sigma_m\nL1,0,0,0,6378137,0,0,1\n",
        ),
        ("landmarks.csv", "both latitude_deg and x_m"),
    ),
    BadCase(
        "landmark-x-kilometres",
        put(LAND, "landmark_id,x_m,y_m,z_m,sigma_m\nL1,6378.137,0,0,1\n"),
        ("landmarks.csv, row 2", "found 6378.137 m", "6300 to 6400 km", "kilometres?"),
    ),
    BadCase(
        "landmark-no-sigma",
        drop_column(LAND, "sigma_m"),
        ("landmarks.csv", "neither sigma_m nor sigma_east_m"),
    ),
    BadCase(
        "landmark-sigma-negative",
        swap(LAND, "30.0,0.5", "30.0,-0.5"),
        ("landmarks.csv, row 4, column sigma_m", "found -0.5", "0 or more"),
    ),
    BadCase(
        "landmark-sigma-up-only",
        swap(LAND, "sigma_m", "sigma_up_m"),
        ("landmarks.csv", "sigma_up_m without sigma_east_m"),
    ),
    BadCase(
        "image-twice",
        swap(IMG, "I2", "I1"),
        ("images.csv, row 3, column image_id", '"I1" again (first in row 2)', "once"),
    ),
    BadCase(
        "image-unknown",
        swap(OBS, "I2,L1", "I3,L1"),
        ("observations.csv, row 5, column image_id", 'found "I3"', "one of the 2 images"),
    ),
    BadCase(
        "landmark-unknown",
        swap(OBS, "I2,L1", "I2,M7"),
        ("observations.csv, row 5, column landmark_id", 'found "M7"', "one of the 3 landmarks"),
    ),
    BadCase(
        "pair-twice",
        swap(OBS, "I2,L1", "I1,L3"),
        (
            "observations.csv, row 5, column landmark_id",
            '"L3" in image "I1" again (first in row 4)',
            "each pair once",
        ),
    ),
    BadCase(
        "pair-many-times",
        many_rows,
        ("observations.csv, row 3, column landmark_id", "again (first in row 2)"),
    ),
    BadCase(
        "pixel-right-of-image",
        swap(OBS, "8000.3", "12000.1"),
        ("observations.csv, row 2, column column_px", "found 12000.1", "-0.5 to 11999.5"),
    ),
    BadCase(
        "pixel-above-image",
        swap(OBS, "2658.1", "-0.6"),
        ("observations.csv, row 2, column row_px", "found -0.6", "-0.5 to 11999.5"),
    ),
    BadCase(
        "pixel-corner",
        both(swap(TOML, "[mounting]", 'pixel_origin = "corner"\n[mounting]'), swap(OBS, "8000.3", "-0.1")),
        ("observations.csv, row 2, column column_px", "found -0.1", "0 to 12000"),
    ),
    BadCase(
        "sigma-px-zero",
        swap(OBS, "2658.1,0.2", "2658.1,0"),
        ("observations.csv, row 2, column sigma_px", "found 0", "positive"),
    ),
    BadCase(
        "role-unknown",
        put(
            OBS,
            "image_id,landmark_id,column_px,row_px,sigma_px,role\nI1,L1,1,1,1,control\nI1,L2,1,1,1,Check\n",
        ),
        ("observations.csv, row 3, column role", 'found "Check"', '"control" or "check"'),
    ),
    BadCase(
        "role-all-check",
        put(OBS, "image_id,landmark_id,column_px,row_px,sigma_px,role\nI1,L1,1,1,1,check\n"),
        ("observations.csv, column role", "only check points", "control"),
    ),
    BadCase("line-scan-no-period", LINE_SCAN, ("images.csv", "line_period_s", "line-scan")),
    BadCase(
        "line-period-zero",
        both(LINE_SCAN, put(IMG, "image_id,time,line_period_s\nI1,2020-01-01T00:00:01,0\n")),
        ("images.csv, row 2, column line_period_s", "found 0", "positive"),
    ),
    BadCase(
        "look-angles-missing",
        both(LINE_SCAN, NO_OPTICS),
        ("camera.look_angles", "detectors.csv", "no such file"),
    ),
    BadCase(
        "look-angles-folded",
        both(LINE_SCAN, NO_OPTICS, put("detectors.csv", DETECTORS.replace("5999,0.0", "5999,0.03"))),
        (
            "detectors.csv, row 4, column tan_x",
            "found 0.02",
            "go on and on from the first detector to the last",
        ),
    ),
    BadCase(
        "look-angles-unsorted",
        both(LINE_SCAN, NO_OPTICS, put("detectors.csv", DETECTORS.replace("11999", "5000"))),
        ("detectors.csv, row 4, column column_px", "found 5000", "increase"),
    ),
    BadCase(
        "look-angles-beside-focal",
        both(LINE_SCAN, swap(TOML, "[mounting]", 'look_angles = "detectors.csv"\n[mounting]')),
        ("camera.focal_length_mm", "beside look_angles"),
    ),
]

OEM = """\
CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2020-01-02T00:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = BIRD
OBJECT_ID = 2020-001A
CENTER_NAME = EARTH
REF_FRAME = ITRF
TIME_SYSTEM = UTC
START_TIME = 2020-01-01T00:00:00
STOP_TIME = 2020-01-01T00:00:04
META_STOP
2020-01-01T00:00:00 7058.137 0.0 -15.0 0.0 0.0 7.5
2020-01-01T00:00:04 7058.137 0.0 15.0 0.0 0.0 7.5
"""

AEM = """\
CCSDS_AEM_VERS = 2.0
CREATION_DATE = 2020-01-02T00:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = BIRD
OBJECT_ID = 2020-001A
REF_FRAME_A = ITRF
REF_FRAME_B = STR_1
TIME_SYSTEM = UTC
START_TIME = 2020-01-01T00:00:00
STOP_TIME = 2020-01-01T00:00:04
ATTITUDE_TYPE = QUATERNION
META_STOP
DATA_START
2020-01-01T00:00:00 -0.5 -0.5 0.5 0.5
2020-01-01T00:00:04 -0.5 -0.5 0.5 0.5
DATA_STOP
"""

USE_OEM = swap(TOML, "ephemeris.csv", "orbit.oem")
USE_AEM = swap(TOML, "attitude.csv", "attitude.aem")

MESSAGES = [
    BadCase(
        "oem-other-frame",
        both(USE_OEM, put("orbit.oem", OEM.replace("= ITRF", "= EME2000"))),
        ("orbit.oem", 'found the frame "EME2000"', "wanted ITRF as ephemeris.frame says"),
    ),
    BadCase(
        "oem-kilometres-twice",
        both(USE_OEM, put("orbit.oem", OEM.replace("7058.137", "7058137.0"))),
        ("orbit.oem, the position at 2020-01-01T00:00:00.000 UTC", "7.058137e+09 m", "6500 to 50000 km"),
    ),
    BadCase(
        "oem-other-object",
        both(USE_OEM, put("orbit.oem", OEM), swap(TOML, "sigma_m = 3.0", 'sigma_m = 3.0\nobject = "FISH"')),
        ("orbit.oem", '"BIRD"', 'wanted "FISH" as ephemeris.object says'),
    ),
    BadCase(
        "object-of-a-table",
        swap(TOML, "sigma_m = 3.0", 'sigma_m = 3.0\nobject = "BIRD"'),
        ("ephemeris.csv", "a table beside ephemeris.object"),
    ),
    BadCase("oem-no-oem", both(USE_OEM, put("orbit.oem", "no orbit")), ("orbit.oem, line 1", "no orbit")),
    BadCase(
        "aem-other-direction",
        both(
            USE_AEM,
            put("attitude.aem", AEM),
            swap(TOML, 'from = "ITRF"\nto = "star_tracker"', 'from = "star_tracker"\nto = "ITRF"'),
        ),
        ("attitude.aem", 'found the frame "ITRF"', 'wanted "star_tracker" as attitude.from says'),
    ),
    BadCase(
        "aem-other-frame",
        both(USE_AEM, put("attitude.aem", AEM.replace("= ITRF", "= TEME"))),
        ("attitude.aem", 'found the frame "TEME"', 'wanted "ITRF" as attitude.from says'),
    ),
    BadCase(
        "bsp-is-none",
        both(swap(TOML, "ephemeris.csv", "orbit.bsp"), put("orbit.bsp", "no orbit")),
        ("orbit.bsp", "SPK"),
    ),
    BadCase(
        "sp3-is-none",
        both(swap(TOML, "ephemeris.csv", "orbit.sp3"), put("orbit.sp3", "no orbit")),
        ("orbit.sp3", "SP3"),
    ),
]

BAD_CASES = [*MESSAGES, *KEYS, *TABLES, *SERIES, *MARKERS]
