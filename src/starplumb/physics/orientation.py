"""Earth orientation: ``C_IJ``, GCRF from ITRF, by ERFA's IAU 2006/2000A (IERS Conventions 2010, chapter 5).

Polar motion, UT1 and the celestial pole offsets come from a table in the format of ``finals2000A.all``. Its
Bulletin A columns are used throughout: one series without a step where the Bulletin B columns end, and the
closer of the two to the final series C04 (UT1 of 2016 to 2026: within 2.6 mas; Bulletin B: 7.2 mas). Tidal
variations within a day, up to 1 mas, are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import erfa
import numpy as np
import numpy.typing as npt

from .errors import EpochError, InputError
from .timescales import format_iso, leap_seconds, tt_julian, utc_midnight, utc_minus_tai
from .units import ARCSEC

Float = npt.NDArray[np.float64]
Int64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

FrameOfDate = Literal["TOD", "MOD", "TEME"]
"""Inertial frames of the date: true equator and equinox, mean equator and equinox, true equator and mean equinox."""
FRAMES_OF_DATE: tuple[FrameOfDate, ...] = get_args(FrameOfDate)

_TABLE_NODES = 4  # a cubic through four days keeps UT1 to a few microseconds
_CIP_NODES = 6  # a quintic through six half days keeps the CIP to 0.0005 mas
_CIP_PER_DAY = 2

_WIDTH = 187
_MOST_BYTES = 50_000_000
_FLAGS = ((16, "polar motion"), (57, "UT1-UTC"))
# name: first and last column (from 0, exclusive), rad or s per unit, largest sensible value in the unit
_COLUMNS = {
    "polar motion x": (18, 27, ARCSEC, 2.0),
    "polar motion y": (37, 46, ARCSEC, 2.0),
    "UT1-UTC": (58, 68, 1.0, 1.0),
    "dX": (97, 106, 1e-3 * ARCSEC, 10.0),
    "dY": (116, 125, 1e-3 * ARCSEC, 10.0),
}


@dataclass(frozen=True)
class EarthOrientation:
    """Daily rows at 0h UTC: ``t_ns`` (n,), ``values`` (n, 5), ``is_predicted`` (n,); ``source`` says whence.

    ``values``: polar motion x, y (rad), UT1 - TAI (s, no leap seconds), celestial pole offsets dX, dY (rad).
    """

    t_ns: Int64
    values: Float
    is_predicted: Bool
    source: str

    @classmethod
    def load(cls, path: Path | None = None) -> EarthOrientation:
        """The packaged IERS table, or a user's file of the format ``finals2000A``.

        The table ends at its last row with UT1 or where the leap-second table expires, whichever is first.
        Blank dX, dY (far predictions) are taken as zero, an error below 1 mas. Raises InputError with
        the file and the line that is wrong.
        """
        if path is None:
            from astropy_iers_data import IERS_A_FILE

            path = Path(IERS_A_FILE)
        return cls._read(path, *_version(path))

    @classmethod
    @lru_cache(maxsize=4)
    def _read(cls, path: Path, _size: int, _time_ns: int) -> EarthOrientation:
        """A table as it stands in a file of this size and time: parsed once in a process."""
        mjd, values, is_predicted = _read_finals(path)
        leap = leap_seconds()
        known = (mjd >= leap.mjd[0]) & (mjd < leap.expiry_mjd)
        if known.sum() < _TABLE_NODES:
            raise InputError(f"{path}: found {known.sum()} usable days, wanted at least {_TABLE_NODES}")
        t_ns, values, is_predicted = utc_midnight(mjd[known]), values[known], is_predicted[known]
        values[:, 2] += utc_minus_tai(t_ns)
        first, last = format_iso(t_ns[[0, -1]], "UTC", 0)
        source = f"{path.name}, {first[:10]} to {last[:10]}"
        if is_predicted.any():
            source += f", predicted from {format_iso(t_ns[np.argmax(is_predicted)], 'UTC', 0)[0][:10]}"
        for array in (t_ns, values, is_predicted):
            array.flags.writeable = False
        return cls(t_ns, values, is_predicted, source)

    def C_IJ(self, t_ns: npt.ArrayLike) -> Float:
        """(..., 3, 3): takes ITRF coordinates to GCRF at ``t_ns`` (...,); EpochError outside the table.

        C_IJ = (W R3(ERA) Q)^T with Q from the pole X + dX, Y + dY and s, the Earth rotation angle ERA of UT1,
        and W from polar motion and s'. X, Y, s are interpolated, within 0.001 mas of the full series.
        """
        t = np.asarray(t_ns, dtype=np.int64)
        x_pole, y_pole, ut1_minus_tai, dX, dY = np.moveaxis(self._values_at(t), -1, 0)
        tt_day, tt_rest = tt_julian(t)
        X, Y, s = np.moveaxis(_cip(tt_day - erfa.DJ00, tt_rest), -1, 0)
        celestial = erfa.c2ixys(X + dX, Y + dY, s)
        era = erfa.era00(tt_day, tt_rest + (ut1_minus_tai - erfa.TTMTAI) / erfa.DAYSEC)
        terrestrial = erfa.pom00(x_pole, y_pole, erfa.sp00(tt_day, tt_rest))
        C_JI: Float = erfa.c2tcio(celestial, era, terrestrial)
        return C_JI.mT

    def predicted(self, t_ns: npt.ArrayLike) -> Bool:
        """Whether polar motion or UT1 in a row next to ``t_ns`` (...,) is predicted, not measured."""
        row = self._row_before(np.asarray(t_ns, dtype=np.int64))
        return self.is_predicted[row] | self.is_predicted[row + 1]

    def _row_before(self, t_ns: Int64) -> Int64:
        outside = (t_ns < self.t_ns[0]) | (t_ns > self.t_ns[-1])
        if outside.any():
            row = int(np.argmax(outside))
            found = format_iso(t_ns.flat[row], "TAI", 0)[0]
            wanted = f"an epoch within the table of Earth orientation ({self.source})"
            raise EpochError(f"found {found} TAI, wanted {wanted}", row)
        row_before: Int64 = np.searchsorted(self.t_ns[:-1], t_ns, side="right") - 1
        return row_before

    def _values_at(self, t_ns: Int64) -> Float:
        row = self._row_before(t_ns)
        fraction = (t_ns - self.t_ns[row]) / (self.t_ns[row + 1] - self.t_ns[row])
        first: Int64 = np.clip(row - (_TABLE_NODES // 2 - 1), 0, len(self.t_ns) - _TABLE_NODES)
        position = (row - first).astype(np.float64) + fraction
        return _lagrange(self.values, first, position, _TABLE_NODES)


def C_IF(frame: FrameOfDate, t_ns: npt.ArrayLike) -> Float:
    """(..., 3, 3): takes coordinates of a frame of date to GCRF at ``t_ns`` (...,).

    ``MOD``: bias and precession, IAU 2006.  ``TOD``: nutation IAU 2000A as well.  ``TEME``, the frame of SGP4:
    ``r_PEF = R3(GMST82) r_TEME = R3(GAST) r_TOD``, hence ``C_TOD,TEME = R3(GMST82 - GAST)``, with GMST by the formula
    of IAU 1982 and GAST by IAU 2006/2000A.  UT1 drops out of the difference but for 1e-4 arcsec, so that TT stands in.
    Source: D. A. Vallado et al., Revisiting Spacetrack Report #3, AIAA 2006-6753, appendix C.
    """
    day, rest = tt_julian(t_ns)
    C_FI: Float = erfa.pmat06(day, rest) if frame == "MOD" else erfa.pnm06a(day, rest)
    if frame == "TEME":
        turn = erfa.gst06a(day, rest, day, rest) - erfa.gmst82(day, rest)
        C_FI = erfa.rz(turn, C_FI)
    return C_FI.mT


def _lagrange(table: Float, first: Int64, position: Float, nodes: int) -> Float:
    """(..., c): polynomial through ``nodes`` rows of ``table`` (n, c), ``position`` rows from ``first``."""
    i = np.arange(nodes)
    weights = np.ones((*position.shape, nodes))
    for j in range(nodes):
        others = i != j
        weights[..., others] *= (position[..., None] - j) / (i[others] - j)
    value: Float = np.einsum("...n,...nc->...c", weights, table[first[..., None] + i])
    return value


def _cip(tt_day: Float, tt_rest: Float) -> Float:
    """X, Y of the celestial intermediate pole and the locator s (..., 3) in rad, days of TT since J2000.0."""
    part = np.floor(tt_rest * _CIP_PER_DAY)
    first = (tt_day * _CIP_PER_DAY + part).astype(np.int64) - (_CIP_NODES // 2 - 1)
    nodes = np.unique(np.unique(first)[:, None] + np.arange(_CIP_NODES))
    table = np.stack(erfa.xys06a(erfa.DJ00, nodes / _CIP_PER_DAY), axis=-1)
    position = tt_rest * _CIP_PER_DAY - part + (_CIP_NODES // 2 - 1)
    return _lagrange(table, np.searchsorted(nodes, first), position, _CIP_NODES)


def _version(path: Path) -> tuple[int, int]:
    """Size and time, ns, of a file: by them a changed one is known."""
    try:
        found = path.stat()
    except OSError:
        return 0, 0  # reading it says why
    return found.st_size, found.st_mtime_ns


def _read_finals(path: Path) -> tuple[Int64, Float, Bool]:
    """MJD (n,), values (n, 5) with UT1 - UTC in the third column, and the flag of prediction (n,)."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path}: found {path.stat().st_size:,} bytes, wanted a finals2000A table")
        lines = path.read_bytes().rstrip().splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}), wanted a finals2000A table") from error
    table = np.array([line[:_WIDTH].ljust(_WIDTH) for line in lines], dtype=f"S{_WIDTH}")
    chars = table.view(np.uint8).reshape(len(lines), _WIDTH)
    filled = np.flatnonzero((chars[:, slice(*_COLUMNS["UT1-UTC"][:2])] != ord(" ")).any(axis=1))
    if not filled.size:
        raise InputError(
            f"{path}: found no line with UT1-UTC in columns 59 to 68, wanted a finals2000A table"
        )
    chars = chars[: filled[-1] + 1]
    mjd = _column(path, chars, "MJD", 7, 15, 1e5, optional=False)
    steps = np.flatnonzero((np.diff(mjd) != 1) | (mjd[1:] % 1 != 0))
    if steps.size:
        row = int(steps[0]) + 1
        raise InputError(
            f"{path}, line {row + 1}: MJD {mjd[row]} follows {mjd[row - 1]}, wanted every day once"
        )
    columns = [
        unit * _column(path, chars, name, start, stop, limit, optional=name in ("dX", "dY"))
        for name, (start, stop, unit, limit) in _COLUMNS.items()
    ]
    return mjd.astype(np.int64), np.stack(columns, axis=-1), _flags(path, chars)


