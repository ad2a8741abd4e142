"""CSV tables without anything unusual, by the parser of a library: several times quicker than cell by cell.

What is read here is what :mod:`starplumb.io.tables.rows` would read, bit for bit.  Whatever that module might see
otherwise, or refuse, is left to it: this one says None, and why is no matter.  So it needs no words for the user, and
may give up early.  Left to the other are

- quotes, tabs and line ends of one CR, which mean something to one of the two only;
- blank lines but at the end, which would shift the lines of the file;
- letters beyond ASCII in rows: blanks of other scripts may surround a number for one and not for the other;
- inf, nan and empty texts, which the parsers take, and cells too long for the standard library.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from io import BufferedReader
from pathlib import Path

import numpy as np

from ...physics.errors import InputError
from .header import Array, Columns, Wanted
from .parsers import Parser, parser_for

_BYTES = 1 << 20
_LONGEST = 1 << 17
"""Letters of a cell that the standard library's parser takes."""
_MARK = b"\xef\xbb\xbf"


class _Doubt(ValueError):
    """Something that is left to the careful reader."""


def read_plain(
    path: Path, wanted: Wanted, parser: Callable[[int, Sequence[str], Wanted], Parser] = parser_for
) -> Columns | None:
    """The columns of a plain file, or None where it has anything that wants a closer look.

    The file is read and parsed piece by piece, so that its text is never in memory as a whole.
    """
    try:
        with path.open("rb") as file:
            line, header = _header(file)
            wanted.check(path, line, header)
            return _columns(file, line, header, wanted, parser(path.stat().st_size, header, wanted))
    except (OSError, ValueError, InputError):
        return None


def _header(file: BufferedReader) -> tuple[int, list[str]]:
    """The line of the header, below comments and blank lines, and its names."""
    for line, raw in enumerate(file, 1):
        text = _unix(raw.removeprefix(_MARK) if line == 1 else raw).decode()
        if not text.rstrip("\n").isprintable() or '"' in text or len(text) > _LONGEST:
            break
        if text.strip() and not text.lstrip().startswith("#"):
            return line, [cell.strip() for cell in text.split(",")]
    raise _Doubt("no plain header")


def _unix(piece: bytes) -> bytes:
    return piece.replace(b"\r\n", b"\n") if b"\r" in piece else piece


def _pieces(file: BufferedReader) -> Iterator[tuple[bytes, int]]:
    """Whole lines of the rest of the file with LF at their ends, blank ones at its end left out, and how many.

    Raises ValueError for all that might mean something else to the careful reader.
    """
    while piece := file.read(_BYTES):
        piece = _unix(piece + file.readline())
        if not file.peek(1):
            piece = piece.rstrip(b" \n") + b"\n"
            if piece == b"\n":
                return
        codes = np.frombuffer(piece, dtype=np.uint8)
        ends = np.flatnonzero(codes == ord("\n"))
        if np.count_nonzero(codes < ord(" ")) != ends.size or b'"' in piece or not piece.isascii():
            raise _Doubt("an unusual letter")
        length = np.diff(ends, prepend=-1)
        if length.min() == 1 or length.max() > _LONGEST:
            raise _Doubt("a blank line or a very long one")
        yield piece, ends.size


def _columns(file: BufferedReader, line: int, header: list[str], wanted: Wanted, parse: Parser) -> Columns:
    numbers: dict[str, list[Array]] = {name: [] for name in wanted.numbers_in(header)}
    texts: dict[str, list[str]] = {name: [] for name in wanted.texts_in(header)}
    n = 0
    for piece, lines in _pieces(file):
        values, cells = parse(piece)
        n += lines
        for name, blocks in numbers.items():
            blocks.append(values[name])
        for name, column in texts.items():
            column += map(str.strip, cells[name])
    found = {name: np.concatenate(blocks) for name, blocks in numbers.items()}
    good = all(values.size == n and np.isfinite(values).all() for values in found.values())
    if n == 0 or not good or not all(len(column) == n and all(column) for column in texts.values()):
        raise _Doubt("rows that are not one a line, numbers that are not finite, or empty texts")
    return Columns(header, found, texts, np.arange(line + 1, line + 1 + n))
