"""Passes over a site: the orbit that makes one, the times and aims of its images, several flown as one campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics.earth import geodetic_to_itrf, intersect_ellipsoid
from ..physics.errors import InputError
from ..physics.light import inertial_velocity
from ..physics.orbit import C_RO, KeplerOrbit, Orbit, turned
from ..physics.series import Attitude, Ephemeris, Orientation
from ..table.campaign import Campaign, Images
from .scene import Pass, epochs_ns

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_STEPS = 30
"""Newton steps at most; a handful are enough wherever the site can be seen."""
_ANGLE = 1e-9
"""Look angle, rad, at which a time or an orbit is found (less than a millimetre on the ground)."""


@dataclass(frozen=True)
class SampledOrbit:
    """An ephemeris file flown from ``epoch_ns``."""

    ephemeris: Ephemeris
    orientation: Orientation
    epoch_ns: int

    def at(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Inertial r_I and v_I.  Raises EpochError outside the file."""
        t_ns = epochs_ns(self.epoch_ns, time_s)
        r_J, v_J = self.ephemeris.at(t_ns)
        C_IJ = self.orientation.C_IJ(t_ns)
        r_I, v_I = ((C_IJ @ v[..., None])[..., 0] for v in (r_J, inertial_velocity(r_J, v_J)))
        return r_I, v_I


def look_angles(
    orbit: Orbit, orientation: Orientation, epoch_ns: int, time_s: Array, p_J: Array
) -> tuple[Array, Array]:
    """Pitch (ahead) and roll (to the left), rad, at which an orbiting camera sees p_J (..., 3) at times (...)."""
    x, y, z = np.moveaxis(_in_orbital_frame(orbit, orientation, epoch_ns, time_s, p_J), -1, 0)
    return np.arctan2(x, z), np.arctan2(-y, z)


def _in_orbital_frame(
    orbit: Orbit, orientation: Orientation, epoch_ns: int, time_s: Array, p_J: Array
) -> Array:
    r_I, v_I = orbit.at(time_s)
    p_I = (orientation.C_IJ(epochs_ns(epoch_ns, time_s)) @ p_J[..., None])[..., 0]
    return np.asarray((C_RO(r_I, v_I).mT @ (p_I - r_I)[..., None])[..., 0])


def times_at_pitch(
    orbit: Orbit, orientation: Orientation, epoch_ns: int, near_s: ArrayLike, p_J: Array, pitch: Array
) -> Array:
    """Times (m,) at which passes about ``near_s`` see points p_J (3,) or (m, 3) at pitch angles (m,) rad.

    Raises InputError for an angle at which the pass does not see the point.
    """
    time: Array = np.asarray(near_s, dtype=np.float64) + np.zeros_like(pitch)
    for _ in range(_STEPS):
        ahead = look_angles(orbit, orientation, epoch_ns, time, p_J)[0] - pitch
        if np.all(np.abs(ahead) < _ANGLE):
            return time
        slope = look_angles(orbit, orientation, epoch_ns, time + 0.5, p_J)[0] - pitch - ahead
        time = time - np.clip(0.5 * ahead / np.where(slope < 0.0, slope, -1e-3), -60.0, 60.0)
    raise InputError("the pass does not see the site at one of its pitch angles")


