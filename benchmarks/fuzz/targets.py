"""Every reader with valid files of its format, made by the package, by the libraries of the format, or by its tests."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import second
from archives import archives
from damage import BINARY, PLAIN, hashed, in_gzip, odd_number, other_number, respelled
from products import products
from raws import raws
from series import series
from target import Compare, Target

TESTS = Path(__file__).resolve().parents[2] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "imagery")]


def _text(files: Mapping[str, str]) -> dict[str, bytes]:
    return {name: text.encode() for name, text in files.items()}


def _columns(*names: str) -> Compare:
    def compare(data: bytes, found: Any) -> None:
        np.testing.assert_array_equal(found.columns(*names), second.table(data, names))

    return compare


def _table(file: str, texts: tuple[str, ...], numbers: tuple[str, ...]) -> Target:
    """A table of a campaign alone."""
    from helpers import FILES

    def read(folder: Path) -> Any:
        from starplumb.io.tables.read import epochs, read_table

        table = read_table(folder / file, texts=texts, numbers=numbers)
        if "time" in texts:
            epochs(table, "UTC")
        return table

    same = (*PLAIN, hashed, in_gzip, respelled)
    data = {file: FILES[file].encode()}
    return Target(f"table {file}", data, (file,), read, same=same, compare=_columns(*numbers))


def _parquet() -> Target:
    import io

    import pyarrow as pa
    from pyarrow import csv, parquet

    from helpers import OBSERVATIONS

    table = csv.read_csv(io.BytesIO(OBSERVATIONS.encode()))
    sink = pa.BufferOutputStream()
    parquet.write_table(table, sink)
    arrow = pa.BufferOutputStream()
    with pa.ipc.new_file(arrow, table.schema) as writer:
        writer.write_table(table)
    files = {"t.parquet": sink.getvalue().to_pybytes(), "t.arrow": arrow.getvalue().to_pybytes()}

    def read(folder: Path) -> Any:
        from starplumb.io.tables.read import read_table

        numbers = ("column_px", "row_px", "sigma_px")
        return [
            read_table(folder / name, texts=("image_id", "landmark_id"), numbers=numbers) for name in files
        ]

    return Target("table Parquet, Arrow", files, tuple(files), read, BINARY, ())


def _campaign(name: str, files: Mapping[str, bytes], *damaged: str) -> Target:
    def read(folder: Path) -> Any:
        from starplumb.io.campaign.read import load_campaign

        return load_campaign(folder / "campaign.toml", with_detections=True).campaign

    same = (*PLAIN, hashed, respelled)
    return Target(name, files, damaged, read, same=same)


def _campaigns() -> Iterator[Target]:
    from helpers import FILES

    plain = _text(FILES)
    yield _campaign("campaign.toml", plain, "campaign.toml")
    yield _campaign("campaign's tables", plain, *(name for name in plain if name.endswith(".csv")))
    more = FILES["campaign.toml"]
    more = more.replace("sigma_arcsec = [5.0, 5.0, 12.0]\n", ATTITUDE_MORE).replace(
        "sigma_m = 3.0", "sigma_m = 3.0\n" + ORBIT_MORE
    )
    more = more.replace('file = "landmarks.csv"', 'file = "landmarks.csv"\ncommon_sigma_m = [0.5, 0.5, 1.0]')
    more = more.replace("principal_point_px = [5999.5, 5999.5]", CAMERA_MORE) + MORE
    yield _campaign("campaign.toml, more keys", plain | {"campaign.toml": more.encode()}, "campaign.toml")
    lines = FILES["campaign.toml"].replace('model = "frame"', 'model = "line-scan"')
    lines = lines.replace(
        "focal_length_mm = 2200.0\npixel_pitch_um = 9.0\nimage_size_px = [12000, 12000]\n", ""
    )
    lines = lines.replace("principal_point_px = [5999.5, 5999.5]\n", 'look_angles = "detectors.csv"\n')
    scan = {
        "campaign.toml": lines,
        "detectors.csv": "column_px,tan_x,tan_y\n0.0,-0.02,0.001\n5999.0,0.0,0.001\n11999.0,0.02,0.001\n",
        "images.csv": "image_id,time,row_times\nI1,2020-01-01T00:00:01.000,rows.csv\n",
        "rows.csv": "row,time\n0.0,2020-01-01T00:00:01.000\n5000.0,2020-01-01T00:00:01.600\n"
        "12000.0,2020-01-01T00:00:02.400\n",
        "observations.csv": FILES["observations.csv"].split("I2", 1)[0],
    }
    yield _campaign("line scanner's tables", plain | _text(scan), "detectors.csv", "rows.csv", "images.csv")


ATTITUDE_MORE = """sigma_arcsec = [5.0, 5.0, 12.0]
shared_by = "pass"
wander = { sigma_arcsec = [2.0, 2.0, 4.0], correlation_time_s = 1.0 }
session_sigma_arcsec = [1.0, 1.0, 2.0]
"""
ORBIT_MORE = 'shared_by = "image"\n'
CAMERA_MORE = """principal_point_px = [5999.5, 5999.5]
pixel_origin = "center"
distortion = { model = "brown-conrady", k = [0.01, 0.0, 0.0], p = [0.0, 0.0] }
"""
MORE = """
[corrections]
light_time = true
aberration = true
refraction = true

