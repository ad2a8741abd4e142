"""One table, read and checked: CSV, Parquet or Arrow files, and data frames of any library.

Every source gives the same :class:`Table`; an error names the row and column.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import EpochError, InputError
from . import csv_tables
from .arrow import TextColumn, binary_format, columns_of_table, read_binary, table_of
from .cells import Array, Columns, as_found, found_error
from .csv_tables import MOST_TABLE, read_csv, require_rows
from .declared import UNDECLARED, Declared, Times
from .schema import Schema

Epochs = NDArray[np.int64]

TABLE_SUFFIXES = (".csv", ".parquet", ".arrow", ".feather")
"""Endings of tables; a file's format is recognised by its content."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A data frame in place of a file: ``str`` is what messages call it, ``table`` the ``pyarrow.Table`` of it."""

    name: str
    table: Any

    def __str__(self) -> str:
        return self.name

    @classmethod
    def of(cls, name: str, data: object) -> Frame:
        """A frame of pandas, polars, PyArrow or any other library that gives Arrow data, or a mapping of columns."""
        return cls(name, table_of(name, data))

    def fingerprint(self) -> str:
        """``sha256:`` and the digest of the columns, their names and types."""
        import pyarrow as pa

        table = self.table.combine_chunks().replace_schema_metadata(None)
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, table.schema) as writer:
            writer.write_table(table)
        return "sha256:" + hashlib.sha256(sink.getvalue()).hexdigest()


TableSource = Path | Frame


def other_format(source: TableSource) -> Path | None:
    """The file, where its ending is not one of a table."""
    return None if isinstance(source, Frame) or source.suffix.lower() in TABLE_SUFFIXES else source


@dataclass(frozen=True)
class Table:
    """Columns of a table, n rows: ``numbers`` as (n,) arrays, ``texts`` without blanks around them.

    ``str`` of ``source`` is what messages call it; ``row_number`` takes a row (from 0) to the number by which the user
    finds it: the line in a text file, else the row itself; ``places`` are such words for each row where a number does
    not do; ``notices`` are sentences for the user.
    """

    source: object
    numbers: dict[str, Array]
    texts: dict[str, Sequence[str]]
    rows: int
    row_number: Callable[[int], int]
    notices: list[str]
    declared: Declared = UNDECLARED
    places: Sequence[str] = ()

    def __len__(self) -> int:
        return self.rows

    def where(self, row: int, *columns: str) -> str:
        """A row, and columns by the table's own names, as messages name them."""
        place = self.places[row] if self.places else f"{self.source}, row {self.row_number(row)}"
        s = "s" * (len(columns) > 1)
        named = f", column{s} {', '.join(map(self.declared.name, columns))}" if columns else ""
        return place + named

    def named_only(self, rows: Sequence[int], texts: dict[str, Sequence[str]]) -> Table:
        """Some of the rows with these texts and no numbers: they are still named as in the whole table."""
        return replace(
            self,
            numbers={},
            texts=texts,
            rows=len(rows),
            row_number=lambda i: self.row_number(rows[i]),
            places=[self.places[row] for row in rows] if self.places else (),
        )

    def error(self, row: int, column: str, found: object, wanted: str) -> InputError:
        """The sentence about one cell: table, row, column, what was found and what is wanted."""
        return found_error(self.where(row, column), found, wanted)

    def columns(self, *names: str) -> Array:
        """Number columns side by side, (n, k)."""
        return np.stack([self.numbers[name] for name in names], axis=-1)

    def has(self, *names: str) -> bool:
        """Whether all of these number columns are there. Raises InputError where only some of them are."""
        there = [name for name in names if name in self.numbers]
        if there and len(there) < len(names):
            lacking = ", ".join(self.declared.name(name) for name in names if name not in there)
            found = f"found the column {self.declared.name(there[0])} without {lacking}"
            raise InputError(f"{self.source}: {found}, wanted all of them or none")
        return bool(there)

    def require(self, good: NDArray[np.bool_], column: str, wanted: str) -> None:
        """Raise InputError about the first row for which ``good`` (n,) does not hold."""
        if not good.all():
            row = int(np.argmin(good))
            raise self.error(row, column, float(self.numbers[column][row]), wanted)

    def require_distinct(self, column: str, wanted: str) -> None:
        """Raise InputError, naming both rows, where a text occurs twice."""
        texts = self.texts[column]
        if texts.all_differ() if isinstance(texts, TextColumn) else len(set(texts)) == len(texts):
            return
        first: dict[str, int] = {}
        for row, text in enumerate(texts):
            if (earlier := first.setdefault(text, row)) != row:
                found = f"{as_found(text)} again (first in row {self.row_number(earlier)})"
                raise InputError(f"{self.where(row, column)}: found {found}, wanted {wanted}")

    def with_stated(self) -> Table:
        """The table with the columns that it lacks and whose one value is stated beside it.

        Raises InputError where such a column is there all the same.
        """
        names = self.declared.stated
        key = self.declared.stated_by
        if twice := [name for name in (key, *names) if names and name in self.numbers]:
            found = f"found the column {self.declared.name(twice[0])} beside {self.declared.key}.{key}"
            raise InputError(f"{self.source}: {found}, wanted only one of the two")
        whole = {name: np.full(self.rows, value) for name, value in names.items()}
        return replace(self, numbers=self.numbers | whole) if whole else self


