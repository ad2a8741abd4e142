"""From a marker's place to the direction in which the camera sees it: light time, refraction, aberration.

Everything is computed in the axes of J at the instant of exposure, taken as inertial for the flight of the light; the
velocities in play are geocentric, which a camera near the Earth may use: the Earth's own 30 km/s turn marker and camera
alike and cancel (checked against SPICE CN+S to 0.0004 arcsec).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .earth import OMEGA_EARTH, itrf_to_geodetic
from .units import C_LIGHT

Array = NDArray[np.float64]

REFRACTIVITY = 2.77e-4
"""n - 1 of visible light at sea level (standard air)."""
SCALE_HEIGHT = 8200.0
"""Height over which the refractivity falls by e, m."""


@dataclass(frozen=True)
class Corrections:
    """The light effects that the observations contain, so that the model must contain them.

    ``aberration`` is False where the attitude product has it absorbed already.
    """

    light_time: bool = True
    aberration: bool = True
    refraction: bool = False


def apparent_direction(
    p_J: ArrayLike, r_J: ArrayLike, v_J: ArrayLike | None, corrections: Corrections
) -> tuple[Array, Array]:
    """Unit vector e_J from the camera to the marker as it is seen, and the range (m).

    Shapes: marker ``p_J``, camera ``r_J`` and its velocity relative to the turning Earth ``v_J`` (..., 3) in m and m/s;
    ``v_J`` is needed for the aberration only.
    """
    p = np.asarray(p_J, dtype=np.float64)
    r = np.asarray(r_J, dtype=np.float64)
    if corrections.light_time:
        p = emission_place(p, r)
    if corrections.refraction:
        p = p + refraction_shift(p, r)
    u = p - r
    distance = np.sqrt(np.vecdot(u, u))
    e = u / distance[..., None]
    if corrections.aberration:
        if v_J is None:
            raise ValueError("the aberration needs the velocity of the camera")
        e = aberrate(e, inertial_velocity(r, v_J))
    return e, distance


def emission_place(p_J: Array, r_J: Array) -> Array:
    """Marker when the light left it: ``R_z(-omega tau) p_J``, ``tau = |p - r| / c`` (the Earth has turned since)."""
    u = p_J - r_J
    angle = OMEGA_EARTH / C_LIGHT * np.sqrt(np.vecdot(u, u))
    x, y = p_J[..., 0], p_J[..., 1]
    # the angle is 2e-7 rad: cos = 1 - 2e-14, so the chord is exact to 1e-7 m
    return np.stack([x + angle * y, y - angle * x, np.broadcast_to(p_J[..., 2], angle.shape)], axis=-1)


def inertial_velocity(r_J: ArrayLike, v_J: ArrayLike) -> Array:
    """Geocentric velocity along the axes of J: ``v_J + omega x r_J``, m/s."""
    r, v = np.asarray(r_J, dtype=np.float64), np.asarray(v_J, dtype=np.float64)
    turn = np.stack([-OMEGA_EARTH * r[..., 1], OMEGA_EARTH * r[..., 0], np.zeros_like(r[..., 0])], axis=-1)
    return np.asarray(v + turn)


def aberrate(e: Array, velocity: Array) -> Array:
    """Direction seen by a moving observer, exact: the Lorentz transform of the light's direction.

    ``e' = (e/g + b + b (e.b)/(1 + 1/g)) / (1 + e.b)`` with ``b = v/c``, ``g = 1/sqrt(1 - b^2)``.
    Source: Urban and Seidelmann, Explanatory Supplement to the Astronomical Almanac, 3rd ed., section 7.2.3.
    """
    b = velocity / C_LIGHT
    eb = np.vecdot(e, b)[..., None]
    inverse_g = np.sqrt(1.0 - np.vecdot(b, b))[..., None]
    return np.asarray((inverse_g * e + (1.0 + eb / (1.0 + inverse_g)) * b) / (1.0 + eb))


def refraction_shift(p_J: Array, r_J: Array) -> Array:
    """Shift of the marker that makes the straight line the one along which its light arrives, m.

    Light rises steeper through the dense air than outside, so the line outside, drawn back to the ground, meets it
    farther from the camera's foot by ``D = tan z / cos^2 z * integral (n - 1) dh``, z the zenith distance of the camera
    seen from the marker, for an exponential atmosphere ``(n0 - 1) H exp(-h/H)`` above the marker.  First order in
    n - 1; against a ray trace through shells it is good to 5 % up to 40 deg off nadir (2.1 m at 30 deg from 600 km).
    """
    latitude, longitude, height = itrf_to_geodetic(p_J)
    up = np.stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)],
        axis=-1,
    )
    u = p_J - r_J
    e = u / np.linalg.norm(u, axis=-1, keepdims=True)
    cos_z = -np.sum(e * up, axis=-1, keepdims=True)
    away = e + cos_z * up  # horizontal, length sin z
    column = REFRACTIVITY * SCALE_HEIGHT * np.exp(-height / SCALE_HEIGHT)[..., None]
    return np.asarray(column * away / cos_z**3)
