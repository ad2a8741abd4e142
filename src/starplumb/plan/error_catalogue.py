"""Error sources of a scene by what causes them: star trackers, orbit, survey, clocks, camera and its measurements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..physics.camera import LineScanCamera
from ..physics.covariance import ellipse_of
from ..physics.earth import C_JT, itrf_to_geodetic
from ..physics.errors import InputError
from ..physics.light import inertial_velocity
from ..physics.orbit import C_RO, argument_of_latitude
from ..physics.trackers import Fusion, fusion_weights
from ..table.campaign import Campaign
from ..table.considered import refraction as refracted
from ..table.considered import source_of
from ..table.error_sources import (
    UNIT_ARCSEC,
    UNIT_METRE,
    UNIT_MILLISECOND,
    UNIT_PERCENT,
    UNIT_PIXEL,
    UNIT_PPM,
    Distribution,
    Source,
    Unit,
)
from ..table.observations import Observations
from ..table.parameter_names import GROUPS
from ..table.parameters import LookAngles
from ..table.sharing import FORGOTTEN, chained, correlated, neighbours

Array = NDArray[np.float64]
Index = NDArray[np.int64]

XYZ = ("x", "y", "z")
_GAUSSIAN = Distribution()


@dataclass(frozen=True)
class Flight:
    """What error sources need to know of a scene: its table without error, the pass and the session of each image (m,),
    and, for errors along the axes of the orbit or of inertial space, the campaign (None: a table alone)."""

    truth: Observations
    campaign: Campaign | None
    pass_of_image: Index
    session_of_image: Index | None = None
    """None: a pass is a session."""

    @classmethod
    def of_table(cls, truth: Observations) -> Flight:
        """A table whose images belong to one pass and whose orbit is not known."""
        return cls(truth, None, np.zeros(truth.n_images, dtype=np.int64))

    @property
    def m(self) -> int:
        return self.truth.n_images

    @property
    def camera(self) -> Index:
        """The camera of each sighting (n,)."""
        of = self.truth.camera
        return np.zeros(self.truth.n, dtype=np.int64) if of is None else of

    @property
    def flown(self) -> Campaign:
        """The campaign; ValueError where there is only a table."""
        if self.campaign is None:
            raise ValueError("this error source needs the campaign, not its table alone")
        return self.campaign

    @property
    def C_IJ(self) -> Array:
        """Orientation of the Earth at each image (m, 3, 3)."""
        if self.flown.orientation is None:
            raise ValueError("a simulated campaign knows the orientation of the Earth")
        return self.flown.orientation.C_IJ(self.flown.images.t_ns)

    @property
    def state_I(self) -> tuple[Array, Array]:
        """Inertial r_I, v_I (m, 3) of the images."""
        r_J, v_J = self.flown.ephemeris.at(self.flown.images.t_ns)
        r_I, v_I = ((self.C_IJ @ v[..., None])[..., 0] for v in (r_J, inertial_velocity(r_J, v_J)))
        return r_I, v_I

    def groups(self, shared_by: str) -> Index:
        """Which draw each image takes, (m,)."""
        match shared_by:
            case "image":
                return np.arange(self.m)
            case "session" if self.session_of_image is not None:
                return np.unique(self.session_of_image, return_inverse=True)[1]
            case "pass" | "session":
                return np.unique(self.pass_of_image, return_inverse=True)[1]
            case "campaign":
                return np.zeros(self.m, dtype=np.int64)
        raise ValueError(f"unknown sharing {shared_by!r}")

    def axes_J(self, frame: str) -> Array:
        """Axes of a frame of the orbit's error in J (m, 3, 3): ITRF, GCRF, or orbital (along, across, down)."""
        if frame == "ITRF":
            return np.broadcast_to(np.eye(3), (self.m, 3, 3))
        C_JI = self.C_IJ.mT
        return C_JI if frame == "GCRF" else np.asarray(C_JI @ C_RO(*self.state_I))


