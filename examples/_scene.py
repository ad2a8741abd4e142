"""The true scene that the examples share: a satellite 680 km high, its camera and markers under every image."""

from __future__ import annotations

import numpy as np

from starplumb.physics import so3
from starplumb.physics.camera import Camera, FrameCamera
from starplumb.physics.earth import geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.light import Corrections
from starplumb.physics.orbit import KeplerOrbit
from starplumb.physics.orientation import EarthOrientation
from starplumb.physics.timescales import parse
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.campaign import Campaign

EARTH = EarthOrientation.load()
EPOCH_NS = int(parse(["2025-06-21T10:30:00"], "UTC")[0])
ORBIT = KeplerOrbit(7_051_000.0, 0.001, 98.1 * DEG, 82.0 * DEG, 90.0 * DEG, -60.0 * DEG)
CAMERA = FrameCamera(2.2, 9e-6, (5999.5, 5999.5), (12000, 12000))
C_EK_TRUE = so3.exp(np.array([0.3, -0.8, 91.0]) * DEG)
SIGMAS = scene.Sigmas(
    attitude=np.array([5.0, 5.0, 12.0]) * ARCSEC,
    position=np.array([3.0, 3.0, 3.0]),
    landmark=np.array([0.5, 0.5, 1.0]),
    pixel=0.3,
)


def flight(
    images: int = 6,
    markers: int = 10,
    tilt_deg: float = 8.0,
    turn_deg: float = 90.0,
    camera: Camera = CAMERA,
    corrections: Corrections | None = None,
    seed: int = 0,
) -> Campaign:
    """A campaign as it truly was: images 25 s apart, tilted to all sides, every other one turned about z."""
    time = 25.0 * np.arange(images)
    r_J, v_J = scene.fly(ORBIT, EARTH, EPOCH_NS, time)
    down = -r_J / np.linalg.norm(r_J, axis=-1, keepdims=True)
    ahead = v_J / np.linalg.norm(v_J, axis=-1, keepdims=True)
    side = np.cross(down, ahead)
    azimuth = 2.4 * np.arange(images)[:, None]
    tilt = np.tan(tilt_deg * DEG) * (np.cos(azimuth) * ahead + np.sin(azimuth) * side)
    latitude, longitude, _ = itrf_to_geodetic(r_J + 680e3 * (down + tilt))
    aim_J = geodetic_to_itrf(latitude, longitude, np.zeros(images))
    turn = turn_deg * DEG * (np.arange(images) % 2)
    light = Corrections() if corrections is None else corrections
    campaign = scene.photograph(
        camera, ORBIT, EARTH, EPOCH_NS, scene.Pass(time, aim_J, turn), C_EK_TRUE, SIGMAS, light
    )
    draw = np.random.default_rng(seed)
    pixel = draw.uniform(200.0, 11800.0, (images * markers, 2))
    height = draw.uniform(0.0, 900.0, images * markers)
    return scene.mark_pixels(campaign, np.repeat(np.arange(images), markers), pixel, height, SIGMAS)
