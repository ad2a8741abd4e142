"""The text of STK's ephemeris and attitude files: keywords, then one block of times and numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path

import numpy as np

from ....physics import timescales
from ....physics.errors import EpochError, InputError
from ...text.files import lines_of, read_text, show
from ...text.numbers import decimal
from ...text.numbers import numbers as all_numbers
from ..series_tables import EpochArray, FloatArray, Rows

_DATA = re.compile(
    r"(Ephemeris(MSL|Terrain|Geocentric|Geodetic)?(LLA|LLR)?Time\w+|AttitudeTime\w+)\Z", re.IGNORECASE
)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_DATE = re.compile(r"(\d{1,2})\s+([A-Za-z]{3})[a-z]*\s+(\d{4})\s+(\d{1,2}):(\d\d):(\d\d)(\.\d*)?")


@dataclass
class StkFile:
    """Keywords in small letters with their lines and values, the keyword of the data, and the rows below it."""

    path: Path
    keys: dict[str, tuple[int, str]] = field(default_factory=dict)
    kind: str = ""
    kind_line: int = 0
    lines: list[int] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)
    borders: list[tuple[int, str]] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)

    def error(self, line: int, fault: str) -> InputError:
        return InputError(f"{self.path}, line {line}: {fault}")

    def value(self, key: str) -> str | None:
        return self.keys[key.lower()][1] if key.lower() in self.keys else None


def parse(path: Path, block: str, kinds: dict[str, int]) -> StkFile:
    """The one block of a file, its rows of words not yet numbers."""
    file = StkFile(path)
    spelt = {kind.lower(): kind for kind in kinds}
    content = read_text(path)
    lines = _meaningful(content)
    for at, text in lines:
        words = text.split()
        key = words[0].lower()
        if key == "begin" and len(words) > 1 and words[1].lower() == "segmentboundarytimes":
            file.borders = _until_end(file, lines)
        elif _DATA.match(words[0]) and len(words) == 1:
            if key not in spelt:
                raise file.error(at, f"found {words[0]}, wanted {', '.join(kinds)}")
            file.kind, file.kind_line = spelt[key], at
            break
        elif len(words) > 1 and key not in ("begin", "end"):
            if key in file.keys:
                raise file.error(
                    at, f"found {words[0]} again (first on line {file.keys[key][0]}), wanted it once"
                )
            file.keys[key] = (at, text.split(None, 1)[1].strip().strip('"'))
    if not file.kind:
        raise InputError(f"{path}: found no data of an {block.lower()}, wanted {', '.join(kinds)}")
    closed = False
    for at, text in lines:
        words = text.split()
        if closed := words[0][0].isalpha():  # END, or a table of covariances
            break
        file.lines.append(at)
        file.rows.append(words)
    if not file.rows:
        raise file.error(file.kind_line, "found no row below it, wanted times and numbers")
    if not closed:
        _require_whole(file, block, content.endswith(("\n", "\r")))
    return file


def _require_whole(file: StkFile, block: str, ends_a_line: bool) -> None:
    """A file without END is broken off, unless it has the rows that it announces."""
    if not ends_a_line:
        raise file.error(file.lines[-1], f"found the end of the file within a row, wanted END {block}")
    announced, n = file.value(f"NumberOf{block}Points"), len(file.rows)
    if announced is None or announced.split(".")[0] != str(n):
        of = "" if announced is None else f" of {show(announced)}"
        raise file.error(file.lines[-1], f"found {n} rows{of} and no END {block} below, wanted a whole file")
    file.notices.append(f"{file.path}: found no END {block}, but all {n} rows that it announces")


def _meaningful(text: str) -> Iterator[tuple[int, str]]:
    """Lines with their numbers, without comments and blank ones."""
    for at, line in enumerate(lines_of(text), 1):
        stripped = line.split("#", 1)[0].strip()
        if stripped:
            yield at, stripped


def _until_end(file: StkFile, lines: Iterator[tuple[int, str]]) -> list[tuple[int, str]]:
    found = []
    for at, text in lines:
        if text.lower().startswith("end"):
            break
        found.append((at, text))
    return found


def times(file: StkFile) -> tuple[EpochArray, list[int], tuple[Rows, ...], list[str]]:
    """Epochs of the rows that are kept, which those are, the arcs, and a notice about rows left out.

    The words of the time are taken off every row.
    """
    style = (file.value("TimeFormat") or "EpSec").lower()
    clock: dict[str, Callable[[StkFile], EpochArray]] = {"epsec": _epoch_seconds, "utcg": _dates}
    if style not in clock:
        line = file.keys["timeformat"][0]
        raise file.error(line, f"TimeFormat is {show(file.value('TimeFormat'))}, wanted EpSec or UTCG")
    t_ns = clock[style](file)
    borders = set(_bordertimes(file, style))
    keep, notices = list(range(len(t_ns))), [*file.notices]
    for row in np.flatnonzero(np.diff(t_ns) <= 0).tolist():
        if t_ns[row + 1] < t_ns[row] or int(t_ns[row]) not in borders:
            fault = "repeats" if t_ns[row + 1] == t_ns[row] else "is earlier than"
            raise file.error(
                file.lines[row + 1], f"the time {fault} that of the row before, wanted times that increase"
            )
        keep.remove(row + 1)
        notices.append(
            f"{file.path}, line {file.lines[row + 1]}: an arc begins at the time at which the one before ends, its "
            "first row was left out"
        )
    kept = t_ns[keep]
    cuts = sorted(
        {int(np.searchsorted(kept, border, side="right")) for border in borders if border > kept[0]}
        - {len(kept)}
    )
    return kept, keep, tuple(pairwise([0, *cuts, len(kept)])), notices


def _bordertimes(file: StkFile, style: str) -> list[int]:
    if not file.borders:
        return []
    if style != "epsec":
        raise file.error(file.borders[0][0], "found borders of segments beside dates, wanted times in EpSec")
    start = _scenario_epoch(file)
    return [start + _nanoseconds(file, line, text) for line, text in file.borders]


def _scenario_epoch(file: StkFile) -> int:
    if "scenarioepoch" not in file.keys:
        raise InputError(f"{file.path}: found no ScenarioEpoch, wanted the time from which its seconds count")
    line, text = file.keys["scenarioepoch"]
    return int(_parsed(file, [_iso(file, line, text)], [line])[0])


def _epoch_seconds(file: StkFile) -> EpochArray:
    start = _scenario_epoch(file)
    counted = [_nanoseconds(file, line, row.pop(0)) for line, row in zip(file.lines, file.rows, strict=True)]
    return np.array([start + count for count in counted], dtype=np.int64)


def _nanoseconds(file: StkFile, line: int, text: str) -> int:
    seconds = decimal(text)
    if seconds is not None and abs(seconds) < 10**9:
        return int((seconds * 10**9).to_integral_value())
    raise file.error(line, f"found {show(text)}, wanted a number of seconds")


def _dates(file: StkFile) -> EpochArray:
    texts = []
    for line, row in zip(file.lines, file.rows, strict=True):
        texts.append(_iso(file, line, " ".join(row[:4])))
        del row[:4]
    return _parsed(file, texts, file.lines)


def _iso(file: StkFile, line: int, text: str) -> str:
    """ISO 8601 of a date as "1 Jun 2002 12:00:00.000"."""
    found = _DATE.fullmatch(text)
    if found is None or found[2].lower() not in _MONTHS:
        raise file.error(line, f"found {show(text)}, wanted a date such as 1 Jun 2002 12:00:00.000")
    day, month, year, hour, minute, second, decimals = found.groups()
    number = _MONTHS.index(month.lower()) + 1
    tail = decimals if decimals and decimals != "." else ""
    return f"{year}-{number:02d}-{int(day):02d}T{int(hour):02d}:{minute}:{second}{tail}"


def _parsed(file: StkFile, texts: list[str], lines: list[int]) -> EpochArray:
    try:
        return timescales.parse(texts, "UTC")
    except EpochError as error:
        raise file.error(lines[error.row], str(error)) from None


def numbers(file: StkFile, rows: list[list[str]], width: int, power: int = 0) -> FloatArray:
    """Rows (n, width) of numbers times ten to ``power``."""
    for line, row in zip(file.lines, rows, strict=True):
        if len(row) != width:
            raise file.error(line, f"found {len(row)} numbers after the time, wanted {width}")
    values = all_numbers(list(chain.from_iterable(rows)), power).reshape(len(rows), width)
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        at = int(np.argmin(finite))
        raise file.error(file.lines[at], f"found {show(' '.join(rows[at]))}, wanted finite numbers")
    return values
