"""The scene of Tkachenko 2019: two markers on the ground under a descending pass, and runs drawn from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics import so3
from ..physics.earth import OMEGA_EARTH, geodetic_to_itrf
from ..physics.orbit import KeplerOrbit, pointing
from ..physics.units import ARCMIN, ARCSEC, DEG, MM, UM
from ..plan.error_catalogue import Flight, focal_length
from ..plan.scene import site_grid
from ..table import error_sources
from ..table.error_sources import stated_sources
from ..table.observations import Observations
from ..table.simulate import measure
from .still import still_frames

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
    """Nominal geometry and the sigmas of everything drawn.

    ``r_J`` (m, 3) and ``C_KJ`` (m, 3, 3) of the images; ``p_J`` (n, 3); ``tracker_covariance`` (3, 3) rad^2;
    ``initial`` rad, ``focal_length`` relative, ``aim`` m, ``gps`` m, ``marker`` px; ``pixel`` its tangent.
    """

    r_J: Array
    C_KJ: Array
    p_J: Array
    tracker_covariance: Array
    initial: float
    focal_length: float
    aim: float
    gps: float
    marker: float
    pixel: float

    @property
    def range_m(self) -> Array:
        """Distance of each image (m,) from the middle of the markers."""
        return np.asarray(np.linalg.norm(np.mean(self.p_J, axis=0) - self.r_J, axis=-1))

    def truth(self, C_EK_true: Array, C_KJ: Array) -> Observations:
        """Tables without error of mountings (..., 3, 3) whose images are turned to ``C_KJ`` (..., m, 3, 3)."""
        m, n = len(self.r_J), len(self.p_J)
        image = np.repeat(np.arange(m), n)
        C_EJ = (C_EK_true[..., None, :, :] @ C_KJ)[..., image, :, :]
        return still_frames(
            self.r_J[image],
            C_EJ,
            np.tile(self.p_J, (m, 1)),
            image,
            np.tile(np.arange(n), m),
            C_EK_true,
            self.pixel,
            attitude_E=self.tracker_covariance,
            position_m=self.gps,
            landmark_m=0.0,
            noise_px=self.marker,
        )


def scene(paper: Mapping[str, Any], pitch_deg: ArrayLike, focal_length_mm: float, cone_deg: float) -> Scene:
    """The scene of ``paper2019.toml`` photographed at the pitch angles (m,)."""
    place, errors = paper["scene"], paper["errors"]
    site = place["latitude_deg"] * DEG, place["longitude_deg"] * DEG
    centre = geodetic_to_itrf(*site, 0.0)
    r_J, v_J = _pass(place, centre, np.atleast_1d(pitch_deg) * DEG)
    return Scene(
        r_J=r_J,
        C_KJ=pointing(r_J, v_J, centre).mT,
        p_J=site_grid(*site, 0.0, np.array(place["markers_east_north_m"])),
        tracker_covariance=trackers(cone_deg * DEG, np.array(errors["tracker_arcsec"]) * ARCSEC),
        initial=errors["initial_arcmin"] * ARCMIN,
        focal_length=paper["camera"]["focal_length_error"],
        aim=errors["aim_m"],
        gps=errors["gps_m"],
        marker=errors["marker_px"],
        pixel=paper["camera"]["pixel_um"] * UM / (focal_length_mm * MM),
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
    """Simulated runs: what any estimator reads, and the truth (runs, 3, 3) behind it."""

    observations: Observations
    C_EK_true: Array


def draw(scene: Scene, rng: np.random.Generator, runs: int, theta_E: ArrayLike | None = None) -> Runs:
    """Simulate runs, all with the initial error ``theta_E`` (3,) rad where one is given.

    Drawn anew for each run: the true mounting, the aim of each image, what the table states (attitude, position,
    marker), and the focal length, whose error no estimator knows of.
    """
    theta = scene.initial * rng.standard_normal((runs, 3)) if theta_E is None else np.asarray(theta_E)
    C_EK_true = so3.exp(np.broadcast_to(-theta, (runs, 3))) @ C_EK_MODEL
    tilt = np.zeros((runs, len(scene.r_J), 3))
    tilt[..., :2] = scene.aim / scene.range_m[:, None] * rng.standard_normal((*tilt.shape[:-1], 2))
    truth = scene.truth(C_EK_true, so3.exp(tilt) @ scene.C_KJ)
    focal = focal_length(Flight.of_table(truth), "focal length", scene.focal_length)
    errors = error_sources.draw(truth, (*stated_sources(truth), focal), rng, (runs,))
    return Runs(measure(truth, C_EK_true, errors), C_EK_true)
