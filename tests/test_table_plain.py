"""The quick reader of plain tables: what it takes it reads as the careful one does, which is the oracle here."""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from starplumb.io.tables import parsers as table_parsers
from starplumb.io.tables import plain as table_plain
from starplumb.io.tables.header import Columns, Wanted
from starplumb.io.tables.plain import read_plain
from starplumb.io.tables.rows import read_rows
from starplumb.physics.errors import InputError

WANTED = Wanted(("id",), ("x",), ("name",), ("y",))
PARSERS = {"NumPy": table_parsers.numpy_parser, "PyArrow": table_parsers.arrow_parser}
Read = Callable[..., Columns | None]


@pytest.fixture(params=PARSERS)
def plainly(request: pytest.FixtureRequest) -> Read:
    """The quick reader with each parser, whatever the size of the file."""
    if request.param == "PyArrow":
        pytest.importorskip("pyarrow.csv", reason="pyarrow is not installed")
    make = PARSERS[request.param]

    def read(path: Path, wanted: Wanted = WANTED) -> Columns | None:
        return read_plain(path, wanted, lambda _, header, wanted: make(header, wanted))

    return read


HEAD = "id,x,note\n"


def written(folder: Path, content: str | bytes) -> Path:
    path = folder / "t.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def carefully(path: Path, wanted: Wanted = WANTED) -> Columns | str:
    """What the careful reader finds, or its complaint."""
    try:
        return read_rows(path, wanted)
    except InputError as error:
        return str(error)


def require_same(found: Columns, wanted: Columns | str) -> None:
    assert isinstance(wanted, Columns), f"accepted what is refused: {wanted}"
    assert found.header == wanted.header
    assert found.texts == wanted.texts
    assert list(found.numbers) == list(wanted.numbers)
    for name, values in wanted.numbers.items():
        assert found.numbers[name].tobytes() == values.tobytes()
        assert found.numbers[name].dtype == values.dtype
    assert found.line.tolist() == wanted.line.tolist()
    assert found.line.dtype == wanted.line.dtype


PLAIN = {
    "plain": HEAD + "a,1.5,\nb,-2,seen\n",
    "no last end": HEAD + "a,1.5,",
    "CRLF": (HEAD + "a,1.5,\nb,2,x\n").replace("\n", "\r\n"),
    "mark": "\ufeff" + HEAD + "a,1,\n",
    "comments above": "# one\n\n  # two\n" + HEAD + "a,1,\n",
    "hash inside": HEAD + "#a,1,#\n",
    "blanks around": " id , x , y \n a b , 1.5 ,  2 \n",
    "blank end": HEAD + "a,1,\n\n  \n\n",
    "accents above": "# Z\u00fcrich\nid,x,h\u00f6he\na,1,\n",
    "only text": "id,x\na b,1\n",
    "long names": HEAD + "".join(f"{'n' * k},{k},{'z' * k}\n" for k in range(1, 900)),
    "digits": HEAD
    + "a,0.1000000000000000055511151231257827021181583404541015625,\nb,4.9e-324,\nc,1e-400,\nd,-0,\n",
    "forms": HEAD + "a,+1,\nb,.5,\nc,5.,\nd,1E+05,\ne,00012,\n",
}
"""Tables that the quick reader should take, since ordinary ones look like that."""

UNUSUAL = {
    "quotes": HEAD + '"a",1,\n',
    "quote inside": HEAD + 'a"b,1,\n',
    "quoted header": '"id",x\na,1\n',
    "quoted header ignored": 'id,x,"note"\na,1,\n',
    "CR above": "# one\r" + HEAD + "a,1,\n",
    "NUL above": "# \0\n" + HEAD + "a,1,\n",
    "line separator above": "# \u2028\n" + HEAD + "a,1,\n",
    "null": HEAD + "a,null,\n",
    "NA": HEAD + "a,NA,\n",
    "blank line": HEAD + "a,1,\n\nb,2,\n",
    "line of blanks": HEAD + "a,1,\n  \nb,2,\n",
    "CR only": (HEAD + "a,1,\n").replace("\n", "\r"),
    "one CR": HEAD + "a,1,\rb,2,\n",
    "CR CR LF": HEAD + "a,1,\r\r\n",
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
    "no-break space in text": HEAD + "\u00a0a,1.5,\n",
    "accent": HEAD + "Z\u00fcrich,1,\n",
    "accent ignored": HEAD + "a,1,Z\u00fcrich\n",
    "tab": HEAD + "a\tb,1,\n",
    "vertical tab": HEAD + "a,1\x0b,\n",
    "separator": HEAD + "\x1ca,1,\n",
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
    "very long ignored": HEAD + f"a,1,{'a' * 132_000}\nb,2,\n",
    "very long header": f"id,x,{'a' * 132_000}\nb,2,\n",
}
"""Tables that must be left to the careful reader, which accepts some of them and refuses others."""


