"""Second parsers, with nothing of the package: the numbers that a damaged file must have given if it was accepted.

Each takes the content and gives arrays, or None for what it does not know (then nothing is compared).
"""

from __future__ import annotations

import csv
import gzip
import io
import re
from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?0*\d{1,6})?", re.ASCII)


class Unknown(Exception):
    """Nothing that this parser knows."""


def plain(data: bytes) -> str:
    """UTF-8 text, unpacked."""
    try:
        data = gzip.decompress(data) if data.startswith(b"\x1f\x8b") else data
        return data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except (OSError, EOFError, ValueError, ArithmeticError):
        raise Unknown from None


def value(word: str, factor: int | Decimal = 1) -> float:
    """The nearest double to a decimal number times a factor; AssertionError where the reader took what is none."""
    if not _NUMBER.fullmatch(word):
        raise AssertionError(f"{word[:40]!r} was accepted as a number")
    return float(Decimal(word) * factor)


def message(data: bytes, width: int, factor: int | Decimal) -> Array:
    """Rows of the one segment of a CCSDS message in its text notation."""
    text = plain(data)
    if text.lstrip().startswith("<") or text.count("META_STOP") != 1 or "USEABLE" in text:
        raise Unknown
    rows = []
    for line in text.split("META_STOP", 1)[1].split("\n"):
        words = line.split()
        if not words or words[0] == "COMMENT" or words[0] in ("DATA_START", "DATA_STOP"):
            continue
        if words[0] == "COVARIANCE_START":
            break
        rows.append([value(word, factor) for word in words[1 : 1 + width]])
    return _array(rows)


def sp3(data: bytes) -> Array:
    """Positions of the one satellite."""
    rows = []
    text = plain(data)
    if re.findall(r"^[*PV].", text, re.MULTILINE) != ["* ", "PL", "VL"] * 2:
        raise Unknown
    for line in text.split("\n"):
        if line.startswith("EOF"):
            break
        if line.startswith("PL47"):
            row = [value(line[at : at + 14].strip(), 1000) for at in (4, 18, 32)]
            if any(row) and max(map(abs, row)) < 999_999_000.0:
                rows.append(row)
    return _array(rows)


def stk(data: bytes) -> Array:
    """The numbers behind the seconds."""
    rows, inside, factor = [], False, 1
    for line in plain(data).split("\n"):
        words = line.split("#")[0].split()
        if words and not inside and "distanceunit" in line.lower():
            if words != ["DistanceUnit", "Kilometers"]:
                raise Unknown
            factor = 1000
        if not words:
            continue
        if inside and words[0][0].isalpha():
            break
        if inside:
            rows.append([value(word, factor) for word in words[1:]])
        inside = inside or words[0].lower() in ("ephemeristimeposvel", "attitudetimequatangvels")
    return _array(rows)


def orbex(data: bytes) -> Array:
    """The quaternions of L47, scalar first."""
    rows, inside = [], False
    for line in plain(data).split("\n"):
        if line.startswith("+"):
            inside = line[1:].strip() == "EPHEMERIS/DATA"
        elif line.startswith("-"):
            inside = False
        words = line.split()
        if inside and words[:2] == ["ATT", "L47"]:
            rows.append([value(word) for word in words[-4:]])
    return _array(rows)


def table(data: bytes, names: tuple[str, ...]) -> Array:
    """Columns of a table with commas."""
    rows = list(csv.reader(io.StringIO(plain(data), newline=""), skipinitialspace=True))
    rows = [
        row
        for row in rows
        if "".join(row).strip() and not (row[0].lstrip().startswith("#") and row is rows[0])
    ]
    if not rows or rows[0][0].lstrip().startswith("#"):
        raise Unknown
    header = [cell.strip() for cell in rows[0]]
    if sorted(set(header)) != sorted(header) or not set(names) <= set(header):
        raise Unknown
    places = [header.index(name) for name in names]
    return _array([[value(row[at].strip()) for at in places] for row in rows[1:] if len(row) == len(header)])


def _array(rows: list[list[float]]) -> Array:
    if not rows or len({len(row) for row in rows}) != 1:
        raise Unknown
    return np.array(rows)


def unit(q: Array) -> Array:
    """Quaternions brought to norm 1."""
    return q / np.linalg.norm(q, axis=-1, keepdims=True)
