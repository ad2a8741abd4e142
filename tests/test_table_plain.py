"""The quick reader of large CSV files: what it takes it reads as the row by row one does, which is the oracle here."""

from __future__ import annotations

import gzip
import re
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from starplumb.io.tables import csv_rows, csv_tables, pieces
from starplumb.io.tables import read as table_read
from starplumb.io.tables.arrow import plain_rows
from starplumb.io.tables.cells import Columns, Part
from starplumb.io.tables.csv_tables import read_csv
from starplumb.io.tables.schema import Schema
from starplumb.physics.errors import InputError

SCHEMA = Schema(("id",), ("x",), ("name",), ("y",))


HEAD = "id,x,note\n"


def written(folder: Path, content: str | bytes) -> Path:
    path = folder / "t.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def carefully(path: Path, schema: Schema = SCHEMA) -> Columns | str:
    """What the careful reader finds, or its complaint."""
    try:
        return read_csv(path, schema, quick=False)
    except InputError as error:
        return str(error)


def quickly(path: Path, schema: Schema = SCHEMA) -> Columns | None:
    """What the quick reader finds in a file that counts as large; None where it leaves a piece to the careful one."""
    took = []

    def watched(*of: Any) -> Part | None:
        part = plain_rows(*of)
        took.append(part is not None)
        return part

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(csv_tables, "LARGE", 0)
        patch.setattr(csv_tables, "plain_rows", watched)
        try:
            found = read_csv(path, schema)
        except InputError:
            return None
    return found if took and all(took) else None


def require_same(found: Columns, wanted: Columns | str) -> None:
    assert isinstance(wanted, Columns), f"accepted what is refused: {wanted}"
    assert found.header == wanted.header
    assert {name: list(texts) for name, texts in found.texts.items()} == wanted.texts
    assert list(found.numbers) == list(wanted.numbers)
    for name, values in wanted.numbers.items():
        assert found.numbers[name].tobytes() == values.tobytes()
        assert found.numbers[name].dtype == values.dtype
    assert found.rows == wanted.rows
    assert list(map(found.row_number, range(found.rows))) == list(map(wanted.row_number, range(wanted.rows)))


PLAIN = {
    "plain": HEAD + "a,1.5,\nb,-2,seen\n",
    "no last end": HEAD + "a,1.5,",
    "CRLF": (HEAD + "a,1.5,\nb,2,x\n").replace("\n", "\r\n"),
    "mark": "\ufeff" + HEAD + "a,1,\n",
    "comments above": "# one\n\n  # two\n" + HEAD + "a,1,\n",
    "hash inside": HEAD + "#a,1,#\n",
    "blanks around": " id , x , y \n a b , 1.5 ,  2 \n",
    "empty end": HEAD + "a,1,\n\n\n",
    "accents above": "# Z\u00fcrich\nid,x,h\u00f6he\na,1,\n",
    "only text": "id,x\na b,1\n",
    "long names": HEAD + "".join(f"{'n' * k},{k},{'z' * k}\n" for k in range(1, 900)),
    "digits": HEAD
    + "a,0.1000000000000000055511151231257827021181583404541015625,\nb,4.9e-324,\nc,1e-400,\nd,-0,\n",
    "CR above": "# one\r" + HEAD + "a,1,\n",
    "line separator above": "# \u2028\n" + HEAD + "a,1,\n",
    "blank line": HEAD + "a,1,\n\nb,2,\n",
    "CR only": (HEAD + "a,1,\n").replace("\n", "\r"),
    "one CR": HEAD + "a,1,\rb,2,\n",
    "CR CR LF": HEAD + "a,1,\r\r\n",
    "no-break space in text": HEAD + "\u00a0a,1.5,\n",
    "accent": HEAD + "Z\u00fcrich,1,\n",
    "accent ignored": HEAD + "a,1,Z\u00fcrich\n",
    "tab": HEAD + "a\tb,1,\n",
    "separator": HEAD + "\x1ca,1,\n",
    "quotes": HEAD + '"a",1,\n"b,c","2.5",""\n',
    "quotes at the end": 'x,id\r\n1,"a\'b"\r\n2,"c"',
    "quoted header": '"id",x\na,1\n',
    "quoted header ignored": 'id,x,"note"\na,1,\n',
    "forms": HEAD + "a,+1,\nb,.5,\nc,5.,\nd,1E+05,\ne,00012,\n",
}
"""Tables that the quick reader should take, since ordinary ones look like that."""

