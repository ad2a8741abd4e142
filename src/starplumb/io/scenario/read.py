"""A scenario from its TOML file, or from those that come with the package, brought inside as physics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.resources import files as package_files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.camera import Camera
from ...physics.errors import InputError, did_you_mean
from ...physics.orbit import KeplerOrbit, Orbit
from ...physics.orientation import EarthOrientation
from ...physics.timescales import moment
from ...physics.units import ARCSEC, DEG
from ...plan import passes, scene
from ...plan.error_catalogue import Flight
from ...plan.rigs import together
from ...plan.scenario import Initial, Scenario
from ...table import sharing
from ...table.campaign import Campaign
from ...table.error_sources import Distribution
from ...table.geometry import observe
from ..text.toml import check, plain, read_toml
from .config import ScenarioConfig
from .errors import error_sources
from .parts import (
    UNSTATED,
    camera_of,
    corrections,
    file_orbit,
    kepler,
    laid_out,
    mounted,
    offsets,
    require_few,
    square_period,
    unit_layout,
)

Array = NDArray[np.float64]

SHIPPED = "scenarios"
"""Folder of the package that holds the shipped scenarios."""


def shipped_scenarios() -> dict[str, Path]:
    """The scenarios that come with the package, by name."""
    folder = Path(str(package_files("starplumb") / SHIPPED))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def find_scenario(name: str) -> Path:
    """A file of this name, or the shipped scenario.  Raises InputError that lists the shipped ones."""
    path, shipped = Path(name), shipped_scenarios()
    if path.exists() or path.suffix == ".toml":
        return path
    if name in shipped:
        return shipped[name]
    hint = did_you_mean(name, shipped)
    raise InputError(
        f"{name}: found no such file, wanted a SCENARIO.toml or one of {', '.join(shipped)}{hint}"
    )


def load_scenario(source: Mapping[str, Any] | Path | str, folder: Path | None = None) -> Scenario:
    """The scenario of a TOML file, of a shipped name, or of a dictionary with the keys of such a file.

    A name is looked up as :func:`find_scenario` does.  A dictionary may hold tuples, NumPy arrays and paths; files that
    it names stand relative to ``folder`` (left out: the working directory; for a file: its own folder).  The checks and
    their sentences are the same for all three.  Raises InputError, one line with all that is wrong.
    """
    return read_scenario(source, folder).built


@dataclass(frozen=True)
class Read:
    """A scenario's checked document, what it is called in messages, and the folder that its files are relative to."""

    config: ScenarioConfig
    name: Path
    folder: Path

    @property
    def built(self) -> Scenario:
        """The scenario itself."""
        with self.named():
            return build(self.config, self.folder)

    @contextmanager
    def named(self) -> Iterator[None]:
        """Where what is wrong with the scenario is said of its file, or of one that it names."""
        config, folder = self.config, self.folder
        try:
            yield
        except InputError as error:
            tables = (section.look_angles for section, _ in config.optics.values())
            named = (config.orbit.file, *tables, config.markers.file)
            says_file = str(error).startswith(tuple(str(folder / file) for file in named if file is not None))
            raise error if says_file else InputError(f"{self.name}: {error}") from None


def read_scenario(source: Mapping[str, Any] | Path | str, folder: Path | None = None) -> Read:
    """The checked document of :func:`load_scenario`, nothing being built of it yet."""
    if isinstance(source, Mapping):
        name, document = Path("scenario"), plain(source)
        folder = Path() if folder is None else folder
    else:
        name = find_scenario(source) if isinstance(source, str) else source
        document, folder = read_toml(name), name.parent if folder is None else folder
    return Read(check(document, ScenarioConfig, name), name, folder)


