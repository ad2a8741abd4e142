"""SP3-c and SP3-d precise orbits: reader.

Source: S. Hilla, "The Extended Standard Product 3 Orbit Format", 2010 (SP3-c) and 2016 (SP3-d).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...physics import timescales
from ...physics.errors import EpochError, InputError
from ..text.files import read_text
from .series_tables import EphemerisTable, FloatArray

_SCALES = ("GPS", "UTC", "TAI")
_FRAME = re.compile(r"(ITRF?|IGS|IGB|IG|SLR|WGS)[ _-]?\d{0,4}")
_FIELDS = (slice(4, 18), slice(18, 32), slice(32, 46))
_ABSENT = 999999.0
"""Fields of 999999.999999 mean that there is no position or velocity (as three zeros do)."""
_MANOEUVRE, _PREDICTED = slice(78, 79), slice(79, 80)
"""Flags M and P of a position record."""


@dataclass
class _Header:
    """What the first lines say."""

    frame_text: str
    satellites: list[str] = field(default_factory=list)
    time_scale: str = ""


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


def read_sp3(path: str | Path, satellite: str | None = None) -> EphemerisTable:
    """Ephemeris of one satellite ("L47", "G01" ...) in ITRF, m and m/s relative to the turning Earth.

    ``satellite`` may be left out where the file has one only. Epochs at which its position is missing are
    left out, and all velocities are if one of them is missing, with notices. Clocks and correlations are not
    read. Raises InputError, naming the line, for another version, time system or frame and for a file that
    breaks off.
    """
    lines = read_text(Path(path)).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    header = _header(path, lines)
    name = _choose(path, header.satellites, satellite)
    records = _records(path, lines, name)
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
        frame="ITRF",
        time_scale=header.time_scale,
        object_name=name,
        segments=((0, len(t_ns)),),
        frame_text=header.frame_text,
        object_id=name,
        notices=(*_notices(path, name, records), *notices),
    )


def _header(path: str | Path, lines: list[str]) -> _Header:
    """Version, frame, satellites and time system; everything before the first epoch."""
    first = lines[0]
    if not re.match(r"#[a-z]", first):
        raise InputError(
            f"{path}, line 1: found {first[:20]!r}, wanted an SP3 header that begins with #c or #d"
        )
    if first[1] not in "cd":
        raise InputError(f"{path}, line 1: this is SP3-{first[1]}, wanted SP3-c or SP3-d")
    frame_text = first[46:51].strip()
    if not _FRAME.fullmatch(frame_text.upper()):
        fault = (
            f"the coordinate system is {frame_text!r}, wanted an Earth-fixed one (ITRF, IGS, IGb, SLR or WGS)"
        )
        raise InputError(f"{path}, line 1: {fault}")
    header = _Header(frame_text)
    for number, line in enumerate(lines[1:], 2):
        if line.startswith("*"):
            break
        if line.startswith("+ "):
            names = (_name(line[column : column + 3]) for column in range(9, 60, 3))
            header.satellites += [name for name in names if re.fullmatch(r"[A-Z]\d\d", name)]
        elif line.startswith("%c") and not header.time_scale:
            header.time_scale = line[9:12].strip()
            if header.time_scale not in _SCALES:
                wanted = ", ".join(_SCALES)
                fault = f"the time system is {header.time_scale!r}, wanted one of {wanted}"
                raise InputError(f"{path}, line {number}: {fault}")
    if not header.time_scale:
        raise InputError(f"{path}: found no %c line, wanted one that names the time system")
    return header


def _name(field: str) -> str:
    """Identifier in its usual form: letter and two digits (the format allows G 1 for G01)."""
    return field.replace(" ", "0")


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
        raise InputError(f"{path}: holds no satellite {satellite!r}, name one of {listed}")
    return satellite


def _records(path: str | Path, lines: list[str], name: str) -> _Records:
    """All records of one satellite, up to EOF."""
    records = _Records()
    epoch = ""
    for number, line in enumerate(lines, 1):
        kind = line[:1]
        if kind == "*":
            epoch = _epoch(path, number, line)
        elif line.startswith("EOF"):
            return records
        elif not epoch or _name(line[1:4]) != name:
            continue
        elif kind == "P":
            _take_position(path, number, line, epoch, records)
        elif kind == "V" and records.epochs and records.epochs[-1] == epoch:
            records.velocities[-1] = _vector(path, number, line, power=-1)  # dm/s
    raise InputError(f"{path}, line {len(lines)}: the file breaks off, the closing EOF is missing")


def _take_position(path: str | Path, number: int, line: str, epoch: str, records: _Records) -> None:
    position = _vector(path, number, line, power=3)  # km
    if position is None:
        records.missing += 1
        return
    records.epochs.append(epoch)
    records.lines.append(number)
    records.positions.append(position)
    records.velocities.append(None)
    records.predicted += line[_PREDICTED] == "P"
    records.manoeuvres += line[_MANOEUVRE] == "M"


def _epoch(path: str | Path, number: int, line: str) -> str:
    """ISO 8601 text of an epoch line; its date is checked when it is parsed."""
    words = line[1:].split()
    try:
        year, month, day, hour, minute = map(int, words[:5])
        whole, _, decimals = words[5].partition(".")
        second = f"{int(whole):02d}.{decimals or '0'}"
    except (ValueError, IndexError):
        raise InputError(
            f"{path}, line {number}: found {line.strip()!r}, wanted * year month day hour minute second"
        ) from None
    return f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{minute:02d}:{second}"


def _vector(path: str | Path, number: int, line: str, power: int) -> list[float] | None:
    """Three fixed-width fields times ten to ``power``, None where the file marks them as missing."""
    try:
        raw = [float(line[columns]) for columns in _FIELDS]
        scaled = [float(f"{line[columns].strip()}e{power}") for columns in _FIELDS]
    except ValueError:
        found = line[4:46].strip()
        raise InputError(f"{path}, line {number}: found {found!r}, wanted three numbers") from None
    absent = not any(raw) or any(abs(value) >= _ABSENT for value in raw)
    return None if absent else scaled


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
