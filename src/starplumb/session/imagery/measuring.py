"""Measuring: the raw images of a campaign on its reference, whatever kind that is."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ... import __version__
from ...imagery.chain import Wanted, measure_images
from ...io.campaign.read import LoadedImages, load_images
from ...io.imagery.kept import KeptImages
from ...io.imagery.rasters import files_of
from ...io.imagery.scene import open_scene, raw_paths, reference_paths
from ...io.text.files import fingerprint
from ...physics.errors import InputError
from ...table.geometry import position_covariance, stations
from ..arguments import checked
from .library import open_library
from .measurement import Measurement, require_cut
from .targets import measure_targets_of

Array = NDArray[np.float64]
Tell = Callable[[int, int], None]
"""Hears how many chips of how many are done."""


@checked
def measure(path: str | Path) -> Measurement:
    """Measure the raw images of a ``campaign.toml`` on its reference.

    The campaign has the sections [imagery] and [reference], and ``mounting.sigma_arcsec``, which says how far to
    search; it needs neither [landmarks] nor [observations].  Raises InputError, one sentence, for the first file that
    cannot be used.
    """
    return measure_watched(Path(path), lambda done, total: None)


def measure_watched(path: Path, tell: Tell, out: Path | None = None) -> Measurement:
    """The same; ``tell`` hears how far it is.  With ``out``, where it will be saved, finished images are kept beside
    that folder until :meth:`Measurement.save` has written it, and a run that was ended before is gone on with."""
    loaded = load_images(path)
    config = loaded.config
    if config.imagery is None or config.reference is None:
        lacks = "imagery" if config.imagery is None else "reference"
        raise InputError(f"{path}: {lacks}: missing, wanted the section [{lacks}] with files")
    prior_E = loaded.campaign.prior_E
    if prior_E is None:
        raise InputError(
            f"{path}: mounting.sigma_arcsec: missing, wanted the error that the model mounting may have: "
            "it says how far to search"
        )
    if config.reference.kind == "points":
        loaded = _with_inputs(loaded, _raw_files(loaded))
        return measure_targets_of(path, loaded, prior_E, _own(loaded), tell, partial(_kept, out))
    if config.reference.kind == "chips":
        loaded, scene = open_library(str(path), _with_inputs(loaded, _raw_files(loaded)))
    else:
        scene = open_scene(str(path), loaded.campaign, loaded.folder, config.imagery, config.reference)
        loaded = _with_inputs(loaded, [*_raw_files(loaded), *_reference_files(path, loaded)])
    wanted = Wanted(config.measure.chip_px, config.measure.grid, config.measure.check_share)
    kept = _kept(out, loaded)
    total = len(scene.raws) * wanted.grid[0] * wanted.grid[1]
    images = measure_images(scene, prior_E, _own(loaded), wanted, lambda done: tell(done, total), kept)
    return Measurement(path, loaded, scene, tuple(images), kept)


def require_library(folder: Path, campaign: Path) -> None:
    """Raise InputError before the work where a library could not be cut of a campaign's reference into a folder."""
    reference = load_images(campaign).config.reference
    if reference is not None:
        require_cut(folder, reference.kind)


def _reference_files(settings: Path, loaded: LoadedImages) -> list[Path]:
    """The tiles and heights that are read, with what lies beside them."""
    reference = loaded.config.reference
    assert reference is not None
    tiles = reference_paths(str(settings), loaded.folder, reference)
    grids = [loaded.folder / name for name in (reference.dem, reference.geoid) if name]
    return [part for path in (*tiles, *grids) for part in files_of(path)]


def _raw_files(loaded: LoadedImages) -> list[Path]:
    """The raw images that are there."""
    assert loaded.config.imagery is not None
    return [
        path for path in raw_paths(loaded.campaign, loaded.folder, loaded.config.imagery) if path.is_file()
    ]


def _with_inputs(loaded: LoadedImages, further: Sequence[Path]) -> LoadedImages:
    """The campaign with the digests of further files that are read."""
    inputs = {_relative(each, loaded.folder): fingerprint(each) for each in further}
    return replace(loaded, inputs=loaded.inputs | inputs, sources=(*loaded.sources, *further))


def _kept(out: Path | None, loaded: LoadedImages) -> KeptImages | None:
    """Where finished images are kept, by all that they depend on: what is read, and the program."""
    if out is None:
        return None
    return KeptImages.beside(out, json.dumps([__version__, loaded.inputs], sort_keys=True))


def _relative(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.as_posix()


def _own(loaded: LoadedImages) -> Array:
    """Covariance (3, 3) rad^2 about E's axes of what moves each image by itself: attitude and position, at worst."""
    campaign = loaded.campaign
    m = len(campaign.images.ids)
    attitude = np.broadcast_to(campaign.cov_attitude_E, (m, 3, 3)).max(axis=0)
    station = stations(campaign, np.arange(m), np.zeros(m))
    distance = np.linalg.norm(station.r_J, axis=-1) - _EARTH_RADIUS_M
    position = np.sqrt(np.linalg.eigvalsh(position_covariance(campaign))[:, -1]) / distance
    return np.diag(np.diagonal(attitude)) + float(np.max(position)) ** 2 * np.eye(3)


_EARTH_RADIUS_M = 6.371e6
