"""A CCSDS message on disk: notation recognised by the content, header written, digits kept."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path

import numpy as np

from ...physics import timescales
from ...physics.errors import InputError
from ..text.files import read_bytes, read_text
from ..text.write import write_text
from .ccsds_kvn import format_kvn, parse_kvn
from .ccsds_message import Dialect, Entry, Message, Segment
from .ccsds_xml import format_xml, read_xml
from .series_tables import AttitudeTable, EphemerisTable, FloatArray

_XML_STARTS = (b"<", b"\xff\xfe<\0", b"\xfe\xff\0<", b"<\0", b"\0<")


def load(path: str | Path, dialect: Dialect) -> Message:
    """The message in a file, KVN or XML; InputError where it cannot be read or is neither."""
    data = read_bytes(Path(path))
    if data.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(_XML_STARTS):
        return read_xml(str(path), data, dialect)
    return parse_kvn(str(path), read_text(Path(path)), dialect)


def blank(originator: str, created: str | None) -> Message:
    """A version 2 message with its header; ``created`` is an ISO 8601 time in UTC, now where None."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    header = {"CREATION_DATE": Entry(created or now), "ORIGINATOR": Entry(originator)}
    return Message("", named_columns=True, header=header, version=2)


def add_segments(
    message: Message,
    table: EphemerisTable | AttitudeTable,
    meta: dict[str, str],
    tail: dict[str, str],
    rows: Sequence[list[str]],
) -> None:
    """Append the table's segments; metadata in the standard's order: ``meta``, the times, ``tail``."""
    epochs = timescales.format_iso(table.t_ns, table.time_scale, digits=9)
    for start, stop in table.segments:
        times = {"TIME_SYSTEM": table.time_scale, "START_TIME": epochs[start], "STOP_TIME": epochs[stop - 1]}
        entries = {key: Entry(text) for key, text in {**meta, **times, **tail}.items()}
        message.segments.append(Segment(0, entries, epochs[start:stop], list(rows[start:stop])))


def save(path: str | Path, message: Message, dialect: Dialect, *, xml: bool) -> None:
    """Write the message; InputError for a value that would not be one line of text."""
    for entries in (message.header, *(segment.meta for segment in message.segments)):
        for key, entry in entries.items():
            if not entry.text.strip() or not entry.text.isprintable():
                raise InputError(f"{path}: {key} would be {entry.text!r}, wanted one line of printable text")
    write_text(Path(path), (format_xml if xml else format_kvn)(message, dialect))


def digits(values: FloatArray, power: int = 0) -> list[list[str]]:
    """Decimal text of ``values`` (n, k) times ten to ``power``: the shortest digits that read back alike."""
    texts = [format(Decimal(repr(value)).scaleb(power), "f") for value in np.ravel(values).tolist()]
    width = values.shape[1]
    return [texts[start : start + width] for start in range(0, len(texts), width)]
