"""A campaign from its settings and tables, files or data frames, checked and brought inside as physics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...physics import so3
from ...physics.errors import ArgumentError, InputError
from ...physics.light import Corrections
from ...physics.orientation import EarthOrientation
from ...physics.units import ARCSEC
from ...table.cameras.ties import guessed
from ...table.campaign import Campaign, Detections, Images, Landmarks, Sightings
from ...table.considered import considered
from ..gis.heights import Ground
from ..tables.cells import Array
from ..tables.read import Table
from ..text.frames import earth_frame
from ..text.toml import check, refuse
from . import motion
from .attitude import Exposures, read_attitude
from .camera import pixel_shift
from .cameras.rig import Optics, read_optics
from .config import CampaignConfig
from .files import Files
from .fixed_frames import Turn
from .marks import markers
from .marks.images import images_of, read_images
from .marks.landmarks import read_landmarks
from .marks.outside import Coverage, LeftOut, Outside
from .marks.row_times import named, require_rows
from .settings import Settings, read_settings
from .sharing import attitude_sharing, position_sharing
from .spice_config import spice_rules
from .table_config import LandmarksConfig

_EXACT = 1e-6
"""A matrix this near to orthonormal is taken as a rotation written with its digits; beyond it a notice says
so."""


@dataclass(frozen=True)
class LoadedCampaign:
    """A campaign with what it was read from.

    ``inputs`` maps each file, as the campaign names it, to its SHA-256; ``notices`` are sentences the user
    should see; ``orientation`` is that of the Earth where an inertial frame asked for it (its ``source``
    names the table). ``detections`` stand in for the sightings, of which there are then none, where the
    landmarks are not known; ``rows`` names the rows of either, and ``left_out`` are those outside attitude and orbit
    where that was asked for; ``sources`` are the places of the files, which nothing may be written over.
    """

    campaign: Campaign
    config: CampaignConfig
    inputs: dict[str, str]
    notices: tuple[str, ...]
    orientation: EarthOrientation | None
    rows: Table
    detections: Detections | None = None
    outside: Outside = "refuse"
    left_out: tuple[LeftOut, ...] = ()
    sources: tuple[Path, ...] = ()

    @property
    def predicted_orientation(self) -> bool:
        """Whether the Earth's orientation at an image is predicted rather than measured."""
        return self.orientation is not None and bool(
            np.any(self.orientation.predicted(self.campaign.images.t_ns))
        )

    @property
    def coverage(self) -> Coverage:
        """Which marks attitude and orbit cover."""
        return Coverage.of(self.campaign, self.detections, self.rows)

    @property
    def C_EK_true(self) -> Array | None:
        """The true mounting where the campaign is simulated and says so."""
        truth = self.config.truth
        return None if truth is None else so3.from_quaternion(truth.quaternion_xyzw)

    @property
    def shift_px(self) -> float:
        """What the user's pixel coordinates are ahead of ours: 0.5 where (0, 0) is a corner."""
        return pixel_shift(self.config.first[1])


def load_campaign(
    settings: Path | Mapping[str, Any],
    tables: Mapping[str, object] | None = None,
    *,
    with_detections: bool = False,
    outside: Outside = "refuse",
) -> LoadedCampaign:
    """Read a campaign: ``settings`` is the path of ``campaign.toml`` or its content as a dictionary.

    ``tables`` go before the files that the settings name, and their sections need no ``file``: each is a path or a
    data frame (pandas, polars, PyArrow and any other that gives Arrow data, or a mapping of columns), by the name of
    its section: ``ephemeris``, ``attitude`` (or ``trackers.0``, ...), ``landmarks``, ``images``, ``observations`` or
    ``detections``, or ``look_angles``; None is as if left out. Rows of data frames are counted from 0. Files that the
    settings name stand relative to the folder of ``campaign.toml``, else to the working directory.

    ``with_detections`` says that the caller can do without known landmarks; a campaign with [detections] is
    else refused. ``outside="skip"`` leaves out marks that attitude or orbit do not cover; else whoever needs them
    refuses them. Raises InputError, one sentence, for the first file or table that cannot be used.
    """
    given = read_settings(settings, tables)
    config = _config(given)
    files = Files.of(config, given)
    if config.detections is not None and not with_detections:
        raise InputError(
            f"{given.name}: detections: found marker images whose landmarks are not known, wanted [observations]: "
            "label the detections first"
        )
    notices: list[str] = []
    orientation = _orientation(config, files)
    campaign, detections, rows = _assemble(config, files, orientation, notices, given.name)
    assert rows is not None
    further = named(campaign.images)
    inputs = given.digest | files.fingerprints(further)
    sources = (*([settings] if isinstance(settings, Path) else []), *files.paths(further))
    loaded = LoadedCampaign(
        *(campaign, config, inputs, tuple(notices), orientation, rows, detections, outside), sources=sources
    )
    return _without_outside(loaded) if outside == "skip" else loaded