UNUSUAL = {
    "blank end": HEAD + "a,1,\n\n  \n\n",
    "doubled quotes": HEAD + '"a""b",1,\n',
    "blank before quotes": HEAD + 'a,1, "b,c"\n',
    "quotes not closed at once": HEAD + '"a"b,1,"c"\n',
    "line end in quotes": HEAD + '"a\nb",1,\n',
    "quotes not closed": HEAD + '"a,1,\n',
    "quote inside": HEAD + 'a"b,1,\n',
    "NUL above": "# \0\n" + HEAD + "a,1,\n",
    "null": HEAD + "a,null,\n",
    "NA": HEAD + "a,NA,\n",
    "line of blanks": HEAD + "a,1,\n  \nb,2,\n",
    "underscore": HEAD + "a,1_000,\n",
    "infinite": HEAD + "a,inf,\n",
    "not a number": HEAD + "a,NaN,\n",
    "too large": HEAD + "a,1e999,\n",
    "hexadecimal": HEAD + "a,0x10,\n",
    "Fortran": HEAD + "a,1d5,\n",
    "complex": HEAD + "a,1j,\n",
    "words": HEAD + "a,one,\n",
    "two numbers": HEAD + "a,1 2,\n",
    "other digits": HEAD + "a,\u0661,\n",
    "no-break space": HEAD + "a,\u00a01.5,\n",
    "vertical tab": HEAD + "a,1\x0b,\n",
    "NUL": HEAD + "a\0,1,\n",
    "empty number": HEAD + "a,,\n",
    "blank number": HEAD + "a, ,\n",
    "empty text": HEAD + ",1,\n",
    "blank text": HEAD + "  ,1,\n",
    "short row": HEAD + "a,1\n",
    "long row": HEAD + "a,1,,\n",
    "comment inside": HEAD + "a,1,\n# two\nb,2,\n",
    "decimal comma": HEAD + "a,1,5,\n",
    "semicolons": "id;x\na;1\n",
    "tabs": "id\tx\na\t1\n",
    "doubled": "id,x,x\na,1,2\n",
    "lacking": "id,y\na,1\n",
    "no rows": HEAD,
    "blank rows only": HEAD + "\n\n",
    "nothing": "",
    "comments only": "# one\n# two\n",
    "not UTF-8": (HEAD + "Z\u00fcrich,1,\n").encode("latin-1"),
    "not UTF-8 above": "# Z\u00fcrich\n".encode("latin-1") + (HEAD + "a,1,\n").encode(),
    "UTF-16": (HEAD + "a,1,\n").encode("utf-16"),
    "very long header": f"id,x,{'a' * 132_000}\nb,2,\n",
}
"""Tables that must be left to the careful reader, which accepts some of them and refuses others."""


@pytest.mark.parametrize("name", PLAIN)
def test_plain_tables_are_taken_and_read_alike(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, PLAIN[name])
    found = quickly(path, SCHEMA)
    assert found is not None
    require_same(found, carefully(path))


@pytest.mark.parametrize("name", UNUSUAL)
def test_whatever_is_unusual_is_left_to_the_careful_reader(tmp_path: Path, name: str) -> None:
    assert quickly(written(tmp_path, UNUSUAL[name]), SCHEMA) is None


def test_one_column_of_text(tmp_path: Path) -> None:
    schema = Schema(("id",), ())
    for content in ("id\n \n", "id\na\n \nb\n"):
        assert quickly(written(tmp_path, content), schema) is None
    for content in ("id\na b\nc\n\n", "id\n\na\n"):
        path = written(tmp_path, content)
        found = quickly(path, schema)
        assert found is not None
        require_same(found, carefully(path, schema))


