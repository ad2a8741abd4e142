"""Ground points of other programs, recognised by the ending of the file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from ...physics.errors import InputError
from ..tables.cells import PRINTABLE
from ..text.files import show
from ..text.visible import IN_NAME

if TYPE_CHECKING:
    from .ground_points import GroundPoints

POINT_SUFFIXES = (".points", ".gcp", ".txt")
"""Endings of files that can be nothing else, and so may stand in place of a campaign's tables."""

MARKED_SUFFIXES = (*POINT_SUFFIXES, ".geojson", ".json")
"""Those that hold marks in images too; of landmarks alone a GeoJSON may be a table of places."""

_WANTED = (
    ".points (QGIS), .gcp (Ames Stereo Pipeline), .txt (OpenDroneMap), .geojson or .json (Orthority, rasterio), "
    ".csv, or .tif with control points in its tags"
)


def read_ground_points(path: Path, crs: str | None = None) -> GroundPoints:
    """Points of a file by its ending; ``crs`` is the reference system of a file that does not state it.

    Raises InputError for another ending and for anything in the file that cannot be used.
    """
    found = _read(path, crs)
    for names in (found.landmark_id, found.image_id):
        if re.search(IN_NAME, "".join(names)):
            name = next(name for name in names if re.search(IN_NAME, name))
            raise InputError(f"{path}: found the name {show(name)}, wanted {PRINTABLE}")
    return found


def _read(path: Path, crs: str | None) -> GroundPoints:
    match path.suffix.lower():
        case ".points":
            from .qgis import read_qgis

            return read_qgis(path, crs)
        case ".gcp":
            from .asp import read_asp

            return read_asp(path)
        case ".txt":
            from .odm import read_odm

            return read_odm(path, crs)
        case ".geojson" | ".json" | ".geojsonl" | ".geojsons":
            from .named import read_geojson_points

            return read_geojson_points(path, crs)
        case ".csv":
            from .named import read_csv_points

            return read_csv_points(path, crs)
        case ".tif" | ".tiff":
            from .tags import read_tags

            return read_tags(path, crs)
    raise InputError(f"{path}: found the ending {show(path.suffix)}, wanted {_WANTED}")
