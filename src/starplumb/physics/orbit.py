"""Orbits and pointing for simulation and planning: Keplerian motion with the secular drift by J2, camera turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import so3

Array = NDArray[np.float64]

GM_EARTH = 3.986004418e14
"""m^3/s^2 (IERS Conventions 2010)."""
J2_EARTH = 1.0826359e-3
"""Dynamical form factor (IERS Conventions 2010)."""
EARTH_RADIUS = 6378136.6
"""Equatorial radius that goes with GM and J2 (IERS Conventions 2010), m."""


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