def build(config: ScenarioConfig, folder: Path) -> Scenario:
    """The scenario of a checked document; the files it names stand relative to ``folder``."""
    rng = np.random.default_rng(config.scenario.scene_seed)
    cameras = [camera_of(section, folder) for section, _ in config.optics.values()]
    unmarked, pass_of_image = _fly(config, folder, cameras[0], mounted(config)[0], rng)
    pass_of_image = np.tile(pass_of_image, len(cameras))
    session_of_image = _sessions(config)[pass_of_image]
    campaign = _mark(config, folder, unmarked, cameras, rng)
    if campaign.sightings.image.size < 2:
        raise InputError(
            f"markers: found {campaign.sightings.image.size} in the images, wanted two sightings or more "
            "(their extent may pass the frame)"
        )
    sources = error_sources(config, Flight(observe(campaign), campaign, pass_of_image, session_of_image))
    start = config.initial
    initial = Initial(ARCSEC * np.array(start.sigma_arcsec), Distribution(start.distribution), start.stated)
    if initial.stated and not np.all(initial.sigma > 0.0):
        raise InputError("initial.sigma_arcsec: found a sigma of 0 stated as a prior, wanted positive ones")
    return Scenario.of(
        campaign,
        sources,
        omit=config.stated.omit,
        factor=config.stated.factor,
        initial=initial,
        description=config.scenario.description,
    )


def _fly(
    config: ScenarioConfig, folder: Path, camera: Camera, C_EK: Array, rng: np.random.Generator
) -> tuple[Campaign, NDArray[np.int64]]:
    """The campaign without markers, and the pass of each image."""
    orientation = EarthOrientation.load()
    epoch_ns = moment(config.scenario.epoch, config.scenario.time_scale)
    from_file = config.orbit.model == "file"
    orbit: Orbit = file_orbit(config, folder, orientation, epoch_ns) if from_file else kepler(config.orbit)
    period = config.images.line_period_s or square_period(camera, orbit)

    def photograph(orbit: Orbit, epoch_ns: int, flight: scene.Pass) -> Campaign:
        return scene.photograph(
            camera,
            orbit,
            orientation,
            epoch_ns,
            flight,
            C_EK,
            UNSTATED,
            corrections(config),
            period,
            config.scenario.name,
        )

    if config.images.times_s is not None:
        images = config.images
        time = np.array(images.times_s)
        roll, pitch, yaw = (
            DEG * np.broadcast_to(turn, time.shape)
            for turn in (images.roll_deg, images.pitch_deg, images.yaw_deg)
        )
        flight = passes.aim_from_orbit(
            orbit, orientation, epoch_ns, time, np.stack([roll, pitch], axis=-1), yaw
        )
        campaign = photograph(orbit, epoch_ns, flight)
        return campaign, sharing.passes(campaign)
    flown = []
    for number, plan in enumerate(config.passes):
        try:
            flown.append(photograph(*_plan_pass(config, number, orbit, orientation, epoch_ns, rng)))
        except InputError as error:
            raise InputError(
                f"passes.{number}: {error} (roll {plan.roll_deg or 0:g}, pitch {plan.pitch_deg})"
            ) from None
    return passes.join(flown)


def _sessions(config: ScenarioConfig) -> NDArray[np.int64]:
    """The session of each pass; of images at times, whose passes nobody lists, each its own."""
    if config.images.times_s is not None:
        return np.arange(len(config.images.times_s))
    named = [(number, "") if p.session is None else (0, p.session) for number, p in enumerate(config.passes)]
    return sharing.numbered([f"{number} {name}" for number, name in named])