def test_a_file_that_is_not_there_is_left_to_the_careful_reader(tmp_path: Path) -> None:
    assert quickly(tmp_path / "none.csv", SCHEMA) is None
    assert quickly(tmp_path, SCHEMA) is None


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\n\n"])
def test_pieces_join_without_a_seam(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str) -> None:
    """Rows that are quick and rows that are not, cells of several lines across the seams, in pieces of 200 bytes."""
    cells = ["x", "", '"a\nb"', '"\n"', '"c, ""d"""']
    rows = [f"{'n' * (1 + i % 30)},{i / 7!r},{cells[i % 5] if i % 40 < 20 else 'x'}" for i in range(600)]
    path = written(tmp_path, end.join(["# '\"'", "id,x,note", *rows, "", ""]))
    expected = carefully(path)
    assert isinstance(expected, Columns)
    monkeypatch.setattr(csv_tables, "LARGE", 0)
    monkeypatch.setattr(pieces, "PIECE", 200)
    for held in (10**9, 3_000):
        monkeypatch.setattr(csv_tables, "MOST_HELD", held)
        require_same(read_csv(path, SCHEMA), expected)
        require_same(read_csv(path, SCHEMA, quick=False), expected)
    packed = tmp_path / "t.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    require_same(read_csv(packed, SCHEMA), expected)


@pytest.mark.parametrize(
    ("row", "complaint"),
    [
        (b"c,x,\n", 'row 502, column x: found "x"'),
        (b"c,1\n", "row 502: found 2 cells"),
        (b"c,1,\0\n", "line 502: found a NUL byte"),
        (b"c,1,\xff\n", "line 502: found the byte 0xFF"),
        (b'"c,1,\n', "row 502: found text that is not CSV"),
        (b"," * 300, "found a line of more than 200 bytes"),
    ],
)
def test_a_fault_in_a_late_piece_names_the_line_before_memory_is_filled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, row: bytes, complaint: str
) -> None:
    monkeypatch.setattr(csv_tables, "LARGE", 0)
    monkeypatch.setattr(pieces, "PIECE", 200)
    monkeypatch.setattr(csv_tables, "MOST_HELD", 1_000)
    held = []
    monkeypatch.setattr(csv_tables, "joined", held.append)
    path = written(tmp_path, HEAD.encode() + b"a,1,b\n" * 500 + row)
    with pytest.raises(InputError, match=rf"t\.csv(, |: ){re.escape(complaint)}"):
        read_csv(path, SCHEMA)
    assert held == []


@pytest.mark.parametrize("quick", [True, False])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_rows_between_blank_lines_have_the_lines_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str, quick: bool
) -> None:
    monkeypatch.setattr(csv_tables, "LARGE", 0)
    path = written(tmp_path, end.join([HEAD.strip(), "", "a,1,b", "", "", "c,2,d", "e,3,f", "", "g,4,h"]))
    found = read_csv(path, SCHEMA, quick=quick)
    assert [found.row_number(i) for i in range(4)] == [3, 6, 7, 9]


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        ("a,1,b\n" + 30 * "\n", ": found more than 20 blank lines, wanted rows"),
        ("a,1,b\n" + 30 * "\r", ": found more than 20 blank lines, wanted rows"),
        (300 * " \n", ": found more than 20 blank lines, wanted rows"),
        ("a,1,b\n" + 30 * ",,\n", ", row 3: found 30 rows of empty cells from here on"),
        (
            f"a,1,{40 * (chr(34) + 8 * 'x' + chr(10) + chr(34) + ',')}",
            ", row 2: found a row of more than 200 bytes",
        ),
        ('a,1,"b\nc,2,d\n\ne,3,f\n', ", row 2: found text that is not CSV (unexpected end of data)"),
        ('a,1,b\nc,"2"x,d\n', ", row 3: found text that is not CSV"),
    ],
)
def test_what_is_no_table_ends_early_at_the_row_that_has_the_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: str, complaint: str
) -> None:
    for name, module, value in (
        ("LARGE", csv_tables, 0),
        ("PIECE", pieces, 200),
        ("PIECE", csv_tables, 200),
        ("MOST_BLANK", csv_tables, 20),
        ("MOST_EMPTY", csv_rows, 1000),
    ):
        monkeypatch.setattr(module, name, value)
    with pytest.raises(InputError, match=rf"t\.csv{re.escape(complaint)}"):
        read_csv(written(tmp_path, HEAD + rows), SCHEMA)


def test_a_fault_in_a_large_file_has_the_sentence_of_a_small_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_tables, "LARGE", 0)
    path = written(tmp_path, HEAD + "\na,1,\n\nb,two,\n")
    with pytest.raises(InputError, match=r't\.csv, row 5, column x: found "two", wanted a finite number'):
        table_read.read_table(path, texts=["id"], numbers=["x"])


