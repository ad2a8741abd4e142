"""Tables from Parquet, Arrow and data frames: read as the CSV file of the same content, refused as plainly."""

from __future__ import annotations

import datetime as dt
import decimal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import feather, parquet

from helpers import write_good_campaign
from starplumb.io.campaign.read import load_campaign
from starplumb.io.tables.read import Frame, read_table
from starplumb.physics.errors import InputError

ROWS = pa.table({"id": ["a", " b "], "x": [1.5, -2.0], "note": ["", None]})


class ArrowStream:
    """A data frame of a library that we know nothing of: it gives Arrow data, and nothing else."""

    def __init__(self, table: pa.Table) -> None:
        self._table = table

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self._table.__arrow_c_stream__(requested_schema)


class Protocol:
    """A data frame that has the interchange protocol only."""

    def __init__(self, table: pa.Table) -> None:
        self._table = table

    def __dataframe__(self, nan_as_null: bool = False, allow_copy: bool = True) -> object:
        return self._table.__dataframe__(nan_as_null, allow_copy)


def arrow_file(table: pa.Table, path: Path) -> None:
    with pa.ipc.new_file(path, table.schema) as writer:
        writer.write_table(table)


def arrow_stream(table: pa.Table, path: Path) -> None:
    with pa.ipc.new_stream(path, table.schema) as writer:
        writer.write_table(table)


FILES: dict[str, Callable[[pa.Table, Path], None]] = {
    "t.parquet": parquet.write_table,
    "t.arrow": arrow_file,
    "t.stream.arrow": arrow_stream,
    "t.feather": feather.write_feather,
    "named.csv": parquet.write_table,
}
FRAMES: dict[str, Callable[[pa.Table], object]] = {
    "pyarrow": lambda table: table,
    "batch": lambda table: table.to_batches()[0],
    "stream": ArrowStream,
    "protocol": Protocol,
    "mapping": lambda table: {name: table[name].to_pylist() for name in table.column_names},
}


@pytest.mark.parametrize("name", FILES)
def test_binary_files_are_known_by_their_content(tmp_path: Path, name: str) -> None:
    FILES[name](ROWS, tmp_path / name)
    read = read_table(tmp_path / name, texts=["id"], numbers=["x"])
    assert list(read.texts["id"]) == ["a", "b"]
    assert read.numbers["x"].tolist() == [1.5, -2.0]
    assert read.notices == [f"{tmp_path / name}: ignored the column note"]


@pytest.mark.parametrize("kind", FRAMES)
def test_data_frames_of_any_library(kind: str) -> None:
    read = read_table(Frame.of("points", FRAMES[kind](ROWS)), texts=["id"], numbers=["x"])
    assert list(read.texts["id"]) == ["a", "b"]
    assert read.numbers["x"].tolist() == [1.5, -2.0]
    assert len(read) == 2
    assert read.notices == ["points: ignored the column note"]


def test_a_frame_of_polars() -> None:
    polars = pytest.importorskip("polars", reason="polars is not installed")
    data = polars.DataFrame({"id": ["a", "b"], "x": [1, 2], "kind": ["u", "u"]})
    frame = Frame.of("points", data.with_columns(polars.col("kind").cast(polars.Categorical)))
    read = read_table(frame, texts=["id", "kind"], numbers=["x"])
    assert (list(read.texts["id"]), list(read.texts["kind"])) == (["a", "b"], ["u", "u"])
    assert read.numbers["x"].tolist() == [1.0, 2.0]


def test_a_frame_of_pandas() -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    data = pandas.DataFrame({"id": ["a", "b"], "x": [1, 2]}, index=[7, 9])
    read = read_table(Frame.of("points", data), texts=["id"], numbers=["x"])
    assert read.numbers["x"].tolist() == [1.0, 2.0]
    assert read.notices == []
    with pytest.raises(InputError, match="points, row 1, column x: found an empty cell"):
        read_table(Frame.of("points", pandas.DataFrame({"x": [1.0, np.nan, 2.0]})), numbers=["x"])


