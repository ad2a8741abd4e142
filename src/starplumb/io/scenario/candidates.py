"""A scenario as what images are planned with: its orbit kept, its camera turned to sites, its errors told of each
view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...physics.camera import Camera
from ...physics.earth import itrf_to_geodetic
from ...physics.errors import InputError
from ...physics.orbit import KeplerOrbit, Orbit
from ...physics.orientation import EarthOrientation
from ...physics.timescales import moment
from ...physics.units import DEG
from ...plan import passes, scene
from ...plan.choice.information import Information, Level, blocks, factors, information
from ...plan.choice.views import Agility, Sites, Views, layers
from ...plan.error_catalogue import Flight
from ...plan.scenario import Scenario
from ...table.campaign import Campaign
from ...table.equation import linearise
from ...table.error_sources import Source
from ...table.geometry import observe
from .config import ScenarioConfig
from .error_config import SHARED_BY, ErrorConfig
from .errors import error_sources
from .parts import (
    UNSTATED,
    camera_of,
    corrections,
    file_orbit,
    kepler,
    mounted,
    offsets,
    square_period,
    unit_layout,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LONG_S = 60.0
"""Correlation time from which on, to choose by, the images of a pass share an error; below, each has its own."""


@dataclass(frozen=True)
class Stage:
    """What is flown: the orbit from ``epoch_ns``, the camera (of several the first) at its true mounting, the duration
    of a row."""

    config: ScenarioConfig
    folder: Path
    camera: Camera
    C_EK: Array
    orbit: Orbit
    orientation: EarthOrientation
    epoch_ns: int
    line_period_s: float

    @property
    def exposed_s(self) -> float:
        """Duration of an image."""
        return float(self.camera.size_px[1]) * self.line_period_s if self.camera.scans else 0.0

    @property
    def on_site(self) -> bool:
        """Whether the images of a site see the same markers."""
        return self.config.markers.layout == "file" or self.config.markers.on == "site"


def stage(config: ScenarioConfig, folder: Path) -> Stage:
    """Of a scenario; of one with passes, the orbit of the first is kept and flown on.  Raises InputError where the
    orbit cannot see its site."""
    orientation = EarthOrientation.load()
    section, _ = next(iter(config.optics.values()))
    camera = camera_of(section, folder)
    epoch_ns = moment(config.scenario.epoch, config.scenario.time_scale)
    orbit, epoch_ns = _kept_orbit(config, folder, orientation, epoch_ns)
    C_EK = mounted(config)[0]
    period = config.images.line_period_s or square_period(camera, orbit)
    return Stage(config, folder, camera, C_EK, orbit, orientation, epoch_ns, period)


def _kept_orbit(
    config: ScenarioConfig, folder: Path, orientation: EarthOrientation, epoch_ns: int
) -> tuple[Orbit, int]:
    if config.orbit.model == "file":
        return file_orbit(config, folder, orientation, epoch_ns), epoch_ns
    shape = kepler(config.orbit)
    if not config.passes:
        return shape, epoch_ns
    first, site = config.passes[0], config.site
    assert site is not None  # the document's rules saw to it
    epoch_ns += round(1e9 * first.time_s)
    place = (DEG * site.latitude_deg, DEG * site.longitude_deg)
    roll, up = DEG * (first.roll_deg or 0.0), first.direction == "ascending"
    kept: KeplerOrbit = passes.pass_over(shape, orientation, epoch_ns, place, roll, up)
    return kept, epoch_ns


def agility(config: ScenarioConfig, scans: bool) -> Agility:
    """How the satellite can look, as [plan] says."""
    plan = config.plan
    yaw = plan.yaw_deg or ((0.0, 180.0) if scans else (0.0, 90.0))
    return Agility(
        DEG * plan.max_look_deg,
        DEG * plan.min_sun_deg,
        DEG * np.array(plan.pitch_deg),
        DEG * np.array(yaw),
        DEG * plan.slew_deg_s,
        plan.settle_s,
        plan.per_pass or np.iinfo(np.int64).max,
    )


def home_site(config: ScenarioConfig) -> Sites | None:
    """The scenario's own site."""
    if config.site is None:
        return None
    place = (config.site.latitude_deg * DEG, config.site.longitude_deg * DEG, config.site.height_m)
    latitude, longitude, height = (np.array([value]) for value in place)
    return Sites(("home",), latitude, longitude, height, np.ones(1))