def _column(
    path: Path,
    chars: npt.NDArray[np.uint8],
    name: str,
    start: int,
    stop: int,
    limit: float,
    *,
    optional: bool,
) -> Float:
    """Numbers of the right-justified columns start..stop; an ``optional`` blank is zero."""
    cells = np.ascontiguousarray(chars[:, start:stop]).view(f"S{stop - start}")[:, 0]
    if optional:
        cells = np.where(np.strings.strip(cells) == b"", b"0".rjust(stop - start), cells)
    try:
        values = cells.astype(np.float64)
        # A line cut short within a number would leave blanks after it.
        bad = ~(np.abs(values) <= limit) | np.strings.endswith(cells, b" ")
    except ValueError:
        values = np.empty(0)
        bad = np.array([not _is_number(cell) for cell in cells.tolist()])
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(
            f"{path}, line {row + 1}: {name} in columns {start + 1} to {stop} is "
            f"{cells[row].decode('latin-1')!r}, wanted a number up to {limit:g} as in a finals2000A table"
        )
    return values


def _is_number(cell: bytes) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _flags(path: Path, chars: npt.NDArray[np.uint8]) -> Bool:
    """True where polar motion or UT1 is predicted (flag P, not I)."""
    is_predicted = np.zeros(len(chars), dtype=np.bool_)
    for column, name in _FLAGS:
        flag = chars[:, column]
        bad = (flag != ord("I")) & (flag != ord("P"))
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"{path}, line {row + 1}: the flag of {name} in column {column + 1} is {chr(flag[row])!r}, "
                "wanted I (measured) or P (predicted)"
            )
        is_predicted |= flag == ord("P")
    return is_predicted
