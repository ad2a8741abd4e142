"""Text from files, with a sentence for all that can be wrong before the content is looked at."""

from __future__ import annotations

import codecs
import re
import stat
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from ...disk.publish import fingerprint as fingerprint
from ...physics.errors import InputError
from ...physics.errors import nearest as nearest
from .packed import beginning, is_packed, unpacked

MOST_TEXT = 100_000_000
"""Bytes of a file that is read as a whole: an attitude of ten samples a second fills a day with fewer."""
MOST_LINES = 3_000_000
"""Of such a file: every line takes some hundred bytes more than its letters."""
_SHOWN = 60
_HEAD = 1 << 16
"""Bytes by which a format is known; the comments before its first word are shorter."""
_MARKS = (
    (codecs.BOM_UTF32_LE, "UTF-32"),
    (codecs.BOM_UTF32_BE, "UTF-32"),
    (codecs.BOM_UTF16_LE, "UTF-16"),
    (codecs.BOM_UTF16_BE, "UTF-16"),
)


def cut(text: str) -> str:
    """``text`` as far as a message repeats it."""
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."


_SQLITE = b"SQLite format 3\0"


def show(value: object) -> str:
    """``value`` as one short line: text in double quotes, control characters escaped, as in TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        text = "[" + ", ".join(show(item) for item in value[:8]) + (", ...]" if len(value) > 8 else "]")
    elif isinstance(value, str):
        return '"' + "".join(c if c.isprintable() else repr(c)[1:-1] for c in cut(value)) + '"'
    else:
        text = " ".join(str(value).split())
    return cut(text)


def composed(text: str) -> str:
    """``text`` with accents joined to their letters (NFC): the same name reads the same from any system."""
    return text if text.isascii() else unicodedata.normalize("NFC", text)


def trouble(path: Path) -> str | None:
    """Why ``path`` cannot be read as a file (``found ..., wanted ...``), or None."""
    try:
        if (kind := _no_file(path)) is not None:
            return f"found {kind}, wanted a file"
        with path.open("rb"):
            return None
    except FileNotFoundError:
        return "found no such file, wanted a readable file"
    except PermissionError:
        return "found a file that may not be read, wanted one with read permission"
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        return f"found a file that cannot be opened ({reason}), wanted a readable file"


def _no_file(path: Path) -> str | None:
    """What stands there in place of a file: a pipe never ends its first opening, a device never its reading."""
    mode = path.stat().st_mode
    if stat.S_ISREG(mode):
        return None
    kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
    return kinds.get(stat.S_IFMT(mode), "a device")


def read_bytes(path: Path, most: int = MOST_TEXT) -> bytes:
    """Content of a file, unpacked where it is packed.

    Raises InputError where it is missing, a folder, unreadable, empty, damaged, or larger than ``most`` bytes.
    """
    if (found := trouble(path)) is not None:
        raise InputError(f"{path}: {found}")
    size = path.stat().st_size
    if size > most:
        raise InputError(f"{path}: found {size:,} bytes, wanted at most {most:,}")
    data = unpacked(str(path), path.read_bytes(), most)
    if not data.strip():
        raise InputError(f"{path}: found an empty file, wanted one with content")
    return data


def read_beginning(path: Path) -> bytes:
    """The first bytes of what a file holds, unpacked; empty where it cannot be opened."""
    try:
        if _no_file(path) is not None:
            return b""
        with path.open("rb") as file:
            return beginning(str(path), file.read(_HEAD), _HEAD)
    except (OSError, ValueError):
        return b""


@contextmanager
def unpacked_file(path: Path) -> Iterator[Path]:
    """A file for libraries that open it themselves: ``path``, or while it is used a copy of what is packed there."""
    with path.open("rb") as file:
        packed = is_packed(file.read(4))
    if not packed:
        yield path
        return
    with TemporaryDirectory() as folder:
        copy = Path(folder) / path.stem
        copy.write_bytes(read_bytes(path))
        yield copy


def read_text(path: Path, most: int = MOST_TEXT, most_lines: int | None = MOST_LINES) -> str:
    """Text of a UTF-8 file, a byte-order mark taken off, line ends as they are.

    Raises InputError as ``read_bytes`` does, for more than ``most_lines``, and for UTF-16, NUL and bytes that are not
    UTF-8.
    """
    data = read_bytes(path, most)
    if most_lines is not None and max(data.count(b"\n"), data.count(b"\r")) > most_lines:
        raise InputError(f"{path}: found more than {most_lines:,} lines, wanted fewer")
    return decoded(path, data)


def decoded(path: Path, data: bytes, before: int = 0) -> str:
    """The text that bytes of a file are, behind so many lines, a byte-order mark taken off.

    Raises InputError for UTF-16, NUL and bytes that are not UTF-8.
    """
    if data.startswith(_SQLITE):
        raise InputError(f"{path}: found an SQLite database, as archives are, wanted UTF-8 text")
    if not before and (encoding := _wide_encoding(data)) is not None:
        raise InputError(f"{path}: found {encoding} text, wanted UTF-8")
    if (at := data.find(0)) >= 0:
        raise InputError(f"{path}, line {before + _line(data, at)}: found a NUL byte, wanted UTF-8 text")
    try:
        return data.decode("utf-8" if before else "utf-8-sig")
    except UnicodeDecodeError as error:
        where, byte = before + _line(data, error.start), data[error.start]
        raise InputError(f"{path}, line {where}: found the byte 0x{byte:02X}, wanted UTF-8 text") from None


def lines_of(text: str) -> list[str]:
    """Lines that end in LF, CR LF or CR.

    ``splitlines`` ends them at form feeds and other letters too, which editors show within a line: a key would stand on
    one line and its value on the next.
    """
    lines = re.split(r"\r\n|\n|\r", text)
    return lines[:-1] if not lines[-1] else lines


def _line(data: bytes, at: int) -> int:
    return data.count(b"\n", 0, at) + 1


def _wide_encoding(data: bytes) -> str | None:
    """UTF-16 or UTF-32 by their marks, or UTF-16 without one: Latin text has a NUL in every second byte."""
    for mark, name in _MARKS:
        if data.startswith(mark):
            return name
    head = data[:400]
    half = max(len(head) // 2, 1)
    if len(head) >= 4 and any(head[start::2].count(0) > 0.6 * half for start in (0, 1)):
        return "UTF-16"
    return None