Piecewise = Callable[[Table | None], None]
"""What looks at the rows of a table, some at a time; None stands behind the last."""


def read_table(
    source: TableSource,
    *,
    texts: Sequence[str] = (),
    numbers: Sequence[str] = (),
    optional_texts: Sequence[str] = (),
    optional_numbers: Sequence[str] = (),
    declared: Declared = UNDECLARED,
    may_be_empty: bool = False,
    like: Sequence[str] = (),
    instead: Mapping[str, Sequence[str]] = MappingProxyType({}),
    unknown: Sequence[str] = (),
    most: int = MOST_TABLE,
    most_rows: int | None = None,
    each: Piecewise | None = None,
) -> Table:
    """The columns asked for, by the names that are ``declared``; others are passed over with a notice.

    Number columns ``like`` a pattern are taken where they are there, and so are those that stand ``instead`` of one;
    in those that may be ``unknown`` an empty cell is NaN, and one may be ``inf``.  A CSV file of more than ``most``
    bytes is refused, and a table of more than ``most_rows``.  Of a CSV file that fills the memory ``each`` is first
    given all rows, some at a time, and then None, to refuse what will be refused.

    A file may be CSV (UTF-8, commas, any line ends; blank lines and leading ``#`` lines are passed over), Parquet or
    Arrow, which its content tells. Raises InputError naming the table and, where there are such, row and column.
    """
    optional_numbers = [*optional_numbers, *(n for n in declared.columns if Schema(like=like).alike(n))]
    asked = Schema(
        texts,
        numbers,
        optional_texts,
        optional_numbers,
        may_be_empty=may_be_empty,
        like=like,
        instead=instead,
        unknown=unknown,
    )
    schema = declared.schema(asked, str(source))

    names = (*numbers, *optional_numbers, *(name for others in instead.values() for name in others))

    def of(found: Columns) -> Table:
        return _named(source, declared, schema, found, names, (*texts, *optional_texts))

    def look(found: Columns | None) -> None:
        if each is not None:
            each(None if found is None else of(found))

    found = _columns(source, schema, most, most_rows, None if each is None else look)
    require_rows(source, found.rows, most_rows)
    return of(found)


def _named(
    source: TableSource,
    declared: Declared,
    schema: Schema,
    found: Columns,
    asked: Sequence[str],
    words: Sequence[str],
) -> Table:
    """Columns by our names, those of numbers and of texts that are asked for, and what the user should know."""
    ignored = schema.ignored(found.header)
    s = "s" * (len(ignored) > 1)
    notices = [f"{source}: ignored the column{s} {', '.join(ignored)}"] if ignored else []
    if found.left_out:
        notices.append(
            f"{source}: left out {found.left_out} of {found.left_out + found.rows} rows by {declared.key}.keep"
        )
    by_ours = {
        name: found.numbers[declared.name(name)] for name in asked if declared.name(name) in found.numbers
    }
    by_ours |= {name: x for name, x in found.numbers.items() if schema.alike(name)}
    texts = {name: found.texts[declared.name(name)] for name in words if declared.name(name) in found.texts}
    if schema.stamps:
        texts |= {stamp(i): found.texts[name] for i, name in enumerate(schema.stamps)}
    return Table(source, by_ours, texts, found.rows, found.row_number, notices, declared).with_stated()


def stamp(i: int) -> str:
    """Our name of the i-th column of a time."""
    return "time" if i == 0 else f"time {i + 1}"


def epochs(table: Table, scale: str) -> Epochs:
    """``t_ns`` (n,) of a table's times, declared or in its column ``time``.

    Raises InputError naming the row of one that is none of this scale.
    """
    times, decimal = table.declared.time or Times(("time",)), table.declared.decimal
    cells = [table.texts[stamp(i)] for i in range(len(times.columns))]
    if decimal != ".":
        cells = [[cell.replace(decimal, ".") for cell in column] for column in cells]
    try:
        return times.epochs(cells, scale)
    except EpochError as error:
        count = times.format == "iso" and re.fullmatch(r"[-+]?\d+(\.\d*)?", cells[0][error.row])
        hint = '; a count is declared, as in time = { column = "time", format = "unix" }' if count else ""
        raise InputError(f"{table.where(error.row, 'time')}: {error}{hint}") from None


def _columns(
    source: TableSource, schema: Schema, most: int, most_rows: int | None, each: csv_tables.Piecewise | None
) -> Columns:
    if isinstance(source, Frame):
        return columns_of_table(str(source), source.table, schema)
    if (kind := binary_format(source)) is not None:
        return columns_of_table(str(source), read_binary(source, kind), schema)
    return read_csv(source, schema, most, most_rows=most_rows, each=each)
