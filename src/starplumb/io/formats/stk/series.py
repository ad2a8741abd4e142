"""STK ephemeris (``.e``) and attitude (``.a``) files, as STK, FreeFlyer, GMAT and many simulators write them.

Times are seconds since ``ScenarioEpoch``, which is UTC.  The trap: STK's quaternion turns the reference axes into those
of the body, and its coordinate matrix is the transpose; ours, which takes coordinates along, is its conjugate.  The
manual's example of AttitudeTimeQuatAngVels shows it: after 10 s at +6 deg/s about its z a body has q3 = sin(30 deg).
Source: STK help, "Ephemeris File Format (*.e)" and "Attitude File Format (*.a)".
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ....physics.errors import InputError
from ...text.files import show
from ...text.frames import EarthFrame
from ..quaternions import CONJUGATE, unit
from ..series_tables import AttitudeTable, EphemerisTable
from .text import StkFile, numbers, parse, times

_FRAMES: dict[str, EarthFrame] = {
    "fixed": "ITRF",
    "itrf": "ITRF",
    "j2000": "GCRF",
    "icrf": "GCRF",
    "inertial": "GCRF",
    "temeofdate": "TEME",
    "trueofdate": "TOD",
    "meanofdate": "MOD",
}
_FRAME_WORDS = "Fixed, ICRF, J2000, Inertial, TEMEOfDate, TrueOfDate or MeanOfDate"
_METRES = {"meters": 0, "kilometers": 3}
"""Powers of ten."""
_ORBITS = {"EphemerisTimePos": 3, "EphemerisTimePosVel": 6, "EphemerisTimePosVelAcc": 9}
_ATTITUDES = {"AttitudeTimeQuaternions": 4, "AttitudeTimeQuatScalarFirst": 4, "AttitudeTimeQuatAngVels": 7}


def read_stk_ephemeris(path: Path) -> EphemerisTable:
    """Orbit of a ``.e`` file with Cartesian positions, in m and m/s.

    ``SegmentBoundaryTimes`` part arcs; a time that stands twice at such a border is the end of one and the beginning of
    the next, of which the second row is left out.  Raises InputError, naming the line, for what cannot be used.
    """
    file = parse(path, "Ephemeris", _ORBITS)
    _require_earth(file)
    word = file.value("CoordinateSystem") or "Fixed"  # STK's default
    frame = _frame(file, "CoordinateSystem", word)
    unit_word = file.value("DistanceUnit") or "Meters"
    if unit_word.lower() not in _METRES:
        line = file.keys["distanceunit"][0]
        raise file.error(line, f"DistanceUnit is {show(unit_word)}, wanted Meters or Kilometers")
    t_ns, keep, segments, notices = times(file)
    states = numbers(file, file.rows, _ORBITS[file.kind], _METRES[unit_word.lower()])[keep]
    return EphemerisTable(
        t_ns,
        r=states[:, :3],
        v=states[:, 3:6] if states.shape[1] > 3 else None,
        frame=frame,
        time_scale="UTC",
        object_name="",
        segments=segments,
        frame_text=word,
        notices=tuple(notices),
    )


def read_stk_attitude(path: Path) -> AttitudeTable:
    """Attitude of a ``.a`` file of quaternions as C_BA, from its axes A to those of the body, which it does not name.

    Raises InputError, naming the line, for what cannot be used.
    """
    file = parse(path, "Attitude", _ATTITUDES)
    _require_earth(file)
    word = file.value("CoordinateAxes")
    if word is None:
        raise InputError(f"{path}: found no CoordinateAxes, wanted {_FRAME_WORDS}")
    _frame(file, "CoordinateAxes", word)
    t_ns, keep, segments, notices = times(file)
    q = numbers(file, file.rows, _ATTITUDES[file.kind])[keep, :4]
    if file.kind == "AttitudeTimeQuatScalarFirst":
        q = np.roll(q, -1, axis=1)
    lines = np.array(file.lines)[keep]
    q_AB = unit(q, lambda row, fault: file.error(int(lines[row]), fault))
    if file.kind == "AttitudeTimeQuatAngVels":
        notices.append(
            f"{path}: its rates beside the quaternions are not used; between samples the attitude is interpolated from "
            "the quaternions alone"
        )
    return AttitudeTable(
        t_ns,
        q_BA_xyzw=q_AB * CONJUGATE,
        frame_a=_FRAMES[word.lower()],
        frame_b="",
        time_scale="UTC",
        object_name="",
        segments=segments,
        notices=tuple(notices),
    )


def _require_earth(file: StkFile) -> None:
    body = file.value("CentralBody") or "Earth"
    if body.lower() != "earth":
        raise file.error(file.keys["centralbody"][0], f"CentralBody is {show(body)}, wanted Earth")


def _frame(file: StkFile, key: str, word: str) -> EarthFrame:
    frame = _FRAMES.get(word.lower())
    if frame is None:
        line = file.keys[key.lower()][0]
        raise file.error(line, f"{key} is {show(word)}, wanted {_FRAME_WORDS}")
    return frame
