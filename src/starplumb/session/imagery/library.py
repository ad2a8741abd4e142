"""Libraries of chips as the reference of a campaign, and what of a measurement is cut into one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...imagery.chain import MeasuredImage
from ...imagery.chips import MARGIN_PX, SEARCH_PX
from ...imagery.matching.orientation import RIM_PX
from ...imagery.scene import Scene
from ...io.campaign.marks.landmarks import read_landmarks
from ...io.campaign.read import LoadedImages
from ...io.campaign.table_config import LandmarksConfig
from ...io.imagery.config import ImageryConfig, ReferenceConfig
from ...io.imagery.library import TABLE, Library, LibraryChip, read_library
from ...io.imagery.scene import open_raws
from ...io.tables.read import read_table
from ...io.text.files import fingerprint, show
from ...physics.errors import InputError
from ...table.campaign import Landmarks

Array = NDArray[np.float64]

CUT = 1.5
"""A chip is cut so many times as far to each side as it is looked at, whatever the camera's azimuth."""


def open_library(settings: str, loaded: LoadedImages) -> tuple[LoadedImages, Scene]:
    """The scene of a campaign with [reference] kind = "chips"; the campaign's landmarks are the chips' centres.

    Raises InputError, one sentence, for the first file of a library that cannot be used.
    """
    imagery, reference = loaded.config.imagery, loaded.config.reference
    assert imagery is not None
    assert reference is not None
    tables = [_table(settings, loaded.folder, name) for name in reference.files]
    chips: list[LibraryChip] = []
    found: list[Landmarks] = []
    for name, table in zip(reference.files, tables, strict=True):
        chips += read_library(table)
        found.append(_landmarks(table, name, reference))
    ids = [name for each in found for name in each.ids]
    first = {name: k for k, name in reversed(list(enumerate(ids)))}
    kept = sorted(first.values())
    r_J = np.concatenate([each.r_J for each in found])
    _require_alike(settings, ids, r_J, first)
    landmarks = Landmarks(
        tuple(ids[k] for k in kept),
        r_J[kept],
        np.concatenate([each.covariance_J for each in found])[kept],
        correlation_length=_length(tables, reference),
    )
    library = Library([chips[k] for k in kept])
    inputs = {
        str(Path(name) / table.name): fingerprint(table)
        for name, table in zip(reference.files, tables, strict=True)
    }
    campaign = replace(loaded.campaign, landmarks=landmarks)
    loaded = replace(
        loaded, campaign=campaign, inputs=loaded.inputs | inputs, sources=(*loaded.sources, *tables)
    )
    return loaded, _scene(settings, loaded, library, imagery)


def _scene(settings: str, loaded: LoadedImages, library: Library, imagery: ImageryConfig) -> Scene:
    raws = open_raws(settings, loaded.campaign, loaded.folder, imagery)
    saturation = imagery.saturation_dn
    return Scene(
        loaded.campaign, raws, library, library.height_at, library.step_m, saturation, library.half_m
    )


def _table(settings: str, folder: Path, name: str) -> Path:
    place = folder / name
    table = place / TABLE
    if not place.is_dir() or not table.is_file():
        kind = "a folder without chips.csv" if place.is_dir() else "no folder of that name"
        raise InputError(
            f"{settings}: reference.files: {show(name)}: found {kind}, wanted a library as starplumb measure --chips "
            "writes it"
        )
    return table


def _landmarks(table: Path, name: str, reference: ReferenceConfig) -> Landmarks:
    stated = LandmarksConfig(file=str(Path(name) / TABLE), sigma_m=reference.sigma_m)
    return read_landmarks(table, [], declared=stated.declared("reference"))


def _require_alike(settings: str, ids: list[str], r_J: Array, first: dict[str, int]) -> None:
    """Raise InputError for a chip that two libraries have at different places."""
    for k, name in enumerate(ids):
        apart = float(np.linalg.norm(r_J[k] - r_J[first[name]]))
        if apart > _SAME_M:
            raise InputError(
                f"{settings}: reference.files: found the chip {show(name)} in two libraries, {apart:.3g} m apart, "
                "wanted each landmark_id at one place"
            )


def _length(tables: list[Path], reference: ReferenceConfig) -> float | None:
    """Over which distance the chips' errors are alike: as the campaign states it, else as their tables do."""
    if reference.correlation_length_m is not None:
        return reference.correlation_length_m
    name, stated = "correlation_length_m", set[float]()
    for path in tables:
        table = read_table(path, optional_numbers=(name,))
        if name in table.numbers:
            table.require(table.numbers[name] > 0.0, name, "a positive number of metres")
            stated |= set(table.numbers[name].tolist())
    if len(stated) > 1:
        few = ", ".join(f"{value:g}" for value in sorted(stated)[:3])
        raise InputError(f"{tables[0]}: found several {name} ({few}), wanted one, or reference.{name}")
    return stated.pop() if stated else None


def to_cut(scene: Scene, images: tuple[MeasuredImage, ...], chip_px: int) -> tuple[Array, Array]:
    """Centres p_J (n, 3) of chips worth keeping, and half their sides (n,) m: those that were found, each piece of
    ground once."""
    p_J: list[Array] = []
    half: list[float] = []
    reach = 0.5 * chip_px + SEARCH_PX + RIM_PX + MARGIN_PX
    for image in images:
        for chip in image.used if not image.reason else []:
            assert chip.p_J is not None
            side = scene.pixel_m(image.C_EK, image.image, chip.pixel)
            if not p_J or np.linalg.norm(np.array(p_J) - chip.p_J, axis=-1).min() > 0.5 * chip_px * side:
                p_J.append(chip.p_J)
                half.append(CUT * reach * side)
    return np.array(p_J).reshape(-1, 3), np.array(half)


_SAME_M = 0.01