def unmarked(s: Stage, views: Views, chosen: Index) -> Campaign:
    """The campaign of some views that do not overlap, without markers."""
    return scene.photograph(
        s.camera,
        s.orbit,
        s.orientation,
        s.epoch_ns,
        views.flight(chosen),
        s.C_EK,
        UNSTATED,
        corrections(s.config),
        s.line_period_s,
        s.config.scenario.name,
    )


@dataclass(frozen=True)
class Ground:
    """The markers of all sites, p_J (L, 3), and the site of each."""

    p_J: Array
    site: Index


def ground(s: Stage, sites: Sites) -> Ground | None:
    """The markers that the images of a site share; None where every image has its own."""
    if not s.on_site:
        return None
    markers = s.config.markers
    if markers.layout == "file":
        from ..campaign.marks.landmarks import read_landmarks

        p_J = read_landmarks(s.folder / str(markers.file), []).r_J
        away = np.linalg.norm(p_J[:, None] - sites.r_J, axis=-1)
        return Ground(p_J, np.argmin(away, axis=-1))
    found = []
    for k in range(len(sites.names)):
        rng = np.random.default_rng([s.config.scenario.scene_seed, k])
        east_north = 1e3 * offsets(markers, rng)
        height = rng.uniform(*markers.height_m, len(east_north)) + _raised(s, sites)[k]
        found.append(scene.site_grid(float(sites.latitude[k]), float(sites.longitude[k]), height, east_north))
    return Ground(np.concatenate(found), np.repeat(np.arange(len(found)), [len(p) for p in found]))


def _raised(s: Stage, sites: Sites) -> Array:
    """How much higher each site lies than the scenario's, of which the heights of markers are stated."""
    site = s.config.site
    return sites.height - site.height_m if site is not None else np.zeros(sites.height.size)


def marked(s: Stage, campaign: Campaign, sites: Sites, site: Index, on: Ground | None) -> Campaign:
    """The campaign of images that look at sites (m,), with its markers sighted."""
    if on is not None:
        of = [np.flatnonzero(on.site == k) for k in range(len(sites.names))]
        image = np.repeat(np.arange(site.size), [of[k].size for k in site])
        landmark = np.concatenate([of[k] for k in site])
        return scene.mark_pairs(campaign, on.p_J, image, landmark, UNSTATED)
    markers = s.config.markers
    rng = np.random.default_rng([s.config.scenario.scene_seed, site.size])
    columns, rows = campaign.camera.size_px
    middle = 0.5 * np.array([columns - 1.0, rows - 1.0])
    pixel = np.concatenate(
        [middle + (markers.extent or 1.0) * middle * unit_layout(markers, rng) for _ in range(site.size)]
    )
    each = len(pixel) // site.size
    image = np.repeat(np.arange(site.size), each)
    height = rng.uniform(*markers.height_m, len(pixel)) + _raised(s, sites)[site[image]]
    return scene.mark_pixels(campaign, image, pixel, height, UNSTATED)


def to_choose_by(config: ScenarioConfig, on_site: bool) -> tuple[ScenarioConfig, dict[str, Level]]:
    """The scenario with errors that are correlated in time or on the ground taken as shared or not, and who shares each
    source."""
    truth: dict[str, ErrorConfig] = {}
    level: dict[str, Level] = {tracker.name: "image" for tracker in config.trackers}
    for name, error in config.truth.items():
        if error.error == "blunder":
            continue
        truth[name], level[name] = _simplified(error, config, on_site)
    return config.model_copy(update={"truth": truth}), level


