"""Small campaigns of all kinds, drawn at random: orbit, camera, passes, sampling, markers and sigmas all vary."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from starplumb.physics import so3
from starplumb.physics.camera import Camera, FrameCamera, LineScanCamera
from starplumb.physics.earth import geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.light import Corrections
from starplumb.physics.orbit import KeplerOrbit
from starplumb.physics.orientation import EarthOrientation
from starplumb.physics.series import Attitude, Ephemeris
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.campaign import Campaign
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors

EARTH = EarthOrientation.load()
SECOND = 10**9
Rng = np.random.Generator


@dataclass(frozen=True)
class Scene:
    """A true campaign with its errors: what :func:`deliver` makes files of.  ``passes`` (m,) of the images."""

    truth: Campaign
    errors: Errors
    model: np.ndarray
    passes: np.ndarray

    @property
    def C_EK_true(self) -> np.ndarray:
        return self.truth.C_EK

    @property
    def n_images(self) -> int:
        return len(self.truth.images.ids)


@dataclass(frozen=True)
class Wanted:
    """What a fault needs of a campaign."""

    images: int = 1
    passes: int = 1
    frame: bool = False
    swung: bool = False
    site: bool = False
    close: bool = False
    margin_s: float = 0.0


def drawn(rng: Rng, wanted: Wanted | None = None) -> Scene:
    """A campaign at random that has what is wanted."""
    w = wanted or Wanted()
    m = max(int(rng.choice([1, 2, 3, 4, 5, 6, 8, 10, 14, 20, 30])), w.images)
    camera = _frame(rng) if w.frame or rng.random() < 0.6 else _line(rng)
    period = float(rng.uniform(1.0, 6.0)) / camera.size_px[1] if camera.scans else 0.0
    passes = np.minimum(np.arange(m) * max(w.passes, int(rng.integers(1, 4))) // m, m - 1)
    margin_s = max(w.margin_s, 1.0 if w.close else float(rng.choice([1.0, 1.0, 5.0, 25.0])))
    time_s = _times(rng, passes, 2.0 * margin_s + camera.size_px[1] * period + 2.0)
    sigmas = _sigmas(rng)
    C_EK = so3.exp(rng.uniform(-1.0, 1.0, 3) * [5 * DEG, 5 * DEG, np.pi])
    truth = _photographed(rng, camera, time_s, sigmas, C_EK, period, margin_s, w.swung)
    truth = _marked(rng, truth, sigmas, w.site or (m > 2 and not camera.scans and rng.random() < 0.15))
    share = float(rng.choice([0.0, 0.15, 0.3]))
    check = _checks(rng, truth, share)
    truth = replace(truth, sightings=replace(truth.sightings, check=check))
    off = rng.normal(0.0, rng.choice([0.02, 0.3, 1.0]) * DEG, 3)
    if rng.random() < 0.3:
        truth = replace(truth, sigma_mounting=np.full(3, 1.5 * float(np.max(np.abs(off)))))
    errors = Errors.draw(replace(observe(truth), prior_E=None), rng)
    return Scene(truth, errors, so3.exp(off) @ C_EK, passes)


def _frame(rng: Rng) -> FrameCamera:
    size = int(rng.choice([2000, 4096, 9000]))
    pitch = float(rng.choice([3.45e-6, 5.5e-6, 9e-6]))
    focal = 0.5 * size * pitch / np.tan(rng.uniform(0.6, 2.5) * DEG)
    return FrameCamera(round(focal, 3), pitch, ((size - 1) / 2, (size - 1) / 2), (size, size))


def _line(rng: Rng) -> LineScanCamera:
    size, pitch = int(rng.choice([6000, 12000])), 8e-6
    focal = round(0.5 * size * pitch / np.tan(rng.uniform(0.8, 2.0) * DEG), 3)
    return LineScanCamera.from_optics(
        focal, pitch, ((size - 1) / 2, float(rng.uniform(-100, 100))), size, rows=size
    )


def _times(rng: Rng, passes: np.ndarray, least_s: float) -> np.ndarray:
    """Images some seconds apart in passes hours apart; some at whole seconds, as commanded."""
    step = least_s + rng.uniform(0.0, 40.0)
    time = step * np.arange(passes.size) + rng.uniform(0.0, 1.0, passes.size)
    time = time + np.cumsum(rng.uniform(1.5, 40.0, passes.max() + 1) * 5700.0)[passes]
    return np.rint(time) if rng.random() < 0.1 else time


def _sigmas(rng: Rng) -> scene.Sigmas:
    across = float(rng.choice([1.0, 3.0, 5.0, 15.0]))
    about = across * float(rng.choice([1.0, 2.0, 5.0]))
    return scene.Sigmas(
        attitude=np.array([across, across, about]) * ARCSEC,
        position=np.full(3, rng.choice([0.5, 3.0, 8.0])),
        landmark=np.array([1.0, 1.0, 2.0]) * rng.choice([0.2, 0.5, 2.0]),
        pixel=float(rng.choice([0.1, 0.3, 0.7])),
    )


def _photographed(
    rng: Rng,
    camera: Camera,
    time_s: np.ndarray,
    sigmas: scene.Sigmas,
    C_EK: np.ndarray,
    period: float,
    margin_s: float,
    swung: bool,
) -> Campaign:
    """A true campaign without markers: a burst of samples about each image, held along the orbit or swung."""
    height = rng.uniform(450e3, 800e3)
    angles = rng.uniform(-np.pi, np.pi, 3)
    orbit = KeplerOrbit(6378e3 + height, 0.001, rng.choice([97.6, 51.6]) * DEG, *angles)
    epoch_ns = int(rng.integers(600, 800)) * 10**6 * SECOND
    while abs(itrf_to_geodetic(scene.fly(orbit, EARTH, epoch_ns, time_s[:1])[0])[0][0]) > 70 * DEG:
        orbit = replace(orbit, mean_anomaly=orbit.mean_anomaly + 1.0)
    r_J, v_J = scene.fly(orbit, EARTH, epoch_ns, time_s)
    aim = _aims(rng, r_J, v_J, height)
    turn = rng.choice([0.0, 0.5, 1.0]) if not camera.scans else rng.choice([0.0, 1.0])
    flight = scene.Pass(time_s, aim, np.pi * turn * (np.arange(time_s.size) % 2))
    base = scene.photograph(
        camera, orbit, EARTH, epoch_ns, flight, C_EK, sigmas, Corrections(), period, "drawn"
    )
    rate = 8 if margin_s < 10.0 else 4
    long = margin_s + (camera.size_px[1] * period if camera.scans else 0.0)
    since = np.arange(-margin_s, long + 1.0 / rate, 1.0 / rate)
    start = (base.images.t_ns - epoch_ns) * 1e-9
    sample_s = start[:, None] + since
    t_ns = scene.epochs_ns(epoch_ns, sample_s).reshape(-1)
    C_EI = scene.held_attitude(orbit, EARTH, epoch_ns, flight, sample_s, C_EK)
    if swung:
        C_EI = _swing(rng, since) @ C_EI
    order = np.argsort(t_ns)
    r, v = scene.fly(orbit, EARTH, epoch_ns, (t_ns[order] - epoch_ns) * 1e-9)
    q = so3.to_quaternion(C_EI.reshape(-1, 3, 3)[order])
    return replace(
        base,
        ephemeris=Ephemeris(t_ns[order], r, v, 2.0 / rate),
        attitude=Attitude(t_ns[order], q, "GCRF", EARTH, 2.0 / rate),
    )


def _swing(rng: Rng, since_s: np.ndarray) -> np.ndarray:
    """A satellite that swings about a fixed axis."""
    axis = rng.normal(size=3)
    angle = (
        rng.uniform(0.5, 2.0)
        * DEG
        * np.sin(2 * np.pi * since_s / rng.uniform(12.0, 25.0) + rng.uniform(0, 6))
    )
    return so3.exp(angle[:, None] * axis / np.linalg.norm(axis))


def _aims(rng: Rng, r_J: np.ndarray, v_J: np.ndarray, height: float) -> np.ndarray:
    """Points on the ground to all sides of the track, or all to one."""
    m = len(r_J)
    tilt = np.tan(rng.uniform(2.0, 28.0) * DEG)
    turn = rng.uniform(0, 2 * np.pi) + (
        2.4 * np.arange(m) if rng.random() < 0.7 else 0.05 * rng.normal(size=m)
    )
    down = -r_J / np.linalg.norm(r_J, axis=-1, keepdims=True)
    ahead = v_J / np.linalg.norm(v_J, axis=-1, keepdims=True)
    look = down + tilt * (np.cos(turn)[:, None] * ahead + np.sin(turn)[:, None] * np.cross(down, ahead))
    latitude, longitude, _ = itrf_to_geodetic(r_J + height * look)
    return geodetic_to_itrf(latitude, longitude, np.zeros(m))


def _marked(rng: Rng, campaign: Campaign, sigmas: scene.Sigmas, site: bool) -> Campaign:
    m, size = len(campaign.images.ids), campaign.camera.size_px
    if site:
        return _of_site(rng, campaign, sigmas)
    count = int(rng.choice([4, 6, 10, 15, 25])) if m < 20 else int(rng.choice([4, 8, 12]))
    pixel = rng.uniform(0.03, 0.97, (m * count, 2)) * (np.array(size) - 1.0)
    heights = rng.uniform(0.0, rng.choice([100.0, 1500.0]), m * count)
    return scene.mark_pixels(campaign, np.repeat(np.arange(m), count), pixel, heights, sigmas)


def _of_site(rng: Rng, campaign: Campaign, sigmas: scene.Sigmas) -> Campaign:
    """The markers of the first image seen by all, each image turned to them: the images' own epochs, one site."""
    count, size = int(rng.choice([8, 14])), campaign.camera.size_px
    m = len(campaign.images.ids)
    pixel = rng.uniform(0.25, 0.75, (count, 2)) * (np.array(size) - 1.0)
    first = scene.mark_pixels(
        campaign, np.zeros(count, dtype=int), pixel, rng.uniform(0.0, 500.0, count), sigmas
    )
    o = first.landmarks.r_J
    series, turned = campaign.one_attitude, campaign.one_attitude.q_EF.copy()
    C_IJ = EARTH.C_IJ(series.t_ns)
    r_J = campaign.ephemeris.r_J
    middle = np.mean(o, axis=0)
    owner = np.argmin(np.abs(series.t_ns[:, None] - campaign.images.t_ns), axis=1)
    near = np.zeros(m, dtype=bool)
    for i in range(m):
        mine = owner == i
        look = middle - r_J[mine]
        near[i] = np.all(np.linalg.norm(look, axis=-1) < 1200e3)
        C_EJ = so3.from_quaternion(turned[mine]) @ C_IJ[mine]
        boresight = C_EJ.mT @ campaign.C_EK[:, 2]
        u = look / np.linalg.norm(look, axis=-1, keepdims=True)
        axis = np.cross(boresight, u)
        angle = np.arctan2(np.linalg.norm(axis, axis=-1), np.sum(boresight * u, axis=-1))
        C_JJ = so3.exp(
            angle[:, None] * axis / np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-15)
        )
        turned[mine] = so3.to_quaternion((C_EJ @ C_JJ.mT) @ C_IJ[mine].mT)
    pointed = replace(campaign, attitude=replace(series, q_EF=turned))
    if not np.all(near):  # the site is out of sight of later passes
        return scene.mark_pixels(
            campaign, np.repeat(np.arange(m), count), np.tile(pixel, (m, 1)), 100.0, sigmas
        )
    return scene.mark_site(pointed, o, sigmas)


def _checks(rng: Rng, campaign: Campaign, share: float) -> np.ndarray:
    """Some sightings kept for checking, never of an image that has only three."""
    image = campaign.sightings.image
    check = rng.random(image.size) < share
    few = np.bincount(image[~check], minlength=len(campaign.images.ids)) < 3
    return check & ~few[image]


def deliver(s: Scene) -> Campaign:
    """What its files hold."""
    return scene.measured(s.truth, s.errors, s.model)


def log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sign(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def unit_vector(rng: Rng, n: int = 3) -> np.ndarray:
    u = rng.normal(size=n)
    return u / np.linalg.norm(u)
