"""Tables of the times of the rows of a line scanner, one for an image, that ``images.csv`` names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....physics.errors import InputError
from ....table.campaign import Images
from ....table.row_times import RowTimes
from ...tables.read import Table, epochs, read_table
from ...text.files import cut, show, trouble

_PERIODS_AGREE = 0.2
"""Relative difference up to which a stated line period is that of a table of rows."""


_MOST_ROWS = 1e9


def read_row_times(images: Table, t_ns: NDArray[np.int64], folder: Path, scale: str) -> tuple[RowTimes, ...]:
    """The tables in the column ``row_times`` of the images, relative to ``folder``.

    Raises InputError for a table that cannot be read, whose rows or times do not go one way, or whose row 0 is not
    exposed at the image's own time.
    """
    found = [
        _read(images, i, folder / name, name, t_ns[i], scale)
        for i, name in enumerate(images.texts["row_times"])
    ]
    stated = images.numbers.get("line_period_s")
    if stated is not None:
        mean = np.array([table.mean_period_s for table in found])
        wanted = "the mean period of its row_times, or no column line_period_s"
        images.require(np.abs(stated / mean - 1.0) <= _PERIODS_AGREE, "line_period_s", wanted)
    return tuple(found)


def _read(images: Table, i: int, path: Path, name: str, t_ns: np.int64, scale: str) -> RowTimes:
    if (fault := trouble(path)) is not None:
        raise images.error(i, "row_times", name, f"a table of rows: {cut(str(path))}: {fault}")
    table = read_table(path, texts=("time",), numbers=("row",))
    row, times = table.numbers["row"], epochs(table, scale)
    steps = np.diff(times)
    if row.size < 2:
        raise InputError(f"{path}: found {row.size} row, wanted at least two")
    table.require(np.abs(row) < _MOST_ROWS, "row", f"a row from -{_MOST_ROWS:g} to {_MOST_ROWS:g}")
    table.require(np.append(True, np.diff(row) > 1.0 / _MOST_ROWS), "row", "rows that increase")
    one_way = np.append(True, steps > 0 if steps[0] > 0 else steps < 0)
    if not one_way.all():
        at = int(np.argmin(one_way))
        raise table.error(at, "time", table.texts["time"][at], "times that increase, or decrease, throughout")
    rows = RowTimes(row, times - t_ns, name)
    late_s = 1e-9 * float(rows.late(0.0))
    if abs(late_s) > abs(float(rows.period_s(0.0))):
        found = f"found row 0 exposed {late_s:.6g} s after the time of the image {show(images.texts['image_id'][i])}"
        raise InputError(f"{path}: {found}, wanted them to agree: the time of an image is that of its row 0")
    return rows


def require_rows(images: Images, image: NDArray[np.int64], row_px: NDArray[np.float64], marks: Table) -> None:
    """Raise InputError about the first mark more than a row beyond the table of its image."""
    for i, table in enumerate(images.row_times or ()):
        if table is not None:
            mine = np.flatnonzero(image == i)
            off = (row_px[mine] < table.row[0] - 1.0) | (row_px[mine] > table.row[-1] + 1.0)
            if off.any():
                at = int(mine[np.argmax(off)])
                wanted = f"a row of {table.name}, which has {table.row[0]:g} to {table.row[-1]:g}"
                raise marks.error(at, "row_px", float(row_px[at]), wanted)


def named(images: Images) -> Sequence[str]:
    """The files that hold the tables, as the campaign names them."""
    return list(dict.fromkeys(table.name for table in images.row_times or () if table is not None))
