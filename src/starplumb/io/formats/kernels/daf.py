"""The structure of a SPICE kernel of orbits or attitudes (DAF), checked before SPICE opens it.

SPICE believes what a segment says of itself, and a wrong count makes it leave its own memory. Here every segment must
lie in the file, and be as long as the numbers at its end say. Source: NAIF, DAF, SPK and CK Required Reading.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ....physics.errors import InputError
from ...text.files import show
from ..series_tables import FloatArray

_RECORD, _WORD, _SUMMARY_WORDS = 1024, 8, 5
_MOST_SUMMARIES = 25
_ORDER = {b"LTL-IEEE": "<", b"BIG-IEEE": ">"}
_MOST_NODES = 28
"""Of an interpolation in SPICE, whose arrays have so many places."""
_MOST_DEGREE = 25
_MOST_TIME = 1e19
"""Of seconds or ticks of a clock."""
_MOST_NUMBER = 1e30
_FAR_S = 1e6
"""Of the two bodies' orbit from the nearest state."""
_ROUNDING_S = 1e-3
"""Of the ends of what a segment holds."""
_GROUP = 100
"""Of how many values a directory names the last."""


@dataclass(frozen=True)
class _Daf:
    """An open file: its path for the user, the order of its bytes, and how many words it has."""

    path: Path
    file: BinaryIO
    order: str
    words: int

    def numbers(self, first: int, n: int) -> tuple[float, ...]:
        """Words ``first`` (from 1) and the following."""
        if not 1 <= first <= first + n - 1 <= self.words:
            raise self.broken(f"words {first} to {first + n - 1} of {self.words}, wanted a whole file")
        self.file.seek((first - 1) * _WORD)
        return struct.unpack(f"{self.order}{n}d", self.file.read(n * _WORD))

    def count(self, at: int, what: str, least: int = 0, most: int | None = None) -> int:
        """The whole number that a word is."""
        (value,) = self.numbers(at, 1)
        top = self.words if most is None else most
        if not (least <= value <= top and value == int(value)):
            raise self.broken(f"{value:.9g} as {what}, wanted a whole number of {least} to {top}")
        return int(value)

    def times(self, first: int, n: int, names: int) -> FloatArray:
        """``n`` increasing times from word ``first``, and after them a directory: every hundredth of them, or between
        it and the next."""
        values = np.array(self.numbers(first, n + names))
        found, directory = values[:n], values[n:]
        if not (np.isfinite(found).all() and (np.diff(found) > 0.0).all()):
            raise self.broken("times that do not increase, wanted others")
        self.require_directory(directory, found)
        return found

    def require_directory(self, directory: FloatArray, times: FloatArray) -> None:
        before = times[_GROUP - 1 :: _GROUP][: directory.size]
        after = np.append(times, times[-1])[_GROUP::_GROUP][: directory.size]
        if not ((before <= directory) & (directory <= after)).all():
            raise self.broken("a directory of other times, wanted those of the segment")

    def require_numbers(self, first: int, n: int) -> None:
        """Raise InputError where a word is no number that SPICE could count with."""
        self.file.seek((first - 1) * _WORD)
        values = np.frombuffer(self.file.read(n * _WORD), dtype=f"{self.order}f8")
        if not (np.abs(values) < _MOST_NUMBER).all():
            raise self.broken("numbers that are none, or without bounds, wanted others")

    def broken(self, found: str) -> InputError:
        return InputError(f"{self.path}: found a damaged kernel, {found}")


@dataclass(frozen=True)
class _Segment:
    """Its type, whether it has rates (CK), its first and last word, and the first and last time that it is for."""

    kind: int
    flag: int
    begin: int
    end: int
    opens: float
    closes: float

    @property
    def length(self) -> int:
        return self.end - self.begin + 1


def require_whole(path: Path, kernel: Path) -> None:
    """Raise InputError where the segments of ``kernel``, the user's file ``path``, are not what they say."""
    with kernel.open("rb") as file:
        head = file.read(_RECORD)
        words = file.seek(0, 2) // _RECORD * (_RECORD // _WORD)  # SPICE reads whole records
        order = _ORDER.get(head[88:96])
        if head.startswith(b"NAIF/DAF"):  # of old, which do not say
            order = next((each for each in "<>" if struct.unpack(f"{each}2i", head[8:16]) == (2, 6)), None)
        if order is None or len(head) < _RECORD:
            found = f"found the format {show(head[88:96].decode('latin-1'))} of numbers"
            raise InputError(f"{path}: {found}, wanted LTL-IEEE or BIG-IEEE")
        daf = _Daf(path, file, order, words)
        if (sizes := struct.unpack(f"{order}2i", head[8:16])) != (2, 6):
            raise daf.broken(f"summaries of {sizes[0]} and {sizes[1]} numbers, wanted 2 and 6")
        spk = not head.startswith(b"DAF/CK")
        checks = _SPK if spk else _CK
        first, last, free = struct.unpack(f"{order}3i", head[76:88])
        if not 1 <= free <= words + 1:
            raise daf.broken(f"its free address {free} outside, wanted a whole file")
        for segment in _segments(daf, first, last, spk):
            if not 2 * _RECORD // _WORD < segment.begin <= segment.end <= words:
                raise daf.broken(f"words {segment.begin} to {segment.end} of {words}, wanted a whole file")
            if segment.kind not in checks:
                wanted = ", ".join(map(str, checks))
                raise InputError(f"{path}: found a segment of type {segment.kind}, wanted one of {wanted}")
            if segment.length < _MOST_TAIL:
                raise daf.broken(f"a segment of {segment.length} words, wanted a whole file")
            daf.require_numbers(segment.begin, segment.length)
            checks[segment.kind](daf, segment)