[consider]
focal_length = "5um"

[spice]
camera = { name = "SAT1_CAM", id = -999101 }
spacecraft_id = -999
"""


def _answers() -> Iterator[Target]:
    """Numbers anywhere in a campaign that are possible or not, and what calibrating with them gives."""
    from helpers import FILES

    def read(folder: Path) -> Any:
        import starplumb as sp

        try:
            return sp.calibrate(sp.read_campaign(folder / "campaign.toml")).document
        except sp.AlignmentFailed as failed:
            return str(failed)

    more = FILES["campaign.toml"].replace(
        "[ephemeris]", "sigma_arcsec = [3600.0, 3600.0, 3600.0]\n\n[ephemeris]"
    )
    files = _text(FILES) | {"campaign.toml": more.encode()}
    yield Target("calibrate", files, tuple(files), read, (odd_number, other_number), ())


def _documents() -> Iterator[Target]:
    from tempfile import TemporaryDirectory

    import starplumb as sp

    with TemporaryDirectory() as folder:
        found = sp.calibrate(sp.demo(images=2))
        found.save(folder)
        texts = {name: Path(folder, name).read_bytes() for name in ("result.json", "normals.json")}

    def result(folder: Path) -> Any:
        from starplumb.documents.result import ResultDocument
        from starplumb.io.text.files import read_text

        document = ResultDocument.from_json(read_text(folder / "result.json"), "result.json")
        return document.C_EK, document.covariance_E, document.interval_95_E

    def normals(folder: Path) -> Any:
        from starplumb.documents.normals import NormalsDocument
        from starplumb.io.text.files import read_text

        return NormalsDocument.from_json(read_text(folder / "normals.json"), "normals.json").to_dict()

    for name, read in (("result.json", result), ("normals.json", normals)):
        yield Target(name, {name: texts[name]}, (name,), read)


def _scenarios() -> Iterator[Target]:
    from starplumb.io.scenario.read import shipped_scenarios

    def read(folder: Path) -> Any:
        from starplumb.io.scenario.read import load_scenario

        return load_scenario(folder / "scenario.toml").initial

    for name, path in list(shipped_scenarios().items())[:3]:
        yield Target(
            f"scenario {name}",
            {"scenario.toml": path.read_bytes()},
            ("scenario.toml",),
            read,
            same=(*PLAIN, hashed),
        )


def _orientation() -> Iterator[Target]:
    from astropy_iers_data import IERS_A_FILE

    rows = Path(IERS_A_FILE).read_bytes().splitlines(keepends=True)[16000:16040]

    def read(folder: Path) -> Any:
        from starplumb.physics.orientation import EarthOrientation

        table = EarthOrientation.load(folder / "finals.all")
        return table.t_ns, table.values

    yield Target("Earth orientation", {"finals.all": b"".join(rows)}, ("finals.all",), read, same=PLAIN[:1])


def targets() -> dict[str, Target]:
    """Every reader by its name."""
    found = [
        _table("ephemeris.csv", ("time",), ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")),
        _table("attitude.csv", ("time",), ("qx", "qy", "qz", "qw")),
        _table("observations.csv", ("image_id", "landmark_id"), ("column_px", "row_px", "sigma_px")),
        _parquet(),
    ]
    further = (_documents, _scenarios, _orientation, _answers, archives, raws)
    for several in (_campaigns, series, products, *further):
        found += several()
    return {target.name: target for target in found}