@dataclass(frozen=True)
class Tracker:
    """One star tracker: ``C_EA`` (3, 3) its axes A in E, ``sigma`` (3,) rad its noise about them, z the boresight."""

    name: str
    C_EA: Array
    sigma: Array


def fused_axes(trackers: tuple[Tracker, ...], fusion: Fusion) -> list[Array]:
    """What each tracker's error, along its own axes, does to the fused attitude: W_j C_EA_j (3, 3) each.

    Raises InputError where a tracker that is weighted against others claims to be exact.
    """
    if len(trackers) <= 1:
        return [tracker.C_EA for tracker in trackers]
    covariance_E = np.stack([t.C_EA @ np.diag(t.sigma**2) @ t.C_EA.mT for t in trackers])
    weights = fusion_weights(covariance_E, np.ones(len(trackers), dtype=bool), fusion)
    return [W @ t.C_EA for W, t in zip(weights, trackers, strict=True)]


def attitude(
    flight: Flight, name: str, sigma: Array, axes: Array, shared_by: str, shape: Distribution = _GAUSSIAN
) -> Source:
    """Attitude error with ``sigma`` (3,) rad along axes whose effect on E is ``axes`` (3, 3)."""
    words = f"attitude, shared by the markers of an image{'' if shared_by == 'image' else f', by the {shared_by}'}"
    pattern = np.broadcast_to(axes, (flight.m, 3, 3))
    return Source(
        name,
        words,
        "alpha_E",
        pattern,
        flight.groups(shared_by),
        np.arange(3),
        sigma,
        XYZ,
        UNIT_ARCSEC,
        shape,
    )


def drift(
    flight: Flight,
    name: str,
    sigma: Array,
    axes: Array,
    harmonics: tuple[int, ...],
    shape: Distribution = _GAUSSIAN,
) -> Source:
    """Thermal drift ``sum_k a_k cos(k u) + b_k sin(k u)`` over the argument of latitude; a_k, b_k of ``sigma`` rad."""
    u = argument_of_latitude(*flight.state_I)
    waves = [wave(k * u)[:, None, None] * axes for k in harmonics for wave in (np.cos, np.sin)]
    pattern = np.concatenate(waves, axis=-1)
    component = np.tile(np.arange(3), 2 * len(harmonics))
    words = f"drift with the argument of latitude, harmonics {', '.join(map(str, harmonics))}"
    return Source(
        name, words, "alpha_E", pattern, flight.groups("campaign"), component, sigma, XYZ, UNIT_ARCSEC, shape
    )


def position(
    flight: Flight, name: str, sigma: Array, frame: str, shared_by: str, shape: Distribution = _GAUSSIAN
) -> Source:
    """Orbit error with ``sigma`` (3,) m along the axes of a frame."""
    words = f"position along {frame} axes, shared by the markers of an image"
    words += "" if shared_by == "image" else f", by the {shared_by}"
    labels = ("along", "across", "down") if frame == "orbital" else XYZ
    return Source(
        name,
        words,
        "rho_J",
        flight.axes_J(frame),
        flight.groups(shared_by),
        np.arange(3),
        sigma,
        labels,
        UNIT_METRE,
        shape,
    )


def correlated_position(
    flight: Flight, name: str, sigma: Array, frame: str, time_s: float, shape: Distribution = _GAUSSIAN
) -> Source:
    """Orbit error as a Gauss-Markov process: correlation ``exp(-|dt| / time)`` between images."""
    words = f"position along {frame} axes, correlated over {time_s:g} s"
    labels = ("along", "across", "down") if frame == "orbital" else XYZ
    t_s = np.asarray(flight.flown.images.t_ns * 1e-9)
    group = chained(t_s, FORGOTTEN * time_s)
    unit = correlated(name, "rho_J", flight.axes_J(frame), t_s, group, time_s)
    return _scaled(unit, words, sigma, labels, UNIT_METRE, shape)


