"""True scenes shared by the tests: frame and line-scan, one to thirty images, tilted and turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starplumb.physics import so3
from starplumb.physics.camera import Camera, FrameCamera, LineScanCamera
from starplumb.physics.earth import OMEGA_EARTH, geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.light import Corrections
from starplumb.physics.orbit import KeplerOrbit
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.campaign import Campaign


@dataclass(frozen=True)
class UniformEarth:
    """Earth turning uniformly about z: a stand-in whose rotation is written down by hand."""

    def C_IJ(self, t_ns):
        angle = OMEGA_EARTH * np.asarray(t_ns) * 1e-9
        c, s, o = np.cos(angle), np.sin(angle), np.zeros_like(angle)
        return np.stack([np.stack([c, -s, o], -1), np.stack([s, c, o], -1), np.stack([o, o, o + 1], -1)], -2)


ORBIT = KeplerOrbit(7058e3, 0.001, 98 * DEG, 0.3, 0.2, 0.6)
SIGMAS = scene.Sigmas(
    attitude=np.array([5.0, 5.0, 12.0]) * ARCSEC,
    position=np.array([3.0, 3.0, 3.0]),
    landmark=np.array([1.0, 1.0, 1.5]),
    pixel=0.3,
)
FRAME = FrameCamera(2.2, 9e-6, (5999.5, 5999.5), (12000, 12000))
LINE = LineScanCamera.from_optics(2.2, 9e-6, (5999.5, 40.0), 12000, rows=12000)
C_EK_TRUE = so3.exp(np.array([0.4, -1.1, 2.0]) * DEG)
LINE_PERIOD_S = 4.1e-4


def truth(
    camera: Camera = FRAME,
    images: int = 4,
    markers: int = 6,
    tilt_deg: float = 10.0,
    yaw_deg: float = 0.0,
    shared_site: bool = False,
    corrections: Corrections | None = None,
    sigmas: scene.Sigmas = SIGMAS,
    time_s: np.ndarray | None = None,
) -> Campaign:
    """A true scene: images 30 s apart, aimed ahead and aside by turns, each with its own markers or one common site."""
    earth = UniformEarth()
    time = 30.0 * np.arange(images) if time_s is None else time_s
    r_J, v_J = scene.fly(ORBIT, earth, 0, time)
    tilts = tilt_deg * DEG * np.array([np.cos(2.4 * np.arange(images)), np.sin(2.4 * np.arange(images))])
    down = -r_J / np.linalg.norm(r_J, axis=-1, keepdims=True)
    ahead = v_J / np.linalg.norm(v_J, axis=-1, keepdims=True)
    look = down + np.tan(tilts[0])[:, None] * ahead + np.tan(tilts[1])[:, None] * np.cross(down, ahead)
    lat, lon, _ = itrf_to_geodetic(r_J + 690e3 * look)
    if shared_site:
        lat, lon = np.full(images, lat[images // 2]), np.full(images, lon[images // 2])
    aim = geodetic_to_itrf(lat, lon, np.zeros(images))
    yaw = yaw_deg * DEG * np.arange(images)
    flight = scene.Pass(time, aim, yaw)
    period = LINE_PERIOD_S if camera.scans else 0.0
    light = corrections or Corrections()
    campaign = scene.photograph(camera, ORBIT, earth, 0, flight, C_EK_TRUE, sigmas, light, period)
    if shared_site:
        side = int(np.ceil(np.sqrt(markers)))
        grid = np.stack(np.meshgrid(*[np.linspace(-9e3, 9e3, side)] * 2), axis=-1).reshape(-1, 2)[:markers]
        return scene.mark_site(campaign, scene.site_grid(lat[0], lon[0], 200.0, grid), sigmas)
    draw = np.random.default_rng(images * 1000 + markers)
    pixel = draw.uniform(500.0, 11500.0, (images * markers, 2))
    height = draw.uniform(0.0, 1500.0, images * markers)
    return scene.mark_pixels(campaign, np.repeat(np.arange(images), markers), pixel, height, sigmas)
