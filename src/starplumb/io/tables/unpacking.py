"""What Arrow and Parquet files declare to unpack to, looked at before PyArrow believes it.

Source: Arrow columnar format, "Encapsulated message format" and "Message.fbs"; FlatBuffers internals.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from ...physics.errors import InputError

MOST_BYTES, MOST_TIMES = 400_000_000, 20
"""What a file may unpack to: so much, or so many times its size."""
_DICTIONARY, _BATCH = 2, 3


def require_fewer(path: Path, what: str, size: int) -> None:
    """Raise InputError where a file would unpack to more bytes than may be."""
    if size > max(MOST_BYTES, MOST_TIMES * path.stat().st_size):
        found = f"found {what} in {path.stat().st_size:,} bytes"
        raise InputError(f"{path}: {found}, wanted a table that is no larger than it says")


def require_small_parquet(path: Path, metadata: Any) -> None:
    """Raise InputError where a file of a few bytes declares more cells than its bytes can be of."""
    # asked for a damaged column, Arrow ends the program
    size = sum(metadata.row_group(i).total_byte_size for i in range(metadata.num_row_groups))
    cells = metadata.num_rows * metadata.num_columns
    require_fewer(path, f"{metadata.num_rows:,} rows of {metadata.num_columns} columns", max(8 * cells, size))


def require_small_texts(path: Path, table: Any) -> None:
    """Raise InputError where the texts of a table that stand for many rows each would fill the memory."""
    import pyarrow as pa
    from pyarrow import compute

    size = 0
    for column in table.columns:
        if pa.types.is_dictionary(column.type) and not pa.types.is_primitive(column.type.value_type):
            for chunk in column.chunks:
                length = compute.binary_length(chunk.dictionary.cast(pa.large_string()))
                size += compute.sum(length.take(chunk.indices.drop_null())).as_py() or 0
    require_fewer(path, f"texts of {size:,} letters", size)


def dictionaries(metadata: Any) -> list[str]:
    """Text columns of a Parquet file, by its schema: their cells may be numbers of texts that stand once, however long.

    Which are so only the columns themselves say, of which a damaged one ends the program where it is asked for.
    """
    columns = [metadata.schema.column(j) for j in range(metadata.num_columns)]
    return [c.path for c in columns if c.physical_type == "BYTE_ARRAY" and c.converted_type != "DECIMAL"]


def require_small_arrow(path: Path, stream: bool) -> None:
    """Raise InputError where packed parts of an Arrow file would fill the memory.  Damage is left to PyArrow."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        size = 0
        try:
            for message in _stream(data) if stream else _file(data):
                size += _unpacked(data, message)
        except (struct.error, IndexError, ValueError):
            return
    require_fewer(path, f"parts that unpack to {size:,} bytes", size)


class _Message(NamedTuple):
    """Where the head of a message stands, and its body."""

    head: int
    body: int


def _stream(data: mmap.mmap) -> Iterator[_Message]:
    """The messages of a stream, one behind the other."""
    at = 0
    while at + 8 <= len(data):
        mark, size = struct.unpack_from("<Ii", data, at)
        if mark != 0xFFFFFFFF or size <= 0:
            return
        head = at + 8
        yield _Message(head, head + size)
        at = head + size + _Table.root(data, head).number("<q", 3)


def _file(data: mmap.mmap) -> Iterator[_Message]:
    """The messages that the end of a file lists: dictionaries and rows."""
    (size,) = struct.unpack_from("<i", data, len(data) - 10)
    footer = _Table.root(data, len(data) - 10 - size)
    for field in (2, 3):
        for at in footer.items(field, 24):
            offset, head = struct.unpack_from("<qi", data, at)
            yield _Message(offset + 8, offset + head)


def _unpacked(data: mmap.mmap, message: _Message) -> int:
    """Bytes that the body of a message unpacks to, beyond its own."""
    root = _Table.root(data, message.head)
    kind, part = root.number("<B", 1), root.table(2)
    if kind == _DICTIONARY and part is not None:
        part = part.table(1)
    elif kind != _BATCH:
        return 0
    if part is None or part.table(3) is None:
        return 0
    size = 0
    for at in part.items(2, 16):
        offset, length = struct.unpack_from("<qq", data, at)
        if length:
            size += max(*struct.unpack_from("<q", data, message.body + offset), 0)
    return size


class _Table(NamedTuple):
    """A table of a FlatBuffer."""

    data: mmap.mmap
    at: int

    @classmethod
    def root(cls, data: mmap.mmap, at: int) -> _Table:
        return cls(data, at + _of(data, "<I", at))

    def field(self, number: int) -> int | None:
        """Where a field stands; None where it is left out."""
        names = self.at - _of(self.data, "<i", self.at)
        if 4 + 2 * number >= _of(self.data, "<H", names):
            return None
        offset = _of(self.data, "<H", names + 4 + 2 * number)
        return self.at + offset if offset else None

    def number(self, form: str, number: int) -> int:
        at = self.field(number)
        return 0 if at is None else _of(self.data, form, at)

    def table(self, number: int) -> _Table | None:
        at = self.field(number)
        return None if at is None else _Table.root(self.data, at)

    def items(self, number: int, size: int) -> range:
        """Where the items of a list stand, each of so many bytes."""
        at = self.field(number)
        if at is None:
            return range(0)
        at += _of(self.data, "<I", at)
        count = _of(self.data, "<I", at)
        if at + 4 + size * count > len(self.data):
            raise ValueError("a list beyond the end")
        return range(at + 4, at + 4 + size * count, size)


def _of(data: mmap.mmap, form: str, at: int) -> int:
    if at < 0:
        raise ValueError("a place before the beginning")
    return int(struct.unpack_from(form, data, at)[0])
