"""Files packed by gzip or by compress (``.gz``, ``.Z``), told by their first bytes and unpacked up to a limit.

Source of the second: LZW as Unix's compress writes it, codes of 9 to 16 bits, least significant bit first.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO

from ...physics.errors import InputError

_GZIP, _COMPRESS = b"\x1f\x8b", b"\x1f\x9d"
_CLEAR = 256
_FIRST_BITS = 9
STEP = 1 << 22
"""Bytes that are unpacked at a time."""


def is_packed(data: bytes) -> bool:
    """Whether bytes begin as gzip or compress writes them."""
    return data.startswith((_GZIP, _COMPRESS))


def unpacked(name: str, data: bytes, most: int) -> bytes:
    """What the file ``name`` holds, unpacked where it is packed.

    Raises InputError where it is damaged, or grows beyond ``most`` bytes.
    """
    if not is_packed(data):
        return data
    content = _joined(unpacked_pieces(name, BytesIO(data)), most + 1)
    if len(content) > most:
        raise too_large(name, most)
    return content


def too_large(name: str, most: int) -> InputError:
    """The sentence about a packed file that grows beyond ``most`` bytes."""
    return InputError(f"{name}: found a packed file of more than {most:,} bytes, wanted fewer")


def beginning(name: str, data: bytes, most: int) -> bytes:
    """The first ``most`` bytes of what a file holds whose first bytes are ``data``."""
    return (
        _joined(unpacked_pieces(name, BytesIO(data), whole=False), most) if is_packed(data) else data[:most]
    )


def unpacked_pieces(name: str, file: BinaryIO, *, whole: bool = True) -> Iterator[bytes]:
    """What a packed file holds, some bytes at a time; ``whole`` False: the file may end anywhere.

    Raises InputError where it is damaged.
    """
    head = file.read(STEP)
    try:
        if head.startswith(_GZIP):
            yield from _gzipped(head, file, whole)
        else:
            yield from _compressed(head + file.read())
    except (zlib.error, ValueError) as error:
        raise InputError(f"{name}: found a damaged packed file ({error}), wanted a whole one") from None


def _joined(pieces: Iterator[bytes], most: int) -> bytes:
    content = bytearray()
    for piece in pieces:
        content += piece
        if len(content) >= most:
            break
    return bytes(content[:most])


def _gzipped(data: bytes, file: BinaryIO, whole: bool) -> Iterator[bytes]:
    """The members of a gzip file, one behind the other."""
    while data.startswith(_GZIP):
        member = zlib.decompressobj(wbits=31)
        while True:
            piece = member.decompress(data, STEP)
            yield piece
            if member.eof:
                break
            data = member.unconsumed_tail
            if data or len(piece) == STEP:  # it may hold back more of what it has read
                continue
            data = file.read(STEP)
            if not data and whole:
                raise ValueError("it breaks off")
            if not data:
                return
        data = member.unused_data
        if len(data) < len(_GZIP):
            data += file.read(STEP)


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
