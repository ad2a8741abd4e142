"""Where a satellite is on its orbit, by Earth-fixed states: argument of latitude, even motion, height of the Sun."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics.errors import EpochError
from ..physics.light import inertial_velocity
from ..physics.orbit import EARTH_RADIUS, GM_EARTH, J2_EARTH, argument_of_latitude
from ..physics.timescales import LATEST_UTC_MINUS_TAI, tt_julian, utc_minus_tai
from ..physics.units import DEG
from .campaign import Campaign

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]

DOUBT = 6e-3
"""Part by which the mean motion by one state may be off: 4e-3 for states that are mean ones, without the short waves of
a real orbit."""
STEPS = 8
"""Trial motions for each turn that the phase of the last image could be off by."""
COHERENT = 0.97
"""Resultant of the phases about an even motion (14 deg rms) from which on it is one."""
SAME_PEAK = 0.999
"""Part of the best resultant from which on another motion explains the phases as well."""


_LEAST_RATE = 1e-6
"""Of an orbit about the Earth, rad/s: a turn in ten weeks."""


@dataclass(frozen=True)
class OrbitPhase:
    """Even motion along an orbit: ``u = rate (t - node)``, ``node_ns`` an ascending node, ``rate`` rad/s."""

    node_ns: int
    rate: float

    def at(self, t_ns: ArrayLike) -> Array:
        """Argument of latitude (...), rad in [-pi, pi)."""
        u = self.rate * 1e-9 * (np.asarray(t_ns, dtype=np.int64) - self.node_ns)
        return np.asarray(np.mod(u + np.pi, 2.0 * np.pi) - np.pi)


def latitude_argument(r_J: ArrayLike, v_J: ArrayLike) -> Array:
    """Angle u (...), rad, from the ascending node, of states (..., 3) relative to the turning Earth.

    The pole is that of J: u is counted from the equator of date.
    """
    return argument_of_latitude(r_J, inertial_velocity(r_J, v_J))


def mean_rate(r_J: Array, v_J: Array) -> Array:
    """Mean rate (...) of u, rad/s, by single states (..., 3).

    ``a = a_osc - 3/2 J2 R^2/a sin^2 i cos 2u`` and the secular rates of :class:`starplumb.physics.orbit.KeplerOrbit`
    for a circle.
    """
    v = inertial_velocity(r_J, v_J)
    r = np.linalg.norm(r_J, axis=-1)
    h = np.cross(r_J, v)
    c2 = (h[..., 2] / np.linalg.norm(h, axis=-1)) ** 2
    osculating = 1.0 / (2.0 / r - np.sum(v * v, axis=-1) / GM_EARTH)
    wave = 1.5 * J2_EARTH * EARTH_RADIUS**2 / osculating * (1.0 - c2)
    a = osculating - wave * np.cos(2.0 * argument_of_latitude(r_J, v))
    a = np.where(a > 0.0, a, np.nan)  # no orbit is closed that leaves the Earth
    drift = 0.75 * J2_EARTH * (EARTH_RADIUS / a) ** 2
    return np.asarray(np.sqrt(GM_EARTH / a**3) * (1.0 + drift * (8.0 * c2 - 2.0)))


def even_motion(t_ns: Epochs, u: Array, rate: float) -> OrbitPhase | None:
    """The even motion of phases u (m,) at epochs (m,), near a ``rate`` that is known to :data:`DOUBT`; None where
    they follow none."""
    if u.size == 0:
        return None
    first = int(t_ns.min())
    t: Array = 1e-9 * (t_ns - first).astype(np.float64)
    span = float(t.max())
    half = max(int(np.ceil(STEPS * DOUBT * rate * span / (2.0 * np.pi))), 1)
    off = DOUBT * rate * np.arange(-half, half + 1) / half
    # the resultant of what an even motion leaves, a trial motion at a time
    resultant = np.array([np.abs(np.mean(np.exp(1j * (u - (rate + trial) * t)))) for trial in off])
    best = np.flatnonzero(resultant >= SAME_PEAK * resultant.max())
    start = rate + float(off[best[np.argmin(np.abs(off[best]))]])
    if resultant.max() < COHERENT - 0.1:
        return None
    rate, phase, left = _fitted(t, u, start)
    if np.mean(np.cos(left)) < COHERENT:
        return None
    return OrbitPhase(first - round(1e9 * (phase / rate)), rate)


def _fitted(t: Array, u: Array, rate: float) -> tuple[float, float, Array]:
    """Rate, phase at time 0 and what is left, by least squares of the phases about a motion close to theirs."""
    middle = np.angle(np.mean(np.exp(1j * (u - rate * t))))
    away = np.angle(np.exp(1j * (u - rate * t - middle)))
    if np.ptp(t) * rate < 1.0:  # less than a radian of the orbit tells no rate
        return rate, float(middle), away
    slope, offset = np.polyfit(t - t.mean(), away, 1)
    return (
        rate + float(slope),
        float(middle + offset - slope * t.mean()),
        away - slope * (t - t.mean()) - offset,
    )


def sun_J(t_ns: Epochs) -> Array:
    """Direction (..., 3) of the Sun; to 0.02 deg.

    Source: Astronomical Almanac, low-precision formulas for the Sun and for Greenwich mean sidereal time.
    """
    day, part = tt_julian(t_ns)
    d = day - 2_451_545.0 + part
    g = DEG * (357.528 + 0.9856003 * d)
    longitude = DEG * (280.460 + 0.9856474 * d + 1.915 * np.sin(g) + 0.020 * np.sin(2.0 * g))
    tilt = DEG * (23.439 - 4e-7 * d)
    turn = DEG * (280.46061837 + 360.98564736629 * (d + (_utc_minus_tai(t_ns) - 32.184) / 86400.0))
    # the Sun's right ascension and declination, then its direction in the Earth's axes
    x, y, z = np.cos(longitude), np.cos(tilt) * np.sin(longitude), np.sin(tilt) * np.sin(longitude)
    return np.stack([np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x, z], axis=-1)


def sun_beta(t_ns: Epochs, r_J: Array, v_J: Array) -> Array:
    """Height (...) of the Sun above the orbit's plane, rad, positive on the side of the orbit's normal; to 0.02 deg."""
    h = np.cross(r_J, inertial_velocity(r_J, v_J))
    sine = np.sum(h * sun_J(t_ns), axis=-1) / np.linalg.norm(h, axis=-1)
    return np.asarray(np.arcsin(np.clip(sine, -1.0, 1.0)))


def _utc_minus_tai(t_ns: Epochs) -> Array:
    try:
        return np.asarray(utc_minus_tai(t_ns), dtype=np.float64)
    except EpochError:  # a second is 0.004 deg of the Earth's turn
        return np.full(t_ns.shape, float(LATEST_UTC_MINUS_TAI))


@dataclass(frozen=True)
class Phases:
    """Argument of latitude ``u`` (m,) and height ``beta`` (m,) of the Sun above the orbit's plane, rad, NaN where no
    orbit covers an image; ``orbit`` is the even motion through all of them, None where there is none."""

    u: Array
    beta: Array
    orbit: OrbitPhase | None


def phases(campaign: Campaign) -> Phases:
    """Of the images of a campaign, by its orbit."""
    t_ns = campaign.images.t_ns
    nothing = np.full(t_ns.size, np.nan)
    covered = campaign.ephemeris.bursts.covers(t_ns)
    try:
        r_J, v_J = campaign.ephemeris.at(t_ns[covered])
    except EpochError:  # positions alone, too few of them for a velocity
        return Phases(nothing, nothing, None)
    if not np.any(covered):
        return Phases(nothing, nothing, None)
    u, beta = nothing.copy(), nothing.copy()
    u[covered], beta[covered] = latitude_argument(r_J, v_J), sun_beta(t_ns[covered], r_J, v_J)
    rate = float(np.median(mean_rate(r_J, v_J)))
    if not rate > _LEAST_RATE:
        return Phases(u, beta, None)
    return Phases(u, beta, even_motion(t_ns[covered], u[covered], rate))