def _segments(daf: _Daf, first: int, last: int, spk: bool) -> Iterator[_Segment]:
    """What every summary says of its segment."""
    record, before = first, 0
    per = _RECORD // _WORD
    while record:
        # its neighbour holds the names
        if not before < record or (record + 1) * per > daf.words:
            raise daf.broken(f"record {record} as one of summaries, wanted one after record {before}")
        start = (record - 1) * per + 1
        following = daf.count(start, "the next record")
        n = daf.count(start + 2, "the number of summaries", most=_MOST_SUMMARIES)
        for i in range(n):
            daf.file.seek((start + 2 + i * _SUMMARY_WORDS + 2) * _WORD)
            whole = struct.unpack(f"{daf.order}6i", daf.file.read(24))
            opens, closes = daf.numbers(start + 3 + i * _SUMMARY_WORDS, 2)
            if not -_MOST_TIME <= opens <= closes <= _MOST_TIME:
                raise daf.broken(f"a segment from {opens:.9g} to {closes:.9g}, wanted times that increase")
            kind, flag = (whole[3], 0) if spk else whole[2:4]
            yield _Segment(kind, flag, whole[4], whole[5], opens, closes)
        record, before = following, record
    if before != last:
        raise daf.broken(f"record {before} as the last of summaries, wanted {last}")


_Check = Callable[[_Daf, _Segment], None]
"""Raises InputError for a segment that is not as long as the numbers at its end say, or whose times do not increase."""
_MOST_TAIL = 5


def _require_length(daf: _Daf, segment: _Segment, length: int) -> None:
    if segment.length != length:
        found = f"a segment of type {segment.kind} with {segment.length} words that says {length}"
        raise daf.broken(f"{found}, wanted a whole file")


def _require_within(daf: _Daf, segment: _Segment, first: float, last: float) -> None:
    """SPICE writes no segment for times beyond what it holds, and reads a polynomial far outside its nodes there."""
    if not first - _ROUNDING_S <= segment.opens <= segment.closes <= last + _ROUNDING_S:
        held = f"{first:.9g} to {last:.9g}"
        raise daf.broken(
            f"a segment for {segment.opens:.9g} to {segment.closes:.9g}, wanted times within {held}"
        )


def _at_times(daf: _Daf, segment: _Segment, n: int, width: int, names: int, tail: int) -> FloatArray:
    """``n`` records of ``width`` numbers, their times, the directory, and ``tail`` numbers more; the times."""
    _require_length(daf, segment, (width + 1) * n + names + tail)
    return daf.times(segment.begin + width * n, n, names)


def _in_stretches(daf: _Daf, segment: _Segment, n: int, width: int, tail: int) -> FloatArray:
    """The times, checked as before, with the beginnings of stretches, and a directory of them, before the ``tail``."""
    k = daf.count(segment.end - 1, "the number of intervals", 1, n)
    _require_length(daf, segment, (width + 1) * n + _names(n) + k + _names(k) + tail)
    at = segment.begin + width * n
    times = daf.times(at, n, _names(n))
    begins = daf.times(at + n + _names(n), k, _names(k))
    if begins[0] != times[0] or not np.isin(begins, times).all():
        raise daf.broken("intervals that begin at no time of the segment, wanted those")
    return times


def _names(n: int) -> int:
    return (n - 1) // _GROUP


