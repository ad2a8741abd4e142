"""Cutting a library of chips out of an orthoimage and its heights, as :mod:`.library` reads it."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...disk.publish import Content, publish
from ...imagery.chips import MISSING
from ...imagery.scene import Scene
from ...physics.earth import itrf_to_geodetic
from ...physics.errors import InputError
from ...physics.units import DEG
from ..tables.columns import GEODETIC, SIGMA_ENU
from ..text.write import Column, csv_text
from .library import HEIGHT_NUMBERS, HEIGHTS, TABLE, TEXTS, degrees_a_metre
from .ortho import Ortho

Array = NDArray[np.float64]

MOST_CELLS = 600
"""Cells along each side of a chip."""
MOST_HEIGHTS = 65
BEYOND = 1.25
"""Heights reach so many times as far as the chip: a line of sight comes down from beside it."""
FULL = 4095
"""The largest value that is written, the darkest is 1."""


@dataclass(frozen=True)
class Cut:
    """Where chips are cut, centres p_J (n, 3) and half their sides (n,) m; ``sigma_m`` errs in them east, north and
    up, alike over ``correlation_length_m``."""

    p_J: Array
    half_m: Array
    sigma_m: Sequence[float]
    correlation_length_m: float | None


def require_new_folder(folder: Path) -> None:
    """Raise InputError where a library could not be written without touching something else."""
    if folder.is_symlink() or (folder.exists() and (not folder.is_dir() or any(folder.iterdir()))):
        raise InputError(f"{folder}: found something there, wanted a new folder for the library of chips")


def write_library(folder: Path, scene: Scene, cut: Cut) -> int:
    """Write the chips of a scene whose reference is an orthoimage, all or none; how many there are.

    Those of which the reference knows too little are left out.  Raises InputError where none is left.
    """
    require_new_folder(folder)
    rows, files = [], dict[str, Content]()
    for row, pictures in _chips(scene, cut):
        rows.append(row)
        files |= {name: _writer(data) for name, data in pictures.items()}
    if not rows:
        raise InputError(f"{folder}: found no chip of which the reference knows enough, wanted one at least")
    names = list(rows[0])
    columns: list[Column] = [[row[name] for row in rows] for name in names]
    columns = [np.array(c) if isinstance(c[0], float) else c for c in columns]
    publish(folder, files | {TABLE: csv_text(names, columns)})
    return len(rows)


def _writer(data: bytes) -> Content:
    def write(path: Path) -> None:
        path.write_bytes(data)

    return write


def _chips(scene: Scene, cut: Cut) -> Iterator[tuple[dict[str, Any], dict[str, bytes]]]:
    """The row of the table and the files of each chip, by their names."""
    for p_J, half in zip(cut.p_J, cut.half_m.tolist(), strict=True):
        latitude, longitude, height = (float(each) for each in itrf_to_geodetic(p_J))
        place = latitude / DEG, longitude / DEG
        gsd, count = _cells(scene, half)
        values = _sampled(scene, place, height, gsd, count)
        if np.mean(~np.isfinite(values)) > MISSING:
            continue
        name = chip_id(*place)
        picture = _png(_grey(values))
        relief, numbers = _relief(scene, place, height, half)
        files = {f"{name}.png": picture, f"{name}_heights.png": relief}
        texts = zip(TEXTS, (name, "EPSG:4326", f"{name}.png", _digest(picture)), strict=True)
        heights = zip(HEIGHTS, (f"{name}_heights.png", _digest(relief)), strict=True)
        row: dict[str, Any] = dict(texts) | dict(zip(GEODETIC, (*place, height), strict=True))
        row |= dict(zip(SIGMA_ENU, map(float, cut.sigma_m), strict=True)) | {"gsd_m": gsd}
        if cut.correlation_length_m is not None:
            row["correlation_length_m"] = float(cut.correlation_length_m)
        yield row | dict(heights) | dict(zip(HEIGHT_NUMBERS, numbers, strict=True)), files


def _cells(scene: Scene, half_m: float) -> tuple[float, int]:
    """Size of a chip's cells, m, that of the orthoimage where these are not too many, and how many there are."""
    assert isinstance(scene.reference, Ortho)
    gsd = max(min(tile.cell_m for tile in scene.reference.tiles), 2.0 * half_m / MOST_CELLS)
    return gsd, 2 * int(np.ceil(half_m / gsd)) + 1


def _grid(place: tuple[float, float], height: float, step_m: float, count: int) -> tuple[Array, Array]:
    """Latitudes and longitudes (n, n) rad of cells around a place in degrees, the northernmost row first."""
    north, east = degrees_a_metre(*place, height)
    along = (np.arange(count) - 0.5 * (count - 1)) * step_m
    y, x = np.meshgrid(place[0] - north * along, place[1] + east * along, indexing="ij")
    return DEG * y, DEG * x


def _sampled(scene: Scene, place: tuple[float, float], height: float, step_m: float, count: int) -> Array:
    return scene.reference.sample(*_grid(place, height, step_m, count), step_m)


def _grey(values: Array) -> NDArray[np.uint16]:
    """Values as 1 to :data:`FULL`, unknown ones as 0; contrast and brightness are told from the image."""
    known = np.isfinite(values)
    low, high = float(values[known].min()), float(values[known].max())
    scaled = 1.0 + (FULL - 1.0) * (np.where(known, values, low) - low) / ((high - low) or 1.0)
    return np.where(known, np.rint(scaled), 0.0).astype(np.uint16)


def _relief(
    scene: Scene, place: tuple[float, float], height: float, half_m: float
) -> tuple[bytes, tuple[float, float, float]]:
    """The picture of the heights around a place, to the centimetre where they allow; spacing, lowest and step, m."""
    reach = BEYOND * half_m
    count = int(np.clip(np.ceil(2.0 * reach / scene.step_m) + 1, 3, MOST_HEIGHTS)) | 1
    spacing = 2.0 * reach / (count - 1)
    latitude, longitude = _grid(place, height, spacing, count)
    found = scene.height_at(latitude.ravel(), longitude.ravel()).reshape(count, count)
    found = np.where(np.isfinite(found), found, height)
    low, step = float(found.min()), max(0.01, float(np.ptp(found)) / 65535.0)
    return _png(np.rint((found - low) / step).astype(np.uint16)), (spacing, low, step)


def chip_id(latitude_deg: float, longitude_deg: float) -> str:
    """The name of a chip by its place, the same in every library: ``N45.12345E009.12345``."""
    south, west = "NS"[latitude_deg < 0.0], "EW"[longitude_deg < 0.0]
    return f"{south}{abs(latitude_deg):08.5f}{west}{abs(longitude_deg):09.5f}"


def _png(values: NDArray[np.uint16]) -> bytes:
    from PIL import Image

    sink = io.BytesIO()
    Image.fromarray(values).save(sink, format="PNG")
    return sink.getvalue()


def _digest(data: bytes) -> str:
    return "sha256:" + hashlib.sha256(data).hexdigest()