@pytest.mark.parametrize(
    "values",
    [
        pa.array([1, 2], pa.int8()),
        pa.array([1, 2], pa.float32()),
        pa.array([decimal.Decimal("1.0"), decimal.Decimal("2.0")]),
        pa.array(["1", " 2.0 "]),
        pa.array(["1", "2"], pa.large_string()),
        pa.array(["1", "2"]).dictionary_encode(),
    ],
    ids=lambda values: str(values.type),
)
def test_types_that_are_numbers(values: pa.Array) -> None:
    assert read_table(Frame.of("t", {"x": values}), numbers=["x"]).numbers["x"].tolist() == [1.0, 2.0]


UTC = dt.timezone.utc  # noqa: UP017 (Arrow wants the older name)


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        (pa.array([7, 8]), ["7", "8"]),
        (pa.array(["u", "v"]).dictionary_encode(), ["u", "v"]),
        (
            pa.array([dt.datetime(2020, 1, 1, 0, 0, 1, 500_000), dt.datetime(2020, 1, 2)]),
            ["2020-01-01 00:00:01.500000", "2020-01-02 00:00:00.000000"],
        ),
        (
            pa.array([dt.datetime(2020, 1, 1, tzinfo=UTC)], pa.timestamp("s", "UTC")),
            ["2020-01-01 00:00:00Z"],
        ),
    ],
    ids=["whole", "category", "time", "time-utc"],
)
def test_types_that_are_names_or_times(values: pa.Array, texts: list[str]) -> None:
    assert list(read_table(Frame.of("t", {"x": values}), texts=["x"]).texts["x"]) == texts


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"id": ["a", "b"], "x": [1.0, None]}, "t, row 1, column x: found an empty cell, wanted a finite"),
        ({"id": ["a", "b"], "x": np.array([1.0, np.inf])}, "t, row 1, column x: found inf, wanted a finite"),
        ({"id": ["a", "b"], "x": ["1", "1_0"]}, 't, row 1, column x: found "1_0", wanted a finite'),
        ({"id": ["a", "b"], "x": ["1", None]}, "t, row 1, column x: found an empty cell"),
        (
            {"id": ["a", "b"], "x": [True, False]},
            "t, column x: found values of the type bool, wanted numbers",
        ),
        (
            {"id": ["a", None], "x": [1, 2]},
            "t, row 1, column id: found an empty cell, wanted text in every row",
        ),
        (
            {"id": ["a", " "], "x": [1, 2]},
            "t, row 1, column id: found an empty cell, wanted text in every row",
        ),
        (
            {"id": ["a", "\x1b[31mb"], "x": [1, 2]},
            't, row 1, column id: found "\\x1b[31mb", wanted text without control characters',
        ),
        ({"id": [[1], [2]], "x": [1, 2]}, "t, column id: found values of the type list"),
        ({"id": [], "x": []}, "t: found no rows, wanted at least one"),
        ({"id": ["a"], "X": [1]}, 't: found the header "id, X", wanted the column x too (did you mean "X"?)'),
        ({}, "t: found no header, wanted the columns id, x"),
        ({"id": ["a"], "x": [1, 2]}, "t: found columns that Arrow cannot hold"),
    ],
)
def test_wrong_frames(columns: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError) as caught:
        read_table(Frame.of("t", columns), texts=["id"], numbers=["x"])
    assert says in str(caught.value)


def test_what_is_no_frame() -> None:
    with pytest.raises(InputError, match='t: found "int", wanted a data frame'):
        Frame.of("t", 3)