def _plan_pass(
    config: ScenarioConfig,
    number: int,
    orbit: Orbit,
    orientation: EarthOrientation,
    epoch_ns: int,
    rng: np.random.Generator,
) -> tuple[Orbit, int, scene.Pass]:
    """Orbit, epoch and images of one pass over the site."""
    plan, site = config.passes[number], config.site
    assert site is not None  # the document's rules saw to it
    place = (DEG * site.latitude_deg, DEG * site.longitude_deg)
    near_s = plan.time_s
    if isinstance(orbit, KeplerOrbit):
        # a pass has its own orbit, of the given shape, so that it sees the site as asked
        epoch_ns, near_s = epoch_ns + round(1e9 * plan.time_s), 0.0
        roll = DEG * (plan.roll_deg or 0.0)
        orbit = passes.pass_over(orbit, orientation, epoch_ns, place, roll, plan.direction == "ascending")
    pitch = DEG * np.array(plan.pitch_deg)
    offset = config.images.pointing_sigma_m * rng.standard_normal((pitch.size, 2))
    centre, *aim = scene.site_grid(*place, site.height_m, np.concatenate([np.zeros((1, 2)), offset]))
    time = passes.times_at_pitch(orbit, orientation, epoch_ns, near_s, centre, pitch)
    yaw = DEG * np.broadcast_to(plan.yaw_deg, pitch.shape)
    return orbit, epoch_ns, scene.Pass(time, np.array(aim), yaw)


def _mark(
    config: ScenarioConfig,
    folder: Path,
    unmarked: Campaign,
    cameras: Sequence[Camera],
    rng: np.random.Generator,
) -> Campaign:
    """The campaign with its markers sighted, of several cameras by all of them at its times."""
    site = _on_site(config, folder, len(unmarked.images.ids) * len(cameras), rng)
    if len(cameras) == 1:
        return _sighted(config, unmarked, site, rng)
    C_EC, parts = mounted(config), []
    for k, (camera, C) in enumerate(zip(cameras, C_EC, strict=True)):
        if camera.scans and camera.size_px[1] != cameras[0].size_px[1]:
            raise InputError(
                f"cameras.{k}.image_size_px: found {camera.size_px[1]:g} rows, wanted {cameras[0].size_px[1]:g} as of "
                "the first: line scanners of a scenario expose the same rows"
            )
        parts.append(_sighted(config, replace(unmarked, camera=camera, C_EK=C), site, rng))
        if parts[-1].sightings.image.size < 2:
            raise InputError(
                f"cameras.{k}: found {parts[-1].sightings.image.size} markers in its images, wanted two sightings or "
                'more (a camera that looks elsewhere wants markers.on = "image")'
            )
    return together(parts, list(config.optics), C_EC[0].mT @ C_EC, one_site=site is not None)


def _on_site(config: ScenarioConfig, folder: Path, images: int, rng: np.random.Generator) -> Array | None:
    """Markers (L, 3) that all images may see; None where each image has its own."""
    markers = config.markers
    if markers.layout == "file":
        from ..campaign.marks.landmarks import read_landmarks

        surveyed = read_landmarks(folder / str(markers.file), []).r_J
        require_few(len(surveyed), images)
        return surveyed
    require_few(laid_out(markers), images)
    if markers.on == "image":
        return None
    site = config.site
    assert site is not None  # the document's rules saw to it
    offset = 1e3 * offsets(markers, rng)
    height = rng.uniform(*markers.height_m, len(offset))
    return scene.site_grid(DEG * site.latitude_deg, DEG * site.longitude_deg, height, offset)


def _sighted(
    config: ScenarioConfig, campaign: Campaign, site: Array | None, rng: np.random.Generator
) -> Campaign:
    """The campaign of one camera with the markers of a site, or else its images' own."""
    if site is not None:
        return scene.mark_site(campaign, site, UNSTATED)
    markers, m = config.markers, len(campaign.images.ids)
    columns, rows = campaign.camera.size_px
    middle = 0.5 * np.array([columns - 1.0, rows - 1.0])
    pixel = np.concatenate(
        [middle + (markers.extent or 1.0) * middle * unit_layout(markers, rng) for _ in range(m)]
    )
    height = rng.uniform(*markers.height_m, len(pixel))
    return scene.mark_pixels(campaign, np.repeat(np.arange(m), len(pixel) // m), pixel, height, UNSTATED)