def correlated_attitude(
    flight: Flight, name: str, sigma: Array, axes: Array, time_s: float, shape: Distribution = _GAUSSIAN
) -> Source:
    """Attitude error of images as a Gauss-Markov process."""
    t_s = np.asarray(flight.flown.images.t_ns * 1e-9)
    L = np.broadcast_to(axes, (flight.m, 3, 3))
    unit = correlated(name, "alpha_E", L, t_s, chained(t_s, FORGOTTEN * time_s), time_s)
    return _scaled(unit, f"attitude, correlated over {time_s:g} s", sigma, XYZ, UNIT_ARCSEC, shape)


def wander(
    flight: Flight, name: str, sigma: Array, axes: Array, time_s: float, shape: Distribution = _GAUSSIAN
) -> Source:
    """Attitude error that changes while an image is taken, a Gauss-Markov process in the time of its rows."""
    o, flown = flight.truth, flight.flown
    t_s = 1e-9 * (flown.images.exposed(o.image, flown.sightings.row_px) - flown.images.t_ns.min())
    L = np.broadcast_to(axes, (o.n, 3, 3))
    unit = correlated(name, "turn_E", L, t_s, o.image, time_s)
    words = f"attitude within an image, correlated over {time_s:g} s"
    return _scaled(unit, words, sigma, XYZ, UNIT_ARCSEC, shape)


def _scaled(
    unit: Source,
    words: str,
    sigma: Array,
    labels: tuple[str, ...],
    of: Unit,
    shape: Distribution,
    name: str | None = None,
) -> Source:
    """A source of unit sigmas about three axes with these."""
    component = np.arange(unit.component.size) % 3
    scaled = replace(unit, words=words, component=component, sigma=sigma, labels=labels, unit=of)
    return replace(scaled, distribution=shape, name=name or unit.name)


def landmark(
    flight: Flight, name: str, sigma: Array, shared_by: str, shape: Distribution = _GAUSSIAN
) -> Source:
    """Survey error with ``sigma`` (3,) m east, north and up, of each marker or of the whole network."""
    latitude, longitude, _ = itrf_to_geodetic(flight.flown.landmarks.r_J)
    L = flight.truth.n_landmarks
    group = np.arange(L) if shared_by == "marker" else np.zeros(L, dtype=np.int64)
    words = f"place of a marker, shared by {'its images' if shared_by == 'marker' else 'the campaign'}"
    labels = ("east", "north", "up")
    pattern = C_JT(latitude, longitude)
    return Source(name, words, "pi_J", pattern, group, np.arange(3), sigma, labels, UNIT_METRE, shape)


def correlated_landmark(
    flight: Flight, name: str, sigma: Array, length: float, shape: Distribution = _GAUSSIAN
) -> Source:
    """Survey error with ``sigma`` (3,) m east, north and up, alike by ``exp(-distance / length)``."""
    landmarks = flight.flown.landmarks
    axes = C_JT(*itrf_to_geodetic(landmarks.r_J)[:2])
    unit = neighbours(landmarks.r_J, axes, np.arange(len(axes)), np.zeros(len(axes), dtype=np.int64), length)
    words = f"place of a marker, correlated over {length:g} m"
    return _scaled(unit, words, sigma, ("east", "north", "up"), UNIT_METRE, shape, name)


def look_angles(flight: Flight, name: str, sigma: float, shape: Distribution = _GAUSSIAN) -> Source:
    """Look directions of a line of detectors, each of their terms off by ``sigma`` px at the ends of the line.

    Raises InputError for another camera.
    """
    camera = flight.flown.camera
    if flight.truth.camera is not None:
        raise InputError(f"truth.{name}: found look-angles for several cameras, wanted focal-length")
    if not isinstance(camera, LineScanCamera):
        raise InputError(f"truth.{name}: found look-angles for a frame camera, wanted focal-length")
    terms = GROUPS["look_angles"]
    unit = source_of(LookAngles(camera, terms, (1.0,) * 5), np.full(5, camera.pixel_rad), flight.truth)
    scaled = replace(unit, name=name, words="look angles, shared by the campaign", unit=UNIT_PIXEL)
    return replace(scaled, sigma=np.full(5, sigma), labels=terms, distribution=shape)