@pytest.mark.parametrize("name", ["t.parquet", "t.arrow", "t.stream.arrow"])
def test_a_damaged_file(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    FILES[name](ROWS, path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputError, match=r"arrow|parquet: found a damaged \w+") as caught:
        read_table(path, texts=["id"])
    assert str(caught.value).isprintable()


def test_a_feather_file_of_the_first_version(tmp_path: Path) -> None:
    path = tmp_path / "t.feather"
    path.write_bytes(b"FEA1 and so on")
    with pytest.raises(InputError, match="Feather version 1, wanted Parquet, Arrow or Feather version 2"):
        read_table(path, texts=["id"])


def test_digests_are_those_of_the_content() -> None:
    base = Frame.of("t", {"x": [1.0, 2.0], "y": ["a", "b"]}).fingerprint()
    chunked = pa.table({"x": pa.chunked_array([[1.0], [2.0]]), "y": pa.chunked_array([["a"], ["b"]])})
    assert Frame.of("other", chunked.replace_schema_metadata({"made": "by hand"})).fingerprint() == base
    assert Frame.of("t", {"x": [1.0, 2.5], "y": ["a", "b"]}).fingerprint() != base
    assert Frame.of("t", {"z": [1.0, 2.0], "y": ["a", "b"]}).fingerprint() != base


# --- whole campaigns -----------------------------------------------------------------------------------------

TABLES = ("ephemeris", "attitude", "landmarks", "images", "observations")


def frames(folder: Path) -> dict[str, pa.Table]:
    """The tables of a campaign as columns of numbers and texts."""
    from pyarrow import csv

    keep = csv.ConvertOptions(column_types={"time": pa.string()})
    return {name: csv.read_csv(folder / f"{name}.csv", convert_options=keep) for name in TABLES}


def settings(path: Path) -> dict[str, Any]:
    import tomllib

    return tomllib.loads(path.read_text())


def require_alike(found: Any, wanted: Any) -> None:
    assert found.campaign.images.ids == wanted.campaign.images.ids
    assert found.campaign.landmarks.ids == wanted.campaign.landmarks.ids
    np.testing.assert_array_equal(found.campaign.sightings.landmark, wanted.campaign.sightings.landmark)
    np.testing.assert_array_equal(found.campaign.sightings.column_px, wanted.campaign.sightings.column_px)
    np.testing.assert_array_equal(found.campaign.landmarks.r_J, wanted.campaign.landmarks.r_J)
    np.testing.assert_array_equal(found.campaign.ephemeris.t_ns, wanted.campaign.ephemeris.t_ns)
    np.testing.assert_array_equal(found.campaign.attitude.q_EF, wanted.campaign.attitude.q_EF)


@pytest.mark.parametrize("kind", FRAMES)
def test_a_campaign_from_data_frames(tmp_path: Path, kind: str) -> None:
    path = write_good_campaign(tmp_path)
    tables = {name: FRAMES[kind](table) for name, table in frames(tmp_path).items()}
    document = settings(path)
    for name in TABLES:
        del document[name]["file"]
    for name in ("landmarks", "images", "observations"):
        del document[name]
    found = load_campaign(document, tables)
    require_alike(found, load_campaign(path))
    names = {f"{name} data frame" for name in TABLES}
    assert set(found.inputs) == {"settings", *names}
    assert all(digest.startswith("sha256:") for digest in found.inputs.values())


def test_a_table_goes_before_the_file_that_the_settings_name(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path)
    changed = frames(tmp_path)["observations"].slice(0, 3)
    (tmp_path / "observations.csv").unlink()
    found = load_campaign(path, {"observations": changed, "images": None})
    assert found.campaign.sightings.image.size == 3
    assert set(found.inputs) >= {"campaign.toml", "observations data frame", "images.csv"}


@pytest.mark.parametrize("name", ["t.parquet", "t.arrow", "t.feather"])
def test_a_campaign_of_binary_tables(tmp_path: Path, name: str) -> None:
    wanted = load_campaign(write_good_campaign(tmp_path))
    path = tmp_path / "campaign.toml"
    for table, rows in frames(tmp_path).items():
        FILES[name](rows, (tmp_path / table).with_suffix(Path(name).suffix))
        (tmp_path / f"{table}.csv").unlink()
    path.write_text(path.read_text().replace(".csv", Path(name).suffix))
    require_alike(load_campaign(path), wanted)


def test_paths_in_place_of_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_good_campaign(tmp_path / "good")
    document = settings(path)
    for name in TABLES:
        document[name].pop("file")
    monkeypatch.chdir(tmp_path)
    tables = {name: f"good/{name}.csv" for name in TABLES}
    require_alike(load_campaign(document, tables), load_campaign(path))
    for name in TABLES:
        document[name]["file"] = tables[name]
    require_alike(load_campaign(document), load_campaign(path))


def test_settings_may_hold_arrays(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path)
    document = settings(path)
    document["mounting"]["quaternion_xyzw"] = np.array([0.0, 0.0, 0.0, 1.0])
    document["ephemeris"]["sigma_m"] = np.float64(3.0)
    for name in TABLES:
        document[name]["file"] = tmp_path / f"{name}.csv"
    require_alike(load_campaign(document), load_campaign(path))


def test_mistakes_in_frames_name_table_row_and_column(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path)
    attitude = frames(tmp_path)["attitude"].to_pydict()
    attitude["qx"][2] = None
    with pytest.raises(
        InputError, match=r"^attitude data frame, row 2, column qx: found an empty cell, wanted"
    ):
        load_campaign(path, {"attitude": attitude})
    landmarks = frames(tmp_path)["landmarks"].to_pydict()
    landmarks["latitude_deg"][1] = 95
    with pytest.raises(
        InputError, match=r"^landmarks data frame, row 1, column latitude_deg: found 95, wanted"
    ):
        load_campaign(path, {"landmarks": landmarks})


def test_mistakes_in_settings_name_the_key(tmp_path: Path) -> None:
    document = settings(write_good_campaign(tmp_path))
    document["camera"]["focal_length_mm"] = -1.0
    with pytest.raises(InputError, match=r"settings: camera.focal_length_mm: found -1.0, wanted a positive"):
        load_campaign(document)
    del document["images"]
    with pytest.raises(InputError, match="images: missing, wanted the section"):
        load_campaign(document)


def test_an_unknown_table(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path)
    with pytest.raises(InputError, match=r'tables: found "landmark", wanted .* \(did you mean landmarks\?\)'):
        load_campaign(path, {"landmark": ROWS})


def test_frames_of_trackers_and_look_angles(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path)
    document = settings(path)
    attitude = document.pop("attitude")
    document["trackers"] = [{key: value for key, value in attitude.items() if key != "file"}]
    document["fusion"] = {"frame": "star_tracker"}
    for name in ("ephemeris", "landmarks", "images", "observations"):
        document[name]["file"] = str(tmp_path / f"{name}.csv")
    found = load_campaign(document, {"trackers.0": frames(tmp_path)["attitude"]})
    assert found.campaign.attitude.trackers[0].attitude.name == "trackers.0 data frame"
    camera = {"model": "line-scan"}
    document["camera"] = camera
    detectors = {"column_px": [0, 6000, 11999], "tan_x": [-0.02, 0.0, 0.02], "tan_y": [0.0, 0.0]}
    with pytest.raises(InputError, match="look_angles data frame: found columns that Arrow cannot hold"):
        load_campaign(document, {"trackers.0": frames(tmp_path)["attitude"], "look_angles": detectors})


def test_a_column_that_is_not_what_its_schema_says(tmp_path: Path) -> None:
    """Arrow ends the program where such a column is asked for by itself."""
    path = tmp_path / "t.parquet"
    parquet.write_table(pa.table({"id": ["a"], "x": [1.5]}), path)
    optional, required = (b"\x25" + kind + b"\x18\x01x" for kind in (b"\x02", b"\x00"))
    data = path.read_bytes()
    assert data.count(optional) == 1
    path.write_bytes(data.replace(optional, required))
    with pytest.raises(InputError, match=r"t\.parquet: found a damaged Parquet file .*wanted a whole one"):
        read_table(path, texts=("id",), numbers=("x",))
