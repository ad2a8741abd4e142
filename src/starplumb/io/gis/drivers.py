"""Rasters and vector files opened by GDAL with the drivers named: a file of one format may not stand in for another.

GDAL looks at the content of a file and would follow what stands in it: a virtual raster or layer names other files and
addresses in the network.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING
from warnings import catch_warnings, simplefilter

from ...physics.errors import InputError
from ..text.files import trouble

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

RASTERS = (
    *(
        "GTiff",
        "COG",
        "HFA",
        "AAIGrid",
        "EHdr",
        "ENVI",
        "SRTMHGT",
        "DTED",
        "GTX",
        "NTv2",
        "BYN",
        "USGSDEM",
        "RST",
    ),
    *(
        "JP2OpenJPEG",
        "PNG",
        "JPEG",
        "netCDF",
        "HDF5",
        "NITF",
        "XYZ",
        "SAGA",
        "ERS",
        "ILWIS",
        "GSAG",
        "GSBG",
        "GS7BG",
    ),
)
"""Drivers that read one file, and what lies beside it under the same name."""


def open_raster(path: Path) -> DatasetReader:
    """A raster.  Raises InputError where the file is none, is a virtual one, or rasterio is not installed."""
    try:
        from rasterio import Env
        from rasterio.errors import NotGeoreferencedWarning, RasterioIOError
        from rasterio.io import DatasetReader
    except ImportError:
        raise InputError(f'{path}: reading it needs rasterio: pip install "starplumb[gis]"') from None
    if (found := trouble(path)) is not None:
        raise InputError(f"{path}: {found}")
    with path.open("rb") as file:
        if re.match(rb"\s*<VRTDataset", file.read(200)):
            found = "found a virtual raster, which names other files"
            raise InputError(f"{path}: {found}, wanted the raster itself (gdal_translate makes one of it)")
    try:
        with Env(), catch_warnings():  # rasterio.open takes one driver only
            simplefilter("ignore", NotGeoreferencedWarning)  # who needs a reference system asks for it
            return DatasetReader(str(path), driver=list(RASTERS))
    except RasterioIOError:
        raise InputError(f"{path}: found a file that is not a raster, wanted a GeoTIFF or the like") from None


_GEOJSON = re.compile(rb'"type"\s*:\s*"(FeatureCollection|Feature)"')
_STARTS = {".gpkg": b"SQLite format 3\0", ".shp": b"\x00\x00\x27\x0a"}
_HEAD = 1 << 16


def require_vector(path: Path) -> None:
    """Raise InputError where the content of a vector file is not what its ending says."""
    if (found := trouble(path)) is not None:
        raise InputError(f"{path}: {found}")
    with path.open("rb") as file:
        head = file.read(_HEAD)
    start = _STARTS.get(path.suffix.lower())
    if start is None:
        good = head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{") and _GEOJSON.search(head) is not None
    else:
        good = head.startswith(start)
    if not good:
        found = f"found a file that is not a vector file of the ending {path.suffix}"
        raise InputError(
            f"{path}: {found}, wanted GeoPackage, GeoJSON or Shapefile, each with its own ending"
        )