def test_a_later_complaint_about_a_large_file_names_the_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_tables, "LARGE", 0)
    path = written(tmp_path, "# by hand\n" + HEAD + "\na,1,\n\nb,2,\na,3,\n")
    table = table_read.read_table(path, texts=["id"], numbers=["x"])
    with pytest.raises(InputError, match=r"t\.csv, row 6, column x: found 2, wanted 1"):
        table.require(table.numbers["x"] == [1.0, 1.0, 3.0], "x", "1")
    with pytest.raises(InputError, match=r'row 7, column id: found "a" again \(first in row 4\)'):
        table.require_distinct("id", "each once")


NASTY = [
    *"a1#'\".",
    "-0",
    "1e5",
    "1_0",
    "inf",
    "nan",
    "0x1",
    "1d5",
    "1j",
    "--1",
    "1e",
    "e1",
    "+.5",
    "1.e3",
    "a" * 16,
]
NASTY += ["", " ", "1 2", "\t1", "1\x0b", "\u00a01", "\u0661", "1\u2028", "\x1c1", "\x851", "\r"]
CELL = st.one_of(
    st.sampled_from(NASTY),
    st.floats().map(repr),
    st.floats(allow_nan=False, allow_infinity=False).map(lambda x: f" {x:.30g} "),
    st.text(st.sampled_from("0123456789+-.eE_ nif"), min_size=1, max_size=12),
    st.text(max_size=4),
)
GOOD = st.floats(-1e12, 1e12).map(lambda x: f"{x:.6g}")
ROW = st.one_of(
    st.tuples(st.sampled_from(["a", "b c", "d"]), GOOD, st.sampled_from(["", "n"])).map(",".join),
    st.tuples(st.sampled_from(["a", " b "]), CELL, st.just("")).map(",".join),
    st.tuples(CELL, GOOD, st.just("")).map(",".join),
    st.lists(CELL, max_size=4).map(",".join),
)
END = st.sampled_from(["\n"] * 8 + ["\r\n", "\r", "\n\n", "\n \n"])


@pytest.mark.slow
@settings(max_examples=600, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    head=st.sampled_from(
        [HEAD] * 8 + ["# c\n" + HEAD, "\ufeff" + HEAD, "x,id\n", " id,x \n", "id,x,id\n", "x\n"]
    ),
    rows=st.lists(st.tuples(ROW, END), max_size=4),
)
@example(head=HEAD, rows=[("a,\u00a01.5,", "\n")])
@example(head=HEAD, rows=[("a,1,", "\n \n"), ("b,2,", "\n")])
def test_what_is_taken_is_read_alike(tmp_path: Path, head: str, rows: list[tuple[str, str]]) -> None:
    content = head + "".join(row + end for row, end in rows)
    path = written(tmp_path, content.encode("utf-8", "surrogatepass"))
    found = quickly(path, SCHEMA)
    if found is not None:
        require_same(found, carefully(path))


@pytest.mark.slow
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=st.lists(st.floats(-9e74, 9e74), min_size=1, max_size=30))
def test_numbers_are_those_of_python(tmp_path: Path, values: list[float]) -> None:
    path = written(tmp_path, "x\n" + "".join(f"{value!r}\n" for value in values))
    found = quickly(path, Schema((), ("x",)))
    assert found is not None
    assert found.numbers["x"].tobytes() == np.array(values).tobytes()


@pytest.mark.parametrize(("bytes_more", "quick"), [(1, 0), (0, 1)])
def test_large_files_are_read_by_pyarrow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bytes_more: int, quick: int
) -> None:
    path = written(tmp_path, HEAD + "a,1,\n")
    monkeypatch.setattr(csv_tables, "LARGE", len("a,1,\n") + bytes_more)
    calls = []
    monkeypatch.setattr(csv_tables, "plain_rows", lambda *of: calls.append(of))
    assert list(table_read.read_table(path, texts=["id"], numbers=["x"]).texts["id"]) == ["a"]
    assert len(calls) == quick


def test_the_text_is_never_in_memory_as_a_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "PIECE", 1 << 18)
    quickly(written(tmp_path, PLAIN["plain"]))  # PyArrow is imported now
    path = written(tmp_path, "x,note\n" + f"1.25,{'n' * 90}\n" * 400_000)
    tracemalloc.start()
    try:
        found = quickly(path, Schema((), ("x",)))
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert found is not None
    assert path.stat().st_size > 38e6
    assert 3.2e6 < most < 12e6  # of which 3.2 MB are the answer
