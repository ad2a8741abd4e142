"""Attitude from ORBEX files of the IGS (version 0.09), as GNSS centres and GROOPS write them.

A record ATT is the quaternion q, scalar first, that takes coordinates of the Earth's frame (or, FRAME_TYPE ECI, of the
inertial one) to those of the satellite's body: (0, v_B) = q (0, v_T) q*, which is our sense.  Source: S. Loyer et al.,
ORBEX: The Orbit Exchange Format, draft 0.09, and the comment that its writers put above the records.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ....physics import timescales
from ....physics.errors import EpochError, InputError
from ...text.files import lines_of, read_text, show
from ...text.frames import EarthFrame
from ...text.numbers import numbers
from ..quaternions import unit
from ..series_tables import AttitudeTable

_FRAMES: dict[str, EarthFrame] = {"ECEF": "ITRF", "ECI": "GCRF"}
_EPOCH = re.compile(
    r"##\s+(\d{4})\s+(\d{1,2})\s+(\d{1,2})\s+(\d{1,2})\s+(\d{1,2})\s+(\d{1,2})(\.\d*)?(\s+\d+)?\s*"
)


@dataclass
class _Records:
    """What is read of one satellite: ISO times, quaternions scalar first, and the lines they stand on."""

    epochs: list[str] = field(default_factory=list)
    quaternions: list[list[float]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)


def read_orbex(path: Path, satellite: str | None = None) -> AttitudeTable:
    """Attitude of one satellite, by its identifier where the file has several, as q_BA to its body B.

    Raises InputError, naming the line, for what cannot be used.
    """
    described: dict[str, tuple[int, str]] = {}
    found: dict[str, _Records] = {}
    epoch = ""
    for at, block, line in _lines(path):
        if block == "FILE/DESCRIPTION":
            key, _, value = line.strip().partition(" ")
            if key in described and key in ("TIME_SYSTEM", "FRAME_TYPE"):
                raise InputError(f"{path}, line {at}: found {key} again, wanted it once")
            described[key] = (at, value.strip())
        elif block == "EPHEMERIS/DATA" and line.startswith("##"):
            epoch = _epoch(path, at, line)
        elif block == "EPHEMERIS/DATA" and line.split()[0] == "ATT":
            if not epoch:
                raise InputError(
                    f"{path}, line {at}: found a record before any epoch, wanted ## and a date first"
                )
            name, values = _record(path, at, line)
            records = found.setdefault(name, _Records())
            records.epochs.append(epoch)
            records.quaternions.append(values)
            records.lines.append(at)
    name = _chosen(path, sorted(found), satellite)
    return _table(path, name, found[name], _frame(path, described), _scale(path, described))


def _lines(path: Path) -> Iterator[tuple[int, str, str]]:
    """Lines of content with their numbers and the name of their block. A file must not break off within one."""
    block = ""
    at = 0
    for at, line in enumerate(lines_of(read_text(path)), 1):
        if line.startswith("+"):
            block = line[1:].strip()
        elif line.startswith("-"):
            block = ""
        elif line.strip() and not line.startswith(("*", "%")):
            yield at, block, line
    if block:
        raise InputError(f"{path}, line {at}: found the end within {show(block)}, wanted a whole file")


def _epoch(path: Path, at: int, line: str) -> str:
    """ISO 8601 text of an epoch; that it is a date is checked where it is parsed."""
    words = _EPOCH.fullmatch(line)
    if words is None or not line.isascii():
        raise InputError(
            f"{path}, line {at}: found {show(line.strip())}, wanted ## year month day hour minute second"
        )
    year, month, day, hour, minute, second, decimals = words.groups()[:7]
    tail = decimals if decimals and decimals != "." else ""
    parts = [int(value) for value in (month, day, hour, minute, second)]
    return f"{year}-{parts[0]:02d}-{parts[1]:02d}T{parts[2]:02d}:{parts[3]:02d}:{parts[4]:02d}{tail}"


def _record(path: Path, at: int, line: str) -> tuple[str, list[float]]:
    """Identifier and the four numbers of a record; flags may stand between the identifier and the count."""
    words = line.split()
    values = numbers(words[-4:])
    good = len(words) >= 7 and words[-5] == "4" and bool(np.isfinite(values).all())
    if not good or not line.isascii():
        wanted = "ATT, a satellite, the number 4 and a quaternion"
        raise InputError(f"{path}, line {at}: found {show(line.strip())}, wanted {wanted}")
    return words[1], values.tolist()


def _chosen(path: Path, names: list[str], satellite: str | None) -> str:
    if not names:
        raise InputError(f"{path}: found no record ATT, wanted an attitude")
    listed = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
    if satellite is not None and satellite not in names:
        raise InputError(
            f"{path}: found no satellite {show(satellite)}, wanted one of {listed} as attitude.object says"
        )
    if satellite is None and len(names) > 1:
        raise InputError(
            f"{path}: found {len(names)} satellites ({listed}), wanted one named by attitude.object"
        )
    return satellite or names[0]


def _frame(path: Path, described: dict[str, tuple[int, str]]) -> EarthFrame:
    at, word = described.get("FRAME_TYPE", (0, ""))
    if word.upper() not in _FRAMES:
        where = f"{path}, line {at}" if at else f"{path}"
        raise InputError(f"{where}: found the FRAME_TYPE {show(word)}, wanted ECEF or ECI")
    return _FRAMES[word.upper()]


def _scale(path: Path, described: dict[str, tuple[int, str]]) -> str:
    at, word = described.get("TIME_SYSTEM", (0, ""))
    if word.upper() not in timescales.SCALES:
        where = f"{path}, line {at}" if at else f"{path}"
        wanted = ", ".join(timescales.SCALES)
        raise InputError(f"{where}: found the TIME_SYSTEM {show(word)}, wanted one of {wanted}")
    return word.upper()


def _table(path: Path, name: str, records: _Records, frame: EarthFrame, scale: str) -> AttitudeTable:
    try:
        t_ns = timescales.parse(records.epochs, scale)
    except EpochError as error:
        raise InputError(f"{path}, line {records.lines[error.row]}: {error}") from None
    late = np.diff(t_ns) <= 0
    if late.any():
        at = records.lines[int(np.argmax(late)) + 1]
        raise InputError(
            f"{path}, line {at}: found {show(name)} not later than before, wanted epochs that increase"
        )

    def wrong(row: int, fault: str) -> InputError:
        return InputError(f"{path}, line {records.lines[row]}: {fault}")

    q_BA = unit(np.roll(np.array(records.quaternions), -1, axis=1), wrong)
    return AttitudeTable(
        t_ns,
        q_BA_xyzw=q_BA,
        frame_a=frame,
        frame_b="",
        time_scale=scale,
        object_name=name,
        segments=((0, len(t_ns)),),
    )
