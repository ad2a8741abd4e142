"""CSV tables in, results out: what is accepted, where a fault is placed, and that no file is ever half written."""

from __future__ import annotations

import errno
import gc
import json
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starplumb.io.tables.arrow import TextColumn
from starplumb.io.tables.lookup import places
from starplumb.io.tables.read import read_table
from starplumb.io.text.files import fingerprint, nearest, read_text, show
from starplumb.io.text.write import csv_pieces, csv_text, json_text, publish, write_text
from starplumb.physics.errors import InputError

PLAIN = "id,x,y\na,1.5,-2\nb,+3e2,.5\n"


def table(folder: Path, content: str | bytes) -> Path:
    path = folder / "t.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(
    "content",
    [
        PLAIN,
        "\ufeff" + PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN.rstrip("\n"),
        PLAIN + "\n\n  \n",
        "# made by hand\n\n# twice\n" + PLAIN,
        " id , x, y \n a , 1.5 ,-2\nb,  +3e2, .5 \n",
        'id,"x",y\n"a",1.5,-2\nb,"+3e2",.5\n',
        PLAIN.replace("\nb", "\n\nb"),
    ],
    ids=[
        "plain",
        "bom",
        "crlf",
        "cr",
        "no-last-end",
        "blank-end",
        "comments",
        "blanks",
        "quotes",
        "blank-inside",
    ],
)
def test_accepted_forms_read_alike(tmp_path: Path, content: str) -> None:
    read = read_table(table(tmp_path, content), texts=["id"], numbers=["x", "y"])
    assert read.texts["id"] == ["a", "b"]
    np.testing.assert_array_equal(read.columns("x", "y"), [[1.5, -2.0], [300.0, 0.5]])
    assert read.notices == []


def test_columns_may_stand_in_any_order_and_extra_ones_are_told_once(tmp_path: Path) -> None:
    read = read_table(table(tmp_path, "note,y,id,x,\nfine,2,a,1,\n"), texts=["id"], numbers=["x", "y"])
    np.testing.assert_array_equal(read.columns("x", "y"), [[1.0, 2.0]])
    assert [notice.split(": ")[1] for notice in read.notices] == ["ignored the columns note, (unnamed)"]


def test_lines_are_those_of_the_file(tmp_path: Path) -> None:
    content = '# one\n# two\nid,x\na,1\n\nb,2\n"c\nd",3\ne,4\n'
    read = read_table(table(tmp_path, content), texts=["id"], numbers=["x"])
    assert [read.row_number(row) for row in range(4)] == [4, 6, 8, 9]


@pytest.mark.slow
@pytest.mark.parametrize("row", [0, 1023, 1024, 5000, 99_999])
@pytest.mark.parametrize(
    ("bad", "found"),
    [("7,x", '"x"'), ("7,", "an empty cell"), ("7", "found 1 cell"), ("7,8,9", "found 3 cells")],
)
def test_fault_is_placed_in_a_long_table(tmp_path: Path, row: int, bad: str, found: str) -> None:
    lines = ["7,8.25"] * 100_000
    lines[row] = bad
    with pytest.raises(InputError, match=f"t.csv, row {row + 2}[,:]") as caught:
        read_table(table(tmp_path, "id,x\n" + "\n".join(lines)), texts=["id"], numbers=["x"])
    assert found in str(caught.value)


def test_long_table_agrees_with_python_floats_bit_for_bit(tmp_path: Path, rng: np.random.Generator) -> None:
    x = rng.normal(size=30_000) * 10.0 ** rng.integers(-300, 74, 30_000)
    read = read_table(table(tmp_path, csv_text(["x"], [x])), numbers=["x"])
    np.testing.assert_array_equal(read.numbers["x"], x)
    assert gc.isenabled()


