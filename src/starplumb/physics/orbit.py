"""Orbits and pointing: Keplerian motion with the drift by J2, camera turns, velocities held against positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import so3
from .earth import OMEGA_EARTH

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]

GM_EARTH = 3.986004418e14
"""m^3/s^2 (IERS Conventions 2010)."""
J2_EARTH = 1.0826359e-3
"""Dynamical form factor (IERS Conventions 2010)."""
EARTH_RADIUS = 6378136.6
"""Equatorial radius that goes with GM and J2 (IERS Conventions 2010), m."""
VELOCITY_NOISE = 2.0
"""Median contradiction, m/s, that the noise of velocities may cause."""
POSITION_NOISE_M = 40.0
"""The same of positions; divided by the time between two of them."""
_OF_BEND = 0.1
"""Part of the bend of the path between two samples that what is left out of the force model may be."""
MOST_COMPARED = 500
"""Samples of a long orbit whose velocities are compared with the positions."""
_MINUTE_NS = 60 * 10**9


class Orbit(Protocol):
    """What a simulation needs of an orbit."""

    def at(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Inertial position r_I (..., 3) m and velocity v_I (..., 3) m/s, ``time_s`` (...) after its epoch."""
        ...


@dataclass(frozen=True)
class KeplerOrbit:
    """Mean elements at time 0, m and rad; J2 turns node, perigee and mean anomaly at their secular rates.

    ``dO/dt = -3/2 n J2 (R/p)^2 cos i``, ``dw/dt = 3/4 n J2 (R/p)^2 (5 cos^2 i - 1)``,
    ``dM/dt = n [1 + 3/4 J2 (R/p)^2 sqrt(1 - e^2) (3 cos^2 i - 1)]``, ``p = a (1 - e^2)``, ``n = sqrt(GM/a^3)``.
    Source: D. A. Vallado, Fundamentals of Astrodynamics and Applications, 4th ed., section 9.6.
    """

    semi_major_axis: float
    eccentricity: float
    inclination: float
    node: float
    perigee: float
    mean_anomaly: float
    j2: float = J2_EARTH

    def at(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Inertial position r_I (..., 3) m and velocity v_I (..., 3) m/s, ``time_s`` after the elements' epoch.

        The velocity is the derivative of the position, the drift of the elements included.
        """
        t = np.asarray(time_s, dtype=np.float64)
        a, e, i = self.semi_major_axis, self.eccentricity, self.inclination
        n = np.sqrt(GM_EARTH / a**3)
        p = a * (1.0 - e * e)
        drift = 0.75 * n * self.j2 * (EARTH_RADIUS / p) ** 2
        c2 = np.cos(i) ** 2
        root = np.sqrt(1.0 - e * e)
        node_rate, perigee_rate = -2.0 * drift * np.cos(i), drift * (5.0 * c2 - 1.0)
        mean_rate = n + drift * root * (3.0 * c2 - 1.0)
        E = _eccentric_anomaly(self.mean_anomaly + mean_rate * t, e)
        x, y = a * (np.cos(E) - e), a * root * np.sin(E)
        rate = mean_rate * a / (1.0 - e * np.cos(E))
        vx = -rate * np.sin(E) - perigee_rate * y
        vy = rate * root * np.cos(E) + perigee_rate * x
        P, Q = _perifocal(self.node + node_rate * t, self.perigee + perigee_rate * t, i)
        r_I = x[..., None] * P + y[..., None] * Q
        turn = node_rate * np.stack([-r_I[..., 1], r_I[..., 0], np.zeros_like(x)], axis=-1)
        return r_I, vx[..., None] * P + vy[..., None] * Q + turn


def _eccentric_anomaly(mean: Array, e: float) -> Array:
    """Kepler's equation by Newton's method, to rounding."""
    E = mean + e * np.sin(mean)
    for _ in range(12):
        E = E - (E - e * np.sin(E) - mean) / (1.0 - e * np.cos(E))
    return np.asarray(E)


def _perifocal(node: Array, perigee: Array, i: float) -> tuple[Array, Array]:
    """Unit vectors towards perigee and 90 deg ahead of it, in I."""
    cO, sO, cw, sw, ci, si = (
        *(f(x) for x in (node, perigee) for f in (np.cos, np.sin)),
        np.cos(i),
        np.sin(i),
    )
    P = np.stack([cO * cw - sO * sw * ci, sO * cw + cO * sw * ci, sw * si], axis=-1)
    Q = np.stack([-cO * sw - sO * cw * ci, -sO * sw + cO * cw * ci, cw * si], axis=-1)
    return P, Q


def argument_of_latitude(r_I: ArrayLike, v_I: ArrayLike) -> Array:
    """Angle u (...), rad, from the ascending node to the satellite, of inertial states (..., 3)."""
    r, v = np.asarray(r_I, dtype=np.float64), np.asarray(v_I, dtype=np.float64)
    h = np.cross(r, v)
    h = h / np.linalg.norm(h, axis=-1, keepdims=True)
    # with i the inclination: r_z = r sin i sin u, and (z x h) . r = r sin i cos u
    return np.asarray(np.arctan2(r[..., 2], h[..., 0] * r[..., 1] - h[..., 1] * r[..., 0]))


def C_RO(r_R: ArrayLike, v_R: ArrayLike) -> Array:
    """Orbital frame O (x along track, y against the orbit normal, z down) in the frame R of position and velocity.

    (..., 3), (..., 3) -> (..., 3, 3), columns the axes of O.
    """
    r, v = np.asarray(r_R, dtype=np.float64), np.asarray(v_R, dtype=np.float64)
    z = -r / np.linalg.norm(r, axis=-1, keepdims=True)
    y = np.cross(z, v)
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=-1)


def turned(C_RO: Array, roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> Array:
    """Orbital frame after a turn: yaw about z, then pitch about the new y, then roll about the new x (rad).

    Positive pitch looks ahead (z turns towards +x), positive roll to the left of the flight (z turns towards -y).
    """
    axis = np.eye(3)
    angles = [np.asarray(angle, dtype=np.float64)[..., None] for angle in (yaw, pitch, roll)]
    Z, Y, X = so3.exp(angles[0] * axis[2]), so3.exp(angles[1] * axis[1]), so3.exp(angles[2] * axis[0])
    return np.asarray(C_RO @ Z @ Y @ X)


def pointing(r_R: Array, v_R: Array, target_R: Array, yaw: ArrayLike = 0.0) -> Array:
    """C_RK of a camera whose boresight passes through a target, rows growing along the track, turned by yaw about it.

    Shapes (..., 3) -> (..., 3, 3).
    """
    z = target_R - r_R
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    x = np.cross(v_R, z)  # y_K = z x x lies along the velocity as far as the boresight lets it
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    C_RK = np.stack([x, np.cross(z, x), z], axis=-1)
    return np.asarray(C_RK @ so3.exp(np.asarray(yaw, dtype=np.float64)[..., None] * np.eye(3)[2]))


def velocity_fault(t_ns: Epochs, r: Array, v: Array, last: Epochs, *, turning: bool = True) -> str | None:
    """What contradicts the velocities ``v`` (n, 3) m/s of positions ``r`` (n, 3) m at ``t_ns`` (n,), or None.

    ``last`` (n,) is the last sample of the burst of each; ``turning``: the frame turns with the Earth.  Velocities in
    other units, or inertial ones, contradict the motion of the positions.  Between samples h apart, whatever their
    step, the corrected trapezium holds::

        (v_0 + v_1) / 2 = (r_1 - r_0) / h + h (a_1 - a_0) / 12 + O(h^4 r^(5) / 720)

    with the accelerations of gravity and of the turning Earth: 0.1 m/s at 300 s in a low orbit.  A sample is compared
    with the last one of its burst at most a minute later, or else with the next, so that noise of the positions counts
    little.
    """
    first, second = _compared(t_ns, last)
    if first.size == 0:
        return None
    h = (t_ns[second] - t_ns[first])[:, None] * 1e-9
    a = _acceleration(r, v, OMEGA_EARTH if turning else 0.0)
    bend = h * (a[second] - a[first]) / 12.0
    moved = (r[second] - r[first]) / h + bend
    stated = 0.5 * (v[first] + v[second])
    offset = _median_length(stated - moved)
    noise = VELOCITY_NOISE + POSITION_NOISE_M / float(np.median(h))
    if offset <= noise + _OF_BEND * _median_length(bend):
        return None
    return (
        f"the velocities differ from the motion of the positions by {offset:.0f} m/s"
        f"{_likely(moved, stated, 0.5 * (r[first] + r[second]), turning)}; "
        "wanted m/s in the frame of the positions (for ITRF relative to the turning Earth)"
    )


def _compared(t_ns: Epochs, last: Epochs) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of samples (p,) of one burst, a minute or one step apart; of a long series some evenly spread."""
    first = np.flatnonzero(last > np.arange(t_ns.size))
    first = first[:: max(first.size // MOST_COMPARED, 1)]
    within = np.searchsorted(t_ns, t_ns[first] + _MINUTE_NS, side="right") - 1
    return first, np.clip(within, first + 1, last[first])


def _acceleration(r: Array, v: Array, rate: float) -> Array:
    """Acceleration (..., 3) m/s^2 in axes turning about z: ``-mu r / |r|^3 - 2 w x v - w x (w x r)``."""
    w = np.array([0.0, 0.0, rate])
    gravity = -GM_EARTH * r / np.linalg.norm(r, axis=-1, keepdims=True) ** 3
    return np.asarray(gravity - np.cross(w, 2.0 * v + np.cross(w, r)))


def _median_length(vectors: Array) -> float:
    return float(np.median(np.linalg.norm(vectors, axis=-1)))


def _likely(moved: Array, stated: Array, r: Array, turning: bool) -> str:
    """What the velocities seem to be instead at the places ``r`` between, where one assumption explains them."""
    spin = np.cross([0.0, 0.0, OMEGA_EARTH], r)
    if turning and _median_length(stated - spin - moved) < 0.2 * _median_length(stated - moved):
        return " (they look like inertial velocities, turned into the axes of the Earth)"
    times = _median_length(stated) / _median_length(moved)
    if _median_length(stated - times * moved) < 0.2 * _median_length(stated - moved):
        return f" (they are {float(f'{times:.2g}'):g} times that motion: another unit?)"
    return ""
