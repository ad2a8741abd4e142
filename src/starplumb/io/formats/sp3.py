"""SP3 precise orbits, versions a to d: reader.

Source: S. Hilla, "The Extended Standard Product 3 Orbit Format", 2010 (SP3-c) and 2016 (SP3-d); the older versions a
and b have satellites without letters and no time system (GPS).  What the analysis centres of laser ranging and DORIS
write otherwise is read where it has one meaning only, and said.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...physics import timescales
from ...physics.errors import EpochError, InputError
from ..text.files import read_text, show
from ..text.frames import earth_frame
from ..text.numbers import whole
from .series_tables import EphemerisTable, FloatArray
from .sp3_lines import name_of, read_epoch, vector

_SCALES = {"GPS": "GPS", "UTC": "UTC", "TAI": "TAI", "GAL": "GPS", "QZS": "GPS", "IRN": "GPS"}
"""Time systems by the scale that they keep, to nanoseconds."""
_UNSTATED = ("", "ccc")
_FRAME = re.compile(r"(ITRF?|IGS|IGB|IGR|IG|SLRF?|WGS|[DJEG]TRF|DPOD)[ _-]?\w{0,4}")
_TURNING = re.compile(r"ECEF|ECF|EFG|TRF|EARTH|FIXED")
"""Names that say no more than that the frame turns with the Earth."""
_MANOEUVRE, _PREDICTED = slice(78, 79), slice(79, 80)
"""Flags M and P of a position record."""


@dataclass
class _Header:
    """What the first lines say; the frame and its ``notices`` may rest on the campaign's word."""

    frame: str
    frame_text: str
    epochs: int
    satellites: list[str] = field(default_factory=list)
    time_scale: str = ""
    notices: list[str] = field(default_factory=list)


@dataclass
class _Records:
    """Records of one satellite as they are read: text of the epoch, position m, velocity m/s or None."""

    epochs: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    positions: list[list[float]] = field(default_factory=list)
    velocities: list[list[float] | None] = field(default_factory=list)
    missing: int = 0
    predicted: int = 0
    manoeuvres: int = 0
    all_epochs: int = 0


def read_sp3(path: str | Path, satellite: str | None = None, frame: str | None = None) -> EphemerisTable:
    """Ephemeris of one satellite ("L47", "G01" ...), m and m/s, of ITRF relative to the turning Earth.

    ``satellite`` may be left out where the file has one only. ``frame`` is what the campaign says of a coordinate
    system that the file leaves undefined. Epochs at which its position is missing are left out, and all velocities
    are if one of them is missing, with notices. Clocks and correlations are not
    read. Raises InputError, naming the line, for another version or time system and for a file that breaks off.
    """
    lines = read_text(Path(path)).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    header = _header(path, lines, frame)
    name = _choose(path, header.satellites, satellite)
    records = _records(path, lines, name, header)
    if not records.epochs:
        raise InputError(f"{path}: satellite {name} has no position at any epoch")
    try:
        t_ns = timescales.parse(records.epochs, header.time_scale)
    except EpochError as error:
        raise InputError(f"{path}, line {records.lines[error.row]}: {error}") from None
    late = np.diff(t_ns) <= 0
    if late.any():
        row = int(np.argmax(late)) + 1
        fault = f"epoch {records.epochs[row]} is not later than the one before ({records.epochs[row - 1]})"
        raise InputError(f"{path}, line {records.lines[row]}: {fault}, wanted increasing epochs")
    velocities, notices = _velocities(path, records)
    return EphemerisTable(
        t_ns,
        r=np.array(records.positions),
        v=velocities,
        frame=header.frame,
        time_scale=header.time_scale,
        object_name=name,
        segments=((0, len(t_ns)),),
        frame_text=header.frame_text,
        object_id=name,
        notices=(*header.notices, *_notices(path, name, records), *notices),
    )


def _header(path: str | Path, lines: list[str], stated: str | None) -> _Header:
    """Version, frame, satellites and time system; everything before the first epoch."""
    first = lines[0]
    if not re.match(r"#[a-z]", first):
        raise InputError(
            f"{path}, line 1: found {show(first[:20])}, wanted an SP3 header that begins with #a, #b, #c or #d"
        )
    if first[1] not in "abcd":
        raise InputError(f"{path}, line 1: this is SP3-{first[1]}, wanted SP3-a, -b, -c or -d")
    frame_text, epochs = first[46:51].strip(), first[32:39].strip()
    frame, notices = _frame(path, frame_text, stated)
    header = _Header(frame, frame_text, whole(epochs) or 0, notices=notices)
    for number, line in enumerate(lines[1:], 2):
        if line.startswith("*"):
            break
        if line.startswith("+ "):
            names = (name_of(line[column : column + 3]) for column in range(9, 60, 3))
            header.satellites += [name for name in names if re.fullmatch(r"[A-Z]\d\d", name)]
        elif line.startswith("%c") and not header.time_scale:
            header.time_scale = _time_scale(path, number, line[9:12].strip(), first[1])
    if not header.time_scale:
        raise InputError(f"{path}: found no %c line, wanted one that names the time system")
    return header