def test_collector_runs_again_after_a_fault(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_table(table(tmp_path, "x\nfault\n"), numbers=["x"])
    assert gc.isenabled()


def test_half_a_group_of_columns_is_refused(tmp_path: Path) -> None:
    read = read_table(table(tmp_path, "x,y\n1,2\n"), optional_numbers=["x", "y", "z"])
    assert read.has("x", "y")
    assert not read.has("z")
    with pytest.raises(InputError, match="the column x without z"):
        read.has("x", "z")


def test_file_without_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = table(tmp_path, PLAIN)

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(InputError, match=r"t\.csv: found a file that may not be read"):
        read_text(path)


@pytest.mark.parametrize("name", ["a\0b.csv", "x" * 300 + ".csv", "t.csv/inside.csv"])
def test_impossible_names(tmp_path: Path, name: str) -> None:
    table(tmp_path, PLAIN)
    with pytest.raises(InputError, match="wanted a readable file"):
        read_text(tmp_path / name)


def test_show_is_one_short_line() -> None:
    assert show("a\n\tb\x1b[31m") == r'"a\n\tb\x1b[31m"'
    assert show(True) == "true"
    assert show([1, "b", [2.5]]) == '[1, "b", [2.5]]'
    assert len(show("y" * 500)) <= 62
    assert len(show(list(range(1000)))) <= 60


def test_nearest_ignores_case() -> None:
    assert nearest("Latitude", ["longitude_deg", "latitude_deg"]) == "latitude_deg"
    assert nearest("zzz", ["latitude_deg"]) is None


def test_fingerprint_is_sha256(tmp_path: Path) -> None:
    # the published digest of the three bytes "abc" (FIPS 180-4, appendix)
    digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert fingerprint(table(tmp_path, "abc")) == f"sha256:{digest}"


def test_publish_replaces_whole_files(tmp_path: Path) -> None:
    publish(tmp_path / "new" / "folder", {"a": "one\n", "b": "two\n"})
    publish(tmp_path / "new" / "folder", {"a": "three\n"})
    assert {p.name: p.read_bytes() for p in (tmp_path / "new" / "folder").iterdir()} == {
        "a": b"three\n",
        "b": b"two\n",
    }


def test_publish_is_all_or_nothing(tmp_path: Path) -> None:
    write_text(tmp_path / "a", "old\n")
    (tmp_path / "b").mkdir()
    with pytest.raises(InputError, match="found no way to write there") as caught:
        publish(tmp_path, {"a": "new\n", "b": "new\n"})
    assert str(caught.value).isprintable()
    assert (tmp_path / "a").read_text() == "old\n"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b"]


def test_publish_where_a_file_stands(tmp_path: Path) -> None:
    write_text(tmp_path / "a", "old\n")
    with pytest.raises(InputError, match="wanted a place that can be written"):
        publish(tmp_path / "a", {"b": "new\n"})


def test_nothing_is_left_when_a_text_cannot_be_stored(tmp_path: Path) -> None:
    def full() -> Iterator[str]:
        yield "half"
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(InputError, match="no way to write there"):
        publish(tmp_path, {"a": "fine", "b": full()})
    assert list(tmp_path.iterdir()) == []


def test_csv_text_reads_back(tmp_path: Path) -> None:
    names, values = ["a,b", 'say "c"', "d\ne"], [0.1, 1e-300, np.float64(1.0) / 3.0]
    read = read_table(
        table(tmp_path, csv_text(["name", "value"], [names, values])), texts=["name"], numbers=["value"]
    )
    assert read.texts["name"] == names
    assert read.numbers["value"].tolist() == values
    with pytest.raises(ValueError, match="the column b has 0 rows, wanted 1"):
        csv_text(["a", "b"], [[1.0], []])


NAMES = st.text(st.sampled_from("ab \u00e9\U0001f6f0"), max_size=3)


@pytest.mark.slow
@given(known=st.lists(NAMES, unique=True), names=st.lists(NAMES))
def test_names_are_found_alike_in_a_list_and_in_arrow(known: list[str], names: list[str]) -> None:
    expected = [known.index(name) if name in known else -1 for name in names]
    assert places(names, tuple(known)).tolist() == expected
    assert places(TextColumn(pa.chunked_array([names], pa.string())), tuple(known)).tolist() == expected


@given(st.lists(st.lists(NAMES, max_size=3), max_size=3))
def test_a_column_of_texts_is_a_sequence(chunks: list[list[str]]) -> None:
    flat = [text for chunk in chunks for text in chunk]
    column = TextColumn(pa.chunked_array(chunks, pa.string()))
    assert len(column) == len(flat)
    assert list(column) == flat
    assert [column[i] for i in range(len(flat))] == flat
    assert column[1:3] == flat[1:3]
    assert column.all_differ() == (len(set(flat)) == len(flat))


@given(st.lists(st.floats(), min_size=1))
def test_written_floats_read_back_to_the_same_bits(values: list[float]) -> None:
    cells = csv_text(["x"], [np.array(values)]).splitlines()[1:]
    assert [repr(float(cell)) for cell in cells] == [repr(value) for value in values]


def test_masked_cells_are_empty_and_others_say_what_they_are() -> None:
    x = np.ma.masked_invalid([1.5, np.nan, np.inf])
    text = csv_text(["x", "y", "z"], [x, np.array([0.1, np.nan, -np.inf]), [1, True, "a"]])
    assert text == "x,y,z\n1.5,0.1,1\n,nan,True\n,-inf,a\n"


@pytest.mark.slow
def test_a_long_table_comes_in_pieces(tmp_path: Path) -> None:
    n = 100_000
    names = [f"n{i}" for i in range(n)]
    tracemalloc.start()
    publish(tmp_path, {"t.csv": csv_pieces(["name", *"abcdefgh"], [names, *[np.arange(n) / 7.0] * 8])})
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    size = (tmp_path / "t.csv").stat().st_size
    assert peak < 0.8 * size
    read = read_table(tmp_path / "t.csv", texts=["name"], numbers=["a", "h"])
    assert list(read.texts["name"]) == names
    np.testing.assert_array_equal(read.numbers["h"], np.arange(n) / 7.0)


def test_nothing_is_left_when_a_piece_fails(tmp_path: Path) -> None:
    def pieces():
        yield "one\n"
        raise ValueError("no more")

    with pytest.raises(ValueError, match="no more"):
        publish(tmp_path, {"a": "fine", "b": pieces()})
    assert list(tmp_path.iterdir()) == []


def test_json_text_has_no_nan() -> None:
    assert json.loads(json_text({"a": [1.5, None], "name": "Zürich"})) == {"a": [1.5, None], "name": "Zürich"}
    with pytest.raises(ValueError, match="JSON"):
        json_text({"a": float("nan")})


def test_a_matrix_stands_on_a_line_of_a_json_text_and_objects_an_entry_a_line() -> None:
    document = {
        "C": [[1.0, -0.5], [None, 2.0]],
        "rows": [{"é": "\u2028"}, {}],
        "none": [],
        "of": {"a": {"b": 1}},
    }
    lines = [
        "{",
        ' "C": [[1.0, -0.5], [null, 2.0]],',
        ' "rows": [',
        "  {",
        '   "é": "\u2028"',
        "  },",
        "  {}",
        " ],",
    ]
    lines += [' "none": [],', ' "of": {', '  "a": {', '   "b": 1', "  }", " }", "}", ""]
    assert json_text(document) == "\n".join(lines)
    assert json.loads(json_text(document)) == document
    with pytest.raises(ValueError, match="JSON"):
        json_text({"rows": [{"a": [float("inf")]}]})


@pytest.mark.parametrize("rows", [2, 40_000])
@pytest.mark.parametrize("letter", ["\x1b", "\x85", "\u202e"])
def test_a_name_that_a_terminal_would_obey_is_refused(tmp_path, letter, rows):
    path = table(tmp_path, "id,x,y\n" + "a,1,2\n" * rows + f"b{letter}c,1,2\n")
    with pytest.raises(
        InputError, match=rf"t.csv, row {rows + 2}, column id: found .*, wanted text without control"
    ):
        read_table(path, texts=["id"], numbers=["x", "y"])
