"""Ground points of the QGIS georeferencer, ``.points``: one file for each image."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...physics.errors import InputError, counted
from ..tables.read import read_table
from ..text.files import lines_of, read_text
from .from_rows import from_rows
from .ground_points import GroundPoints, Row, image_id


def read_qgis(path: Path, crs: str | None = None) -> GroundPoints:
    """Points of the QGIS georeferencer of one image, which is named as the file is.

    Pixels count from the upper left corner of the image, rows upwards (negative).  A file whose first line is not
    ``#CRS: ...`` needs ``crs``.  Points that are switched off are left out with a notice.
    """
    text = read_text(path)
    stated = re.match(r"\s*#\s*CRS:\s*(\S.*)", text)
    reference = crs or (stated[1].strip() if stated else None)
    if reference is None:
        raise InputError(
            f"{path}: found no line #CRS:, wanted the reference system of mapX and mapY stated (--crs)"
        )
    names = ("sourceX", "sourceY") if "sourceX" in _header(text) else ("pixelX", "pixelY")
    table = read_table(path, numbers=("mapX", "mapY", *names), optional_numbers=("enable",))
    on = np.flatnonzero(table.numbers.get("enable", np.ones(len(table))) != 0.0).tolist()
    if not on:
        raise InputError(f"{path}: found no point that is switched on, wanted at least one")
    image = image_id(path.stem)
    rows = []
    for i in on:
        x, y, column, row = (float(table.numbers[name][i]) for name in ("mapX", "mapY", *names))
        if row > 0.0:
            raise InputError(
                f"{path}, row {table.row_number(i)}, column {names[1]}: found {row:.12g}, wanted a negative number: "
                "QGIS counts rows upwards from the upper edge of an image without georeference"
            )
        where = f"{path}, row {table.row_number(i)}"
        rows.append(
            Row(where, f"{image}-{table.row_number(i)}", image, x, y, np.nan, column - 0.5, -row - 0.5)
        )
    off = len(table) - len(on)
    notices = [f"{path}: left out {counted(off, 'point')} that QGIS has switched off"] if off else []
    return from_rows(path, reference, rows, notices)


def _header(text: str) -> str:
    """The line that names the columns."""
    lines = (line for line in lines_of(text) if line.strip() and not line.lstrip().startswith("#"))
    return next(lines, "")
