"""Grids of ground positions on disk: GeoTIFF with GDAL's geolocation tags, or a NumPy array.

A GeoTIFF is compressed: angles are whole multiples of 2^-30 deg, at most 0.05 mm on the ground from what was computed
(which is known to 0.1 mm), and heights that vary of 2^-14 m; what is left then fits a byte a pixel in place of 24, some
six where the ground is rough.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...disk.staging import require_room, staged, take_room
from ...physics.errors import InputError
from ...physics.units import DEG
from ..text.files import trouble
from .drivers import open_raster

Array = NDArray[np.float64]

ENDINGS = (".tif", ".tiff", ".npy")
_TIFF_TAGS = 1 << 16
"""Bytes that a GeoTIFF needs beside its pixels, and some more."""
_STEPS = (2.0**-30, 2.0**-30, 2.0**-14)
"""Of longitude and latitude, deg, and of heights, m, in a GeoTIFF."""
_ARRAY_BYTES, _FLAT_BYTES, _ROUGH_BYTES = 24, 1, 6
"""Of a pixel: in an array, and about so many in a GeoTIFF of one height and in one of a terrain."""
BANDS = ("longitude_deg", "latitude_deg", "height_m")


def require_ending(path: Path) -> None:
    """Raise InputError for a file name with another ending."""
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path}: found the ending {path.suffix!r}, wanted {', '.join(ENDINGS)}")


def bytes_on_disk(path: Path, shape: tuple[int, int], flat: bool) -> int:
    """How large the file of a grid becomes: exactly for an array, about for a GeoTIFF; ``flat`` is of one height."""
    compressed = _FLAT_BYTES if flat else _ROUGH_BYTES
    return (_ARRAY_BYTES if _is_array(path) else compressed) * shape[0] * shape[1]


def _is_array(path: Path) -> bool:
    return path.suffix.lower() == ".npy"


def write_grid(path: Path, blocks: Iterable[Array], shape: tuple[int, int], every: int) -> int:
    """Write blocks of rows (r, c, 3) of longitude, latitude (rad) and height (m); returns how many pixels are NaN.

    ``shape`` is (rows, columns), ``every`` the step in pixels.  The file appears when it is whole.  Raises InputError
    where it cannot be written.
    """
    open_file = _array if _is_array(path) else _geotiff
    with staged(path.parent, place=path) as staging:
        with open_file(staging.path(path.name), shape, every) as put:
            missing, at = 0, 0
            for block in blocks:
                degrees = block * np.array([1.0 / DEG, 1.0 / DEG, 1.0])
                missing += int(np.isnan(degrees[..., 2]).sum())
                put(at, np.moveaxis(degrees, -1, 0))
                at += len(block)
        staging.commit([path.name])
    return missing


def is_grid(path: Path) -> bool:
    """Whether a file holds such a grid, of any image: by the bands that it has."""
    if trouble(path) is not None:
        return False
    try:
        if _is_array(path):
            with path.open("rb") as file:
                np.lib.format.read_magic(file)
                shape, _, dtype = np.lib.format.read_array_header_1_0(file)
            return len(shape) == 3 and shape[0] == len(BANDS) and dtype == np.float64
        with open_raster(path) as raster:
            return tuple(raster.descriptions) == BANDS
    except (OSError, ValueError, InputError):
        return False


@contextmanager
def _array(path: Path, shape: tuple[int, int], every: int) -> Iterator[Any]:
    """Writer of a NumPy file (3, rows, columns), whose room is taken at once: a full disk ends no long work."""
    header = {"descr": "<f8", "fortran_order": False, "shape": (len(BANDS), *shape)}
    band = 8 * shape[0] * shape[1]
    with path.open("xb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        begin = file.tell()
        take_room(file.fileno(), begin + len(BANDS) * band)

        def put(at: int, block: Array) -> None:
            for i, values in enumerate(block):
                file.seek(begin + i * band + 8 * at * shape[1])
                file.write(np.ascontiguousarray(values, dtype="<f8").tobytes())

        yield put


@contextmanager
def _geotiff(path: Path, shape: tuple[int, int], every: int) -> Iterator[Any]:
    """Writer of a GeoTIFF with a band each and the tags by which GDAL takes it as a geolocation array."""
    try:
        import rasterio
        from rasterio.errors import NotGeoreferencedWarning, RasterioIOError
        from rasterio.windows import Window
    except ImportError:
        raise InputError(f'{path}: writing it needs rasterio: pip install "starplumb[gis]"') from None
    require_room(path, bytes_on_disk(path, shape, flat=False) + _TIFF_TAGS)
    profile = {
        "driver": "GTiff",
        "dtype": "float64",
        "count": len(BANDS),
        "nodata": float("nan"),
        "bigtiff": "if_safer",
        "interleave": "band",
        "compress": "deflate",
        "predictor": 3,
        "zlevel": 1,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)  # its own pixels are where it says they are
        try:
            with rasterio.open(path, "w", height=shape[0], width=shape[1], **profile) as file:
                for band, name in enumerate(BANDS, 1):
                    file.set_band_description(band, name)
                tags = {"X_BAND": 1, "Y_BAND": 2, "Z_BAND": 3, "SRS": "EPSG:4979"}
                # GDAL counts from the corner of the image, whatever the user does, and these are centres of pixels
                steps = {"PIXEL_OFFSET": 0.5, "LINE_OFFSET": 0.5, "PIXEL_STEP": every, "LINE_STEP": every}
                file.update_tags(ns="GEOLOCATION", **tags, **steps)

                def put(at: int, block: Array) -> None:
                    file.write(_rounded(block), window=Window(0, at, block.shape[2], block.shape[1]))

                yield put
        except RasterioIOError as error:
            raise OSError(str(error)) from None


def _rounded(block: Array) -> Array:
    """Bands (3, r, c) in whole steps; a height that is everywhere the same stays as it is."""
    height = block[2][np.isfinite(block[2])]
    rounded = [np.round(band / step) * step for band, step in zip(block, _STEPS, strict=True)]
    return np.stack([*rounded[:2], rounded[2] if height.size and np.ptp(height) > 0.0 else block[2]])
