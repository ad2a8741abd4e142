"""Ground points from GeoJSON and CSV files with the names of other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ...physics.errors import InputError
from ..tables.read import read_table
from ..text.files import read_text, show
from .from_rows import from_rows
from .ground_points import GroundPoints, Row
from .layouts import LAYOUTS, Layout, layout_of

_CRS84 = "OGC:CRS84"
_IN_GEOMETRY = [layout for layout in LAYOUTS if layout.program in ("Orthority", "rasterio", "starplumb")]


def read_geojson_points(path: Path, crs: str | None = None) -> GroundPoints:
    """Points of a ``FeatureCollection``: WGS 84 (RFC 7946) unless its member ``crs`` or ``crs`` says otherwise."""
    document = _document(path)
    features = document.get("features")
    if document.get("type") != "FeatureCollection" or not isinstance(features, list) or not features:
        raise InputError(f"{path}: found {show(document.get('type'))}, wanted a FeatureCollection of points")
    rows: list[Row] = []
    for i, feature in enumerate(features, 1):
        rows.append(_feature(path, f"{path}, feature {i}", i, feature))
    return from_rows(path, crs or _member(path, document), rows)


def _document(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: found text that is not JSON ({reason}), wanted GeoJSON") from None
    if not isinstance(document, dict):
        raise InputError(f"{path}: found {show(document)}, wanted GeoJSON, a FeatureCollection of points")
    return document


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


def _feature(path: Path, where: str, number: int, feature: Any) -> Row:
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    properties = feature.get("properties") if isinstance(feature, dict) else None
    if not isinstance(geometry, dict) or geometry.get("type") != "Point" or not isinstance(properties, dict):
        raise InputError(f"{where}: found no point with properties, wanted a Feature with the geometry Point")
    place = geometry.get("coordinates")
    if not isinstance(place, list) or len(place) not in (2, 3):
        raise InputError(f"{where}: found the coordinates {show(place)}, wanted two or three numbers")
    layout = layout_of(where, list(properties), _IN_GEOMETRY, with_place=False)
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
    lines = (
        line for line in read_text(path).splitlines() if line.strip() and not line.lstrip().startswith("#")
    )
    return [cell.strip().strip('"') for cell in next(lines, "").split(",")]
