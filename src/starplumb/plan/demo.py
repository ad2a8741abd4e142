"""The example campaign of ``starplumb init``: a small satellite over its calibration site, its true mounting known."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.camera import Camera, FrameCamera, LineScanCamera
from ..physics.earth import geodetic_to_itrf, itrf_to_geodetic
from ..physics.light import Corrections
from ..physics.orbit import KeplerOrbit
from ..physics.orientation import EarthOrientation
from ..physics.timescales import parse
from ..physics.units import ARCSEC, DEG
from ..table.campaign import Campaign
from ..table.geometry import observe
from ..table.simulate import Errors
from . import scene

Array = NDArray[np.float64]

EPOCH = "2025-06-21T10:30:00"
"""UTC of the orbit's elements."""
ORBIT = KeplerOrbit(7_051_000.0, 0.001, 98.1 * DEG, 82.0 * DEG, 90.0 * DEG, -60.0 * DEG)
MARKERS = 12
CHECKS = 2
"""Markers of each image, and how many of them are kept for checking."""
SIGMAS = scene.Sigmas(
    attitude=np.array([5.0, 5.0, 12.0]) * ARCSEC,
    position=np.array([3.0, 3.0, 3.0]),
    landmark=np.array([0.5, 0.5, 1.0]),
    pixel=0.3,
)
LINE_PERIOD_S = 4.2e-4


def _camera(kind: Literal["frame", "line-scan"]) -> Camera:
    if kind == "frame":
        return FrameCamera(2.2, 9e-6, (5999.5, 5999.5), (12000, 12000))
    return LineScanCamera.from_optics(2.2, 9e-6, (5999.5, 0.0), 12000, rows=12000)


def demo(kind: Literal["frame", "line-scan"], images: int, seed: int) -> tuple[Campaign, Array]:
    """A measured campaign and its true mounting C_EK; the same for the same arguments.

    The images are taken 25 s apart along one pass, tilted up to 8 deg to all sides, every other one turned about the
    boresight, a frame by 90 deg and a line scanner, whose line must lie across the track, by 180 deg; the model
    mounting is off by some tenths of a degree about each axis.
    """
    rng = np.random.default_rng(seed)
    orientation = EarthOrientation.load()
    epoch_ns = int(parse([EPOCH], "UTC")[0])
    C_EK_true = so3.exp(DEG * np.array([0.3, -0.8, 91.0]))
    time: Array = 25.0 * np.arange(images, dtype=np.float64)
    camera = _camera(kind)
    half_turns: Array = np.arange(images, dtype=np.float64) % 2 * (1.0 if camera.scans else 0.5)
    flight = scene.Pass(time, _aims(orientation, epoch_ns, time), np.pi * half_turns)
    period = LINE_PERIOD_S if camera.scans else 0.0
    truth = scene.photograph(
        camera,
        ORBIT,
        orientation,
        epoch_ns,
        flight,
        C_EK_true,
        SIGMAS,
        Corrections(),
        period,
        "starplumb demo",
    )
    pixel = rng.uniform(200.0, 11800.0, (images * MARKERS, 2))
    height = rng.uniform(0.0, 900.0, images * MARKERS)
    truth = scene.mark_pixels(truth, np.repeat(np.arange(images), MARKERS), pixel, height, SIGMAS)
    truth = replace(
        truth, sightings=replace(truth.sightings, check=np.tile(np.arange(MARKERS) < CHECKS, images))
    )
    C_EK_model = so3.exp(rng.normal(0.0, 0.4 * DEG, 3)) @ C_EK_true
    return scene.measured(truth, Errors.draw(observe(truth), rng), C_EK_model), C_EK_true


def _aims(orientation: EarthOrientation, epoch_ns: int, time_s: Array) -> Array:
    """Points on the ground up to 8 deg to the sides of, ahead of and behind the camera."""
    r_J, v_J = scene.fly(ORBIT, orientation, epoch_ns, time_s)
    down = -r_J / np.linalg.norm(r_J, axis=-1, keepdims=True)
    ahead = v_J / np.linalg.norm(v_J, axis=-1, keepdims=True)
    turn = 2.4 * np.arange(time_s.size)
    tilt = np.tan(8.0 * DEG) * (np.cos(turn)[:, None] * ahead + np.sin(turn)[:, None] * np.cross(down, ahead))
    latitude, longitude, _ = itrf_to_geodetic(r_J + 680e3 * (down + tilt))
    return geodetic_to_itrf(latitude, longitude, np.zeros(time_s.size))