_LEVELS: Mapping[str, Level] = {
    "image": "image",
    "pass": "pass",
    "session": "pass",
    "campaign": "campaign",
}


def _simplified(error: ErrorConfig, config: ScenarioConfig, on_site: bool) -> tuple[ErrorConfig, Level]:
    match error.error:
        case "pixel" | "rounding":
            return error, "sighting"
        case "wander":
            return error, "image"
        case "landmark" if error.correlation_length_m is not None:
            extent = 500.0 * min(config.markers.extent_km or (2.0, 2.0))
            alike = error.correlation_length_m >= extent
            changed = {"correlation_length_m": None, "shared_by": "campaign" if alike else "marker"}
            together: Level = "network" if on_site else "image"
            return error.model_copy(update=changed), together if alike else "marker"
        case "landmark":
            network = error.shared_by == "campaign"
            return error, "network" if network else "marker"
        case "attitude" | "position" if error.correlation_time_s is not None:
            shared = "pass" if error.correlation_time_s >= LONG_S else "image"
            changed = {"correlation_time_s": None, "shared_by": shared}
            return error.model_copy(update=changed), _LEVELS[shared]
        case "attitude" | "position" | "time-tag":
            return error, _LEVELS[error.shared_by or SHARED_BY[error.error][0]]
    return error, "campaign"


def candidate_information(s: Stage, views: Views, sites: Sites, P_theta: Array) -> Information:
    """What every view tells, beside the errors that it shares with others; ``P_theta`` (3, 3) rad^2 is known of the
    mounting beforehand."""
    config, level = to_choose_by(s.config, s.on_site)
    on = ground(s, sites)
    N: Array | None = None
    sizes, names = (3, 0, 0), tuple[str, ...]()
    for chosen in layers(views, s.exposed_s):
        campaign = marked(s, unmarked(s, views, chosen), sites, views.site[chosen], on)
        o = observe(campaign)
        if o.n == 0:
            continue
        model = linearise(o, s.C_EK)
        sources = error_sources(config, Flight(o, campaign, np.zeros(chosen.size, dtype=np.int64)))
        parts = blocks(o, model, sources, level, None if on is None else on.site)
        mine = information(o, model.H, parts)
        N = np.zeros((views.n, *mine.shape[1:])) if N is None else N
        N[chosen] = mine
        sizes = (
            3 + parts.campaign.shape[-1],
            parts.of_pass.shape[-1],
            parts.network.shape[-1] + parts.modes.shape[-1],
        )
        names = parts.names
    if N is None:
        raise InputError("found no marker in any view, wanted sites with markers in the frame")
    known = np.ones(N.shape[-1])
    known[:3] = np.sqrt(np.diagonal(P_theta))
    return Information(factors(N, known), *sizes, views.pass_of, views.site, names)


def chosen_scenario(s: Stage, views: Views, sites: Sites, picks: Index) -> Scenario:
    """The scenario of the images chosen, with every source of error as it is."""
    picks = np.sort(picks)
    on = ground(s, sites)
    campaign = marked(s, unmarked(s, views, picks), sites, views.site[picks], on)
    number = np.unique(views.pass_of[picks], return_inverse=True)[1]
    sources = error_sources(s.config, Flight(observe(campaign), campaign, number))
    if on is not None:
        sources = tuple(by_site(source, s.config, on.site) for source in sources)
    return Scenario.of(campaign, sources, description=s.config.scenario.description)


def by_site(source: Source, config: ScenarioConfig, site: Index) -> Source:
    """A survey error that markers share is one of each site's survey."""
    error = config.truth.get(source.name)
    if error is None or error.error != "landmark" or error.shared_by != "campaign":
        return source
    return replace(source, group=site)


def height_of(s: Stage, time_s: float) -> float:
    """Height of the satellite above the ellipsoid, m."""
    r_I, _ = s.orbit.at(time_s)
    r_J = s.orientation.C_IJ(np.int64(s.epoch_ns + round(1e9 * time_s))).T @ r_I
    return float(itrf_to_geodetic(r_J)[2])
