"""Tables by PyArrow: large CSV files, Parquet and Arrow files, and data frames of any library.

PyArrow is imported where it is used: a small campaign of CSV files does without.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ..text.files import composed, show, trouble
from ..text.numbers import MOST_FINITE
from ..text.visible import IN_NAME, OBEYED
from .cells import NUMBER, PRINTABLE, Array, Columns, Part, cell_error, none_kept, to_numbers
from .pieces import line_ends
from .schema import Schema
from .unpacking import dictionaries, require_small_arrow, require_small_parquet, require_small_texts

_PIECE = 1 << 18
"""Bytes of CSV text that PyArrow converts at a time."""
_QUOTED = re.compile(rb'(?:(?<=[,\n\r])|\A)"[^"\r\n]*"(?=[,\r\n]|\Z)')
"""A cell in quotes that every parser of CSV reads alike."""
_OBEYED = bytes(code for code in OBEYED if code < 0x80 and code != ord("\r"))
_INDEX = re.compile(r"__index_level_\d+__")
"""The name that pandas gives the unnamed index of a data frame when it becomes a column."""
_BEGINNINGS = {
    b"PAR1": "Parquet",
    b"ARROW1": "Arrow",
    b"\xff\xff\xff\xff": "Arrow stream",
    b"FEA1": "Feather 1",
    b"PK\x03\x04": "Excel",
}


class TextColumn(Sequence[str]):
    """Texts (n,) that stay in PyArrow's memory, a fifth of what Python strings take."""

    def __init__(self, column: Any) -> None:
        self.column = column

    def __len__(self) -> int:
        return len(self.column)

    def __getitem__(self, row: Any) -> Any:
        if isinstance(row, slice):
            return self.column[row].to_pylist()
        return self.column[row].as_py()

    def __iter__(self) -> Iterator[str]:
        for chunk in self.column.chunks:
            yield from chunk.to_pylist()

    def all_differ(self) -> bool:
        """Whether no text occurs twice."""
        from pyarrow import compute

        return bool(compute.count_distinct(self.column).as_py() == len(self))

    def places(self, known: Sequence[str]) -> NDArray[np.int64]:
        """Place (n,) of each text among the known ones, which are distinct; -1 for one that is not among them."""
        import pyarrow as pa
        from pyarrow import compute

        found = compute.index_in(self.column, value_set=pa.array(known, self.column.type))
        return np.asarray(found.fill_null(-1).to_numpy(), dtype=np.int64)


def plain_rows(data: bytes, before: int, header: Sequence[str], schema: Schema) -> Part | None:
    """The columns of whole lines of CSV text, behind so many lines, several times quicker than row by row.

    What is read here is what :mod:`.csv_rows` reads, bit for bit. Whatever that module might refuse is left to it
    (None), so that the sentences for the user stand there alone.
    """
    import pyarrow as pa

    if b'"' in data and b'"' in _QUOTED.sub(b"", data):
        return None
    try:
        return _plain_rows(data, before, header, schema)
    except pa.ArrowException:
        return None


def _plain_rows(data: bytes, before: int, header: Sequence[str], schema: Schema) -> Part | None:
    import pyarrow as pa
    from pyarrow import csv

    names = [str(i) for i in range(len(header))]
    numbers = {name: str(header.index(name)) for name in schema.numbers_in(header)}
    texts = {name: str(header.index(name)) for name in schema.texts_in(header)}
    types = dict.fromkeys(numbers.values(), pa.float64()) | dict.fromkeys(texts.values(), pa.string())
    reading = csv.ReadOptions(use_threads=False, block_size=_PIECE, column_names=names)
    converting = csv.ConvertOptions(column_types=types, include_columns=list(types), null_values=[])
    table = csv.read_csv(pa.BufferReader(data), reading, convert_options=converting)
    found = {name: table[place].to_numpy() for name, place in numbers.items()}
    columns = {name: _trimmed(table[place]) for name, place in texts.items()}
    if not all((np.abs(values) < MOST_FINITE).all() for values in found.values()):
        return None
    if any(_first_empty(column) is not None for column in columns.values()):
        return None
    harmless = data.isascii() and len(data.translate(None, _OBEYED)) == len(data)
    if not harmless and any(_first_obeyed(column) is not None for column in columns.values()):
        return None
    held = {name: TextColumn(column) for name, column in columns.items()}
    return Part(found, held, _lines_of_rows(data, before, table.num_rows))


def _lines_of_rows(data: bytes, before: int, rows: int) -> Sequence[int]:
    """The line of each row; those that are empty are none."""
    if rows == line_ends(data) + (data[-1:] not in b"\r\n"):
        return range(before + 1, before + 1 + rows)
    letters = np.frombuffer(data, np.uint8)
    lf, cr = letters == ord("\n"), letters == ord("\r")
    starts = np.append(0, np.flatnonzero(lf | (cr & ~np.append(lf[1:], False))) + 1)
    starts = starts[starts < letters.size]
    lines = before + 1 + np.flatnonzero(~(lf | cr)[starts])  # an empty line begins with its end
    return array("q", lines.astype(np.int64).tobytes())


