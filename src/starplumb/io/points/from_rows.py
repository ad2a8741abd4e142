"""Sightings in a file's own reference system as ground points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...physics.errors import InputError
from ...physics.units import DEG
from ..gis.reference_system import to_wgs84
from .ground_points import GroundPoints, Row, require_heights_alike


def from_rows(path: Path, reference: str, rows: Sequence[Row], notices: Sequence[str] = ()) -> GroundPoints:
    """Ground points of rows without sigmas.  Raises InputError where there is none or a place has no WGS 84."""
    if not rows:
        raise InputError(f"{path}: found no point, wanted at least one")
    x, y, column, row = (
        np.array(values) for values in zip(*((r.x, r.y, r.column_px, r.row_px) for r in rows), strict=True)
    )
    places = to_wgs84(path, reference, x, y, require_heights_alike(rows))
    nothing = np.full(x.size, np.nan)
    return GroundPoints(
        landmark_id=tuple(r.name for r in rows),
        image_id=tuple(r.image for r in rows),
        latitude=places.latitude * DEG,
        longitude=places.longitude * DEG,
        height=nothing if places.height is None else places.height,
        column_px=column,
        row_px=row,
        sigma_enu=np.full((x.size, 3), np.nan),
        sigma_px=nothing,
        notices=(*notices, *places.notices),
    )