@pytest.mark.parametrize("name", PLAIN)
def test_plain_tables_are_taken_and_read_alike(plainly: Read, tmp_path: Path, name: str) -> None:
    path = written(tmp_path, PLAIN[name])
    found = plainly(path)
    assert found is not None
    require_same(found, carefully(path))


@pytest.mark.parametrize("name", UNUSUAL)
def test_whatever_is_unusual_is_left_to_the_careful_reader(plainly: Read, tmp_path: Path, name: str) -> None:
    assert plainly(written(tmp_path, UNUSUAL[name])) is None


def test_one_column_of_text(plainly: Read, tmp_path: Path) -> None:
    wanted = Wanted(("id",), ())
    for content in ("id\na\n \nb\n", "id\n \n", "id\n\na\n"):
        assert plainly(written(tmp_path, content), wanted) is None
    path = written(tmp_path, "id\na b\nc\n \n")
    found = plainly(path, wanted)
    assert found is not None
    require_same(found, carefully(path, wanted))


@pytest.mark.parametrize("length", [15, 16, 17, 63, 64, 900])
def test_texts_longer_than_the_first_are_not_cut(plainly: Read, tmp_path: Path, length: int) -> None:
    path = written(tmp_path, HEAD + f"abcdefgh,1,\n{'n' * length},2,\n")
    found = plainly(path)
    assert found is not None
    require_same(found, carefully(path))


def test_blank_lines_are_seen_where_no_column_is_wanted(plainly: Read, tmp_path: Path) -> None:
    assert plainly(written(tmp_path, "x\n1\n\n2\n"), Wanted((), ())) is None


def test_a_parser_that_drops_a_row_is_not_believed(tmp_path: Path) -> None:
    path = written(tmp_path, "id,x\na,1\nb,2\n")
    for parsed in (({"x": np.ones(1)}, {"id": ["a", "b"]}), ({"x": np.ones(2)}, {"id": ["a"]})):
        assert read_plain(path, WANTED, lambda *_, parsed=parsed: lambda _: parsed) is None


def test_a_file_that_is_not_there_is_left_to_the_careful_reader(plainly: Read, tmp_path: Path) -> None:
    assert plainly(tmp_path / "none.csv") is None
    assert plainly(tmp_path) is None


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 7, 1000, 1 << 17])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_pieces_join_without_a_seam(
    plainly: Read, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int, end: str
) -> None:
    rows = [f"{'n' * (1 + i % 40)},{i / 7!r},x" for i in range(3000)]
    path = written(tmp_path, end.join(["id,x,note", *rows, "", ""]))
    expected = carefully(path)
    monkeypatch.setattr(table_plain, "_BYTES", size)
    found = plainly(path)
    assert found is not None
    require_same(found, expected)


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
def test_what_is_taken_is_read_alike(
    plainly: Read, tmp_path: Path, head: str, rows: list[tuple[str, str]]
) -> None:
    content = head + "".join(row + end for row, end in rows)
    path = written(tmp_path, content.encode("utf-8", "surrogatepass"))
    found = plainly(path)
    if found is not None:
        require_same(found, carefully(path))


@pytest.mark.slow
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=30))
def test_numbers_are_those_of_python(plainly: Read, tmp_path: Path, values: list[float]) -> None:
    path = written(tmp_path, "x\n" + "".join(f"{value!r}\n" for value in values))
    found = plainly(path, Wanted((), ("x",)))
    assert found is not None
    assert found.numbers["x"].tobytes() == np.array(values).tobytes()


def test_large_files_are_parsed_by_pyarrow_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(table_parsers, "numpy_parser", lambda *_: made.append("NumPy"))
    monkeypatch.setattr(table_parsers, "arrow_parser", lambda *_: made.append("PyArrow"))
    for size in (100, table_parsers.WORTHWHILE):
        table_parsers.parser_for(size, ["x"], Wanted((), ("x",)))
    monkeypatch.undo()
    monkeypatch.setattr(table_parsers, "numpy_parser", lambda *_: made.append("NumPy"))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    table_parsers.parser_for(table_parsers.WORTHWHILE, ["x"], Wanted((), ("x",)))
    assert made == ["NumPy", "PyArrow", "NumPy"]


def test_the_text_is_never_in_memory_as_a_whole(plainly: Read, tmp_path: Path) -> None:
    path = written(tmp_path, "x,note\n" + f"1.25,{'n' * 90}\n" * 100_000)
    tracemalloc.start()
    found = plainly(path, Wanted((), ("x",)))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found is not None
    assert path.stat().st_size > 9e6
    assert peak < 5e6  # of which 1.6 MB are the answer
