"""Epochs: text in a named time scale <-> ``t_ns``, int64 nanoseconds of TAI since 2000-01-01T12:00:00 TAI.

TAI - UTC is the IERS table of leap seconds (packaged, with its date of expiry), TAI - GPS = 19 s exactly
(IS-GPS-200), TT - TAI = 32.184 s exactly (IAU 1991). Everything is integer arithmetic: a nanosecond in is a
nanosecond out.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .errors import EpochError, InputError

SCALES = ("UTC", "TAI", "GPS", "TT")
LATEST_UTC_MINUS_TAI = -37
"""Whole seconds, of the last leap second that is known: for times beyond the table's date of expiry."""

_SECOND_NS = 1_000_000_000
_DAY_S = 86_400
_HALF_DAY_NS = _DAY_S // 2 * _SECOND_NS
_MJD_2000 = 51_544
_MJD_1970 = 40_587
_TAI_MINUS_NS = {"TAI": 0, "GPS": 19 * _SECOND_NS, "TT": -32_184_000_000}
_YEARS = (1708, 2291)  # whole years that fit an int64 of nanoseconds around 2000
_LONGEST = 48  # characters; a longer text is no time, and must not set the width of the whole table
_WANTED = "an ISO 8601 time like 2018-12-26T10:48:55.449 or 2018-360T10:48:55.449"

Int64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class LeapSeconds:
    """From 0h UTC of ``mjd`` (``t_ns``) TAI - UTC is ``tai_minus_utc`` s, all (n,); until ``expiry_mjd``."""

    mjd: Int64
    tai_minus_utc: Int64
    t_ns: Int64
    expiry_mjd: int

    @property
    def expiry_t_ns(self) -> int:
        return int(_utc_count(np.int64(self.expiry_mjd)) + self.tai_minus_utc[-1] * _SECOND_NS)


@lru_cache(maxsize=1)
def leap_seconds() -> LeapSeconds:
    """The packaged table of leap seconds (IERS, ``Leap_Second.dat``)."""
    from astropy_iers_data import IERS_LEAP_SECOND_FILE

    text = Path(IERS_LEAP_SECOND_FILE).read_text(encoding="ascii")
    rows = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    mjd = np.array([int(float(row[0])) for row in rows], dtype=np.int64)
    tai_minus_utc = np.array([int(row[4]) for row in rows], dtype=np.int64)
    expiry = re.search(r"expires on\s+(\d+)\s+([A-Z][a-z]{2})[a-z]*\s+(\d{4})", text)
    if expiry is None:
        raise InputError(
            "the packaged leap-second table does not say when it expires: reinstall astropy-iers-data"
        )
    day, month, year = expiry.groups()
    months = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
    date = np.datetime64(f"{year}-{months.index(month) + 1:02d}-{int(day):02d}", "D")
    expiry_mjd = int(date.astype(np.int64)) + _MJD_1970
    return LeapSeconds(mjd, tai_minus_utc, _utc_count(mjd) + tai_minus_utc * _SECOND_NS, expiry_mjd)


def parse(texts: Sequence[str], scale: str) -> Int64:
    """Epochs ``t_ns`` (n,) of ISO 8601 texts in one of ``SCALES``.

    ``YYYY-MM-DDThh:mm:ss[.f...]`` or ``YYYY-DDDThh:mm:ss[.f...]``, ``T`` or one blank, any number of decimals
    (rounded to the nanosecond), in UTC a trailing ``Z`` or ``+00:00`` and second 60 where a leap second was inserted.
    Raises EpochError with an offending row; its text leaves file and row to the caller.
    """
    _check_scale(scale)
    texts = [text.strip() for text in texts]
    if not texts:
        return np.empty(0, dtype=np.int64)
    chars, length = _characters([text.replace("+00:00", "Z") for text in texts], scale)
    zulu = chars[np.arange(len(texts)), length - 1] == ord("Z")
    mjd, calendar, date_good = _date(chars)
    clock = np.where(calendar[:, None], chars[:, 11:], chars[:, 9:-2])
    clock_length = length - np.where(calendar, 11, 9) - zulu
    second, nanosecond, clock_good = _clock(clock, clock_length)
    good = date_good & clock_good
    if scale != "UTC":
        good &= ~zulu
    day_length = np.full(len(texts), _DAY_S)
    if scale == "UTC":
        day_length += np.isin(mjd + 1, leap_seconds().mjd[1:])
    good &= second < day_length
    if not good.all():
        row = int(np.argmin(good))
        raise EpochError(_complaint(texts[row], scale), row)
    return _utc_count(mjd) + second * _SECOND_NS + nanosecond + _tai_minus_ns(mjd, scale)


def moment(text: str, scale: str) -> int:
    """The epoch of one text that a person writes: as :func:`parse` reads it, a day alone being its midnight."""
    day = re.fullmatch(r"\d{4}-(\d\d-\d\d|\d{3})", text.strip())
    return int(parse([f"{text.strip()}T00:00:00" if day else text], scale)[0])


