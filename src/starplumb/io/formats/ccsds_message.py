"""A CCSDS navigation message as text with line numbers, before its numbers are checked.

Both notations (keyword = value, and XML) are parsed into the same :class:`Message`; what is common to the
orbit and the attitude ephemeris is read out of it here. Source: CCSDS 502.0-B-3 (ODM), 504.0-B-1 and -2
(ADM), 505.0-B-3 (XML).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np

from ...physics import timescales
from ...physics.errors import EpochError, InputError
from ..text.files import cut, show
from ..text.numbers import numbers as all_numbers
from ..text.numbers import whole
from .series_tables import EpochArray, FloatArray, Rows


class Entry(NamedTuple):
    """Value of a keyword and the line it stands on."""

    text: str
    line: int = 0


@dataclass
class Segment:
    """One metadata block and the rows under it; ``rows`` hold the text of the columns after the epoch."""

    line: int = 0
    meta: dict[str, Entry] = field(default_factory=dict)
    epochs: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    covariances: int = 0


@dataclass
class Message:
    """A whole file. ``named_columns``: rows were picked by name (XML), so they are in the dialect's order."""

    path: str
    named_columns: bool
    header: dict[str, Entry] = field(default_factory=dict)
    version: int = 0
    segments: list[Segment] = field(default_factory=list)

    def error(self, line: int, text: str) -> InputError:
        """The one sentence: file, line, what is wrong."""
        return InputError(f"{self.path}, line {line}: {text}")


@dataclass(frozen=True)
class Dialect:
    """What distinguishes one kind of message: names, versions, keywords, and the columns wanted of a record.

    ``columns`` maps element names to the unit that a ``units`` attribute may state. ``record_template`` is
    the XML of one record, filled with the epoch and the columns. ``data_marks``: rows stand between
    DATA_START and DATA_STOP. ``choices`` are the values of keywords on which the columns of a record depend.
    """

    name: str
    versions: tuple[int, ...]
    record: str
    columns: dict[str, str]
    record_template: str
    data_marks: bool
    mandatory: tuple[str, ...]
    optional: frozenset[str]
    choices: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def version_key(self) -> str:
        return f"CCSDS_{self.name}_VERS"


HEADER_KEYS = frozenset({"CREATION_DATE", "ORIGINATOR", "MESSAGE_ID", "CLASSIFICATION"})


def set_version(message: Message, dialect: Dialect, found: Entry) -> None:
    """Take the version of the message; InputError where this reader does not know it."""
    major, _, minor = found.text.partition(".")
    if not (whole(major) in dialect.versions and minor.strip("0") == ""):
        wanted = ", ".join(f"{number}.0" for number in dialect.versions)
        raise message.error(
            found.line, f"{dialect.version_key} is {show(found.text)}, wanted one of {wanted}"
        )
    message.version = int(major)


def check(message: Message, dialect: Dialect) -> list[str]:
    """InputError for a missing keyword or an empty segment; returns notices about keywords that are not used."""
    if not message.segments:
        raise InputError(f"{message.path}: holds no segment (no metadata block was found)")
    known = {*dialect.mandatory, *dialect.optional}
    notices = [_ignored(message, key) for key in message.header if key not in HEADER_KEYS]
    for segment in message.segments:
        for key in dialect.mandatory:
            if key not in segment.meta:
                raise message.error(segment.line, f"the metadata that start here lack the mandatory {key}")
        if not segment.rows:
            raise message.error(segment.line, "the segment that starts here has no data")
        notices += [_ignored(message, key) for key in segment.meta if key not in known]
    covariances = sum(segment.covariances for segment in message.segments)
    if covariances:
        notices.append(f"{message.path}: covariance is not read ({covariances} found)")
    return list(dict.fromkeys(notices))


def _ignored(message: Message, key: str) -> str:
    return f"{message.path}: keyword {cut(key)} is not known and was ignored"


def common(message: Message, key: str) -> str:
    """The value that every segment must share (frame, object, time system)."""
    first = message.segments[0].meta[key]
    for segment in message.segments[1:]:
        other = segment.meta[key]
        if other.text != first.text:
            found = f"{key} is {show(other.text)} but {show(first.text)} in the first segment"
            raise message.error(other.line, f"{found}, one file must keep to one")
    return first.text


def choice(message: Message, segment: Segment, key: str, wanted: tuple[str, ...]) -> str:
    """The value of a keyword, one of those wanted."""
    entry = segment.meta.get(key)
    words = ", ".join(wanted[:-1]) + " or " + wanted[-1]
    if entry is None:
        raise message.error(segment.line, f"the metadata that start here lack {key}, wanted {words}")
    value = entry.text.upper()
    if value not in wanted:
        raise message.error(entry.line, f"{key} is {show(entry.text)}, wanted {words}")
    return value


