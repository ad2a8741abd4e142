"""The scene of Tkachenko 2019: two markers on the ground under a descending pass, and runs drawn from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..estimators.published.observer import Observer
from ..estimators.published.observer_rows import SIGHTING_ROWS, STATE_ROWS
from ..physics import so3
from ..physics.earth import OMEGA_EARTH, geodetic_to_itrf
from ..physics.errors import InputError
from ..physics.light import Corrections
from ..physics.orbit import KeplerOrbit, pointing
from ..physics.units import ARCMIN, ARCSEC, DEG, MM, UM
from ..plan.scene import site_grid
from ..table.observations import Observations
from .tkachenko_rows import IMAGE_DRAWS, MARKER_DRAWS, RUN_DRAWS, TRUTH_ROWS, campaign, simulate_block

Array = NDArray[np.float64]

C_EK_MODEL = np.diag([1.0, -1.0, -1.0])
"""The model of the paper has E and K coincide; its camera looks along -z; ours looks along +z with y turned over."""


def trackers(cone: float, sigma: ArrayLike) -> Array:
    """Covariance (3, 3) about E of the plain mean of three trackers with errors ``sigma`` (3,) about their own axes.

    Their boresights (z) lie on a cone about -z_K, 120 deg apart: ``1/9 sum C diag(sigma^2) C^T``.
    """
    about_axis = so3.exp(np.arange(3.0)[:, None] * 120.0 * DEG * np.eye(3)[2])
    C_ET = about_axis @ so3.exp(np.array([cone, 0.0, 0.0]))
    covariance = C_ET @ np.diag(np.asarray(sigma) ** 2) @ C_ET.mT
    return np.asarray(np.sum(covariance, axis=0) / 9.0)


@dataclass(frozen=True)
class Scene:
    """True geometry and the sigmas of everything drawn.

    ``images`` (m, 8): r_J, quaternion of C_KJ, range; ``p_J`` (n, 3); ``tracker_covariance`` (3, 3) rad^2;
    ``sigma`` (5): initial error rad, relative focal length, aim m, GPS m, marker in tangents; ``pixel`` rad.
    """

    images: Array
    p_J: Array
    tracker_covariance: Array
    sigma: Array
    pixel: float

    @property
    def draws(self) -> int:
        """Normal numbers that a run needs."""
        return RUN_DRAWS + len(self.images) * (IMAGE_DRAWS + MARKER_DRAWS * len(self.p_J))

    @property
    def constants(self) -> tuple[Array, Array, Array]:
        """Root of the trackers' covariance, quaternion of the model mounting, sigmas: what the rows' formulas take."""
        root = np.asarray(np.linalg.cholesky(self.tracker_covariance), dtype=np.float64)
        return root, so3.to_quaternion(C_EK_MODEL), self.sigma


def scene(paper: Mapping[str, Any], pitch_deg: ArrayLike, focal_length_mm: float, cone_deg: float) -> Scene:
    """The scene of ``paper2019.toml`` photographed at the pitch angles (m,)."""
    place, errors = paper["scene"], paper["errors"]
    site = place["latitude_deg"] * DEG, place["longitude_deg"] * DEG
    centre = geodetic_to_itrf(*site, 0.0)
    r_J, v_J = _pass(place, centre, np.atleast_1d(pitch_deg) * DEG)
    C_JK = pointing(r_J, v_J, centre)
    reach = np.linalg.norm(centre - r_J, axis=-1, keepdims=True)
    focal = focal_length_mm * MM
    sigma = [
        errors["initial_arcmin"] * ARCMIN,
        paper["camera"]["focal_length_error"],
        errors["aim_m"],
        errors["gps_m"],
        errors["marker_px"] * paper["camera"]["pixel_um"] * UM / focal,
    ]
    return Scene(
        images=np.concatenate([r_J, so3.to_quaternion(C_JK.mT), reach], axis=-1),
        p_J=site_grid(*site, 0.0, np.array(place["markers_east_north_m"])),
        tracker_covariance=trackers(cone_deg * DEG, np.array(errors["tracker_arcsec"]) * ARCSEC),
        sigma=np.array(sigma),
        pixel=paper["camera"]["pixel_um"] * UM / focal,
    )


def _pass(place: Mapping[str, Any], site_J: Array, pitch: Array) -> tuple[Array, Array]:
    """Positions and velocities (m, 3) over the turning Earth from which a site (3,) is seen at the pitch angles.

    The site is below perigee, crossed at time 0; the place of an image follows from the height and the speed of the
    ground track, ``t = -H tan(pitch) / v``.
    """
    height, inclination = place["height_km"] * 1e3, place["inclination_deg"] * DEG
    eccentricity = place["eccentricity"]
    radius = np.linalg.norm(site_J)
    argument = np.arcsin(site_J[2] / radius / np.sin(inclination))
    if place["descending"]:
        argument = np.pi - argument
    meridian = np.arctan2(np.cos(inclination) * np.sin(argument), np.cos(argument))
    node = np.arctan2(site_J[1], site_J[0]) - meridian
    perigee = radius + height
    orbit = KeplerOrbit(perigee / (1.0 - eccentricity), eccentricity, inclination, node, argument, 0.0)
    _, v0 = orbit.at(0.0)
    time = -height * np.tan(pitch) / (np.linalg.norm(v0) * radius / perigee)
    r_I, v_I = orbit.at(time)
    C_JI = so3.exp(-OMEGA_EARTH * time[:, None] * np.eye(3)[2])
    r_J, v_turning = (C_JI @ r_I[..., None])[..., 0], (C_JI @ v_I[..., None])[..., 0]
    return r_J, v_turning - np.cross([0.0, 0.0, OMEGA_EARTH], r_J)


@dataclass(frozen=True)
class Runs:
    """Simulated runs: the observer's work rows (10 + 16 n m, runs), and the same as an observation table."""

    rows: Array
    scene: Scene
    Z: Array

    @property
    def C_EK_true(self) -> Array:
        """``exp(-theta_E) C_EK_MODEL`` (runs, 3, 3)."""
        return so3.from_quaternion(self.rows[:4].mT)

    @property
    def theta_E(self) -> Array:
        """Initial errors (runs, 3) rad."""
        return np.asarray(self.scene.sigma[0] * self.Z[:3].mT)

    @property
    def observations(self) -> Observations:
        """What any estimator reads; the focal length's error is in the tangents, but stated nowhere."""
        s = self.scene
        m, n = len(s.images), len(s.p_J)
        block = self.rows[STATE_ROWS:].reshape(m * n, SIGHTING_ROWS, -1)
        e_K, e_E, axes = (np.moveaxis(block[:, a:b], -1, 0) for a, b in ((0, 3), (3, 6), (6, 15)))
        image = np.repeat(np.arange(m), n)
        first = RUN_DRAWS + (IMAGE_DRAWS + MARKER_DRAWS * n) * image
        rho_J = s.sigma[3] * np.moveaxis(self.Z[first[:, None] + np.arange(5, 8)], -1, 0)
        r_J = s.images[image, :3] + rho_J
        p_J = np.tile(s.p_J, (m, 1))
        count = m * n
        return Observations(
            image=image,
            landmark=np.tile(np.arange(n), m),
            xy_K=e_K[..., :2] / e_K[..., 2:],
            slope_K=np.broadcast_to(s.pixel * np.eye(2), (count, 2, 2)),
            line_period_s=np.zeros(count),
            C_EJ=axes.reshape(-1, count, 3, 3).mT,
            omega_E=np.zeros((count, 3)),
            r_J=r_J,
            v_J=np.zeros((count, 3)),
            p_J=p_J,
            e_E=e_E,
            row_rate_E=np.zeros((count, 3)),
            range_m=np.linalg.norm(p_J - r_J, axis=-1),
            sigma_px=np.full(count, s.sigma[4] / s.pixel),
            weight=np.ones(count),
            cov_attitude_E=np.broadcast_to(s.tracker_covariance, (m, 3, 3)),
            cov_position_J=np.broadcast_to(s.sigma[3] ** 2 * np.eye(3), (m, 3, 3)),
            cov_landmark_J=np.zeros((n, 3, 3)),
            corrections=Corrections(light_time=False, aberration=False),
        )


