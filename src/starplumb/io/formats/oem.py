"""CCSDS Orbit Ephemeris Message, versions 1 to 3 (CCSDS 502.0-B-1, -2, -3): reader and version 2 writers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...physics.errors import InputError
from ..text.files import show
from ..text.frames import earth_frame
from .ccsds_file import add_segments, blank, digits, load, save
from .ccsds_message import (
    Dialect,
    Message,
    Piece,
    Segment,
    check,
    check_columns,
    common,
    join,
    numbers,
    segment_epochs,
    time_scale,
    usable,
)
from .series_tables import EphemerisTable

OEM = Dialect(
    name="OEM",
    versions=(1, 2, 3),
    record="stateVector",
    columns={"X": "km", "Y": "km", "Z": "km", "X_DOT": "km/s", "Y_DOT": "km/s", "Z_DOT": "km/s"},
    record_template="<stateVector><EPOCH>{}</EPOCH>"
    "<X>{}</X><Y>{}</Y><Z>{}</Z><X_DOT>{}</X_DOT><Y_DOT>{}</Y_DOT><Z_DOT>{}</Z_DOT></stateVector>",
    data_marks=False,
    mandatory=(
        "OBJECT_NAME",
        "OBJECT_ID",
        "CENTER_NAME",
        "REF_FRAME",
        "TIME_SYSTEM",
        "START_TIME",
        "STOP_TIME",
    ),
    optional=frozenset(
        {
            "USEABLE_START_TIME",
            "USEABLE_STOP_TIME",
            "REF_FRAME_EPOCH",
            "INTERPOLATION",
            "INTERPOLATION_DEGREE",
        }
    ),
)
_KM = 3
_ACCEPTED = (
    "ITRF or one of its realisations (ITRF-97 ...), WGS84, GCRF, ICRF, EME2000, J2000, TEME, TOD or MOD"
)


def read_oem(path: str | Path) -> EphemerisTable:
    """Ephemeris of an OEM, KVN or XML, in metres and metres per second.

    Frames ITRF, any realisation of it, and WGS84 become "ITRF" (they agree to centimetres); GCRF, ICRF,
    EME2000 and J2000 become "GCRF" (EME2000 differs by 0.02 arcsec). Rows outside the useable time are left
    out and accelerations and covariances are not read, with notices. Raises InputError, naming the line, for
    all else that cannot be used.
    """
    message = load(path, OEM)
    notices = check(message, OEM)
    scale = time_scale(message)
    object_name, object_id = common(message, "OBJECT_NAME"), common(message, "OBJECT_ID")
    frames = {_frame(message, segment) for segment in message.segments}
    if len(frames) > 1:
        raise InputError(f"{path}: found segments in ITRF and in GCRF, one file must keep to one frame")
    pieces = []
    for segment in message.segments:
        check_columns(message, segment, (6,) if message.version == 1 else (6, 9))
        t_ns = segment_epochs(message, segment, scale)
        states = numbers(message, segment, slice(6), power=_KM)
        rows, dropped = usable(message, segment, t_ns, scale)
        notices += dropped
        pieces.append(Piece(t_ns[rows], states[rows], segment.line))
    t_ns, states, segments, joints = join(message, pieces)
    meta = message.segments[0].meta
    return EphemerisTable(
        t_ns,
        r=states[:, :3],
        v=states[:, 3:],
        frame=frames.pop(),
        time_scale=scale,
        object_name=object_name,
        segments=segments,
        frame_text=meta["REF_FRAME"].text,
        object_id=object_id,
        notices=(*notices, *joints),
    )


def _frame(message: Message, segment: Segment) -> str:
    """The frame by our name; the centre must be the Earth's."""
    center = segment.meta["CENTER_NAME"]
    if center.text.upper() != "EARTH":
        raise message.error(center.line, f"CENTER_NAME is {show(center.text)}, wanted EARTH")
    frame = segment.meta["REF_FRAME"]
    if (known := earth_frame(frame.text)) is not None:
        return known
    raise message.error(frame.line, f"REF_FRAME is {show(frame.text)}, wanted {_ACCEPTED}")


def write_oem_kvn(
    path: str | Path, table: EphemerisTable, *, originator: str = "STARPLUMB", created: str | None = None
) -> None:
    """Write version 2, keyword = value; it reads back bit for bit. InputError without velocities."""
    save(path, _message(path, table, originator, created), OEM, xml=False)


def write_oem_xml(
    path: str | Path, table: EphemerisTable, *, originator: str = "STARPLUMB", created: str | None = None
) -> None:
    """Write version 2, XML; it reads back bit for bit. InputError without velocities."""
    save(path, _message(path, table, originator, created), OEM, xml=True)


def _message(path: str | Path, table: EphemerisTable, originator: str, created: str | None) -> Message:
    if table.v is None:
        raise InputError(f"{path}: an OEM needs velocities and this ephemeris has none")
    message = blank(originator, created)
    meta = {
        "OBJECT_NAME": table.object_name,
        "OBJECT_ID": table.object_id or table.object_name,
        "CENTER_NAME": "EARTH",
        "REF_FRAME": table.frame_text or table.frame,
    }
    states = np.hstack([table.r, table.v])
    add_segments(message, table, meta, {}, digits(states, power=-_KM))
    return message
