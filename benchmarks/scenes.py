"""True scenes for the benchmarks: one orbit, a camera with a 2.2 m lens, images aimed ahead and aside by turns."""

from __future__ import annotations

import numpy as np

from starplumb.physics import so3
from starplumb.physics.camera import Camera, FrameCamera
from starplumb.physics.earth import OMEGA_EARTH, geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.light import Corrections
from starplumb.physics.orbit import KeplerOrbit
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.campaign import Campaign

ORBIT = KeplerOrbit(7058e3, 0.001, 98 * DEG, 0.3, 0.2, 0.6)
CAMERA = FrameCamera(2.2, 9e-6, (5999.5, 5999.5), (12000, 12000))
C_EK_TRUE = so3.exp(np.array([0.4, -1.1, 2.0]) * DEG)
SIGMAS = scene.Sigmas(
    attitude=np.array([5.0, 5.0, 12.0]) * ARCSEC,
    position=np.array([3.0, 3.0, 3.0]),
    landmark=np.array([1.0, 1.0, 1.5]),
    pixel=0.3,
)


class UniformEarth:
    """The Earth turning uniformly about z."""

    def C_IJ(self, t_ns):
        angle = OMEGA_EARTH * 1e-9 * np.asarray(t_ns)
        return so3.exp(angle[..., None] * np.array([0.0, 0.0, 1.0]))


def photographed(
    images: int, tilt_deg: float = 10.0, camera: Camera = CAMERA, step_s: float = 30.0
) -> Campaign:
    """Images some seconds apart, still without markers."""
    time = step_s * np.arange(images)
    r_J, v_J = scene.fly(ORBIT, UniformEarth(), 0, time)
    tilts = tilt_deg * DEG * np.array([np.cos(2.4 * np.arange(images)), np.sin(2.4 * np.arange(images))])
    down = -r_J / np.linalg.norm(r_J, axis=-1, keepdims=True)
    ahead = v_J / np.linalg.norm(v_J, axis=-1, keepdims=True)
    look = down + np.tan(tilts[0])[:, None] * ahead + np.tan(tilts[1])[:, None] * np.cross(down, ahead)
    latitude, longitude, _ = itrf_to_geodetic(r_J + 690e3 * look)
    aim = geodetic_to_itrf(latitude, longitude, np.zeros(images))
    flight = scene.Pass(time, aim, np.zeros(images))
    period = 4.1e-4 if camera.scans else 0.0
    return scene.photograph(
        camera, ORBIT, UniformEarth(), 0, flight, C_EK_TRUE, SIGMAS, Corrections(), period
    )


def marked(campaign: Campaign, markers: int, rng: np.random.Generator) -> Campaign:
    """The campaign with as many markers of its own in each image, strewn over the frame."""
    m = len(campaign.images.ids)
    image = np.repeat(np.arange(m), markers)
    pixel = rng.uniform(500.0, 11500.0, (image.size, 2))
    return scene.mark_pixels(campaign, image, pixel, rng.uniform(0.0, 1500.0, image.size), SIGMAS)