def joined(columns: Sequence[Sequence[str]]) -> Sequence[str]:
    """Texts behind one another: a list where all are lists."""
    if not any(isinstance(column, TextColumn) for column in columns):
        return [text for column in columns for text in column]
    import pyarrow as pa

    return TextColumn(
        pa.chunked_array([c for column in columns for c in to_column(column).column.chunks], pa.string())
    )


def to_column(texts: Sequence[str]) -> TextColumn:
    """Texts in PyArrow's memory."""
    import pyarrow as pa

    return (
        texts
        if isinstance(texts, TextColumn)
        else TextColumn(pa.chunked_array([pa.array(texts, pa.string())]))
    )


def _trimmed(column: Any) -> Any:
    """Texts in one spelling (NFC) without blanks around them."""
    import pyarrow
    from pyarrow import compute

    trimmed = compute.utf8_trim_whitespace(column)
    if compute.all(compute.string_is_ascii(trimmed)).as_py() in (True, None):
        return trimmed
    # by Python: PyArrow 18 takes some texts apart where it should join them
    texts = (None if text is None else composed(text) for text in trimmed.to_pylist())
    return pyarrow.chunked_array([pyarrow.array(texts, pyarrow.string())])


def _first_empty(column: Any) -> int | None:
    from pyarrow import compute

    row = compute.index(compute.binary_length(column), 0).as_py()
    return None if row < 0 else int(row)


def binary_format(path: Path) -> str | None:
    """The format that a file's first bytes tell, None for text and for a file that cannot be opened."""
    if trouble(path) is not None:
        return None
    try:
        with path.open("rb") as file:
            start = file.read(8)
    except (OSError, ValueError):
        return None
    return next((name for magic, name in _BEGINNINGS.items() if start.startswith(magic)), None)


def read_binary(path: Path, kind: str) -> Any:
    """The ``pyarrow.Table`` of a Parquet or Arrow file. Raises InputError where it is damaged or of an old kind."""
    import pyarrow as pa

    if kind == "Feather 1":
        raise InputError(
            f"{path}: found a file of Feather version 1, wanted Parquet, Arrow or Feather version 2"
        )
    if kind == "Excel":
        raise InputError(
            f"{path}: found a workbook of Excel or another zip file, wanted its sheet saved as CSV"
        )
    try:
        if kind == "Parquet":
            from pyarrow import parquet

            metadata = parquet.read_metadata(path)
            require_small_parquet(path, metadata)
            table = parquet.ParquetFile(path, read_dictionary=dictionaries(metadata)).read()
        else:
            require_small_arrow(path, stream=kind != "Arrow")
            with pa.memory_map(str(path)) as file:
                table = (pa.ipc.open_file(file) if kind == "Arrow" else pa.ipc.open_stream(file)).read_all()
        table.validate(full=True)  # what Arrow reads it believes, and then leaves its own memory
        table.schema.names  # noqa: B018  decoded here, where they may be no text
        require_small_texts(path, table)
        return table
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = show(str(error))[1:-1]
        raise InputError(f"{path}: found a damaged {kind} file ({reason}), wanted a whole one") from None


def table_of(name: str, data: object) -> Any:
    """The ``pyarrow.Table`` of a data frame: any that gives an Arrow stream or has the data frame protocol.

    A mapping of columns is taken as well. Raises InputError for anything else.
    """
    import pyarrow as pa

    try:
        if isinstance(data, pa.Table):
            return data
        if hasattr(data, "__arrow_c_stream__"):
            return pa.table(data)
        if isinstance(data, Mapping):
            return pa.table({str(key): pa.array(values, from_pandas=True) for key, values in data.items()})
        if hasattr(data, "__dataframe__"):
            from pyarrow.interchange import from_dataframe

            return from_dataframe(data)
    except (pa.ArrowException, TypeError, ValueError) as error:
        reason = " ".join("; ".join(map(str, error.args)).split())[:160]
        raise InputError(
            f"{name}: found columns that Arrow cannot hold ({reason}), wanted one type in each column"
        ) from None
    raise InputError(
        f"{name}: found {show(type(data).__name__)}, wanted a data frame (pandas, polars, PyArrow and others), "
        "a mapping of columns or the path of a file"
    )


