"""The standard formats of orbit and attitude: by what first lines each is known, and which function reads it.

A new format is one row of :data:`ORBITS` or :data:`ATTITUDES`. The name of a file tells nothing but which reader says
what is wrong with it where its first lines are those of none.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from ...physics.errors import InputError
from ...physics.orbit import velocity_fault
from ..text.files import lines_of, read_beginning, show, trouble
from ..text.numbers import whole
from .series_tables import AttitudeTable, EphemerisTable

Series = TypeVar("Series", EphemerisTable, AttitudeTable)


@dataclass(frozen=True)
class Asked:
    """What a campaign asks of a file, each for the formats that can tell: the satellite's name or number, the epochs
    between which its images lie, the frame that the campaign states (of an attitude the tracker's), and further files
    that the format needs."""

    object: str | None = None
    start_ns: int | None = None
    stop_ns: int | None = None
    frame: str = ""
    kernels: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Format(Generic[Series]):
    """One format: its ``name`` for the user, what it begins with, how it is read, and the ``endings`` it often has.

    ``begins`` is given the first lines of the file, unpacked, as text in which bytes that are none are replaced.
    """

    name: str
    begins: Callable[[str], bool]
    read: Callable[[Path, Asked], Series]
    endings: tuple[str, ...] = ()


def recognised(path: Path, formats: Sequence[Format[Series]]) -> Format[Series] | None:
    """The format of a file, None for a table.

    Raises InputError for a file that is of none of the formats and no table.
    """
    start = _text(read_beginning(path))
    for known in formats:
        if known.begins(start):
            return known
    if _is_table(path, start):
        return None
    if (fault := trouble(path)) is not None:
        raise InputError(f"{path}: {fault}")
    name = path.name.lower().removesuffix(".gz").removesuffix(".z")
    for known in formats:
        if name.endswith(known.endings or ("\0",)):
            return known
    raise _unknown(path, start, formats)


def _text(start: bytes) -> str:
    encoding = "utf-16" if start.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    return start.decode(encoding, "replace")


_TABLE_ENDINGS = (".csv", ".parquet", ".arrow", ".feather")
_BINARY_TABLES = ("PAR1", "ARROW1", "FEA1")


def _is_table(path: Path, start: str) -> bool:
    """Whether a file is a table by its beginning: binary, or a row of names with commas between; else by its ending."""
    if start.startswith(_BINARY_TABLES):
        return True
    lines = (line for line in lines_of(start) if line.strip() and not line.lstrip().startswith("#"))
    cells = [cell.strip() for cell in next(lines, "").split(",")]
    named = len(cells) > 3 and all(re.match(r"[\"A-Za-z_]", cell) for cell in cells)
    return named or path.name.lower().removesuffix(".gz").removesuffix(".z").endswith(_TABLE_ENDINGS)


def _unknown(path: Path, start: str, formats: Sequence[Format[Series]]) -> InputError:
    names = ", ".join(known.name for known in formats)
    every: tuple[Format[Any], ...] = (*ORBITS, *ATTITUDES)
    if other := next((known.name for known in every if known.begins(start)), None):
        return InputError(f"{path}: found a file of the format {other}, wanted a table or {names}")
    line = next((line for line in lines_of(start) if line.strip()), "")
    return InputError(f"{path}: found a file that begins with {show(line)}, wanted a table or {names}")


def _starts_with(pattern: str) -> Callable[[str], bool]:
    """Whether a text, blank lines and comments of its format passed over by the pattern, begins so."""
    return lambda start: re.match(pattern, start, re.IGNORECASE) is not None


def _ccsds(kind: str) -> Callable[[str], bool]:
    """A navigation message as keyword = value, or as an element of XML, alone or in a combined one."""
    keyword = re.compile(rf"\s*(COMMENT[^\n]*\n\s*)*CCSDS_{kind}_VERS\s*=")
    element = re.compile(rf"<(\w+:)?{kind}[\s>]", re.IGNORECASE)

    def begins(start: str) -> bool:
        if start.lstrip().startswith("<"):
            return element.search(start) is not None
        return keyword.match(start) is not None

    return begins


def _read_oem(path: Path, asked: Asked) -> EphemerisTable:
    from .oem import read_oem

    table = read_oem(path)
    _require_object(path, table, asked.object, "ephemeris")
    return table


def _require_object(
    path: Path, table: EphemerisTable | AttitudeTable, wanted: str | None, section: str
) -> None:
    if wanted not in (None, table.object_name, table.object_id):
        found = f"found the object {show(table.object_name)} ({show(table.object_id)})"
        raise InputError(f"{path}: {found}, wanted {show(wanted)} as {section}.object says")


def _read_sp3(path: Path, asked: Asked) -> EphemerisTable:
    from .sp3 import read_sp3

    return _with_possible_velocities(path, read_sp3(path, asked.object, asked.frame or None))


def _with_possible_velocities(path: Path, table: EphemerisTable) -> EphemerisTable:
    """The table, without velocities that contradict its positions: those of DORIS are often m/s in place of dm/s."""
    if table.v is None:
        return table
    last = np.full(table.t_ns.size, table.t_ns.size - 1)
    fault = velocity_fault(table.t_ns, table.r, table.v, last, turning=table.frame == "ITRF")
    if fault is None:
        return table
    said = f"{path}: the velocities are not used, because {fault.replace('the velocities', 'they', 1)}"
    return replace(table, v=None, notices=(*table.notices, said))


def _read_spk(path: Path, asked: Asked) -> EphemerisTable:
    from .spice import read_spk

    target = None if asked.object is None else whole(asked.object)
    if asked.object is not None and target is None:
        found = f"found ephemeris.object = {show(asked.object)}"
        raise InputError(f"{path}: {found}, wanted the whole number by which SPICE knows the satellite")
    return read_spk(path, start_ns=asked.start_ns, stop_ns=asked.stop_ns, target=target)


def _read_aem(path: Path, asked: Asked) -> AttitudeTable:
    from .aem import read_aem

    table = read_aem(path)
    _require_object(path, table, asked.object, "attitude")
    return table


def _read_orbex(path: Path, asked: Asked) -> AttitudeTable:
    from .attitudes.orbex import read_orbex

    return read_orbex(path, asked.object)


def _read_ck(path: Path, asked: Asked) -> AttitudeTable:
    from .attitudes.ck import read_ck

    return read_ck(path, asked.kernels, asked.frame)


def _stk(block: str) -> Callable[[str], bool]:
    """A file of STK's with this block; its version in the first line, comments before it passed over."""
    return _starts_with(rf"\s*(#[^\n]*\n\s*)*stk\.v\.[\d.]+\s(?s:.*?)\bBEGIN\s+{block}\b")


def _read_stk_ephemeris(path: Path, asked: Asked) -> EphemerisTable:
    from .stk.series import read_stk_ephemeris

    return read_stk_ephemeris(path)


def _read_stk_attitude(path: Path, asked: Asked) -> AttitudeTable:
    from .stk.series import read_stk_attitude

    return read_stk_attitude(path)


ORBITS: tuple[Format[EphemerisTable], ...] = (
    Format("CCSDS OEM", _ccsds("OEM"), _read_oem, (".oem", ".xml")),
    Format("SP3", _starts_with(r"#[a-z][PV ]\s?\d{2,4}\s"), _read_sp3, (".sp3",)),
    Format("SPICE SPK", _starts_with(r"DAF/SPK|NAIF/DAF"), _read_spk, (".bsp",)),
    Format("STK ephemeris", _stk("Ephemeris"), _read_stk_ephemeris, (".e",)),
)
ATTITUDES: tuple[Format[AttitudeTable], ...] = (
    Format("CCSDS AEM", _ccsds("AEM"), _read_aem, (".aem", ".xml")),
    Format("SPICE CK", _starts_with("DAF/CK"), _read_ck, (".bc",)),
    Format("ORBEX", _starts_with("%=ORBEX"), _read_orbex, (".obx",)),
    Format("STK attitude", _stk("Attitude"), _read_stk_attitude, (".a",)),
)
