"""Ground control points with their pixels: QGIS ``.points`` and ``.gcp`` of the Ames Stereo Pipeline.

Both hold landmarks and sightings in one file; they become the tables ``landmarks.csv`` and ``observations.csv``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ...physics.units import DEG
from ..tables.read import read_table
from ..text.files import read_text, show

Array = NDArray[np.float64]

POINT_SUFFIXES = (".points", ".gcp")


@dataclass(frozen=True)
class GroundPoints:
    """n sightings of ground points, one row each.

    ``landmark_id`` and ``image_id`` (n,) names; ``latitude``, ``longitude`` (n,) rad; ``height`` (n,) m as the file has
    it, NaN where it has none; ``column_px``, ``row_px`` (n,) with (0, 0) the centre of the first pixel; ``sigma_enu``
    (n, 3) m and ``sigma_px`` (n,), NaN where the file has none.
    """

    landmark_id: tuple[str, ...]
    image_id: tuple[str, ...]
    latitude: Array
    longitude: Array
    height: Array
    column_px: Array
    row_px: Array
    sigma_enu: Array
    sigma_px: Array
    notices: tuple[str, ...] = ()


def read_ground_points(path: Path, crs: str | None = None) -> GroundPoints:
    """Points of a file by its ending; ``crs`` is the reference system of a QGIS file that does not state it.

    Raises InputError for another ending and for anything in the file that cannot be used.
    """
    match path.suffix.lower():
        case ".points":
            return read_qgis(path, crs)
        case ".gcp":
            return read_asp(path)
    raise InputError(
        f"{path}: found the ending {show(path.suffix)}, wanted .points (QGIS) or .gcp (Ames Stereo Pipeline)"
    )


def read_qgis(path: Path, crs: str | None = None) -> GroundPoints:
    """Points of the QGIS georeferencer of one image, which is named as the file is.

    Pixels count from the upper left corner of the image, rows upwards (negative).  A file whose first line is not
    ``#CRS: ...`` needs ``crs``.  Points that are switched off are left out with a notice.
    """
    stated = re.match(r"\s*#\s*CRS:\s*(\S.*)", read_text(path))
    reference = crs or (stated[1].strip() if stated else None)
    if reference is None:
        raise InputError(
            f"{path}: found no line #CRS:, wanted the reference system of mapX and mapY stated (--crs)"
        )
    new = ("sourceX", "sourceY")
    names = new if _has(path, "sourceX") else ("pixelX", "pixelY")
    table = read_table(path, numbers=("mapX", "mapY", *names), optional_numbers=("enable",))
    on = table.numbers.get("enable", np.ones(len(table))) != 0.0
    x, y = table.numbers["mapX"][on], table.numbers["mapY"][on]
    column, row = table.numbers[names[0]][on] - 0.5, -table.numbers[names[1]][on] - 0.5
    if not on.any():
        raise InputError(f"{path}: found no point that is switched on, wanted at least one")
    if (row < -0.5).any():
        at = int(np.argmax(row < -0.5))
        line = table.row_number(int(np.flatnonzero(on)[at]))
        raise InputError(
            f"{path}, row {line}, column {names[1]}: found {-row[at] - 0.5:.12g}, wanted a negative number: "
            "QGIS counts rows upwards from the upper edge of an image without georeference"
        )
    longitude, latitude = _geographic(path, reference, x, y)
    off = int(np.sum(~on))
    notices = (f"{path}: left out {off} point{'s' * (off != 1)} that QGIS has switched off",) if off else ()
    nothing = np.full(x.size, np.nan)
    return GroundPoints(
        landmark_id=tuple(f"{path.stem}-{table.row_number(row)}" for row in np.flatnonzero(on).tolist()),
        image_id=(path.stem,) * x.size,
        latitude=latitude * DEG,
        longitude=longitude * DEG,
        height=nothing,
        column_px=column,
        row_px=row,
        sigma_enu=np.full((x.size, 3), np.nan),
        sigma_px=nothing,
        notices=notices,
    )


def _has(path: Path, column: str) -> bool:
    """Whether the header names a column."""
    lines = (
        line for line in read_text(path).splitlines() if line.strip() and not line.lstrip().startswith("#")
    )
    return column in next(lines, "")


def _geographic(path: Path, reference: str, x: Array, y: Array) -> tuple[Array, Array]:
    """Longitude and latitude (n,) in degrees of WGS 84."""
    try:
        from rasterio.crs import CRS
        from rasterio.errors import CRSError
        from rasterio.warp import transform
    except ImportError:
        raise InputError(f'{path}: reading it needs rasterio: pip install "starplumb[gis]"') from None
    try:
        crs = CRS.from_user_input(reference)
    except CRSError:
        raise InputError(
            f"{path}: found the reference system {show(reference)}, wanted one such as EPSG:32633 or its WKT"
        ) from None
    if crs.to_epsg() == 4326:
        return x, y
    longitude, latitude = transform(crs, "EPSG:4326", x, y)
    return np.asarray(longitude), np.asarray(latitude)


_FIELDS = (
    "id, latitude, longitude, height, three sigmas, then image, column, row and two sigmas for each image"
)
_POINT, _SIGHTING = 7, 5
"""Numbers of fields of a point and of each of its sightings."""


@dataclass(frozen=True)
class _AspLine:
    """One line of a ``.gcp`` file: the point, and image, column, row and sigmas of each of its sightings."""

    name: str
    numbers: tuple[float, ...]
    sightings: tuple[tuple[str, tuple[float, ...]], ...]


def read_asp(path: Path) -> GroundPoints:
    """Points of the Ames Stereo Pipeline: heights above WGS 84, pixels from 0, sigmas along Earth-centred axes.

    The three sigmas of a point must be equal: else they would be along axes that no table of landmarks has.  Images are
    named by their files without folder and ending.
    """
    lines = [
        (at, re.split(r"[,\s]+", line.strip().strip(",")))
        for at, line in enumerate(read_text(path).splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError(f"{path}: found no point, wanted lines of {_FIELDS}")
    points = [_asp_line(path, at, fields) for at, fields in lines]
    if not any(point.sightings for point in points):
        raise InputError(f"{path}: found no point seen in an image, wanted lines of {_FIELDS}")
    rows = [(point, image, pixel) for point in points for image, pixel in point.sightings]
    place = np.array([point.numbers for point, _, _ in rows])
    seen = np.array([pixel for _, _, pixel in rows])
    return GroundPoints(
        landmark_id=tuple(point.name for point, _, _ in rows),
        image_id=tuple(image for _, image, _ in rows),
        latitude=place[:, 0] * DEG,
        longitude=place[:, 1] * DEG,
        height=place[:, 2],
        column_px=seen[:, 0],
        row_px=seen[:, 1],
        sigma_enu=place[:, 3:6],
        sigma_px=seen[:, 2],
    )


def _asp_line(path: Path, at: int, fields: Sequence[str]) -> _AspLine:
    where = f"{path}, line {at}"
    if len(fields) < _POINT or (len(fields) - _POINT) % _SIGHTING:
        raise InputError(f"{where}: found {len(fields)} fields, wanted {_FIELDS}")
    numbers = _finite(where, fields[1:_POINT])
    if len(set(numbers[3:])) > 1:
        differ = ", ".join(fields[4:_POINT])
        raise InputError(f"{where}: found sigmas that differ ({differ}), wanted three equal ones")
    sightings = []
    for start in range(_POINT, len(fields), _SIGHTING):
        pixel = _finite(where, fields[start + 1 : start + _SIGHTING])
        if pixel[2] != pixel[3]:
            raise InputError(
                f"{where}: found pixel sigmas that differ ({pixel[2]:g}, {pixel[3]:g}), wanted equal ones"
            )
        sightings.append((Path(fields[start]).stem, pixel))
    return _AspLine(fields[0], numbers, tuple(sightings))


def _finite(where: str, fields: Sequence[str]) -> tuple[float, ...]:
    values = []
    for text in fields:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            raise InputError(f"{where}: found {show(text)}, wanted a finite number")
        values.append(value)
    return tuple(values)
