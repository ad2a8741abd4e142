"""Small campaigns of all kinds, and what goes wrong with campaigns: for `planted.py` and `diagnosing.py`.

A campaign is drawn: orbit, camera, passes, sampling, markers and sigmas all vary.  A fault changes the errors before
they are measured, the delivered campaign, or the text of its files; it says by which keys `diagnose` names it.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from starplumb.io.campaign.write import write_campaign
from starplumb.physics import so3
from starplumb.physics.camera import Camera, Distortion, FrameCamera, LineScanCamera
from starplumb.physics.earth import WGS84_F, geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.light import Corrections
from starplumb.physics.orbit import KeplerOrbit
from starplumb.physics.orientation import C_IF, EarthOrientation
from starplumb.physics.series import Attitude, Ephemeris
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.campaign import Campaign, SharedErrors
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors

EARTH = EarthOrientation.load()
SECOND = 10**9
Rng = np.random.Generator


# Campaigns ----------------------------------------------------------------------------------------------------


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


# Faults -------------------------------------------------------------------------------------------------------


def _same(s: Scene, rng: Rng) -> Scene:
    return s


def _unchanged(c: Campaign, rng: Rng) -> Campaign:
    return c


def _nothing(folder: Path, rng: Rng) -> None:
    return None


@dataclass(frozen=True)
class Fault:
    """One kind of fault: what it does to the errors, the delivered campaign and the text of the files.

    ``said`` are words of which a message has one where it names the cause; ``keys`` begin the mistakes by which
    `diagnose` names it, none where it is not one of those that it knows.  ``by_directions``: see :class:`Planted`;
    ``absorbable`` tells whether the fault may leave no trace in the residuals.
    """

    name: str
    said: tuple[str, ...]
    keys: tuple[str, ...] = ()
    wanted: Wanted = Wanted()
    errors: Callable[[Scene, Rng], Scene] = _same
    delivered: Callable[[Campaign, Rng], Campaign] = _unchanged
    written: Callable[[Path, Rng], None] = _nothing
    by_directions: bool = False
    absorbable: bool = True

    def plant(self, folder: Path, rng: Rng, exact: bool = False) -> Planted:
        """Write a campaign with this fault into a folder; the truth.  ``exact`` leaves all other errors out."""
        s = drawn(rng, self.wanted)
        if exact:
            s = replace(
                s, errors=Errors(*(0.0 * value for value in vars(s.errors).values() if value is not None))
            )
        s = self.errors(s, rng)
        right = deliver(s)
        write_campaign(folder, self.delivered(right, rng))
        self.written(folder, rng)
        return Planted(s.C_EK_true, directions(right, s.C_EK_true) if self.by_directions else None)


@dataclass(frozen=True)
class Planted:
    """The true mounting (3, 3) and, where the fault is in how pixels are read, the true directions (n, 3) in E of the
    sightings: a mounting that gives these for the pixels as they are read is right."""

    C_EK: np.ndarray
    e_E: np.ndarray | None

    def error_E(self, campaign: Campaign, C_EK: np.ndarray) -> np.ndarray:
        """Error (3,) rad about E of an answer for the campaign as it was read."""
        if self.e_E is None:
            return so3.log(C_EK @ self.C_EK.mT)
        return so3.log(so3.nearest(directions(campaign, C_EK).mT @ self.e_E))


def directions(campaign: Campaign, C_EK: np.ndarray) -> np.ndarray:
    """Of the sightings in E (n, 3)."""
    s = campaign.sightings
    xy_K, _ = campaign.camera.tan_from_px(s.column_px, s.row_px)
    e_K = np.concatenate([xy_K, np.ones((len(xy_K), 1))], axis=-1)
    return e_K / np.linalg.norm(e_K, axis=-1, keepdims=True) @ C_EK.mT


def _log(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _sign(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _unit(rng: Rng, n: int = 3) -> np.ndarray:
    u = rng.normal(size=n)
    return u / np.linalg.norm(u)


def _late_image(c: Campaign, rng: Rng) -> Campaign:
    t = c.images.t_ns.copy()
    t[rng.integers(t.size)] += round(_sign(rng) * _log(rng, 0.01, 0.9) * SECOND)
    return replace(c, images=replace(c.images, t_ns=t))


def _turned_image(c: Campaign, rng: Rng) -> Campaign:
    i = int(rng.integers(len(c.images.ids)))
    turn = so3.exp(_log(rng, 30 * ARCSEC, np.pi) * _unit(rng))

    def change(a: Attitude) -> Attitude:
        first, _ = a.bursts.bounds
        mine = first == first[np.searchsorted(a.t_ns, c.images.t_ns[i], side="right") - 1]
        C = so3.from_quaternion(a.q_EF)
        return replace(a, q_EF=so3.to_quaternion(np.where(mine[:, None, None], turn @ C, C)))

    return c.with_attitude(change)


def _places(change: Callable[..., tuple]) -> Callable[[Campaign, Rng], Campaign]:
    def delivered(c: Campaign, rng: Rng) -> Campaign:
        moved_J = geodetic_to_itrf(*change(*itrf_to_geodetic(c.landmarks.r_J), rng))
        return replace(c, landmarks=c.landmarks.moved(moved_J))

    return delivered


def _exchanged(folder: Path, rng: Rng) -> None:
    _rewrite(
        folder / "landmarks.csv",
        lambda row: row | {"latitude_deg": row["longitude_deg"], "longitude_deg": row["latitude_deg"]},
    )


def _rewrite(path: Path, change: Callable[[dict], dict]) -> None:
    with path.open() as file:
        rows = [change(row) for row in csv.DictReader(file)]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def _rounded(name: str, columns: tuple[str, ...], low: int, high: int) -> Callable[[Path, Rng], None]:
    def written(folder: Path, rng: Rng) -> None:
        decimals = int(rng.integers(low, high + 1))
        _rewrite(folder / name, lambda row: row | {key: f"{float(row[key]):.{decimals}f}" for key in columns})

    return written


def _cut_times(c: Campaign, rng: Rng) -> Campaign:
    step = int(rng.choice([10**6, 10**7, 10**8]))
    return replace(c, images=replace(c.images, t_ns=c.images.t_ns // step * step))


def _without_zeros(folder: Path, rng: Rng) -> None:
    _rewrite(folder / "images.csv", lambda row: row | {"time": row["time"].rstrip("0").rstrip(".")})


def _coarse(c: Campaign, rng: Rng) -> Campaign:
    step = float(rng.choice([1.0, 1.5, 2.0, 3.0]))

    def change(a: Attitude) -> Attitude:
        every = round(step * 4)
        first, _ = a.bursts.bounds
        kept = (np.arange(a.t_ns.size) - first) % every == int(rng.integers(every))
        return replace(a, t_ns=a.t_ns[kept], q_EF=a.q_EF[kept], gap_s=1.5 * step)

    return c.with_attitude(change)


def _bad_sample(c: Campaign, rng: Rng) -> Campaign:
    i = int(rng.integers(len(c.images.ids)))
    turn = so3.exp(_log(rng, 20 * ARCSEC, 3000 * ARCSEC) * _unit(rng))

    def change(a: Attitude) -> Attitude:
        k = int(np.searchsorted(a.t_ns, c.images.t_ns[i])) - int(rng.integers(2))
        q = a.q_EF.copy()
        q[k] = so3.to_quaternion(turn @ so3.from_quaternion(q[k]))
        return replace(a, q_EF=q)

    return c.with_attitude(change)


def _grown(field: str, factor: float) -> Callable[[Scene, Rng], Scene]:
    return lambda s, rng: replace(s, errors=replace(s.errors, **{field: factor * getattr(s.errors, field)}))


def _one_draw(s: Scene, rng: Rng) -> Scene:
    """Images of a pass share one error of tracker and orbit, and the campaign does not say so."""
    first = np.searchsorted(s.passes, s.passes)
    e = replace(s.errors, alpha_E=s.errors.alpha_E[first], rho_J=s.errors.rho_J[first])
    silent = replace(s.truth, attitude_errors=SharedErrors(), position_errors=SharedErrors())
    return replace(s, errors=e, truth=silent)


def _added(s: Scene, alpha_E: np.ndarray) -> Scene:
    return replace(s, errors=replace(s.errors, alpha_E=s.errors.alpha_E + alpha_E))


def _sessions(s: Scene, rng: Rng) -> Scene:
    size = rng.uniform(1.0, 4.0) * np.sqrt(np.diagonal(s.truth.cov_attitude_E))
    return _added(s, rng.normal(0.0, size, (int(s.passes.max()) + 1, 3))[s.passes])


def _drift(s: Scene, rng: Rng) -> Scene:
    size = rng.uniform(3.0, 10.0) * np.sqrt(s.truth.cov_attitude_E[0, 0])
    along = np.linspace(-1.0, 1.0, s.n_images)
    return _added(s, (size * along)[:, None] * _unit(rng))


def _orbital(s: Scene, rng: Rng) -> Scene:
    size = rng.uniform(3.0, 10.0) * np.sqrt(s.truth.cov_attitude_E[0, 0])
    t = (s.truth.images.t_ns - s.truth.images.t_ns[0]) * 1e-9
    return _added(s, (size * np.sin(2 * np.pi * t / 5700.0 + rng.uniform(0, 6)))[:, None] * _unit(rng))


def _clock(c: Campaign, rng: Rng) -> Campaign:
    shift = round(_sign(rng) * _log(rng, 0.005, 0.5) * SECOND)
    return replace(c, images=replace(c.images, t_ns=c.images.t_ns + shift))


def _eighteen(c: Campaign, rng: Rng) -> Campaign:
    shift = round(_sign(rng) * 18) * SECOND
    which = int(rng.integers(2))
    if which == 0:
        return replace(c, images=replace(c.images, t_ns=c.images.t_ns + shift))
    return c.with_attitude(lambda a: replace(a, t_ns=a.t_ns + shift))


def _focal(c: Campaign, rng: Rng) -> Campaign:
    camera, scale = c.camera, 1.0 + _sign(rng) * _log(rng, 5e-4, 0.05)
    if isinstance(camera, FrameCamera):
        return replace(c, camera=replace(camera, focal_length=scale * camera.focal_length))
    return replace(c, camera=replace(camera, tan_x=camera.tan_x / scale))


def _pitch_unit(c: Campaign, rng: Rng) -> Campaign:
    camera, scale = c.camera, float(rng.choice([0.1, 10.0, 25.4, 1000.0]))
    if isinstance(camera, FrameCamera):
        return replace(c, camera=replace(camera, focal_length=scale * camera.focal_length))
    return replace(c, camera=replace(camera, tan_x=camera.tan_x / scale, tan_y=camera.tan_y / scale))


def _lens(c: Campaign, rng: Rng) -> Campaign:
    camera = c.camera
    assert isinstance(camera, FrameCamera)
    edge = 0.5 * camera.pitch / camera.focal_length * float(np.hypot(*camera.size_px))
    k1 = _sign(rng) * _log(rng, 2e-4, 5e-3) / edge**2
    return replace(c, camera=replace(camera, distortion=Distortion(k=(k1, 0.0, 0.0))))


def _moved_pixels(change: Callable[..., tuple]) -> Callable[[Campaign, Rng], Campaign]:
    def delivered(c: Campaign, rng: Rng) -> Campaign:
        s = c.sightings
        column, row = change(s.column_px, s.row_px, c.camera.size_px)
        return replace(c, sightings=replace(s, column_px=column, row_px=row))

    return delivered


def _binned(c: Campaign, rng: Rng) -> Campaign:
    n = int(rng.choice([2, 3, 4]))
    s = c.sightings
    column, row = ((px + 0.5) / n - 0.5 for px in (s.column_px, s.row_px))
    return replace(c, sightings=replace(s, column_px=column, row_px=row, sigma_px=s.sigma_px / n))


def _cropped(c: Campaign, rng: Rng) -> Campaign:
    s = c.sightings
    column, row = (rng.uniform(0.005, 0.2) * size for size in c.camera.size_px)
    return replace(
        c, sightings=replace(s, column_px=s.column_px - np.rint(column), row_px=s.row_px - np.rint(row))
    )


def _requaternion(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Campaign, Rng], Campaign]:
    return lambda c, rng: c.with_attitude(lambda a: replace(a, q_EF=change(a.q_EF)))


def _of_date(c: Campaign, rng: Rng) -> Campaign:
    frame = rng.choice(["TEME", "TOD", "MOD"])
    return c.with_attitude(
        lambda a: replace(a, q_EF=so3.to_quaternion(so3.from_quaternion(a.q_EF) @ C_IF(frame, a.t_ns)))
    )


def _other_key(old: str, new: str) -> Callable[[Path, Rng], None]:
    def written(folder: Path, rng: Rng) -> None:
        path = folder / "campaign.toml"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return written


def _random_blunders(c: Campaign, rng: Rng) -> Campaign:
    s, size = c.sightings, _log(rng, 5.0, 1000.0)
    wrong = rng.random(s.image.size) < rng.uniform(0.03, 0.3)
    move = rng.uniform(-size, size, (2, s.image.size)) * wrong
    return replace(c, sightings=replace(s, column_px=s.column_px + move[0], row_px=s.row_px + move[1]))


def _one_blunder(c: Campaign, rng: Rng) -> Campaign:
    s = c.sightings
    wrong = np.arange(s.image.size) == rng.choice(np.flatnonzero(~s.check))
    move = _log(rng, 10.0, 1000.0) * s.sigma_px * _unit(rng, 2)[:, None] * wrong
    return replace(c, sightings=replace(s, column_px=s.column_px + move[0], row_px=s.row_px + move[1]))


def _coherent_blunders(c: Campaign, rng: Rng) -> Campaign:
    s, size = c.sightings, _log(rng, 3.0, 300.0)
    wrong = rng.random(s.image.size) < rng.uniform(0.15, 0.6)
    alike = rng.random() < 0.5
    directions = np.stack([_unit(rng, 2) for _ in c.images.ids])
    move = size * directions[np.zeros_like(s.image) if alike else s.image] * wrong[:, None]
    return replace(c, sightings=replace(s, column_px=s.column_px + move[:, 0], row_px=s.row_px + move[:, 1]))


def _exchanged_labels(c: Campaign, rng: Rng) -> Campaign:
    s, landmark = c.sightings, c.sightings.landmark.copy()
    mine = np.flatnonzero(s.image == rng.integers(len(c.images.ids)))
    landmark[mine] = np.roll(landmark[mine], 1)
    return replace(c, sightings=replace(s, landmark=landmark))


def _moved_landmark(c: Campaign, rng: Rng) -> Campaign:
    r_J = c.landmarks.r_J.copy()
    seen = np.bincount(c.sightings.landmark, minlength=len(r_J))
    k = int(np.argmax(seen))
    r_J[k] += _log(rng, 15.0, 5000.0) * _unit(rng)
    return replace(c, landmarks=c.landmarks.moved(r_J))


FEET = 0.3048
WORST = ("fits worst", "implausible", "disagree")
IMAGE = ("image", "images disagree", "rejected")

FAULTS = [
    Fault(
        "one image's time wrong, 10 to 900 ms",
        IMAGE,
        ("image.", "sightings"),
        Wanted(4),
        delivered=_late_image,
    ),
    Fault(
        "one image's attitude, 30 arcsec to 180 deg",
        IMAGE,
        ("image.", "sightings"),
        Wanted(4),
        delivered=_turned_image,
    ),
    Fault(
        "labels of an image moved on by one",
        IMAGE,
        ("image.", "sightings"),
        Wanted(4),
        delivered=_exchanged_labels,
    ),
    Fault("latitude and longitude exchanged", WORST, ("landmarks.exchanged",), written=_exchanged),
    Fault(
        "sign of longitude",
        WORST,
        ("landmarks.longitude_sign",),
        delivered=_places(lambda a, b, h, _: (a, -b, h)),
    ),
    Fault(
        "geocentric latitudes",
        WORST,
        ("landmarks.geocentric",),
        Wanted(2),
        delivered=_places(lambda a, b, h, _: (np.arctan((1 - WGS84_F) ** 2 * np.tan(a)), b, h)),
    ),
    Fault(
        "heights in feet",
        WORST,
        ("landmarks.feet",),
        Wanted(3),
        delivered=_places(lambda a, b, h, _: (a, b, h / FEET)),
    ),
    Fault(
        "heights above the geoid, 15 to 80 m",
        ("height", *WORST),
        ("landmarks.height_offset",),
        Wanted(4),
        delivered=_places(lambda a, b, h, rng: (a, b, h + _sign(rng) * rng.uniform(15, 80))),
    ),
    Fault(
        "image times cut to 1, 10 or 100 ms",
        ("multiples", *WORST),
        ("digits.", "clock.", "image."),
        Wanted(3),
        delivered=_cut_times,
        written=_without_zeros,
    ),
    Fault(
        "quaternions of 3 to 5 decimals",
        ("decimals", "scatter", *WORST),
        ("digits.",),
        Wanted(2),
        written=_rounded("attitude.csv", ("qx", "qy", "qz", "qw"), 3, 5),
    ),
    Fault(
        "latitudes of 2 to 4 decimals",
        ("multiples", *WORST),
        ("digits.",),
        Wanted(2),
        written=_rounded("landmarks.csv", ("latitude_deg", "longitude_deg"), 2, 4),
    ),
    Fault(
        "pixels of 0 or 1 decimals",
        ("multiples", *WORST),
        ("digits.",),
        Wanted(2),
        written=_rounded("observations.csv", ("column_px", "row_px"), 0, 1),
    ),
    Fault(
        "attitude sampled too coarsely",
        ("too far apart", "scatter", *WORST),
        ("sampling.",),
        Wanted(3, swung=True, margin_s=12.0),
        delivered=_coarse,
    ),
    Fault(
        "one attitude sample, 20 to 3000 arcsec",
        ("sample", *IMAGE),
        ("sample.", "image.", "sightings"),
        Wanted(4),
        delivered=_bad_sample,
    ),
    Fault(
        "attitude sigma a third",
        ("disagree", "implausible"),
        (),
        Wanted(5),
        errors=_grown("alpha_E", 3.0),
        absorbable=False,
    ),
    Fault(
        "pixel sigma a third", ("implausible",), (), Wanted(2), errors=_grown("pixel", 3.0), absorbable=False
    ),
    Fault(
        "landmark sigma a third",
        ("implausible",),
        (),
        Wanted(2),
        errors=_grown("pi_J", 3.0),
        absorbable=False,
    ),
    Fault(
        "position sigma a third",
        ("disagree", "implausible"),
        (),
        Wanted(5),
        errors=_grown("rho_J", 3.0),
        absorbable=False,
    ),
    Fault(
        "errors of a pass shared, not stated",
        ("shared_by",),
        (),
        Wanted(3, close=True),
        errors=_one_draw,
        absorbable=False,
    ),
    Fault(
        "an offset in each of three sessions", ("disagree", *WORST), (), Wanted(9, passes=3), errors=_sessions
    ),
    Fault("a mounting that drifts", ("disagree", *WORST), (), Wanted(6), errors=_drift),
    Fault(
        "a mounting that moves with the orbit",
        ("disagree", *WORST),
        (),
        Wanted(10, passes=3),
        errors=_orbital,
    ),
    Fault(
        "clock of the camera, 5 to 500 ms", ("time_offset", *WORST), ("clock.",), Wanted(4), delivered=_clock
    ),
    Fault("GPS time taken for UTC", WORST, ("times.",), Wanted(2, margin_s=22.0), delivered=_eighteen),
    Fault(
        "focal length, 0.05 to 5 %",
        ("focal", *WORST),
        ("camera.focal_length",),
        Wanted(3),
        delivered=_focal,
        by_directions=True,
    ),
    Fault(
        "unit of focal length or pitch",
        WORST,
        ("camera.unit", "camera.focal_length"),
        delivered=_pitch_unit,
        by_directions=True,
    ),
    Fault(
        "distortion of the lens",
        ("distort", *WORST),
        ("camera.distortion",),
        Wanted(3, frame=True),
        delivered=_lens,
        by_directions=True,
    ),
    Fault("binned pixels", WORST, ("binning.",), delivered=_binned, by_directions=True),
    Fault("a window on the sensor", WORST, ("window.",), Wanted(2), delivered=_cropped, by_directions=True),
    Fault(
        "mirrored columns",
        WORST,
        ("pixels.column_px_from_right", "axes.camera"),
        Wanted(2),
        delivered=_moved_pixels(lambda x, y, size: (size[0] - 1 - x, y)),
        by_directions=True,
    ),
    Fault(
        "columns and rows exchanged",
        WORST,
        ("pixels.swapped",),
        Wanted(2, frame=True),
        delivered=_moved_pixels(lambda x, y, _: (y, x)),
        by_directions=True,
    ),
    Fault(
        "scalar first taken for last",
        WORST,
        ("attitude.order",),
        Wanted(2),
        delivered=_requaternion(lambda q: np.roll(q, 1, -1)),
    ),
    Fault(
        "attitude the other way round",
        WORST,
        ("attitude.direction",),
        Wanted(2),
        delivered=_requaternion(lambda q: q * [-1, -1, -1, 1]),
    ),
    Fault(
        "attitude's frame ITRF, not GCRF",
        WORST,
        ("attitude.frame",),
        Wanted(2),
        written=_other_key('from = "GCRF"', 'from = "ITRF"'),
    ),
    Fault(
        "positions' frame GCRF, not ITRF",
        WORST,
        ("ephemeris.frame",),
        Wanted(2),
        written=_other_key('frame = "ITRF"', 'frame = "GCRF"'),
    ),
    Fault("attitude of date taken for GCRF", WORST, ("frames.attitude",), Wanted(6), delivered=_of_date),
    Fault(
        "one blunder",
        ("fits worst", "rejected", "implausible"),
        ("sightings", "landmark."),
        Wanted(2),
        delivered=_one_blunder,
    ),
    Fault(
        "3 to 30 % random blunders",
        ("rejected", *WORST),
        ("sightings", "image."),
        Wanted(3),
        delivered=_random_blunders,
    ),
    Fault(
        "15 to 60 % coherent blunders",
        ("rejected", "agree", *WORST),
        ("sightings", "image."),
        Wanted(3),
        delivered=_coherent_blunders,
    ),
    Fault(
        "a landmark misplaced",
        ("landmark", *WORST),
        ("landmark.", "sightings"),
        Wanted(4, frame=True, site=True),
        delivered=_moved_landmark,
    ),
]
GOOD = Fault("nothing", ())
