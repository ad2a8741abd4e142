"""When the rows of a DigitalGlobe image were exposed, and how many there are of them.

``TLCList`` dates rows of the strip; an image that begins later in it, as the tiles R1C1, R2C1 ... of one strip do, says
by ``firstLineTime`` where.  Images delivered as NITF state a size padded to whole blocks: rows end with the table.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ...physics.errors import InputError
from ...table.row_times import RowTimes
from ..text.files import show
from ..text.tree import Array, Node

_LINEAR_ROWS = 0.01
"""How far the table of line times may be from one line period, rows, beyond the microsecond it is written to."""
_FIRST_LINE_ROWS = 0.1
_RATE_TOLERANCE = 0.01
_BLOCK = 64
"""Blocks of NITF have multiples of this many rows and columns."""
_LARGEST_BLOCK = 8192


@dataclass(frozen=True)
class Timing:
    """Row r of ``rows`` is exposed at ``t_ns + r period_s``, or by the table ``uneven`` where the steps differ.

    A scan against the count of the rows has a negative period. ``notices`` are for the user.
    """

    t_ns: int
    period_s: float
    rows: int
    uneven: RowTimes | None
    notices: tuple[str, ...]

    @property
    def span(self) -> tuple[int, int]:
        """Epochs of the earliest and the latest row."""
        last = round(1e9 * self.period_s * (self.rows - 1))
        if self.uneven is not None:
            last = int(self.uneven.late(float(self.rows - 1)))
        return min(self.t_ns, self.t_ns + last), max(self.t_ns, self.t_ns + last)


def timing(imd: Node) -> Timing:
    """The times of an image's rows. Raises InputError where they contradict each other."""
    image, stated = imd.need("IMAGE"), imd.need("numRows").whole(2)
    parent = image.need("TLCListList")
    row, seconds = _table(image, parent)
    table = RowTimes(row, np.rint(1e9 * seconds).astype(np.int64))
    skipped = _first_row(image, table, stated)
    rows, said = _rows(imd, stated, float(row[-1]) - skipped if len(parent.all("TLCList")) > 1 else np.inf)
    start = int(table.late(skipped))
    t_ns = image.need("TLCTime").epoch() + start
    if skipped:
        said = (*said, f"{imd.path}: the image begins at row {skipped:.0f} of its strip")
    uneven = None if _is_even(row, seconds) else RowTimes(row - skipped, table.late_ns - start)
    period = float((seconds[-1] - seconds[0]) / (row[-1] - row[0]))
    if uneven is not None:
        said = (
            *said,
            f"{imd.path}: the rows are not evenly spaced in time; row_times has the times of {row.size}",
        )
    return Timing(t_ns, period, rows, uneven, said)


def _table(image: Node, parent: Node) -> tuple[Array, Array]:
    """Rows and their seconds after TLCTime; of a table of one row the next, by the rate and the way of the scan."""
    rate = image.need("avgLineRate").positive()
    listed = parent.all("TLCList")
    if not listed:
        raise parent.error("no TLCList", "the time of a row")
    row, seconds = np.stack([node.numbers(2) for node in listed]).mT
    if len(listed) == 1:
        way = -1.0 if image.need("scanDirection").text.lower() == "reverse" else 1.0
        return np.append(row, row + 1e6), np.append(seconds, seconds + way * 1e6 / rate)
    steps = np.diff(seconds)
    if np.any(np.diff(row) <= 0.0) or not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise parent.error(
            "rows that do not increase, or times that turn back", "a table of the times of rows"
        )
    period = float((seconds[-1] - seconds[0]) / (row[-1] - row[0]))
    if not abs(abs(period) * rate - 1.0) <= _RATE_TOLERANCE:
        raise image.need("avgLineRate").error(
            f"{rate:g} rows a second", f"{1 / period:.6g}, the rate of the TLCList"
        )
    return row, seconds


def _is_even(row: Array, seconds: Array) -> bool:
    period = (seconds[-1] - seconds[0]) / (row[-1] - row[0])
    off = np.abs(seconds - seconds[0] - period * (row - row[0]))
    return bool(off.max() <= _LINEAR_ROWS * abs(period) + 1e-6)


def _first_row(image: Node, table: RowTimes, rows: int) -> float:
    """The row of the strip that firstLineTime dates, 0 where that is the table's own row 0."""
    first, start = image.need("firstLineTime"), image.need("TLCTime").epoch()
    tolerance_ns = 1e9 * _FIRST_LINE_ROWS * float(np.abs(table.period_s(0.0))) + 1_000
    read = [first.epoch(), *_unpadded(first)]
    away = [t_ns - start - int(table.late(0.0)) for t_ns in read]
    if min(map(abs, away)) <= tolerance_ns:
        return 0.0
    at = float(table.row_at(read[0] - start))
    inside = at > 0.0 and at + rows <= float(table.row[-1]) + _LARGEST_BLOCK * (rows % _BLOCK == 0) + 1.0
    if not inside or abs(at - round(at)) > _FIRST_LINE_ROWS or at + 2 > float(table.row[-1]):
        raise first.error(
            f"{show(first.text)}, {away[0] * 1e-9:.6g} s after row 0 of the TLCList", "the same epoch"
        )
    return float(round(at))


def _unpadded(first: Node) -> list[int]:
    """The epoch as some programs write it, with microseconds that lack their leading zeros."""
    found = re.fullmatch(r"(.*\d)\.(\d{4,5})Z?", first.text)
    if found is None:
        return []
    try:
        return [first.epoch_of(f"{found[1]}.{found[2]:0>6}Z")]
    except InputError:
        return []


def _rows(imd: Node, stated: int, dated: float) -> tuple[int, tuple[str, ...]]:
    """The rows that were exposed: those of the table where the stated number is padded to whole blocks."""
    padding = stated - dated
    if not 1.0 <= padding < _LARGEST_BLOCK or stated % _BLOCK:
        return stated, ()
    rows = round(dated)
    return rows, (
        f"{imd.path}: numRows, {stated}, is padded to blocks; {rows} rows have times, and are taken",
    )


def true_columns(
    imd: Node, tiles: Node | None, rpc: Node | None, padded: bool
) -> tuple[int, tuple[str, ...]]:
    """The columns of the image where the stated number is ``padded`` too: those of its only tile, or by the rational
    model, whose middle is the half of the last column, cut to a whole number."""
    node = imd.need("numColumns")
    stated = node.whole(2)
    if not padded or stated % _BLOCK:
        return stated, ()
    one = tiles is not None and (tiles.find("numTiles") or tiles).text == "1"
    size = tiles.find("tileSizeX") if tiles is not None and one else None
    middle = rpc.find("IMAGE/sampOffset") if rpc is not None else None
    if size is not None:
        columns, source = size.whole(2), "TIL"
    elif middle is not None:
        last = 2.0 * middle.number()
        columns, source = round(last) + (2 if last % 2.0 == 0.0 else 1), "RPB"
    else:
        said = f"{imd.path}: numColumns, {stated}, may be padded to blocks too, and no TIL or RPB tells"
        return stated, (f"{said}: corners may be wrong",)
    if not 0 <= stated - columns < _LARGEST_BLOCK:
        return stated, ()
    said = f"{imd.path}: numColumns, {stated}, is padded to blocks; by the {source} there are {columns}"
    return columns, (said,)
