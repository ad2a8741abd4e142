"""Ground points from GeoJSON and CSV files with the names of other programs."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from ...physics.errors import InputError
from ..tables.read import read_table
from ..text.files import lines_of, read_text, show
from ..text.json_node import MOST_VALUES, unique
from .from_rows import from_rows
from .ground_points import GroundPoints, Row
from .layouts import LAYOUTS, RASTERIO, Layout, layout_of

_CRS84 = "OGC:CRS84"
_BLANKS = re.compile(r"[ \t\r\n\x1e]*")
"""What may stand between the texts of a sequence."""
_IN_GEOMETRY = [layout for layout in LAYOUTS if layout.program in ("Orthority", "rasterio", "starplumb")]


def read_geojson_points(path: Path, crs: str | None = None) -> GroundPoints:
    """Points of a ``FeatureCollection`` or a sequence of features (RFC 8142, or one a line).

    They are WGS 84 (RFC 7946) unless the member ``crs``, rasterio's attribute of that name, or ``crs`` says otherwise.
    """
    features, reference = _features(path)
    own = [_own_system(path, i, feature) for i, feature in enumerate(features, 1)]
    if odd := [i for i, each in enumerate(own, 1) if each != own[0]]:
        raise InputError(
            f"{path}, feature {odd[0]}: found another crs than that of feature 1, wanted one for all"
        )
    rows = [
        _feature(path, f"{path}, feature {i}", i, feature, own[0] is None)
        for i, feature in enumerate(features, 1)
    ]
    return from_rows(path, crs or own[0] or reference, rows)


def _features(path: Path) -> tuple[list[Any], str]:
    """The features of a file, and the reference system of their geometries."""
    documents = _documents(path)
    if len(documents) > 1 or documents[0].get("type") == "Feature":
        return documents, _CRS84
    document = documents[0]
    features = document.get("features")
    if document.get("type") != "FeatureCollection" or not isinstance(features, list) or not features:
        raise InputError(f"{path}: found {show(document.get('type'))}, wanted a FeatureCollection of points")
    return features, _member(path, document)


def _documents(path: Path) -> list[dict[str, Any]]:
    """The objects that stand one after another in a file, at least one."""
    text, decoder = read_text(path), json.JSONDecoder(object_pairs_hook=unique)
    if text.count(",") + text.count("[") + text.count("{") > MOST_VALUES:
        raise InputError(f"{path}: found more than {MOST_VALUES:,} values, wanted fewer points")
    found: list[Any] = []
    at = _past_blanks(text, 0)
    try:
        while not found or at < len(text):
            document, at = decoder.raw_decode(text, at)
            at = _past_blanks(text, at)
            found.append(document)
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: found text that is not JSON ({reason}), wanted GeoJSON") from None
    if odd := [each for each in found if not isinstance(each, dict)]:
        raise InputError(f"{path}: found {show(odd[0])}, wanted GeoJSON, a FeatureCollection of points")
    return found


def _past_blanks(text: str, at: int) -> int:
    blanks = _BLANKS.match(text, at)
    return blanks.end() if blanks else at


def _own_system(path: Path, number: int, feature: Any) -> str | None:
    """The reference system that rasterio writes beside x and y; the geometry may be in it, or turned to WGS 84."""
    properties = feature.get("properties") if isinstance(feature, dict) else None
    if not isinstance(properties, dict) or not {*RASTERIO.needs(with_place=True), "crs"} <= set(properties):
        return None
    if not isinstance(own := properties["crs"], str):
        raise InputError(f"{path}, feature {number}: found crs = {show(own)}, wanted a reference system")
    return own


def _member(path: Path, document: dict[str, Any]) -> str:
    """The reference system of GeoJSON before its RFC, or WGS 84."""
    member = document.get("crs")
    if member is None:
        return _CRS84
    properties = member.get("properties") if isinstance(member, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise InputError(f"{path}: found crs = {show(member)}, wanted the name of a reference system in it")
    return name


def _feature(path: Path, where: str, number: int, feature: Any, in_geometry: bool) -> Row:
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    properties = feature.get("properties") if isinstance(feature, dict) else None
    if not isinstance(geometry, dict) or geometry.get("type") != "Point" or not isinstance(properties, dict):
        raise InputError(f"{where}: found no point with properties, wanted a Feature with the geometry Point")
    place = geometry.get("coordinates")
    if not isinstance(place, list) or len(place) not in (2, 3):
        raise InputError(f"{where}: found the coordinates {show(place)}, wanted two or three numbers")
    layout = layout_of(where, list(properties), _IN_GEOMETRY, with_place=False)
    if not in_geometry:
        return layout.row(path, where, number, properties)
    x, y = layout.place
    # the geometry goes before attributes of the same meaning
    values = properties | {x: place[0], y: place[1]}
    if len(place) == 3:
        values |= {layout.height: place[2]}
    return layout.row(path, where, number, values)


def read_csv_points(path: Path, crs: str | None = None) -> GroundPoints:
    """Points of a CSV table whose columns have the names of one of the layouts; ``crs`` states the reference system."""
    header = _header(path)
    layout = layout_of(str(path), header, [layout for layout in LAYOUTS if len(layout.pixel) == 2])
    reference = crs or (_CRS84 if layout.degrees else None)
    if reference is None:
        x, y = layout.place
        raise InputError(f"{path}: found no reference system of {x} and {y}, wanted it stated (--crs)")
    texts = [name for name in (layout.name, layout.image, layout.height) if name in header]
    numbers = (*layout.pixel, *layout.place)
    table = read_table(path, numbers=numbers, optional_texts=[name for name in texts if name])
    rows = [_line(path, layout, i, table) for i in range(len(table))]
    return from_rows(path, reference, rows, table.notices)


def _line(path: Path, layout: Layout, i: int, table: Any) -> Row:
    values = {name: float(column[i]) for name, column in table.numbers.items()}
    values |= {name: column[i] for name, column in table.texts.items()}
    number = table.row_number(i)
    return layout.row(path, f"{path}, row {number}", number, values)


def _header(path: Path) -> list[str]:
    lines = (line for line in lines_of(read_text(path)) if line.strip() and not line.lstrip().startswith("#"))
    return [cell.strip().strip('"') for cell in next(lines, "").split(",")]
