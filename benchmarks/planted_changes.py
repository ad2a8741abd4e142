"""What goes wrong with campaigns: changes of errors not yet measured, of the delivered campaign, or of its files."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from planted_scenes import SECOND, Rng, Scene, log_uniform, sign, unit_vector

from starplumb.physics import so3
from starplumb.physics.camera import Distortion, FrameCamera
from starplumb.physics.earth import geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.orientation import C_IF
from starplumb.physics.series import Attitude
from starplumb.physics.units import ARCSEC
from starplumb.table.campaign import Campaign, SharedErrors

FEET = 0.3048


def late_image(c: Campaign, rng: Rng) -> Campaign:
    t = c.images.t_ns.copy()
    t[rng.integers(t.size)] += round(sign(rng) * log_uniform(rng, 0.01, 0.9) * SECOND)
    return replace(c, images=replace(c.images, t_ns=t))


def turned_image(c: Campaign, rng: Rng) -> Campaign:
    i = int(rng.integers(len(c.images.ids)))
    turn = so3.exp(log_uniform(rng, 30 * ARCSEC, np.pi) * unit_vector(rng))

    def change(a: Attitude) -> Attitude:
        first, _ = a.bursts.bounds
        mine = first == first[np.searchsorted(a.t_ns, c.images.t_ns[i], side="right") - 1]
        C = so3.from_quaternion(a.q_EF)
        return replace(a, q_EF=so3.to_quaternion(np.where(mine[:, None, None], turn @ C, C)))

    return c.with_attitude(change)


def places(change: Callable[..., tuple]) -> Callable[[Campaign, Rng], Campaign]:
    def delivered(c: Campaign, rng: Rng) -> Campaign:
        moved_J = geodetic_to_itrf(*change(*itrf_to_geodetic(c.landmarks.r_J), rng))
        return replace(c, landmarks=c.landmarks.moved(moved_J))

    return delivered


def exchanged(folder: Path, rng: Rng) -> None:
    rewrite(
        folder / "landmarks.csv",
        lambda row: row | {"latitude_deg": row["longitude_deg"], "longitude_deg": row["latitude_deg"]},
    )


def rewrite(path: Path, change: Callable[[dict], dict]) -> None:
    with path.open() as file:
        rows = [change(row) for row in csv.DictReader(file)]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def rounded(name: str, columns: tuple[str, ...], low: int, high: int) -> Callable[[Path, Rng], None]:
    def written(folder: Path, rng: Rng) -> None:
        decimals = int(rng.integers(low, high + 1))
        rewrite(folder / name, lambda row: row | {key: f"{float(row[key]):.{decimals}f}" for key in columns})

    return written


def cut_times(c: Campaign, rng: Rng) -> Campaign:
    step = int(rng.choice([10**6, 10**7, 10**8]))
    return replace(c, images=replace(c.images, t_ns=c.images.t_ns // step * step))


def without_zeros(folder: Path, rng: Rng) -> None:
    rewrite(folder / "images.csv", lambda row: row | {"time": row["time"].rstrip("0").rstrip(".")})


def coarse(c: Campaign, rng: Rng) -> Campaign:
    step = float(rng.choice([1.0, 1.5, 2.0, 3.0]))

    def change(a: Attitude) -> Attitude:
        every = round(step * 4)
        first, _ = a.bursts.bounds
        kept = (np.arange(a.t_ns.size) - first) % every == int(rng.integers(every))
        return replace(a, t_ns=a.t_ns[kept], q_EF=a.q_EF[kept], gap_s=1.5 * step)

    return c.with_attitude(change)


def bad_sample(c: Campaign, rng: Rng) -> Campaign:
    i = int(rng.integers(len(c.images.ids)))
    turn = so3.exp(log_uniform(rng, 20 * ARCSEC, 3000 * ARCSEC) * unit_vector(rng))

    def change(a: Attitude) -> Attitude:
        k = int(np.searchsorted(a.t_ns, c.images.t_ns[i])) - int(rng.integers(2))
        q = a.q_EF.copy()
        q[k] = so3.to_quaternion(turn @ so3.from_quaternion(q[k]))
        return replace(a, q_EF=q)

    return c.with_attitude(change)


def grown(field: str, factor: float) -> Callable[[Scene, Rng], Scene]:
    return lambda s, rng: replace(s, errors=replace(s.errors, **{field: factor * getattr(s.errors, field)}))


def one_draw(s: Scene, rng: Rng) -> Scene:
    """Images of a pass share one error of tracker and orbit, and the campaign does not say so."""
    first = np.searchsorted(s.passes, s.passes)
    e = replace(s.errors, alpha_E=s.errors.alpha_E[first], rho_J=s.errors.rho_J[first])
    silent = replace(s.truth, attitude_errors=SharedErrors(), position_errors=SharedErrors())
    return replace(s, errors=e, truth=silent)


def added(s: Scene, alpha_E: np.ndarray) -> Scene:
    return replace(s, errors=replace(s.errors, alpha_E=s.errors.alpha_E + alpha_E))


def sessions(s: Scene, rng: Rng) -> Scene:
    size = rng.uniform(1.0, 4.0) * np.sqrt(np.diagonal(s.truth.cov_attitude_E))
    return added(s, rng.normal(0.0, size, (int(s.passes.max()) + 1, 3))[s.passes])


def drift(s: Scene, rng: Rng) -> Scene:
    size = rng.uniform(3.0, 10.0) * np.sqrt(s.truth.cov_attitude_E[0, 0])
    along = np.linspace(-1.0, 1.0, s.n_images)
    return added(s, (size * along)[:, None] * unit_vector(rng))


def orbital(s: Scene, rng: Rng) -> Scene:
    size = rng.uniform(3.0, 10.0) * np.sqrt(s.truth.cov_attitude_E[0, 0])
    t = (s.truth.images.t_ns - s.truth.images.t_ns[0]) * 1e-9
    return added(s, (size * np.sin(2 * np.pi * t / 5700.0 + rng.uniform(0, 6)))[:, None] * unit_vector(rng))


def clock(c: Campaign, rng: Rng) -> Campaign:
    shift = round(sign(rng) * log_uniform(rng, 0.005, 0.5) * SECOND)
    return replace(c, images=replace(c.images, t_ns=c.images.t_ns + shift))


def eighteen(c: Campaign, rng: Rng) -> Campaign:
    shift = round(sign(rng) * 18) * SECOND
    which = int(rng.integers(2))
    if which == 0:
        return replace(c, images=replace(c.images, t_ns=c.images.t_ns + shift))
    return c.with_attitude(lambda a: replace(a, t_ns=a.t_ns + shift))


def focal(c: Campaign, rng: Rng) -> Campaign:
    camera, scale = c.camera, 1.0 + sign(rng) * log_uniform(rng, 5e-4, 0.05)
    if isinstance(camera, FrameCamera):
        return replace(c, camera=replace(camera, focal_length=scale * camera.focal_length))
    return replace(c, camera=replace(camera, tan_x=camera.tan_x / scale))


def pitch_unit(c: Campaign, rng: Rng) -> Campaign:
    camera, scale = c.camera, float(rng.choice([0.1, 10.0, 25.4, 1000.0]))
    if isinstance(camera, FrameCamera):
        return replace(c, camera=replace(camera, focal_length=scale * camera.focal_length))
    return replace(c, camera=replace(camera, tan_x=camera.tan_x / scale, tan_y=camera.tan_y / scale))


def lens(c: Campaign, rng: Rng) -> Campaign:
    camera = c.camera
    assert isinstance(camera, FrameCamera)
    edge = 0.5 * camera.pitch / camera.focal_length * float(np.hypot(*camera.size_px))
    k1 = sign(rng) * log_uniform(rng, 2e-4, 5e-3) / edge**2
    return replace(c, camera=replace(camera, distortion=Distortion(k=(k1, 0.0, 0.0))))


def moved_pixels(change: Callable[..., tuple]) -> Callable[[Campaign, Rng], Campaign]:
    def delivered(c: Campaign, rng: Rng) -> Campaign:
        s = c.sightings
        column, row = change(s.column_px, s.row_px, c.camera.size_px)
        return replace(c, sightings=replace(s, column_px=column, row_px=row))

    return delivered


def binned(c: Campaign, rng: Rng) -> Campaign:
    n = int(rng.choice([2, 3, 4]))
    s = c.sightings
    column, row = ((px + 0.5) / n - 0.5 for px in (s.column_px, s.row_px))
    return replace(c, sightings=replace(s, column_px=column, row_px=row, sigma_px=s.sigma_px / n))


def cropped(c: Campaign, rng: Rng) -> Campaign:
    s = c.sightings
    column, row = (rng.uniform(0.005, 0.2) * size for size in c.camera.size_px)
    return replace(
        c, sightings=replace(s, column_px=s.column_px - np.rint(column), row_px=s.row_px - np.rint(row))
    )


def requaternion(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Campaign, Rng], Campaign]:
    return lambda c, rng: c.with_attitude(lambda a: replace(a, q_EF=change(a.q_EF)))


def of_date(c: Campaign, rng: Rng) -> Campaign:
    frame = rng.choice(["TEME", "TOD", "MOD"])
    return c.with_attitude(
        lambda a: replace(a, q_EF=so3.to_quaternion(so3.from_quaternion(a.q_EF) @ C_IF(frame, a.t_ns)))
    )


def other_key(old: str, new: str) -> Callable[[Path, Rng], None]:
    def written(folder: Path, rng: Rng) -> None:
        path = folder / "campaign.toml"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return written


def random_blunders(c: Campaign, rng: Rng) -> Campaign:
    s, size = c.sightings, log_uniform(rng, 5.0, 1000.0)
    wrong = rng.random(s.image.size) < rng.uniform(0.03, 0.3)
    move = rng.uniform(-size, size, (2, s.image.size)) * wrong
    return replace(c, sightings=replace(s, column_px=s.column_px + move[0], row_px=s.row_px + move[1]))


def one_blunder(c: Campaign, rng: Rng) -> Campaign:
    s = c.sightings
    wrong = np.arange(s.image.size) == rng.choice(np.flatnonzero(~s.check))
    move = log_uniform(rng, 10.0, 1000.0) * s.sigma_px * unit_vector(rng, 2)[:, None] * wrong
    return replace(c, sightings=replace(s, column_px=s.column_px + move[0], row_px=s.row_px + move[1]))


def coherent_blunders(c: Campaign, rng: Rng) -> Campaign:
    s, size = c.sightings, log_uniform(rng, 3.0, 300.0)
    wrong = rng.random(s.image.size) < rng.uniform(0.15, 0.6)
    alike = rng.random() < 0.5
    directions = np.stack([unit_vector(rng, 2) for _ in c.images.ids])
    move = size * directions[np.zeros_like(s.image) if alike else s.image] * wrong[:, None]
    return replace(c, sightings=replace(s, column_px=s.column_px + move[:, 0], row_px=s.row_px + move[:, 1]))


def exchanged_labels(c: Campaign, rng: Rng) -> Campaign:
    s, landmark = c.sightings, c.sightings.landmark.copy()
    mine = np.flatnonzero(s.image == rng.integers(len(c.images.ids)))
    landmark[mine] = np.roll(landmark[mine], 1)
    return replace(c, sightings=replace(s, landmark=landmark))


def moved_landmark(c: Campaign, rng: Rng) -> Campaign:
    r_J = c.landmarks.r_J.copy()
    seen = np.bincount(c.sightings.landmark, minlength=len(r_J))
    k = int(np.argmax(seen))
    r_J[k] += log_uniform(rng, 15.0, 5000.0) * unit_vector(rng)
    return replace(c, landmarks=c.landmarks.moved(r_J))
