"""Ground control points of OpenDroneMap, ``gcp_list.txt``.

Source: OpenDroneMap documentation, "Ground Control Points"; the pixels are OpenSfM's, whose normalised coordinates are
those of (x + 0.5, y + 0.5) from the corner: (0, 0) is the centre of the first pixel.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...physics.errors import InputError
from ..text.files import lines_of, read_text, show
from ..text.numbers import numbers
from .from_rows import from_rows
from .ground_points import GroundPoints, Row, finite, image_id

_FIELDS = "x, y, height, column, row, image and, if it has one, the point's name"


def read_odm(path: Path, crs: str | None = None) -> GroundPoints:
    """Points of a list whose first line is its reference system; ``crs`` goes before that line."""
    lines = [
        (at, line.strip())
        for at, line in enumerate(lines_of(read_text(path)), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines or _is_point(lines[0][1]):
        raise InputError(
            f"{path}: found no reference system in the first line, wanted one such as WGS84 UTM 32N or EPSG:4326"
        )
    rows = [_row(path, at, line.split()) for at, line in lines[1:]]
    return from_rows(path, crs or lines[0][1], rows)


def _is_point(line: str) -> bool:
    words = line.split()[:5]
    return len(words) == 5 and bool(np.isfinite(numbers(words)).all())


def _row(path: Path, at: int, words: list[str]) -> Row:
    where = f"{path}, line {at}"
    if len(words) < 6:
        raise InputError(f"{where}: found {show(' '.join(words))}, wanted {_FIELDS}")
    height = np.nan if words[2].lower() == "nan" else finite(where, words[2])
    x, y, column, row = (finite(where, words[i]) for i in (0, 1, 3, 4))
    name = words[6] if len(words) > 6 else f"{image_id(words[5])}-{at}"
    return Row(where, name, image_id(words[5]), x, y, height, column, row)