@dataclass(frozen=True)
class LoadedImages:
    """A campaign whose marks are still to be measured: it has neither landmarks nor sightings.

    ``inputs``, ``notices`` and ``sources`` are as those of :class:`LoadedCampaign`; ``folder`` is what names in its
    settings are relative to.
    """

    campaign: Campaign
    config: CampaignConfig
    inputs: dict[str, str]
    notices: tuple[str, ...]
    sources: tuple[Path, ...]
    folder: Path

    @property
    def shift_px(self) -> float:
        """What the user's pixel coordinates are ahead of ours."""
        return pixel_shift(self.config.first[1])


MEASURED = ("landmarks", "observations")
"""Sections whose tables measuring writes."""


def load_images(settings: Path) -> LoadedImages:
    """Read a campaign up to its marks; sections [landmarks] and [observations] may be missing, and are not looked at.

    Raises InputError, one sentence, for the first file that cannot be used.
    """
    given = read_settings(settings, None)
    # what is written there is replaced: it need not be there, nor be right
    given.document.update({name: {"file": f"{name}.csv"} for name in MEASURED})
    given.document.pop("detections", None)
    config = _config(given)
    files = Files.of(config, given, without=MEASURED)
    notices: list[str] = []
    orientation = _orientation(config, files)
    campaign, _, _ = _assemble(config, files, orientation, notices, given.name, marked=False)
    further = named(campaign.images)
    inputs = given.digest | files.fingerprints(further)
    return LoadedImages(
        campaign, config, inputs, tuple(notices), (settings, *files.paths(further)), given.folder
    )


def _config(given: Settings) -> CampaignConfig:
    """The checked settings."""
    config = check(given.document, CampaignConfig, given.name)
    flown = config.ephemeris.object if config.ephemeris.file.lower().endswith(".bsp") else None
    if problems := [f"{key}: {text}" for key, text in spice_rules(config.spice, config.tracker, flown)]:
        raise refuse(given.name, problems)
    return config


def _without_outside(loaded: LoadedCampaign) -> LoadedCampaign:
    """The campaign without the marks that attitude or orbit do not cover, and with a notice that names them."""
    coverage = loaded.coverage
    if not coverage.outside.size:
        return loaded
    left_out = coverage.left_out()
    notice = f"{loaded.rows.source}: left out {coverage.told}"
    marks, rows = coverage.kept()
    with_marks: dict[str, Any] = {"detections": marks}
    if isinstance(marks, Sightings):
        with_marks = {"campaign": replace(loaded.campaign, sightings=marks)}
    return replace(loaded, rows=rows, left_out=left_out, notices=(*loaded.notices, notice), **with_marks)


def _orientation(config: CampaignConfig, files: Files) -> EarthOrientation | None:
    """The Earth's orientation where a frame of the campaign is inertial."""
    frames = {config.ephemeris.frame}.union(*((a.source, a.target) for a in config.attitudes.values()))
    inertial = {earth_frame(frame) for frame in frames} - {"ITRF", None}
    return EarthOrientation.load(files.path("earth.orientation_file")) if inertial else None


def _assemble(
    config: CampaignConfig,
    files: Files,
    orientation: EarthOrientation | None,
    notices: list[str],
    settings: str,
    marked: bool = True,
) -> tuple[Campaign, Detections | None, Table | None]:
    scale = config.campaign.time_scale
    optics = read_optics(config, files.tables, notices)
    images = _images(config, files, optics, notices)
    rig = optics.rig(images)
    landmarks, sightings = Landmarks((), np.empty((0, 3)), np.empty((0, 3, 3))), _no_sightings()
    detections, rows = None, None
    if marked:
        landmarks = _landmarks(config, files, notices)
        grids = markers.Grids(dict(zip(optics.cameras, optics.grids, strict=True)), optics.of_image(images))
        sightings, detections, rows = _marks(config, files, images, landmarks, grids, notices)
    marks = sightings if detections is None else detections
    if rows is not None:
        require_rows(images, marks.image, marks.row_px, rows)
    ephemeris = motion.read_ephemeris(
        files.tables["ephemeris.file"], config.ephemeris, scale, images.t_ns, orientation, notices
    )
    exposures = Exposures(images, marks.image, images.exposed(marks.image, marks.row_px))
    attitude, cov_attitude_E = read_attitude(settings, config, files.tables, orientation, exposures, notices)
    turns: dict[str, Turn] = {f"frames.{name}": f for name, f in config.frames.items()}
    turns = {config.key_of(name): mounting for name, (_, mounting) in config.optics.items()} | turns
    notices += [text for key, turn in turns.items() for text in _rounded(f"{settings}: {key}", turn)]
    if config.earth is not None and orientation is None:
        notices.append(
            f"{settings}: earth.orientation_file is not used, since no frame of the campaign is inertial"
        )
    prior, switches = config.first[2].sigma_arcsec, config.corrections
    campaign = Campaign(
        name=config.campaign.name,
        camera=optics.first,
        C_EK=optics.C_EC[0],
        sigma_mounting=None if prior is None else ARCSEC * np.array(prior),
        ephemeris=ephemeris,
        sigma_position=np.array(config.ephemeris.sigma_m),
        position_frame=config.ephemeris.frame,
        attitude=attitude,
        cov_attitude_E=cov_attitude_E,
        landmarks=landmarks,
        images=images,
        sightings=sightings,
        corrections=Corrections(switches.light_time, switches.aberration, switches.refraction),
        orientation=orientation,
        attitude_errors=attitude_sharing(config, attitude, exposures),
        position_errors=position_sharing(config.ephemeris),
        rig=rig,
    )
    return _considering(guessed(campaign), config, settings), detections, rows