def format_iso(t_ns: npt.ArrayLike, scale: str, digits: int = 6) -> list[str]:
    """ISO 8601 texts of epochs (any shape, in C order) in ``scale``, rounded to ``digits`` decimals, 0 to 9.

    No trailing Z: the scale is stated beside the text. Raises EpochError where UTC is not known.
    """
    _check_scale(scale)
    if not 0 <= digits <= 9:
        raise ValueError(f"digits is {digits}, wanted 0 to 9")
    count = np.asarray(t_ns, dtype=np.int64).ravel() - _TAI_MINUS_NS.get(scale, 0)
    unit = 10 ** (9 - digits)
    count = (count + unit // 2) // unit * unit
    leaping = np.zeros(count.shape, dtype=np.bool_)
    if scale == "UTC":
        # In its last second before a new offset begins UTC reads :60, one second beyond the clock's own last.
        leaping = np.isin(count // _SECOND_NS, leap_seconds().t_ns[1:] // _SECOND_NS - 1)
        count = count + (utc_minus_tai(count) - leaping) * _SECOND_NS
    second, nanosecond = np.divmod(count + _HALF_DAY_NS, _SECOND_NS)
    stamps = np.datetime_as_string(np.datetime64("2000-01-01T00:00:00", "s") + second).tolist()
    for row in np.flatnonzero(leaping):
        stamps[row] = stamps[row].removesuffix("59") + "60"
    if digits == 0:
        return list(stamps)
    decimals = (nanosecond // unit).tolist()
    return [f"{stamp}.{decimal:0{digits}d}" for stamp, decimal in zip(stamps, decimals, strict=True)]


def of_count(origin_mjd: int, count_ns: npt.ArrayLike, scale: str) -> Int64:
    """``t_ns`` of counts of nanoseconds (any shape) since 0h of a day, by days of 86400 s in ``scale``.

    So count Unix time, GPS time and Julian dates; a leap second has the count of the second after it.
    Raises EpochError where UTC is not known.
    """
    _check_scale(scale)
    day, rest = np.divmod(np.asarray(count_ns, dtype=np.int64), _DAY_S * _SECOND_NS)
    return np.asarray(_utc_count(origin_mjd + day) + rest + _tai_minus_ns(origin_mjd + day, scale))


def utc_minus_tai(t_ns: npt.ArrayLike) -> Int64:
    """UTC - TAI, whole seconds (negative), any shape; during an inserted second still the value before it.

    Raises EpochError before 1972 and from the expiry of the leap-second table on.
    """
    table = leap_seconds()
    t = np.asarray(t_ns, dtype=np.int64)
    outside = (t < table.t_ns[0]) | (t >= table.expiry_t_ns)
    if outside.any():
        row = int(np.argmax(outside))
        raise EpochError(_no_utc(f"{format_iso(t.flat[row], 'TAI', 0)[0]} TAI"), row)
    return -table.tai_minus_utc[np.searchsorted(table.t_ns, t, side="right") - 1]


def utc_midnight(mjd: npt.ArrayLike) -> Int64:
    """Epochs ``t_ns`` of 0h UTC of whole Modified Julian Dates, any shape; EpochError where not known."""
    day = np.asarray(mjd, dtype=np.int64)
    return _utc_count(day) + _tai_minus_ns(day, "UTC")


def tt_julian(t_ns: npt.ArrayLike) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Terrestrial Time as a two-part Julian Date, any shape: a whole number of days and the rest in [0, 1).

    The rest resolves 1e-16 d (10 ps); ERFA takes the pair as it is.
    """
    count = np.asarray(t_ns, dtype=np.int64) - _TAI_MINUS_NS["TT"]
    day, rest = np.divmod(count, _DAY_S * _SECOND_NS)
    return 2_451_545.0 + day, rest / (_DAY_S * _SECOND_NS)


def _check_scale(scale: str) -> None:
    if scale not in SCALES:
        raise InputError(f"time scale {scale!r} is unknown, wanted one of {', '.join(SCALES)}")


def _utc_count(mjd: npt.NDArray[np.int64] | np.int64) -> Int64:
    """Nanoseconds from 2000-01-01T12:00:00 to 0h of ``mjd`` by days of 86400 s, whatever the scale."""
    return np.asarray((mjd - _MJD_2000) * _DAY_S * _SECOND_NS - _HALF_DAY_NS, dtype=np.int64)


def _tai_minus_ns(mjd: Int64, scale: str) -> Int64:
    """TAI - scale in ns on the days ``mjd`` of that scale; raises EpochError where UTC is not known."""
    if scale != "UTC":
        return np.full(mjd.shape, _TAI_MINUS_NS[scale], dtype=np.int64)
    table = leap_seconds()
    outside = (mjd < table.mjd[0]) | (mjd >= table.expiry_mjd)
    if outside.any():
        row = int(np.argmax(outside))
        raise EpochError(_no_utc(f"{_mjd_text(int(mjd.flat[row]))} UTC"), row)
    return table.tai_minus_utc[np.searchsorted(table.mjd, mjd, side="right") - 1] * _SECOND_NS


def _no_utc(found: str) -> str:
    expiry = _mjd_text(leap_seconds().expiry_mjd)
    return (
        f"found {found}, wanted an epoch within the leap-second table, which covers 1972-01-01 to {expiry} "
        "(a newer astropy-iers-data reaches farther)"
    )


def _mjd_text(mjd: int) -> str:
    return str(np.datetime64(mjd - _MJD_1970, "D"))


def _characters(texts: list[str], scale: str) -> tuple[npt.NDArray[np.uint8], Int64]:
    """Characters (n, width) padded with NUL, and the length of each text; refuses what cannot be a time."""
    length = np.fromiter(map(len, texts), dtype=np.int64, count=len(texts))
    possible = (length >= len("2000-001T00:00:00")) & (length <= _LONGEST)
    if possible.all() and "".join(texts).isascii():
        width = max(int(length.max()), len("2000-01-01T00:00:00Z")) + 3  # either clock fits
        return np.array(texts, dtype=f"S{width}").view(np.uint8).reshape(len(texts), width), length
    row = next(i for i, text in enumerate(texts) if not (possible[i] and text.isascii()))
    raise EpochError(_complaint(texts[row], scale), row)


def _number(chars: npt.NDArray[np.uint8], start: int, stop: int) -> tuple[Int64, Bool]:
    """The unsigned decimal number in columns start..stop, and whether all of them are digits."""
    value = np.zeros(len(chars), dtype=np.int64)
    good = np.ones(len(chars), dtype=np.bool_)
    for column in range(start, stop):
        digit = chars[:, column] - np.uint8(ord("0"))  # wraps: anything but a digit is 10 or more
        good &= digit < 10
        value = 10 * value + digit
    return value, good


def _date(chars: npt.NDArray[np.uint8]) -> tuple[Int64, Bool, Bool]:
    """Modified Julian Date, whether the layout is YYYY-MM-DD (else YYYY-DDD), and whether the date exists."""
    blank = (chars == ord("T")) | (chars == ord(" "))
    calendar = blank[:, 10]
    year, year_good = _number(chars, 0, 4)
    month, month_good = _number(chars, 5, 7)
    day, day_good = _number(chars, 8, 10)
    day_of_year, day_of_year_good = _number(chars, 5, 8)
    month_good &= day_good & (chars[:, 7] == ord("-")) & (month >= 1) & (month <= 12)
    good = year_good & (chars[:, 4] == ord("-")) & (year >= _YEARS[0]) & (year <= _YEARS[1])
    good &= np.where(calendar, month_good, day_of_year_good & blank[:, 8])
    # A day of the year is a day of a month that is twelve months long.
    start = ((year - 1970) * 12 + np.where(calendar, month - 1, 0)).astype("M8[M]")
    end = start + np.where(calendar, 1, 12)
    first = start.astype("M8[D]").astype(np.int64)
    day = np.where(calendar, day, day_of_year)
    good &= (day >= 1) & (day <= end.astype("M8[D]").astype(np.int64) - first)
    return first + day - 1 + _MJD_1970, calendar, good


def _clock(clock: npt.NDArray[np.uint8], length: Int64) -> tuple[Int64, Int64, Bool]:
    """Second of the day, nanosecond and validity of ``hh:mm:ss[.f...]``; second 60 passes at 23:59 only."""
    hour, hour_good = _number(clock, 0, 2)
    minute, minute_good = _number(clock, 3, 5)
    second, second_good = _number(clock, 6, 8)
    good = hour_good & minute_good & second_good & (clock[:, 2] == ord(":")) & (clock[:, 5] == ord(":"))
    good &= (hour < 24) & (minute < 60) & ((second < 60) | ((second == 60) & (hour == 23) & (minute == 59)))
    good &= (length == 8) | ((length > 9) & (clock[:, 8] == ord(".")))
    nanosecond = np.zeros(len(clock), dtype=np.int64)
    for column in range(9, int(length.max())):
        digit = np.where(column < length, clock[:, column], ord("0")) - np.uint8(ord("0"))
        good &= digit < 10
        place = column - 9
        if place < 9:
            nanosecond += digit * np.int64(10 ** (8 - place))
        elif place == 9:
            nanosecond += digit >= 5
    return hour * 3600 + minute * 60 + second, nanosecond, good


def _complaint(text: str, scale: str) -> str:
    """Why ``text`` is no epoch in ``scale``: one sentence for the user."""
    found = f"found {text if len(text) <= _LONGEST else text[:_LONGEST] + '...'!r}"
    if not text:
        return f"found no time, wanted {_WANTED} in {scale}"
    if re.search(r":\d\d(\.\d*)?\s*[+-]\d\d(:?\d\d)?$", text) and not text.endswith("+00:00"):
        return f"{found} with an offset from UTC, wanted the time in {scale} without an offset"
    if text.endswith(("Z", "+00:00")) and scale != "UTC":
        return f"{found}, which says UTC, wanted a time in {scale}"
    if re.search(r":60(\.\d*)?Z?$", text):
        return f"{found}, wanted a second below 60, since {scale} had no leap second then"
    return f"{found}, wanted {_WANTED} in {scale}, of a date that exists"
