"""Tables of images, as the part of a campaign they become."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....physics import timescales
from ....physics.errors import EpochError, InputError
from ....table.campaign import Images
from ....table.row_times import RowTimes
from ...tables.declared import UNDECLARED, Declared
from ...tables.read import Table, TableSource, epochs, read_table
from ...text.files import show
from .point_files import PointFiles
from .row_times import read_row_times

MOST_IMAGES = 1_000_000
"""Of a campaign."""
TEMPERATURE, DEG_C = "temperature_", "_c"
"""Around the name of a temperature in its column's."""


def read_images(
    source: TableSource,
    scale: str,
    scans: bool,
    notices: list[str],
    declared: Declared = UNDECLARED,
    time_from_id: str | None = None,
    folder: Path = Path(),
    cameras: Sequence[str] = (),
) -> Images:
    """Images with their epochs; the line period, which a line scanner needs and a frame camera has not.

    The epochs are those of the column ``time``, or stand in the ids as ``time_from_id`` says.  The column ``row_times``
    names tables of uneven rows, relative to ``folder``; the column ``camera`` is read where the campaign names its
    ``cameras``.
    """
    table = read_table(
        source,
        texts=("image_id",) if time_from_id else ("image_id", "time"),
        optional_texts=("tracker", "pass", "session", "row_times", *(["camera"] if cameras else [])),
        optional_numbers=("line_period_s", "sigma_time_s"),
        declared=declared,
        like=(f"{TEMPERATURE}*{DEG_C}",),
        most_rows=MOST_IMAGES,
    )
    notices += table.notices
    table.require_distinct("image_id", "each image once")
    t_ns = _times_in_ids(table, time_from_id, scale) if time_from_id else epochs(table, scale)
    period, row_times = _rows(table, t_ns, scale, scans, folder, notices)
    sigma_time_s = table.numbers.get("sigma_time_s")
    if sigma_time_s is not None:
        table.require(sigma_time_s >= 0.0, "sigma_time_s", "a sigma in seconds, 0 or more")
    for row, name in enumerate(table.texts.get("camera", ())):
        if name not in cameras:
            raise table.error(row, "camera", name, f"one of the cameras {', '.join(cameras)}")
    names = {name: tuple(texts) for name, texts in table.texts.items()}
    return Images(
        names["image_id"],
        t_ns,
        period,
        str(source),
        names.get("tracker"),
        names.get("pass"),
        names.get("session"),
        sigma_time_s,
        row_times,
        _temperatures(table),
        names.get("camera"),
    )


def _temperatures(table: Table) -> dict[str, NDArray[np.float64]]:
    """Temperatures (m,), deg C, by what stands between ``temperature_`` and ``_c``."""
    found = {}
    for column, values in table.numbers.items():
        if column.startswith(TEMPERATURE) and column.endswith(DEG_C):
            table.require(values > -273.15, column, "a temperature in degrees Celsius")
            found[column.removeprefix(TEMPERATURE).removesuffix(DEG_C)] = values
    return found


def _rows(
    table: Table, t_ns: NDArray[np.int64], scale: str, scans: bool, folder: Path, notices: list[str]
) -> tuple[NDArray[np.float64] | None, tuple[RowTimes, ...] | None]:
    """Line periods (m,), and the tables of uneven rows; neither for a frame camera."""
    period, uneven = table.numbers.get("line_period_s"), "row_times" in table.texts
    if not scans:
        there = [
            name for name, found in (("line_period_s", period is not None), ("row_times", uneven)) if found
        ]
        notices += [
            f"{table.source}: ignored the column {name}, which a frame camera does not have" for name in there
        ]
        return None, None
    if period is not None:
        wanted = "a positive number of seconds (negative where later rows are exposed earlier)"
        table.require(period != 0.0, "line_period_s", wanted)
    if uneven:
        rows = read_row_times(table, t_ns, folder, scale)
        return (np.array([each.mean_period_s for each in rows]) if period is None else period), rows
    if period is None:
        raise InputError(f"{table.source}: found no column line_period_s, wanted it for a line-scan camera")
    return period, None


def images_of(source: TableSource | PointFiles, scale: str, time_from_id: str, declared: Declared) -> Images:
    """The images of a table of observations or detections, in its order, with the times in their ids."""
    if isinstance(source, PointFiles):
        table = source.observations(declared, 0.0)
    else:
        only = {ours: name for ours, name in declared.columns.items() if ours == "image_id"}
        asked = replace(declared, columns=only, stated={})
        table = read_table(source, texts=("image_id",), declared=asked)
    first: dict[str, int] = {}
    for row, name in enumerate(table.texts["image_id"]):
        first.setdefault(name, row)
    rows = list(first.values())
    ids = tuple(table.texts["image_id"][row] for row in rows)
    seen = table.named_only(rows, {"image_id": ids})
    return Images(ids, _times_in_ids(seen, time_from_id, scale), name=str(source))


def _times_in_ids(table: Table, pattern: str, scale: str) -> NDArray[np.int64]:
    """``t_ns`` (n,) of ids by a pattern of ``datetime.strptime``; InputError about the first that does not fit."""
    ids, written = table.texts["image_id"], []
    for row, name in enumerate(ids):
        try:
            time = datetime.strptime(name, pattern)
        except ValueError:
            wanted = f"an id like {show(pattern)}, as images.time_from_id says"
            raise table.error(row, "image_id", name, wanted) from None
        written.append(time.isoformat(timespec="microseconds"))
    try:
        return np.asarray(timescales.parse(written, scale))
    except EpochError as error:
        raise table.error(error.row, "image_id", ids[error.row], f"a time in it ({error})") from None
