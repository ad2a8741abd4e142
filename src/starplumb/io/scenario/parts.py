"""What the sections of a scenario stand for: its camera, its orbit, its markers' layout."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...physics.camera import Camera, LineScanCamera
from ...physics.earth import WGS84_A
from ...physics.errors import InputError
from ...physics.light import Corrections
from ...physics.orbit import KeplerOrbit, Orbit
from ...physics.orientation import EarthOrientation
from ...physics.units import DEG
from ...plan import marker_layout as layout
from ...plan import passes, scene
from ..campaign.attitude import model_mounting
from ..campaign.camera import read_camera
from ..campaign.cameras.config import CameraConfig
from ..campaign.config import EphemerisConfig
from .config import MarkersConfig, OrbitConfig, ScenarioConfig

Array = NDArray[np.float64]

FILE_MARGIN_S = 1200.0
"""How far about the images a SPICE kernel is read."""
MOST_SIGHTINGS = 2_000_000
"""Of a scenario, which then takes about a gigabyte."""
UNSTATED = scene.Sigmas(np.zeros(3), np.zeros(3), np.zeros(3), 1.0)
"""A true scene states no error; its sources do."""


def camera_of(config: CameraConfig, folder: Path) -> Camera:
    table = config.look_angles
    camera = read_camera(config, None if table is None else folder / table, [])
    size = config.image_size_px
    if isinstance(camera, LineScanCamera):
        if size is None:
            raise InputError(
                "camera.image_size_px: missing, wanted two positive whole numbers, columns and rows"
            )
        return replace(camera, size_px=(camera.size_px[0], float(size[1])))
    return camera


def mounted(config: ScenarioConfig) -> Array:
    """The true mountings (k, 3, 3) of the cameras."""
    each = ((name, mounting) for name, (_, mounting) in config.optics.items())
    return np.stack([np.eye(3) if m is None else model_mounting(m, camera=name) for name, m in each])


def kepler(orbit: OrbitConfig) -> KeplerOrbit:
    if orbit.model == "circular":
        a = WGS84_A + 1e3 * (orbit.altitude_km or 0.0)
    else:
        a = 1e3 * (orbit.semi_major_axis_km or 0.0)
    angles = (orbit.inclination_deg, orbit.node_deg, orbit.perigee_deg, orbit.mean_anomaly_deg)
    inclination, node, perigee, anomaly = (DEG * (angle or 0.0) for angle in angles)
    shape = KeplerOrbit(a, orbit.eccentricity or 0.0, inclination, node, perigee, anomaly)
    if a * (1.0 - shape.eccentricity) < WGS84_A + 1e5:
        raise InputError(
            f"orbit: found a perigee {(a * (1.0 - shape.eccentricity) - WGS84_A) / 1e3:.0f} km above the "
            "equator, wanted more than 100 km"
        )
    return shape


def file_orbit(
    config: ScenarioConfig, folder: Path, orientation: EarthOrientation, epoch_ns: int
) -> passes.SampledOrbit:
    from ..campaign.motion import read_ephemeris

    orbit, times = config.orbit, config.images.times_s or tuple(flight.time_s for flight in config.passes)
    assert orbit.file is not None  # the document's rules saw to both
    assert orbit.frame is not None
    around = scene.epochs_ns(epoch_ns, [min(times) - FILE_MARGIN_S, max(times) + FILE_MARGIN_S])
    about = EphemerisConfig(file=orbit.file, frame=orbit.frame, sigma_m=(0.0, 0.0, 0.0), object=orbit.object)
    scale = config.scenario.time_scale
    ephemeris = read_ephemeris(folder / orbit.file, about, scale, around, orientation, [])
    return passes.SampledOrbit(ephemeris, orientation, epoch_ns)


def corrections(config: ScenarioConfig) -> Corrections:
    switches = config.corrections
    return Corrections(switches.light_time, switches.aberration, switches.refraction)


def square_period(camera: Camera, orbit: Orbit) -> float:
    """Duration of a row that makes a pixel as long as it is wide, at nadir, s."""
    if not isinstance(camera, LineScanCamera):
        return 0.0
    r, v = (float(np.linalg.norm(x)) for x in orbit.at(0.0))
    pixel = abs(camera.tan_x[-1] - camera.tan_x[0]) / (camera.column_px[-1] - camera.column_px[0])
    return float(pixel * (r - WGS84_A) / (v * WGS84_A / r))


def offsets(markers: MarkersConfig, rng: np.random.Generator) -> Array:
    """Offsets east and north of the site, km."""
    if markers.east_north_km is not None:
        return np.array(markers.east_north_km)
    return 0.5 * np.array(markers.extent_km) * unit_layout(markers, rng)


def require_few(markers: int, images: int) -> None:
    """Raise InputError where so many markers, each looked for in every image, are more than a scenario takes."""
    if markers * images > MOST_SIGHTINGS:
        found = f"found {markers} markers to look for in {images} images"
        raise InputError(f"markers: {found}, wanted at most {MOST_SIGHTINGS} sightings")


def laid_out(markers: MarkersConfig) -> int:
    """How many markers a layout has."""
    if markers.east_north_km is not None:
        return len(markers.east_north_km)
    count = markers.count or (1,)
    return count[0] * count[-1] if markers.layout == "grid" else math.prod(count)


def unit_layout(markers: MarkersConfig, rng: np.random.Generator) -> Array:
    count = markers.count or (1,)
    if markers.layout == "grid":
        return layout.grid(count[0], count[-1])
    total = laid_out(markers)
    return layout.ring(total) if markers.layout == "ring" else layout.scattered(total, rng)
