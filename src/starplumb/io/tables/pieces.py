"""A large text file in pieces of whole lines, each checked as text before anything looks into it.

The file is never in memory as a whole, whether it is packed or not.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...physics.errors import InputError
from ..text.files import decoded, trouble
from ..text.packed import is_packed, too_large, unpacked_pieces

PIECE = 1 << 22
"""Bytes of a piece; no line is longer."""
_MARK = b"\xef\xbb\xbf"
_END = re.compile(rb"\r\n|\n|\r")


def pieces(path: Path, most: int) -> Iterator[tuple[int, bytes]]:
    """How many lines stand before a piece, and the piece, a byte-order mark taken off.

    Lines end in LF, CR LF or CR.  Raises InputError where a file is missing, a folder, unreadable, empty, damaged, or
    larger than ``most`` bytes, and for UTF-16, NUL and bytes that are not UTF-8.
    """
    before, blank = 0, True
    for piece in _whole_lines(path, most):
        decoded(path, piece, before)
        blank = blank and not piece.strip()
        yield before, piece.removeprefix(_MARK) if before == 0 else piece
        before += line_ends(piece)
    if blank:
        raise InputError(f"{path}: found an empty file, wanted one with content")


def line_ends(data: bytes) -> int:
    """How many lines end in some bytes."""
    lines = int(
        np.count_nonzero(np.frombuffer(data, np.uint8) == ord("\n"))
    )  # a tenth of the time of bytes.count
    return lines + (data.count(b"\r") - data.count(b"\r\n") if b"\r" in data else 0)


def behind_lines(data: bytes, count: int) -> int:
    """The byte behind the first lines."""
    ends = _END.finditer(data)
    at = 0
    for _ in range(count):
        found = next(ends, None)
        if found is None:
            return len(data)
        at = found.end()
    return at


def _whole_lines(path: Path, most: int) -> Iterator[bytes]:
    rest = b""
    for chunk in _chunks(path, most):
        rest += chunk
        while len(rest) > PIECE:
            end = rest.rfind(b"\n", 0, PIECE) + 1 or rest.rfind(b"\r", 0, PIECE - 1) + 1
            if not end:
                raise InputError(f"{path}: found a line of more than {PIECE:,} bytes, wanted rows of a table")
            yield rest[:end]
            rest = rest[end:]
    yield rest


def _chunks(path: Path, most: int) -> Iterator[bytes]:
    if (found := trouble(path)) is not None:
        raise InputError(f"{path}: {found}")
    if (size := path.stat().st_size) > most:
        raise InputError(f"{path}: found {size:,} bytes, wanted at most {most:,}")
    total = 0
    with path.open("rb") as file:
        packed = is_packed(file.read(4))
        file.seek(0)
        for chunk in unpacked_pieces(str(path), file) if packed else iter(lambda: file.read(PIECE), b""):
            total += len(chunk)
            if total > most:
                raise too_large(str(path), most)
            yield chunk
