"""Residuals as a GeoPackage: a layer of points that a geographic information system shows on its map."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...disk.staging import require_room
from ...physics.errors import InputError
from ..text.write import Column

Array = NDArray[np.float64]

LAYER = "residuals"
_TABLES, _ROW = 1 << 17, 1 << 10
"""Bytes that the tables and a row need, and some more: what the library says of a full disk nobody understands."""
_REASON = 80
"""So much of its own words is repeated."""
_NO_DATE = "1970-01-01T00:00:00.000Z"
"""What stands for the time of writing, so that the same input gives the same file."""


def require_pyogrio(path: Path) -> None:
    """Raise InputError where the library that writes ``path`` is not installed; called before long work begins."""
    if find_spec("pyogrio") is None:
        raise InputError(f'{path}: writing it needs pyogrio: pip install "starplumb[gis]"')


def write_residuals(
    path: Path,
    latitude_deg: Array,
    longitude_deg: Array,
    names: Sequence[str],
    columns: Sequence[Column],
) -> None:
    """Write points (n,) of WGS 84 with the columns of ``residuals.csv`` as attributes.

    Raises InputError where pyogrio is not installed, OSError where the place cannot be written to.
    """
    require_pyogrio(path)
    from pyogrio import raw, set_gdal_config_options

    require_room(path, _TABLES + _ROW * len(latitude_deg))
    points = [struct.pack("<BIdd", 1, 1, x, y) for x, y in zip(longitude_deg, latitude_deg, strict=True)]
    set_gdal_config_options({"OGR_CURRENT_DATE": _NO_DATE})
    try:
        raw.write(
            path,
            geometry=np.array(points, dtype=object),
            field_data=[_field(column) for column in columns],
            fields=np.array(names, dtype=object),
            layer=LAYER,
            driver="GPKG",
            geometry_type="Point",
            crs="EPSG:4326",
        )
    except RuntimeError as error:  # of which all of pyogrio's are kinds
        raise OSError(" ".join(str(error).replace(str(path), path.name).split())[:_REASON]) from None
    finally:
        set_gdal_config_options({"OGR_CURRENT_DATE": None})


def _field(column: Column) -> NDArray[Any]:
    """A column of text, or of numbers in which an empty (masked) cell is no number."""
    if isinstance(column, np.ndarray):
        return np.asarray(np.ma.filled(column, np.nan))
    return np.array(column, dtype=object)
