"""Tables of images, as the part of a campaign they become."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from ....physics import timescales
from ....physics.errors import EpochError, InputError
from ....table.campaign import Images
from ...tables.declared import UNDECLARED, Declared
from ...tables.read import Table, TableSource, epochs, read_table
from ...text.files import show
from .point_files import PointFiles


def read_images(
    source: TableSource,
    scale: str,
    scans: bool,
    notices: list[str],
    declared: Declared = UNDECLARED,
    time_from_id: str | None = None,
) -> Images:
    """Images with their epochs; the line period, which a line scanner needs and a frame camera has not.

    The epochs are those of the column ``time``, or stand in the ids as ``time_from_id`` says.
    """
    table = read_table(
        source,
        texts=("image_id",) if time_from_id else ("image_id", "time"),
        optional_texts=("tracker", "pass", "session"),
        optional_numbers=("line_period_s", "sigma_time_s"),
        declared=declared,
    )
    notices += table.notices
    table.require_distinct("image_id", "each image once")
    period = table.numbers.get("line_period_s")
    if scans and period is None:
        raise InputError(f"{source}: found no column line_period_s, wanted it for a line-scan camera")
    if scans and period is not None:
        wanted = "a positive number of seconds (negative where later rows are exposed earlier)"
        table.require(period != 0.0, "line_period_s", wanted)
    elif period is not None:
        notices.append(f"{source}: ignored the column line_period_s, which a frame camera does not have")
        period = None
    sigma_time_s = table.numbers.get("sigma_time_s")
    if sigma_time_s is not None:
        table.require(sigma_time_s >= 0.0, "sigma_time_s", "a sigma in seconds, 0 or more")
    names = {name: tuple(texts) for name, texts in table.texts.items()}
    return Images(
        names["image_id"],
        _times_in_ids(table, time_from_id, scale) if time_from_id else epochs(table, scale),
        period,
        str(source),
        names.get("tracker"),
        names.get("pass"),
        names.get("session"),
        sigma_time_s,
    )


def images_of(source: TableSource | PointFiles, scale: str, time_from_id: str, declared: Declared) -> Images:
    """The images of a table of observations or detections, in its order, with the times in their ids."""
    if isinstance(source, PointFiles):
        table = source.observations(declared, 0.0)
    else:
        only = {ours: name for ours, name in declared.columns.items() if ours == "image_id"}
        asked = replace(declared, columns=only, stated={})
        table = read_table(source, texts=("image_id",), declared=asked)
    first = {name: row for row, name in reversed(list(enumerate(table.texts["image_id"])))}
    rows = sorted(first.values())
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
