"""Files packed by gzip or by compress (``.gz``, ``.Z``), told by their first bytes and unpacked up to a limit.

Source of the second: LZW as Unix's compress writes it, codes of 9 to 16 bits, least significant bit first.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator

from ...physics.errors import InputError

_GZIP, _COMPRESS = b"\x1f\x8b", b"\x1f\x9d"
_CLEAR = 256
_FIRST_BITS = 9


def is_packed(data: bytes) -> bool:
    """Whether bytes begin as gzip or compress writes them."""
    return data.startswith((_GZIP, _COMPRESS))


def unpacked(name: str, data: bytes, most: int) -> bytes:
    """What the file ``name`` holds, unpacked where it is packed.

    Raises InputError where it is damaged, or grows beyond ``most`` bytes.
    """
    if not is_packed(data):
        return data
    content = beginning(name, data, most + 1, whole=True)
    if len(content) > most:
        raise InputError(f"{name}: found a packed file of more than {most:,} bytes, wanted fewer")
    return content


def beginning(name: str, data: bytes, most: int, *, whole: bool = False) -> bytes:
    """The first ``most`` bytes of what is packed; ``whole`` False: ``data`` may end anywhere."""
    try:
        if data.startswith(_COMPRESS):
            return _joined(_compressed(data), most)
        return _joined(_gzipped(data, most, whole), most) if data.startswith(_GZIP) else data[:most]
    except (zlib.error, ValueError) as error:
        raise InputError(f"{name}: found a damaged packed file ({error}), wanted a whole one") from None


def _joined(pieces: Iterator[bytes], most: int) -> bytes:
    content = bytearray()
    for piece in pieces:
        content += piece
        if len(content) >= most:
            break
    return bytes(content[:most])


def _gzipped(data: bytes, most: int, whole: bool) -> Iterator[bytes]:
    """The members of a gzip file, one behind the other, each up to ``most`` bytes."""
    while data.startswith(_GZIP):
        member = zlib.decompressobj(wbits=31)
        yield member.decompress(data, most)
        if not member.eof and not member.unconsumed_tail and whole:
            raise ValueError("it breaks off")
        data = member.unused_data


def _compressed(data: bytes) -> Iterator[bytes]:
    """The strings of an LZW file.

    Codes of one width come in groups of eight; where the width grows or the table is cleared the rest of a group is
    passed over.
    """
    if len(data) < 3 or not _FIRST_BITS <= data[2] & 0x1F <= 16:
        raise ValueError("it breaks off" if len(data) < 3 else "its codes are of no known width")
    widest, clears = data[2] & 0x1F, bool(data[2] & 0x80)
    table, last, bits, at, end = _first_table(clears), b"", _FIRST_BITS, 24, 8 * len(data)
    start = at
    while at + bits <= end:
        code = int.from_bytes(data[at >> 3 : (at >> 3) + 4], "little") >> (at & 7) & ((1 << bits) - 1)
        at += bits
        if clears and code == _CLEAR:
            at, start = (_group_end(at, start, bits),) * 2
            table, last, bits = _first_table(clears), b"", _FIRST_BITS
            continue
        if code > len(table) or (code == len(table) and not last):
            raise ValueError("a code that stands for nothing")
        string = table[code] if code < len(table) else last + last[:1]
        yield string
        if last and len(table) < 1 << widest:
            table.append(last + string[:1])
        last = string
        if len(table) == 1 << bits and bits < widest:
            at, start = (_group_end(at, start, bits),) * 2
            bits += 1


def _first_table(clears: bool) -> list[bytes]:
    return [bytes([byte]) for byte in range(256)] + [b""] * clears


def _group_end(at: int, start: int, bits: int) -> int:
    """The bit behind the group of eight codes that ends at or after ``at``."""
    return start - (start - at) // (8 * bits) * 8 * bits
