"""Ground control points in the tags of a raster, as GDAL and rasterio keep them.

Source: GDAL, "Raster Data Model", GCPs: pixel and line count from the corner of the first pixel.
"""

from __future__ import annotations

from pathlib import Path

from ...physics.errors import InputError
from ..gis.drivers import open_raster, reading
from .from_rows import from_rows
from .ground_points import GroundPoints
from .layouts import RASTERIO


def read_tags(path: Path, crs: str | None = None) -> GroundPoints:
    """The control points of an image without georeference of its own, named as its file is."""
    with open_raster(path) as dataset, reading(path):
        points, stated = dataset.gcps
    if not points:
        raise InputError(f"{path}: found no ground control points in its tags, wanted an image that has them")
    reference = crs or (stated.to_wkt() if stated else None)
    if reference is None:
        raise InputError(f"{path}: found no reference system of its control points, wanted it stated (--crs)")
    rows = []
    for i, point in enumerate(points, 1):
        values = {
            "id": point.id,
            "col": point.col,
            "row": point.row,
            "x": point.x,
            "y": point.y,
            "z": point.z,
        }
        rows.append(RASTERIO.row(path, f"{path}, control point {i}", i, values))
    return from_rows(path, reference, rows)