def refraction(flight: Flight, name: str, sigma: float, shape: Distribution = _GAUSSIAN) -> Source:
    """A part of the computed refraction by which that is wrong."""
    unit = refracted(1.0, flight.truth)
    scaled = replace(unit, name=name, words="refraction, shared by the campaign", unit=UNIT_PERCENT)
    return replace(scaled, sigma=np.array([sigma]), labels=("",), distribution=shape)


def pixel(flight: Flight, name: str, sigma: float, shape: Distribution = _GAUSSIAN) -> Source:
    """Measuring error of each coordinate of each sighting, px."""
    n = flight.truth.n
    pattern = np.broadcast_to(np.eye(2), (n, 2, 2))
    words = "measured pixel, shared by nobody"
    one = np.zeros(2, dtype=np.int64)
    return Source(
        name, words, "pixel", pattern, np.arange(n), one, np.array([sigma]), ("",), UNIT_PIXEL, shape
    )


def elongated_pixel(
    flight: Flight, name: str, column: float, row: float, correlation: float, shape: Distribution = _GAUSSIAN
) -> Source:
    """Measuring error of each sighting with these sigmas of column and row, px, and their correlation; its own sigma is
    the root mean square of the two."""
    sigma, ellipse = ellipse_of(np.array(column), np.array(row), np.array(correlation))
    one = pixel(flight, name, float(sigma), shape)
    root = np.broadcast_to(np.linalg.cholesky(ellipse), one.pattern.shape)
    return replace(one, pattern=root, words="measured pixel, an ellipse, shared by nobody")


def rounding(flight: Flight, name: str, step: float) -> Source:
    """Coordinates rounded to a step: uniform, since pointing puts a marker anywhere within its pixel."""
    return pixel(flight, name, step / np.sqrt(12.0), Distribution("uniform"))


def time_tag(
    flight: Flight, name: str, sigma: float, shared_by: str, shape: Distribution = _GAUSSIAN
) -> Source:
    """Epochs of the images against those of orbit and attitude, s."""
    words = f"time tag of the images, shared by the {shared_by}"
    pattern, zero = np.ones((flight.m, 1, 1)), np.zeros(1, dtype=np.int64)
    group = flight.groups(shared_by)
    return Source(
        name, words, "late_s", pattern, group, zero, np.array([sigma]), ("",), UNIT_MILLISECOND, shape
    )


def focal_length(flight: Flight, name: str, sigma: float, shape: Distribution = _GAUSSIAN) -> Source:
    """Relative error of the focal length: every look direction leaves the boresight by the same part of its tangent."""
    words = "focal length, shared by the campaign"
    zero, group = np.zeros(1, dtype=np.int64), flight.camera
    pattern = -flight.truth.xy_K[..., None]
    return Source(name, words, "tangent", pattern, group, zero, np.array([sigma]), ("",), UNIT_PPM, shape)


def principal_point(
    flight: Flight, name: str, sigma: float, scale: float | Array, shape: Distribution = _GAUSSIAN
) -> Source:
    """Error of the principal point, px, where a pixel is ``scale`` rad wide, of each sighting (n,) or of all."""
    words = "principal point, shared by the campaign"
    pattern = -np.broadcast_to(scale, flight.truth.n)[:, None, None] * np.eye(2)
    labels, component, sigmas = ("column", "row"), np.array([0, 1]), np.array([sigma, sigma])
    return Source(
        name, words, "tangent", pattern, flight.camera, component, sigmas, labels, UNIT_PIXEL, shape
    )