def _considering(campaign: Campaign, config: CampaignConfig, settings: str) -> Campaign:
    """The campaign with its section [consider]."""
    try:
        return replace(campaign, considered=considered(config.consider.stated, campaign))
    except ArgumentError as error:
        raise InputError(f"{settings}: {error}") from None


def _images(config: CampaignConfig, files: Files, optics: Optics, notices: list[str]) -> Images:
    """The images of their table, or where there is none those of the observations or detections."""
    scale, pattern, declared = (
        config.campaign.time_scale,
        config.images.time_from_id,
        config.images.declared("images"),
    )
    if "images.file" in files.tables:
        return read_images(
            files.tables["images.file"],
            scale,
            optics.first.scans,
            notices,
            declared,
            pattern,
            files.folder,
            tuple(optics.cameras) if optics.named else (),
        )
    key, marks = (
        ("observations", config.observations) if config.observations else ("detections", config.detections)
    )
    if marks is None or pattern is None:
        raise ValueError("the rules want a table of images, or their times in their ids")
    return images_of(files.of_points(key), scale, pattern, marks.declared(key))


def _landmarks(config: CampaignConfig, files: Files, notices: list[str]) -> Landmarks:
    """The landmarks of their table, with what their survey shares."""
    section = config.landmarks
    landmarks = read_landmarks(
        files.of_points("landmarks"), notices, _ground(section, files), section.declared("landmarks")
    )
    if section.common_sigma_m is not None:
        landmarks = replace(landmarks, common_sigma=np.array(section.common_sigma_m))
    return replace(landmarks, correlation_length=section.correlation_length_m)


def _ground(config: LandmarksConfig, files: Files) -> Ground:
    """What is said about the heights of the landmarks."""
    words = ("landmarks.dem", "landmarks.heights", "landmarks.geoid")
    return Ground(files.path("landmarks.dem"), config.heights, files.path("landmarks.geoid"), words)


def _marks(
    config: CampaignConfig,
    files: Files,
    images: Images,
    landmarks: Landmarks,
    grid: markers.Grids,
    notices: list[str],
) -> tuple[Sightings, Detections | None, Table]:
    """Sightings of known landmarks, or none and the detections that have none yet."""
    if config.observations is not None:
        declared, file = config.observations.declared("observations"), files.of_points("observations")
        seen, rows = markers.read_observations(
            file, images.ids, landmarks.ids, grid, notices, declared, files.of_points("landmarks")
        )
        return seen, None, rows
    if config.detections is None:
        raise ValueError("the rules want observations or detections")
    declared, file = config.detections.declared("detections"), files.tables["detections.file"]
    detections, rows = markers.read_detections(file, images.ids, grid, notices, declared)
    return _no_sightings(), detections, rows


def _no_sightings() -> Sightings:
    index, value = np.empty(0, dtype=np.int64), np.empty(0)
    return Sightings(index, index, value, value, value, np.empty(0, dtype=np.bool_))


def _rounded(where: str, config: Turn) -> list[str]:
    """A notice where the written matrix is orthonormal to few digits only."""
    if config.matrix is None:
        return []
    C = np.array(config.matrix)
    off = float(np.abs(C @ C.mT - np.eye(3)).max())
    if off <= _EXACT:
        return []
    return [f"{where}.matrix is orthonormal to {off:.1g} only; the nearest rotation is taken"]