def draw(scene: Scene, rng: np.random.Generator, runs: int, theta_E: ArrayLike | None = None) -> Runs:
    """Simulate runs, all with the initial error ``theta_E`` (3,) rad where one is given.

    The work rows hold the true mounting in place of the model's; the state of P is left to the observer.
    """
    Z = rng.standard_normal((scene.draws, runs))
    if theta_E is not None:
        Z[:3] = (np.asarray(theta_E) / scene.sigma[0])[:, None]
    rows = np.zeros((STATE_ROWS + SIGHTING_ROWS * len(scene.images) * len(scene.p_J), runs))
    K = np.zeros((TRUTH_ROWS, runs))
    simulate_block(Z, rows, K, scene.images, scene.p_J, *scene.constants, 1.0)
    rows[:4] = K[:4]
    return Runs(rows, scene, Z)


def errors_E(scene: Scene, observer: Observer, rng: np.random.Generator, runs: int) -> Array:
    """Errors (cycles, 3, runs) rad about E that the observer leaves after each cycle: draws, scene and cycles in one
    pass over blocks of runs, for many of them.

    Raises InputError for another order of the equations than that of J's axes.
    """
    if observer.order != (0, 1, 2):
        raise InputError(f"errors_E: found order = {observer.order}, wanted (0, 1, 2)")
    Z = rng.standard_normal((scene.draws, runs))
    errors = np.empty((observer.cycles, 3, runs))
    P0 = np.array(np.broadcast_to(observer.P0, (3,)), dtype=np.float64)
    run = campaign(observer.factorised, observer.compiled)
    run(
        Z,
        scene.images,
        scene.p_J,
        *scene.constants,
        P0,
        float(np.sqrt(observer.floor)),
        observer.parameters,
        errors,
    )
    return errors