def columns_of_table(name: str, table: Any, schema: Schema) -> Columns:
    """The columns of a ``pyarrow.Table``; its rows are counted from 0, as data frames do.

    Raises InputError naming the column and row of a value that is missing, not finite or of another type.
    """
    header = [column for column in table.column_names if not _INDEX.fullmatch(column)]
    schema.check(name, header)
    table = _without_empty_end(table, header)
    if table.num_rows == 0 and not schema.may_be_empty:
        raise InputError(f"{name}: found no rows, wanted at least one")
    row_number: Callable[[int], int] = int
    all_rows = table.num_rows
    if schema.keep:
        table, row_number = _kept(name, table, schema)
    at = (name, row_number)
    texts: dict[str, Sequence[str]] = {
        column: _texts(at, column, table[column]) for column in schema.texts_in(header)
    }
    texts |= {column: _texts(at, column, table[column], floats=True) for column in schema.stamps}
    return Columns(
        header,
        {
            column: _numbers(at, column, table[column], column in schema.unknown)
            for column in schema.numbers_in(header)
        },
        texts,
        table.num_rows,
        row_number,
        all_rows - table.num_rows,
    )


def _without_empty_end(table: Any, header: Sequence[str]) -> Any:
    """The table without the rows of nulls and empty texts below the last one that holds something."""
    last = table.num_rows
    while last and all(_holds_nothing(table[name][last - 1].as_py()) for name in header):
        last -= 1
    return table.slice(0, last)


def _holds_nothing(cell: object) -> bool:
    return cell is None or (isinstance(cell, str) and not cell.strip()) or cell != cell  # NaN


def _kept(name: str, table: Any, schema: Schema) -> tuple[Any, Callable[[int], int]]:
    """The rows that are kept, and the place in the whole table of each."""
    columns = {column: _decoded(table[column]).to_pylist() for column in schema.keep}
    cells = zip(*columns.values(), strict=True)
    rows = [i for i, row in enumerate(cells) if schema.kept(dict(zip(columns, row, strict=True)))]
    if not rows:
        raise none_kept(name, schema)
    return table.take(rows), rows.__getitem__


At = tuple[str, Callable[[int], int]]
"""What messages call a table, and how they count its rows."""


def _numbers(at: At, column: str, values: Any, unknown: bool = False) -> Array:
    """Finite numbers; where they may be ``unknown`` a null is NaN, and one may be infinite."""
    from pyarrow import types

    name, row_number = at
    values = _decoded(values)
    if _is_text(values.type):
        cells = [cell or "" for cell in values.to_pylist()]
        return to_numbers(name, column, cells, row_number, unknown=unknown)
    if not unknown:
        _require_no_null(at, column, values, f"{NUMBER} in every row")
    if not any(good(values.type) for good in (types.is_integer, types.is_floating, types.is_decimal)):
        raise _type_error(name, column, values, "numbers")
    array = np.asarray(values.cast("float64", safe=False).to_numpy())
    good = np.abs(array) < MOST_FINITE
    if unknown:
        good |= np.isnan(array) | (array == np.inf)
    if not good.all():
        row = int(np.argmin(good))
        raise cell_error(name, row_number(row), column, float(array[row]), NUMBER)
    return array


def _texts(at: At, column: str, values: Any, floats: bool = False) -> TextColumn:
    from pyarrow import types

    name, row_number = at
    values = _decoded(values)
    _require_no_null(at, column, values, "text in every row")
    kinds = [types.is_integer, types.is_timestamp, _is_text]
    kinds += [types.is_floating, types.is_decimal] if floats else []
    if not any(good(values.type) for good in kinds):
        raise _type_error(name, column, values, "text")
    values = _trimmed(values.cast("string"))
    if (row := _first_empty(values)) is not None:
        raise cell_error(name, row_number(row), column, None, "text in every row")
    if (row := _first_obeyed(values)) is not None:
        raise cell_error(name, row_number(row), column, values[row].as_py(), PRINTABLE)
    return TextColumn(values)


def _first_obeyed(values: Any) -> int | None:
    """The first row of texts that hold what a terminal obeys."""
    from pyarrow import compute

    row = compute.index(compute.match_substring_regex(values, IN_NAME), True).as_py()
    return None if row < 0 else int(row)


def _is_text(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_string(kind) or types.is_large_string(kind) or types.is_string_view(kind))


def _decoded(values: Any) -> Any:
    """The values of a categorical column themselves; PyArrow decodes no dictionary of polars, whose texts are views."""
    import pyarrow as pa

    if not pa.types.is_dictionary(values.type):
        return values
    kind = pa.string() if _is_text(values.type.value_type) else values.type.value_type
    return pa.chunked_array(
        [chunk.dictionary.cast(kind).take(chunk.indices) for chunk in values.chunks], kind
    )


def _require_no_null(at: At, column: str, values: Any, wanted: str) -> None:
    from pyarrow import compute

    if values.null_count:
        row = int(compute.index(values.is_null(), True).as_py())
        raise cell_error(at[0], at[1](row), column, None, wanted)


def _type_error(name: str, column: str, values: Any, wanted: str) -> InputError:
    return InputError(f"{name}, column {column}: found values of the type {values.type}, wanted {wanted}")
