"""What [imagery] and [reference] name, opened: the raw image of each image of a campaign, orthoimage and heights."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePath

import numpy as np
from numpy.typing import NDArray

from ...imagery.scene import Raw, Scene
from ...physics.errors import InputError
from ...table.campaign import Campaign
from ..text.files import show, trouble
from .config import IMAGE_ID, ImageryConfig, ReferenceConfig
from .ortho import Ortho, Tile
from .overlaps import require_agreement
from .rasters import MOST_PNG, PngPixels, RawImage, open_pixels
from .relief import read_relief

Array = NDArray[np.float64]


def raw_paths(campaign: Campaign, folder: Path, imagery: ImageryConfig) -> list[Path]:
    """The file of the raw image of each image."""
    for name in campaign.images.ids:
        if PurePath(name).is_absolute() or ".." in PurePath(name).parts:
            raise InputError(
                f"{folder}: found the image {show(name)}, whose raw file would be elsewhere than imagery.files says, "
                "wanted ids that lead out of no folder"
            )
    return [folder / imagery.files.replace(IMAGE_ID, name) for name in campaign.images.ids]


def reference_paths(settings: str, folder: Path, reference: ReferenceConfig) -> list[Path]:
    """The tiles that names and patterns give; raises InputError for one that gives none."""
    return [path for name in reference.files for path in _matching(settings, folder, name)]


def _matching(settings: str, folder: Path, name: str) -> Iterator[Path]:
    if not set(name) & set("*?["):
        yield _named(settings, folder, "files", name)
        return
    beside = (".pgw", ".pngw", ".wld", ".tfw", ".xml", ".ovr", ".prj")
    if name.count("**") > 1:  # looked for along every way through the folders
        raise InputError(f"{settings}: reference.files: found {show(name)}, wanted ** once at most")
    try:
        found = [p for p in sorted(folder.glob(name)) if p.is_file() and p.suffix.lower() not in beside]
    except (ValueError, NotImplementedError):  # an absolute pattern
        found = []
    if not found:
        raise InputError(f"{settings}: reference.files: found no file for {show(name)}, wanted at least one")
    yield from found


def _named(settings: str, folder: Path, key: str, name: str) -> Path:
    """The file that a key of [reference] names; raises InputError, which names the key, where none can be read."""
    if (found := trouble(folder / name)) is not None:
        raise InputError(f"{settings}: reference.{key}: {show(name)}: {found}")
    return folder / name


def _tiles(settings: str, paths: list[Path], reference: ReferenceConfig) -> Iterator[Tile]:
    """The tiles of an orthoimage.  Raises InputError where PNGs, which are held whole, would fill the memory."""
    held = 0
    for path in paths:
        pixels = open_pixels(path, reference.band)
        if isinstance(pixels, PngPixels):
            columns, rows = pixels.size
            held += columns * rows
            if held > MOST_PNG // 2:
                raise InputError(
                    f"{settings}: reference.files: found PNGs of more than {MOST_PNG // 2:,} pixels, which cannot be "
                    "read in parts, wanted GeoTIFFs or the like (extra gis)"
                )
        yield Tile.of(pixels, reference.crs, reference.nodata)


def open_scene(
    settings: str, campaign: Campaign, folder: Path, imagery: ImageryConfig, reference: ReferenceConfig
) -> Scene:
    """The scene of a campaign, in which a raw image that cannot be used among others says why when it is read.

    Raises InputError, one sentence, for the first file of the reference that cannot be used, or of the raw images where
    none can.
    """
    raws = open_raws(settings, campaign, folder, imagery)
    paths = reference_paths(settings, folder, reference)
    tiles = list(_tiles(settings, paths, reference))
    require_agreement(tiles)
    geoid = None if reference.geoid is None else _named(settings, folder, "geoid", reference.geoid)
    if reference.dem is None or reference.heights is None:
        raise ValueError("the rules want heights of an orthoimage")
    dem = _named(settings, folder, "dem", reference.dem)
    relief = read_relief(dem, reference.crs, reference.heights, geoid)
    return Scene(campaign, raws, Ortho(tiles), relief.at, relief.step_m, imagery.saturation_dn)


@dataclass(frozen=True)
class Unread:
    """A raw image that cannot be used, in the place of one; reading it raises InputError, which says why."""

    size_px: tuple[int, int]
    why: str

    def window(self, column: int, row: int, columns: int, rows: int) -> Array:
        raise InputError(self.why)


def open_raws(settings: str, campaign: Campaign, folder: Path, imagery: ImageryConfig) -> list[Raw]:
    """The raw image of each image; one that cannot be used says why when it is read.

    Raises InputError, with the key, for the first where none can.
    """
    return _raws(settings, raw_paths(campaign, folder, imagery), campaign, imagery)


def _raws(settings: str, paths: list[Path], campaign: Campaign, imagery: ImageryConfig) -> list[Raw]:
    columns, rows = campaign.camera.size_px
    size = int(columns), int(rows) if np.isfinite(rows) else 1
    raws: list[Raw] = []
    for path in paths:
        try:
            raws.append(_raw(path, campaign, imagery))
        except InputError as error:
            raws.append(Unread(size, str(error)))
    wrong = [raw.why for raw in raws if isinstance(raw, Unread)]
    if len(wrong) == len(raws):
        raise InputError(f"{settings}: imagery.files: {wrong[0]}")
    return raws


def _raw(path: Path, campaign: Campaign, imagery: ImageryConfig) -> RawImage:
    """A raw image whose size is the camera's; a scanner's may have any number of rows."""
    pixels = open_pixels(path, imagery.band)
    if pixels.affine is not None:
        raise InputError(
            f"{path}: found a georeferenced raster, wanted the image in the columns and rows in which the camera took "
            "it; if these are they, take the georeference off (gdal_edit.py -unsetgt, or remove the world file beside "
            "it)"
        )
    columns, rows = pixels.size
    wanted = campaign.camera.size_px
    if columns != wanted[0] or (not campaign.camera.scans and rows != wanted[1]):
        size = f"{wanted[0]:g} x {wanted[1]:g}" if np.isfinite(wanted[1]) else f"{wanted[0]:g} columns"
        hint = ": is it transposed?" if [rows, columns] == list(wanted) else ""
        raise InputError(
            f"{path}: found {columns} x {rows} pixels, wanted {size} as camera.image_size_px says{hint}"
        )
    return RawImage(pixels, imagery.nodata)
