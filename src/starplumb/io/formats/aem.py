"""CCSDS Attitude Ephemeris Message, versions 1 and 2 (CCSDS 504.0-B-1, -2): reader and version 2 writers.

The trap: CCSDS writes "A to B" with the quaternion whose coordinate matrix is the TRANSPOSE of the rotation
it makes, ``M_BA = R(Q).T`` (ADM annex F). Ours rotates v_A into v_B, ``C_BA = R(q_BA)``; so q_BA is the
conjugate of the file's Q, and Q itself where version 1 says ``ATTITUDE_DIR = B2A``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..text.files import show
from .ccsds_file import add_segments, blank, digits, load, save
from .ccsds_message import (
    Dialect,
    Message,
    Piece,
    Segment,
    check,
    check_columns,
    choice,
    common,
    join,
    numbers,
    segment_epochs,
    time_scale,
    usable,
)
from .quaternions import CONJUGATE, unit
from .series_tables import AttitudeTable, FloatArray

_WIDTHS = {"QUATERNION": 4, "QUATERNION/DERIVATIVE": 8, "QUATERNION/RATE": 7, "QUATERNION/ANGVEL": 7}
AEM = Dialect(
    name="AEM",
    versions=(1, 2),
    record="attitudeState",
    columns={"Q1": "", "Q2": "", "Q3": "", "QC": ""},
    record_template="<attitudeState><quaternionEphemeris><EPOCH>{}</EPOCH><quaternion>"
    "<Q1>{}</Q1><Q2>{}</Q2><Q3>{}</Q3><QC>{}</QC></quaternion></quaternionEphemeris></attitudeState>",
    data_marks=True,
    mandatory=(
        "OBJECT_NAME",
        "OBJECT_ID",
        "REF_FRAME_A",
        "REF_FRAME_B",
        "TIME_SYSTEM",
        "START_TIME",
        "STOP_TIME",
        "ATTITUDE_TYPE",
    ),
    optional=frozenset(
        {
            "CENTER_NAME",
            "ATTITUDE_DIR",
            "QUATERNION_TYPE",
            "USEABLE_START_TIME",
            "USEABLE_STOP_TIME",
            "EULER_ROT_SEQ",
            "RATE_FRAME",
            "ANGVEL_FRAME",
            "INTERPOLATION_METHOD",
            "INTERPOLATION_DEGREE",
        }
    ),
    choices={"ATTITUDE_TYPE": tuple(_WIDTHS)},
)


def read_aem(path: str | Path) -> AttitudeTable:
    """Attitude of an AEM, KVN or XML, as quaternions of C_BA (Hamilton, scalar last: v_B = C_BA v_A).

    Types QUATERNION, QUATERNION/DERIVATIVE, QUATERNION/RATE and QUATERNION/ANGVEL; what follows the
    quaternion is not read. A norm within 1e-3 of one is made one. Rows outside the useable time are left out
    with a notice. Raises InputError, naming the line, for all else that cannot be used.
    """
    message = load(path, AEM)
    notices = check(message, AEM)
    scale = time_scale(message)
    frame_a, frame_b = common(message, "REF_FRAME_A"), common(message, "REF_FRAME_B")
    object_name, object_id = common(message, "OBJECT_NAME"), common(message, "OBJECT_ID")
    pieces = []
    for segment in message.segments:
        t_ns = segment_epochs(message, segment, scale)
        q_BA = _quaternions(message, segment)
        notices += _left_unread(message, segment, notices)
        rows, dropped = usable(message, segment, t_ns, scale)
        notices += dropped
        pieces.append(Piece(t_ns[rows], q_BA[rows], segment.line))
    t_ns, q_BA, segments, joints = join(message, pieces)
    return AttitudeTable(
        t_ns,
        q_BA_xyzw=q_BA,
        frame_a=frame_a,
        frame_b=frame_b,
        time_scale=scale,
        object_name=object_name,
        segments=segments,
        object_id=object_id,
        notices=(*notices, *joints),
    )


def _left_unread(message: Message, segment: Segment, said: list[str]) -> list[str]:
    """A notice, once, that the rates beside the quaternions are not used."""
    kind = segment.meta["ATTITUDE_TYPE"].text.upper()
    words = (
        f"{message.path}: the type {kind} gives rates beside the quaternions, which are not used; between samples the "
        "attitude is interpolated from the quaternions alone"
    )
    return [words] if kind != "QUATERNION" and words not in said else []


def _quaternions(message: Message, segment: Segment) -> FloatArray:
    """q_BA (n, 4) of a segment: order, norm and direction settled."""
    kind = choice(message, segment, "ATTITUDE_TYPE", tuple(_WIDTHS))
    scalar_first = _scalar_first(message, segment)
    conjugate = _a_to_b(message, segment)
    if not message.named_columns:
        check_columns(message, segment, (_WIDTHS[kind],))
    q = numbers(message, segment, slice(4))
    if scalar_first:
        q = np.roll(q, -1, axis=1)
    q = unit(q, lambda row, fault: message.error(segment.lines[row], fault))
    return q * CONJUGATE if conjugate else q


def _scalar_first(message: Message, segment: Segment) -> bool:
    """Whether QC leads: version 1 says so in KVN; XML names the components; version 2 has it last."""
    if message.version == 1 and not message.named_columns:
        return choice(message, segment, "QUATERNION_TYPE", ("FIRST", "LAST")) == "FIRST"
    if message.version == 2:
        _refuse_removed(message, segment, "QUATERNION_TYPE", "LAST")
    return False


def _a_to_b(message: Message, segment: Segment) -> bool:
    """Whether the file's quaternion is CCSDS's A to B: version 1 may say the opposite, version 2 may not."""
    if message.version == 1:
        return choice(message, segment, "ATTITUDE_DIR", ("A2B", "B2A")) == "A2B"
    _refuse_removed(message, segment, "ATTITUDE_DIR", "A2B")
    return True


def _refuse_removed(message: Message, segment: Segment, key: str, implied: str) -> None:
    """Version 2 dropped two keywords; one that contradicts what it fixed instead leaves the meaning open."""
    entry = segment.meta.get(key)
    if entry is not None and entry.text.upper() != implied:
        fault = f"{key} is {show(entry.text)}, but version 2 has no such keyword and always means {implied}"
        raise message.error(entry.line, f"{fault}; remove it, or set CCSDS_AEM_VERS to 1.0 if it is meant")


def write_aem_kvn(
    path: str | Path, table: AttitudeTable, *, originator: str = "STARPLUMB", created: str | None = None
) -> None:
    """Write version 2, keyword = value, in CCSDS's own sense of the quaternion; it reads back bit for bit."""
    save(path, _message(table, originator, created), AEM, xml=False)


def write_aem_xml(
    path: str | Path, table: AttitudeTable, *, originator: str = "STARPLUMB", created: str | None = None
) -> None:
    """Write version 2, XML, in CCSDS's own sense of the quaternion; it reads back bit for bit."""
    save(path, _message(table, originator, created), AEM, xml=True)


def _message(table: AttitudeTable, originator: str, created: str | None) -> Message:
    message = blank(originator, created)
    meta = {
        "OBJECT_NAME": table.object_name,
        "OBJECT_ID": table.object_id or table.object_name,
        "REF_FRAME_A": table.frame_a,
        "REF_FRAME_B": table.frame_b,
    }
    quaternions = digits(table.q_BA_xyzw * CONJUGATE)
    add_segments(message, table, meta, {"ATTITUDE_TYPE": "QUATERNION"}, quaternions)
    return message