def _time_scale(path: str | Path, number: int, word: str, version: str) -> str:
    """The scale of a time system; versions a and b, which name none, keep GPS time."""
    if version in "ab" and word in _UNSTATED:
        return "GPS"
    if word not in _SCALES:
        wanted = ", ".join(_SCALES)
        raise InputError(f"{path}, line {number}: the time system is {show(word)}, wanted one of {wanted}")
    return _SCALES[word]


def _frame(path: str | Path, word: str, stated: str | None) -> tuple[str, list[str]]:
    """The frame by our name; the campaign's, with a notice, where the file leaves it undefined."""
    name = word.upper()
    if _FRAME.fullmatch(name):
        return "ITRF", []
    if (known := earth_frame(name)) is not None:
        return known, []
    found = f"{path}, line 1: the coordinate system is {show(word)}"
    if _TURNING.fullmatch(name):
        return "ITRF", [f"{found}, which turns with the Earth: taken for ITRF"]
    if stated is None:
        raise InputError(f"{found}, wanted one that says a frame (ITRF, IGS, IGb, SLR, WGS, ECF)")
    return stated, [f"{found}, which says no frame: {stated} is taken, as ephemeris.frame says"]


def _choose(path: str | Path, names: list[str], satellite: str | None) -> str:
    """The satellite asked for, or the only one."""
    if not names:
        raise InputError(f"{path}: the header lists no satellite")
    listed = ", ".join(names)
    if satellite is None:
        if len(names) > 1:
            raise InputError(f"{path}: holds {len(names)} satellites, name one of {listed}")
        return names[0]
    if satellite not in names:
        raise InputError(f"{path}: holds no satellite {show(satellite)}, name one of {listed}")
    return satellite


def _records(path: str | Path, lines: list[str], name: str, header: _Header) -> _Records:
    """All records of one satellite, up to EOF or, where the file has none, to the last epoch that it announces."""
    records = _Records()
    epoch = ""
    for number, line in enumerate(lines, 1):
        kind = line[:1]
        if kind == "*":
            epoch = read_epoch(path, number, line, header.time_scale)
            records.all_epochs += 1
        elif line.startswith("EOF"):
            return records
        elif not epoch or name_of(line[1:4]) != name:
            continue
        elif kind == "P":
            _take_position(path, number, line, epoch, records)
        elif kind == "V" and records.epochs and records.epochs[-1] == epoch:
            records.velocities[-1] = vector(path, number, line, power=-1)  # dm/s
    if 0 < header.epochs <= records.all_epochs and not lines[-1]:
        header.notices.append(f"{path}: the closing EOF is missing behind the last epoch, which is there")
        return records
    raise InputError(f"{path}, line {len(lines)}: the file breaks off, the closing EOF is missing")


def _take_position(path: str | Path, number: int, line: str, epoch: str, records: _Records) -> None:
    position = vector(path, number, line, power=3)  # km
    if position is None:
        records.missing += 1
        return
    records.epochs.append(epoch)
    records.lines.append(number)
    records.positions.append(position)
    records.velocities.append(None)
    records.predicted += line[_PREDICTED] == "P"
    records.manoeuvres += line[_MANOEUVRE] == "M"


def _velocities(path: str | Path, records: _Records) -> tuple[FloatArray | None, list[str]]:
    """Velocities (n, 3) if every epoch has one."""
    given = [velocity for velocity in records.velocities if velocity is not None]
    if len(given) == len(records.epochs):
        return np.array(given), []
    if not given:
        return None, []
    lacking = len(records.epochs) - len(given)
    return None, [
        f"{path}: velocities are not used because {lacking} of {len(records.epochs)} epochs lack them"
    ]


def _notices(path: str | Path, name: str, records: _Records) -> list[str]:
    said = (
        (records.missing, "have no position and were left out"),
        (records.predicted, "are predicted"),
        (records.manoeuvres, "are marked as manoeuvre"),
    )
    return [f"{path}: {count} epochs of {name} {what}" for count, what in said if count]
