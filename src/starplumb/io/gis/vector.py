"""Landmarks from GeoPackage, GeoJSON or Shapefile: points in WGS 84 with the attributes of the CSV table."""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np

from ...physics.errors import InputError
from ..tables.cells import PRINTABLE, Array
from ..tables.columns import GEODETIC, SIGMA_ENU
from ..tables.read import Table
from ..text.files import composed, show
from ..text.visible import IN_NAME
from .drivers import require_vector

_WGS84 = re.compile(
    r'EPSG:(4326|4979)|OGC:CRS84h?|GEOG(CRS|CS)\["(GCS_)?WGS[ _](19)?84.*', re.DOTALL | re.IGNORECASE
)
_NAMES = ("landmark_id", "height_m", "sigma_m", *SIGMA_ENU)
_LOST = re.compile(r"incompletely|Unsupported geometry|too many members|Ignoring|truncat", re.IGNORECASE)
"""What GDAL says where it gives another value than the file has."""
_DBASE_LETTERS = 10
"""A shapefile cuts the names of its attributes to so many letters."""
_POINT, _Z_ISO, _Z_FLAG = 1, 1000, 0x80000000


def read_points(path: Path, flat: bool = False) -> Table:
    """The one layer of a vector file as the table of its features (counted from 1).

    ``flat`` says that the points need no heights of their own.

    Longitude and latitude are the point's own, the height above the ellipsoid its third coordinate or the attribute
    ``height_m``; ``landmark_id`` and the sigmas are attributes. Raises InputError for another reference system, several
    layers or features that are not points, and where pyogrio is not installed.
    """
    require_vector(path)
    meta, geometry, attributes, notices = _opened(path)
    if not _WGS84.fullmatch(str(meta["crs"])):
        raise InputError(
            f"{path}: found the reference system {show(meta['crs'])}, wanted EPSG:4326 or EPSG:4979 (WGS 84)"
        )
    cut = {name[:_DBASE_LETTERS]: name for name in _NAMES} if path.suffix.lower() == ".shp" else {}
    names = [cut.get(str(name), str(name)) for name in meta["fields"]]
    table = _table(path, geometry, dict(zip(names, attributes, strict=True)), flat)
    return replace(table, notices=[*table.notices, *notices])


def _opened(path: Path) -> tuple[dict[str, Any], Any, Any, list[str]]:
    """What GDAL reads of the one layer, and what it says of it.

    Raises InputError for whatever it stumbles over, and where a value was lost on the way.
    """
    try:
        from pyogrio import list_layers, raw
    except ImportError:
        raise InputError(f'{path}: reading it needs pyogrio: pip install "starplumb[gis]"') from None
    with catch_warnings(record=True) as said:
        simplefilter("always")
        try:
            layers = [str(name) for name, _ in list_layers(path)]
            if len(layers) == 1:
                meta, _, geometry, attributes = raw.read(path)
        except (RuntimeError, ValueError, NameError, OverflowError) as error:  # RuntimeError: pyogrio's own
            reason = show(" ".join(str(error).split()))
            raise InputError(
                f"{path}: found a file that GDAL cannot read ({reason}), wanted another or a whole one"
            ) from None
    if len(layers) != 1:
        raise InputError(
            f"{path}: found {len(layers)} layers ({show(', '.join(layers))}), wanted one of landmarks"
        )
    lines = list(dict.fromkeys(" ".join(str(each.message).split()) for each in said))
    if lost := next((line for line in lines if _LOST.search(line)), None):
        raise InputError(
            f"{path}: found values that are not what they should be ({show(lost)}), wanted others"
        )
    return meta, geometry, attributes, [f"{path}: GDAL says {show(line)}" for line in lines]


def _table(path: Path, geometry: Any, attributes: dict[str, Any], flat: bool) -> Table:
    points = np.array([_point(path, row, wkb) for row, wkb in enumerate(geometry, 1)]).reshape(-1, 3)
    if not len(points):
        raise InputError(f"{path}: found no feature, wanted at least one landmark")
    if "landmark_id" not in attributes:
        raise InputError(
            f"{path}: found the attributes {show(', '.join(attributes))}, wanted landmark_id too"
        )
    numbers = {
        name: _numbers(path, name, attributes[name]) for name in ("sigma_m", *SIGMA_ENU) if name in attributes
    }
    height = points[:, 2]
    lies_flat = flat and np.isnan(height).all() and "height_m" not in attributes
    if np.isnan(height).any() and not lies_flat:
        if "height_m" not in attributes:
            row = int(np.argmax(np.isnan(height))) + 1
            raise InputError(
                f"{path}, feature {row}: found a point without height, wanted its third coordinate or height_m"
            )
        height = np.where(np.isnan(height), _numbers(path, "height_m", attributes["height_m"]), height)
    numbers |= dict(zip(GEODETIC[:2], (points[:, 1], points[:, 0]), strict=True))
    numbers |= {} if lies_flat else {"height_m": height}
    ids = [_text(path, row, value) for row, value in enumerate(attributes["landmark_id"], 1)]
    used = {*numbers, "landmark_id"}
    ignored = [name for name in attributes if name not in used]
    notices = (
        [f"{path}: ignored the attribute{'s' * (len(ignored) > 1)} {', '.join(ignored)}"] if ignored else []
    )
    return Table(path, numbers, {"landmark_id": ids}, len(points), lambda row: row + 1, notices)


def _text(path: Path, row: int, value: object) -> str:
    text = "" if value is None else composed(str(value).strip())
    if not text:
        raise InputError(f"{path}, feature {row}, attribute landmark_id: found nothing, wanted a name")
    if re.search(IN_NAME, text):
        raise InputError(
            f"{path}, feature {row}, attribute landmark_id: found {show(text)}, wanted {PRINTABLE}"
        )
    return text


def _numbers(path: Path, name: str, values: Any) -> Array:
    try:
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"{path}, attribute {name}: found {show(values[0])}, wanted a column of numbers"
        ) from None


def _point(path: Path, row: int, wkb: bytes | None) -> tuple[float, float, float]:
    """Coordinates of a point in well-known binary, ISO or extended; the third is NaN where there is none."""
    if wkb is None:
        raise InputError(f"{path}, feature {row}: found no geometry, wanted a point")
    order = "<" if wkb[0] else ">"
    (kind,) = struct.unpack_from(order + "I", wkb, 1)
    has_z = bool(kind & _Z_FLAG) or kind == _POINT + _Z_ISO
    if kind & ~_Z_FLAG not in (_POINT, _POINT + _Z_ISO):
        raise InputError(f"{path}, feature {row}: found a geometry that is not a point, wanted a point")
    x, y, *z = struct.unpack_from(order + ("3d" if has_z else "2d"), wkb, 5)
    return x, y, z[0] if z else float("nan")
