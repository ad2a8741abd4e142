"""Ground control points of the Ames Stereo Pipeline, ``.gcp``.

Source: StereoPipeline, docs/tools/bundle_adjust.rst, "Ground control points"; its viewer writes the reference system of
the reference image as a first line ``# WKT: ...``, of which the points, in latitude and longitude, have the datum.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...physics.errors import InputError
from ...physics.units import DEG
from ..gis.reference_system import datum_of, to_wgs84
from ..text.files import lines_of, read_text
from .ground_points import GroundPoints, finite, image_id

_FIELDS = (
    "id, latitude, longitude, height, three sigmas, then image, column, row and two sigmas for each image"
)
_POINT, _SIGHTING = 7, 5
"""Numbers of fields of a point and of each of its sightings."""


@dataclass(frozen=True)
class _Line:
    """One line of the file: the point, and image, column, row and sigmas of each of its sightings."""

    name: str
    numbers: tuple[float, ...]
    sightings: tuple[tuple[str, tuple[float, ...]], ...]


def read_asp(path: Path) -> GroundPoints:
    """Points of the Ames Stereo Pipeline: heights above the ellipsoid, pixels from 0, sigmas along Earth-centred axes.

    The three sigmas of a point must be equal: else they would be along axes that no table of landmarks has.  The datum
    is that of the line ``# WKT:``, WGS 84 where there is none.
    """
    text = read_text(path)
    lines = [
        (at, re.split(r"[,\s]+", line.strip().strip(",")))
        for at, line in enumerate(lines_of(text), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError(f"{path}: found no point, wanted lines of {_FIELDS}")
    points = [_line(path, at, fields) for at, fields in lines]
    rows = [(point, image, pixel) for point in points for image, pixel in point.sightings]
    if not rows:
        raise InputError(f"{path}: found no point seen in an image, wanted lines of {_FIELDS}")
    place = np.array([point.numbers for point, _, _ in rows])
    seen = np.array([pixel for _, _, pixel in rows])
    stated = re.search(r"^\s*#\s*WKT:\s*(\S.*)$", text, re.MULTILINE)
    reference = datum_of(path, stated[1]) if stated else "EPSG:4979"
    wgs84 = to_wgs84(path, reference, place[:, 1], place[:, 0], place[:, 2], on_own_ellipsoid=True)
    return GroundPoints(
        landmark_id=tuple(point.name for point, _, _ in rows),
        image_id=tuple(image for _, image, _ in rows),
        latitude=wgs84.latitude * DEG,
        longitude=wgs84.longitude * DEG,
        height=place[:, 2] if wgs84.height is None else wgs84.height,
        column_px=seen[:, 0],
        row_px=seen[:, 1],
        sigma_enu=place[:, 3:6],
        sigma_px=seen[:, 2],
        notices=wgs84.notices,
    )


def _line(path: Path, at: int, fields: Sequence[str]) -> _Line:
    where = f"{path}, line {at}"
    if len(fields) < _POINT or (len(fields) - _POINT) % _SIGHTING:
        raise InputError(f"{where}: found {len(fields)} fields, wanted {_FIELDS}")
    numbers = tuple(finite(where, text) for text in fields[1:_POINT])
    if len(set(numbers[3:])) > 1:
        differ = ", ".join(fields[4:_POINT])
        raise InputError(f"{where}: found sigmas that differ ({differ}), wanted three equal ones")
    sightings = []
    for start in range(_POINT, len(fields), _SIGHTING):
        pixel = tuple(finite(where, text) for text in fields[start + 1 : start + _SIGHTING])
        if pixel[2] != pixel[3]:
            raise InputError(
                f"{where}: found pixel sigmas that differ ({pixel[2]:g}, {pixel[3]:g}), wanted equal ones"
            )
        sightings.append((image_id(fields[start]), pixel))
    return _Line(fields[0], numbers, tuple(sightings))
