"""CSV tables, in pieces: by PyArrow what is plain, row by row what is small, unusual or wrong."""

from __future__ import annotations

import gc
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import accumulate
from pathlib import Path

import numpy as np

from ...physics.errors import InputError
from ..text.files import decoded
from .arrow import joined, plain_rows, to_column
from .cells import Columns, Part, none_kept
from .csv_rows import Block, CsvLines, without_empty_end
from .pieces import PIECE, behind_lines, line_ends, pieces
from .schema import Schema

LARGE = PIECE // 2
"""Bytes of a piece from which reading it by PyArrow saves more than the import of PyArrow costs (0.1 s)."""
MOST_TABLE = 1_000_000_000
"""Bytes of a table."""
MOST_BLANK = 3_000_000
"""Lines of a table that are no rows."""
MOST_HELD = 100_000_000
"""Bytes of a table from which its values are forgotten until the whole file is known to be sound."""


Piecewise = Callable[[Columns | None], None]
"""What looks at the rows of a file, some at a time; None stands behind the last."""


def read_csv(
    path: Path,
    schema: Schema,
    most: int = MOST_TABLE,
    quick: bool = True,
    most_rows: int | None = None,
    each: Piecewise | None = None,
) -> Columns:
    """The columns of a file. Raises InputError naming the file and, where there is one, the row and column.

    With ``quick`` PyArrow reads of a large file what it reads alike.  What such a file holds is kept only when all of
    it is known to be sound, so that a fault at its end is found before memory is filled; ``each`` then looks at its
    rows, piece by piece.
    """
    with _collector_paused():
        found = _columns(_Walk(path, schema, most, quick), MOST_HELD, most_rows, each)
        if found is None:
            found = _columns(_Walk(path, schema, most, quick), most, most_rows)
    assert found is not None
    return found


def _columns(walk: _Walk, held: int, most_rows: int | None, each: Piecewise | None = None) -> Columns | None:
    """What a walk finds; None for a sound file of more bytes than may be ``held``, at which ``each`` has looked."""
    parts, rows, schema = list[Part](), 0, walk.schema
    for part in walk.parts():
        rows += len(part.line)
        require_rows(walk.path, rows, most_rows)
        parts.append(part)
        if walk.size > held:
            _look(walk, parts, each)
    if not rows and walk.rows:
        raise none_kept(str(walk.path), schema)
    if not (rows or schema.may_be_empty):
        raise InputError(f"{walk.path}: found a header without rows below it, wanted at least one row")
    if walk.size > held:
        _look(walk, parts, each)
        if each is not None:
            each(None)
        return None
    numbers = {
        name: np.concatenate([*(part.numbers[name] for part in parts), np.empty(0)])
        for name in schema.numbers_in(walk.header)
    }
    texts = {name: joined([part.texts[name] for part in parts]) for name in walk.texts}
    return Columns(walk.header, numbers, texts, rows, _line_of(parts), walk.rows - rows)


def require_rows(name: object, rows: int, most: int | None) -> None:
    """Raise InputError where a table has more rows than may be."""
    if most is not None and rows > most:
        raise InputError(f"{name}: found more than {most:,} rows, wanted fewer")


def _look(walk: _Walk, parts: list[Part], each: Piecewise | None) -> None:
    """Have rows looked at, and forget them."""
    if each is not None:
        for part in parts:
            numbers, texts = dict(part.numbers), dict(part.texts)
            each(Columns(walk.header, numbers, texts, len(part.line), part.line.__getitem__))
    parts.clear()


def _line_of(parts: Sequence[Part]) -> Callable[[int], int]:
    """The line of a row, counted from 0."""
    ends = list(accumulate(len(part.line) for part in parts))

    def line(row: int) -> int:
        at = bisect_right(ends, row)
        return int(parts[at].line[row - ends[at]])

    return line


class _Walk:
    """One walk through a file: its header, and then its rows; ``size`` and ``rows`` count what was passed."""

    def __init__(self, path: Path, schema: Schema, most: int, quick: bool) -> None:
        self.path, self.schema = path, schema
        self.size = self.rows = self._blank = 0
        self._pieces = pieces(path, most)
        self.header, self._before, self._first = self._below_header()
        self.texts = (*schema.texts_in(self.header), *schema.stamps)
        self._large = len(self._first) >= LARGE
        plain = not (schema.keep or schema.stamps or schema.separator != "," or schema.decimal != ".")
        self._quick = quick and plain and self._large

    def parts(self) -> Iterator[Part]:
        """The rows that are kept, in order."""
        for found in without_empty_end(self._found(), self.path):
            self.rows += len(found.line)
            if isinstance(found, Part):
                yield found
                continue
            block = found.kept(self.schema, self.header) if self.schema.keep else found
            if block.rows:
                part = block.part(self.path, self.schema, self.header)
                texts = (
                    {name: to_column(texts) for name, texts in part.texts.items()}
                    if self._large
                    else part.texts
                )
                yield replace(part, texts=texts)

    def _lines(self, piece: bytes, before: int, top: bool = False) -> CsvLines:
        return CsvLines(self.path, decoded(self.path, piece, before), self.schema.separator, before, top)

    def _below_header(self) -> tuple[list[str], int, bytes]:
        """The header, the line at which it ends, and what follows in the same piece."""
        for before, piece in self._pieces:
            if not piece.strip():
                self._require_rows(line_ends(piece))
                continue
            lines = self._lines(piece, before, top=True)
            if not lines.empty:
                header = lines.header(self.schema)
                return header, lines.line, piece[behind_lines(piece, lines.line - before) :]
        self.schema.check(str(self.path), [])
        return [], 0, b""

    def _found(self) -> Iterator[Block | Part]:
        before, piece = self._before, self._first
        while piece := piece or self._next():
            rest, rows = b"", 0
            part = plain_rows(piece, before, self.header, self.schema) if self._quick else None
            if part is not None:
                rows = len(part.line)
                yield part
            elif piece.strip():
                piece, rest = self._whole_rows(piece, before)
                for block in self._lines(piece, before).blocks():
                    rows += len(block.rows)
                    yield block
            self.size += len(piece)
            before += (lines := line_ends(piece))
            self._require_rows(lines - rows)
            piece = rest

    def _require_rows(self, blank: int) -> None:
        """Raise InputError where there are so many blank lines, or line breaks within cells, that it is no table."""
        self._blank += blank
        if self._blank > MOST_BLANK:
            raise InputError(
                f"{self.path}: found more than {MOST_BLANK:,} blank lines, wanted rows of a table"
            )

    def _next(self) -> bytes:
        return next(self._pieces, (0, b""))[1]

    def _whole_rows(self, piece: bytes, before: int) -> tuple[bytes, bytes]:
        """A piece as far as its last row that ends in it, and what follows: cells in quotes may have several lines."""
        while b'"' in piece and (line := self._lines(piece, before).cut_off()) is not None:
            following = self._next()
            at = behind_lines(piece, line - before)
            if at or not following:
                return (piece[:at], piece[at:] + following) if following else (piece, b"")
            if len(piece) > PIECE:
                place = f"{self.path}, row {line + 1}"
                raise InputError(f"{place}: found a row of more than {PIECE:,} bytes, wanted rows of a table")
            piece += following
        return piece, b""


@contextmanager
def _collector_paused() -> Iterator[None]:
    """Pause the cycle collector: a million rows are a million short-lived lists, and visiting them doubles the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