def pass_over(
    shape: KeplerOrbit,
    orientation: Orientation,
    epoch_ns: int,
    site: tuple[float, float],
    roll: float,
    ascending: bool,
) -> KeplerOrbit:
    """The orbit of this shape (a, e, i, perigee) that sees a site (latitude, longitude; rad) abeam at its time 0.

    ``roll`` rad to the left of the flight.  Node and mean anomaly follow by Newton's method from the orbit straight
    overhead.  Raises InputError where the inclination does not reach the site.
    """
    p_J = geodetic_to_itrf(site[0], site[1], 0.0)
    p_I = orientation.C_IJ(np.int64(epoch_ns)) @ p_J
    reach = np.linalg.norm(p_I) * np.sin(shape.inclination)
    if reach == 0.0 or abs(p_I[2]) > abs(reach):
        raise InputError("the orbit's inclination does not reach the latitude of the site")
    u = np.arcsin(p_I[2] / reach) if ascending else np.pi - np.arcsin(p_I[2] / reach)
    east_of_node = np.arctan2(np.cos(shape.inclination) * np.sin(u), np.cos(u))
    place = np.array([np.arctan2(p_I[1], p_I[0]) - east_of_node, u - shape.perigee])

    def miss(elements: Array) -> Array:
        orbit = replace(shape, node=float(elements[0]), mean_anomaly=float(elements[1]))
        pitch, left = look_angles(orbit, orientation, epoch_ns, np.array(0.0), p_J)
        return np.array([pitch, left - roll])

    for _ in range(_STEPS):
        off = miss(place)
        if np.all(np.abs(off) < _ANGLE):
            return replace(shape, node=float(place[0]), mean_anomaly=float(place[1]))
        jacobian = np.stack([(miss(place + 1e-6 * axis) - off) / 1e-6 for axis in np.eye(2)], axis=-1)
        if not np.all(np.isfinite(jacobian)) or np.linalg.matrix_rank(jacobian) < 2:
            break
        place = place - np.clip(np.linalg.solve(jacobian, off), -0.1, 0.1)
    raise InputError("no orbit of this shape sees the site at the roll angle of the pass")


def aim_from_orbit(
    orbit: Orbit, orientation: Orientation, epoch_ns: int, time_s: Array, roll_pitch: Array, yaw: Array
) -> Pass:
    """Images at times (m,) whose boresight is turned from nadir by roll and pitch (m, 2) rad, aimed at where it meets
    the ellipsoid.  Raises InputError where it misses the Earth."""
    r_I, v_I = orbit.at(time_s)
    nadir = turned(C_RO(r_I, v_I), roll_pitch[:, 0], roll_pitch[:, 1], 0.0)[..., 2]
    C_JI = orientation.C_IJ(epochs_ns(epoch_ns, time_s)).mT
    r_J, u_J = ((C_JI @ v[..., None])[..., 0] for v in (r_I, nadir))
    aim_J = intersect_ellipsoid(r_J, u_J)
    if not np.all(np.isfinite(aim_J)):
        raise InputError("an image's roll and pitch point it past the Earth")
    return Pass(time_s, aim_J, yaw)


def join(campaigns: Sequence[Campaign]) -> tuple[Campaign, Index]:
    """Campaigns without markers flown one after another as one, and the index of the pass of each image (m,).

    Raises InputError where two of them overlap in time.
    """
    first = campaigns[0]
    series = [(c.ephemeris.t_ns[0], c.ephemeris.t_ns[-1], c) for c in campaigns]
    series.sort(key=lambda entry: int(entry[0]))
    if any(a[1] >= b[0] for a, b in pairwise(series)):
        raise InputError("two passes overlap in time")
    ordered = [entry[2] for entry in series]
    t_ns = np.concatenate([c.ephemeris.t_ns for c in ordered])
    velocities = [c.ephemeris.v_J for c in ordered if c.ephemeris.v_J is not None]
    flown = [len(c.images.ids) for c in campaigns]
    periods = [c.images.line_period_s for c in campaigns if c.images.line_period_s is not None]
    whole = replace(
        first,
        ephemeris=Ephemeris(
            t_ns,
            np.concatenate([c.ephemeris.r_J for c in ordered]),
            np.concatenate(velocities),
            first.ephemeris.gap_s,
        ),
        attitude=Attitude(
            t_ns,
            np.concatenate([c.one_attitude.q_EF for c in ordered]),
            first.one_attitude.frame,
            first.one_attitude.orientation,
            first.one_attitude.gap_s,
        ),
        images=Images(
            tuple(f"image{i + 1:02d}" for i in range(sum(flown))),
            np.concatenate([c.images.t_ns for c in campaigns]),
            np.concatenate(periods) if periods else None,
        ),
    )
    return whole, np.repeat(np.arange(len(campaigns)), flown)