def _differences(daf: _Daf, segment: _Segment) -> None:
    n = daf.count(segment.end, "the number of records", 1)
    times = _at_times(daf, segment, n, 71, n // _GROUP, 1)
    _require_within(daf, segment, -np.inf, times[-1])


def _long_differences(daf: _Daf, segment: _Segment) -> None:
    n = daf.count(segment.end, "the number of records", 1)
    size = daf.count(segment.end - 1, "the size of difference lines", 1, _MOST_DEGREE)
    times = _at_times(daf, segment, n, 4 * size + 11, n // _GROUP, 2)
    _require_within(daf, segment, -np.inf, times[-1])


def _chebyshev(components: int) -> _Check:
    def check(daf: _Daf, segment: _Segment) -> None:
        n = daf.count(segment.end, "the number of records", 1)
        most = 2 + components * (_MOST_DEGREE + 3)
        size = daf.count(segment.end - 1, "the size of records", 2 + components, most)
        first, step = daf.numbers(segment.end - 3, 2)
        if (size - 2) % components or not 0.0 < step < np.inf:
            raise daf.broken(f"records of {size} numbers for {step:g} s, wanted a polynomial's")
        _require_length(daf, segment, size * n + 4)
        _require_within(daf, segment, first, first + n * step)

    return check


def _two_body(daf: _Daf, segment: _Segment) -> None:
    n = daf.count(segment.end, "the number of states", 1)
    times = _at_times(daf, segment, n, 6, n // _GROUP, 2)
    _require_within(daf, segment, times[0] - _FAR_S, times[-1] + _FAR_S)
    (mass,) = daf.numbers(segment.end - 1, 1)
    states = np.array(daf.numbers(segment.begin, 6 * n)).reshape(n, 6)
    distance, speed = np.linalg.norm(states[:, :3], axis=1), np.linalg.norm(states[:, 3:], axis=1)
    turning = np.linalg.norm(np.cross(states[:, :3], states[:, 3:]), axis=1)
    good = (distance > 1.0) & (distance < 1e9) & (turning > 1.0) & (speed**2 * distance < 2.0 * mass)
    if not (mass < 1e12 and good.all()):
        raise daf.broken("states that are on no orbit about its mass, wanted others")


def _equal_steps(daf: _Daf, segment: _Segment) -> None:
    n = daf.count(segment.end, "the number of states", 1)
    daf.count(segment.end - 1, "the degree", 1, min(_MOST_NODES, n) - 1)
    first, step = daf.numbers(segment.end - 3, 2)
    if not 0.0 < step < np.inf:
        raise daf.broken(f"states {step:g} s apart, wanted a positive step")
    _require_length(daf, segment, 6 * n + 4)
    _require_within(daf, segment, first, first + (n - 1) * step)


def _nodes(daf: _Daf, segment: _Segment) -> None:
    n = daf.count(segment.end, "the number of states", 1)
    daf.count(segment.end - 1, "the degree", 0, min(_MOST_NODES, n) - 1)
    times = _at_times(daf, segment, n, 6, _names(n), 2)
    _require_within(daf, segment, times[0], times[-1])


def _packets(daf: _Daf, segment: _Segment) -> None:
    n = daf.count(segment.end, "the number of packets", 1)
    daf.count(segment.end - 1, "the window", 1, min(_MOST_NODES, n))
    width = (12, 6, 6)[daf.count(segment.end - 2, "the subtype", most=2)]
    times = _at_times(daf, segment, n, width, _names(n), 3)
    _require_within(daf, segment, times[0], times[-1])


def _fixed(words: int) -> _Check:
    return lambda daf, segment: _require_length(daf, segment, words)


def _pointing(daf: _Daf, segment: _Segment) -> None:
    n = daf.count(segment.end, "the number of pointings", 1)
    _at_times(daf, segment, n, 7 if segment.flag else 4, _names(n), 1)


def _constant_rates(daf: _Daf, segment: _Segment) -> None:
    """It does not say how many there are: SPICE takes that from its length."""
    n = _GROUP * (segment.length + 1) // (10 * _GROUP + 1)
    _require_length(daf, segment, 10 * n + _names(n))
    begins = daf.times(segment.begin + 8 * n, n, 0)
    ends = daf.times(segment.begin + 9 * n, n, 0)
    if (ends < begins).any():
        raise daf.broken("intervals that end before they begin, wanted others")
    if _names(n):
        daf.require_directory(np.array(daf.numbers(segment.begin + 10 * n, _names(n))), begins)


def _intervals(daf: _Daf, segment: _Segment) -> None:
    n = daf.count(segment.end, "the number of pointings", 1)
    _in_stretches(daf, segment, n, 7 if segment.flag else 4, 2)


def _packets_in_intervals(daf: _Daf, segment: _Segment) -> None:
    n = daf.count(segment.end, "the number of packets", 1)
    daf.count(segment.end - 2, "the window", 1, min(_MOST_NODES, n))
    width = (8, 4, 14, 7)[daf.count(segment.end - 3, "the subtype", most=3)]
    times = _in_stretches(daf, segment, n, width, 5)
    _require_within(daf, segment, times[0], times[-1])


_SPK: dict[int, _Check] = {
    1: _differences,
    2: _chebyshev(3),
    3: _chebyshev(6),
    5: _two_body,
    8: _equal_steps,
    9: _nodes,
    12: _equal_steps,
    13: _nodes,
    15: _fixed(16),
    17: _fixed(12),
    18: _packets,
    21: _long_differences,
}
_CK: dict[int, _Check] = {1: _pointing, 2: _constant_rates, 3: _intervals, 5: _packets_in_intervals}