def time_scale(message: Message) -> str:
    """TIME_SYSTEM, one of those that starplumb knows."""
    found = common(message, "TIME_SYSTEM")
    if found.upper() not in timescales.SCALES:
        line = message.segments[0].meta["TIME_SYSTEM"].line
        wanted = ", ".join(timescales.SCALES)
        raise message.error(line, f"TIME_SYSTEM is {show(found)}, wanted one of {wanted}")
    return found.upper()


def check_columns(message: Message, segment: Segment, allowed: tuple[int, ...]) -> None:
    """InputError for a row with another number of columns after the epoch."""
    for row, line in zip(segment.rows, segment.lines, strict=True):
        if len(row) not in allowed:
            wanted = " or ".join(map(str, allowed))
            raise message.error(line, f"found {len(row)} numbers after the epoch, wanted {wanted}")


def numbers(message: Message, segment: Segment, columns: slice, power: int = 0) -> FloatArray:
    """Columns of all rows as (n, k) doubles, times ten to ``power``.

    The power is put into the decimal text before it is rounded, so that kilometres read as metres are
    correctly rounded and a value written by this package comes back bit for bit.
    """
    rows = [row[columns] for row in segment.rows]
    values = all_numbers(list(chain.from_iterable(rows)), power).reshape(len(rows), -1)
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        wrong = rows[row][int(np.argmin(np.isfinite(values[row])))]
        raise message.error(segment.lines[row], f"found {show(wrong)}, wanted a finite number")
    return values


def epochs(message: Message, texts: Sequence[str], lines: Sequence[int], scale: str) -> EpochArray:
    """Epochs as t_ns; the error for a wrong one names the file and the line."""
    try:
        return timescales.parse(texts, scale)
    except EpochError as error:
        raise message.error(lines[error.row], str(error)) from None


def segment_epochs(message: Message, segment: Segment, scale: str) -> EpochArray:
    """Epochs of a segment's rows, strictly increasing."""
    t_ns = epochs(message, segment.epochs, segment.lines, scale)
    late = np.diff(t_ns) <= 0
    if late.any():
        row = int(np.argmax(late)) + 1
        fault = "repeats" if t_ns[row] == t_ns[row - 1] else "is earlier than"
        raise message.error(
            segment.lines[row],
            f"epoch {segment.epochs[row]} {fault} the one before ({segment.epochs[row - 1]}), "
            "wanted increasing epochs",
        )
    return t_ns


def usable(message: Message, segment: Segment, t_ns: EpochArray, scale: str) -> tuple[slice, list[str]]:
    """Rows inside USEABLE_START_TIME .. USEABLE_STOP_TIME, with a notice about those outside."""
    start, stop = 0, len(t_ns)
    for key, side in (("USEABLE_START_TIME", "left"), ("USEABLE_STOP_TIME", "right")):
        if key not in segment.meta:
            continue
        entry = segment.meta[key]
        limit = epochs(message, [entry.text], [entry.line], scale)
        index = int(np.searchsorted(t_ns, limit[0], side="left" if side == "left" else "right"))
        start, stop = (index, stop) if side == "left" else (start, index)
    if stop <= start:
        raise message.error(segment.line, "no row of the segment that starts here lies in its useable time")
    dropped = len(t_ns) - (stop - start)
    span = f"{segment.epochs[start]} .. {segment.epochs[stop - 1]}"
    notice = f"{dropped} rows outside the useable time were left out, {span} remain"
    return slice(start, stop), [f"{message.path}, line {segment.line}: {notice}"] if dropped else []


class Piece(NamedTuple):
    """Rows of one segment that may be used."""

    t_ns: EpochArray
    values: FloatArray
    line: int


def join(
    message: Message, pieces: Iterable[Piece]
) -> tuple[EpochArray, FloatArray, tuple[Rows, ...], list[str]]:
    """All segments in order of time, with the rows of each.

    Segments may touch (a manoeuvre ends one and begins the next at the same epoch): the later one then loses
    its first row, and a notice says so. Segments that overlap any further contradict each other: InputError.
    """
    kept: list[Piece] = []
    notices = []
    for piece in sorted(pieces, key=lambda piece: int(piece.t_ns[0])):
        if kept and piece.t_ns[0] < kept[-1].t_ns[-1]:
            raise message.error(piece.line, f"this segment overlaps in time the one of line {kept[-1].line}")
        if kept and piece.t_ns[0] == kept[-1].t_ns[-1]:
            touch = f"the segment begins at the epoch where that of line {kept[-1].line} ends"
            notices.append(f"{message.path}, line {piece.line}: {touch}, its first row was left out")
            piece = Piece(piece.t_ns[1:], piece.values[1:], piece.line)
        if len(piece.t_ns):
            kept.append(piece)
    borders = np.cumsum([0, *(len(piece.t_ns) for piece in kept)]).tolist()
    rows = tuple(pairwise(borders))
    return np.concatenate([p.t_ns for p in kept]), np.concatenate([p.values for p in kept]), rows, notices
