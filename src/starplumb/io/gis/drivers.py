"""Rasters and vector files opened by GDAL with the drivers named: a file of one format may not stand in for another.

GDAL looks at the content of a file and would follow what stands in it: a virtual raster or layer names other files and
addresses in the network.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ..text.files import show, trouble
from ..text.libraries import keep_quiet

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

Array = NDArray[np.float64]

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


_TEXTS = ("AAIGrid", "GRASSASCIIGrid", "GSAG", "XYZ", "USGSDEM")
"""Formats whose every cell takes more than a byte."""


_MOST_BLOCK = 1 << 26
"""Cells of a block, which GDAL holds in memory as a whole."""


def open_raster(path: Path) -> DatasetReader:
    """A raster.  Raises InputError where the file is none, is a virtual one, or rasterio is not installed."""
    try:
        from rasterio.errors import CRSError, RasterioError, RasterioIOError
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
        with quiet_gdal(), _no_lines():  # rasterio.open takes one driver only
            dataset = DatasetReader(str(path), driver=list(RASTERS))
            _require_own_files(path, dataset.files)
    except (RasterioError, RasterioIOError, CRSError, UnicodeDecodeError, ValueError, OverflowError):
        raise InputError(f"{path}: found a file that is not a raster, wanted a GeoTIFF or the like") from None
    cells, size = dataset.width * dataset.height, path.stat().st_size
    if dataset.driver in _TEXTS and cells > size:
        found = f"found {dataset.width} x {dataset.height} cells in {size} bytes"
        raise InputError(f"{path}: {found}, wanted a whole grid")
    together = dataset.tags(ns="IMAGE_STRUCTURE").get("INTERLEAVE") == "PIXEL"
    bands = dataset.count if together else 1  # of which one block holds the cells
    for rows, columns in dataset.block_shapes:
        if bands * rows * columns > max(_MOST_BLOCK, 4 * bands * cells):
            found = (
                f"found blocks of {columns} x {rows} cells in a raster of {dataset.width} x {dataset.height}"
            )
            raise InputError(f"{path}: {found}, wanted a whole raster")
    return dataset


_CACHE_MB = 64
"""Blocks of rasters that GDAL keeps: some rows of tiles of the widest."""


def parts_of(path: Path) -> list[Path]:
    """The files that GDAL reads of a raster: it, and what lies beside it under its name."""
    with open_raster(path) as dataset:
        return [Path(name) for name in dataset.files]


def cells_of(path: Path, dataset: DatasetReader, band: int, window: tuple[int, int, int, int]) -> Array:
    """Values of a window (left, top, width, height) of a band, (height, width); NaN where there is no data.

    Raises InputError where they cannot be read.
    """
    from rasterio.enums import MaskFlags
    from rasterio.windows import Window

    with reading(path):
        masked = dataset.mask_flag_enums[band - 1] != [MaskFlags.all_valid]
        cells = dataset.read(band, window=Window(*window), masked=masked)
        # within, since a signalling NaN of a damaged file warns where it is made wider
        return np.asarray(np.ma.filled(cells.astype(np.float64), np.nan), dtype=np.float64)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Whatever GDAL finds wrong while it reads a raster, in a sentence."""
    from rasterio.errors import CRSError, RasterioError, RasterioIOError

    try:
        with quiet_gdal():
            yield
    except (RasterioError, RasterioIOError, CRSError, UnicodeDecodeError):
        raise InputError(f"{path}: found a damaged raster, wanted one whose cells can be read") from None


@contextmanager
def quiet_gdal() -> Iterator[None]:
    """GDAL's own lines kept from the terminal, and no warnings: what matters of them ends in a sentence of ours."""
    from rasterio import Env

    keep_quiet("rasterio")
    # by both, Cython prints that a line of GDAL's is no UTF-8
    hooks = sys.unraisablehook, sys.excepthook
    sys.unraisablehook, sys.excepthook = (lambda _: None), (lambda *_: None)
    try:
        # a cache of GDAL's own choice is a twentieth of the machine's memory
        cache = {} if "GDAL_CACHEMAX" in os.environ else {"GDAL_CACHEMAX": _CACHE_MB}
        with Env(**cache), catch_warnings():
            simplefilter("ignore")
            yield
    finally:
        sys.unraisablehook, sys.excepthook = hooks


@contextmanager
def _no_lines() -> Iterator[None]:
    """Keep from the terminal what PROJ prints itself, past all logs, of a reference system that it cannot make out."""
    try:
        kept = os.dup(2)
    except OSError:  # standard error is closed
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _require_own_files(path: Path, files: Sequence[str]) -> None:
    """Raise InputError where a raster has parts elsewhere than beside it, under its own name."""
    stem = path.stem.lower()
    for name in files:
        part = Path(name)
        if part.resolve().parent != path.resolve().parent or not part.name.lower().startswith(stem):
            found = f"found a raster that names another file, {show(name)}"
            raise InputError(f"{path}: {found}, wanted one that is whole in itself")


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
