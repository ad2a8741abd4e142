"""The scenes of Lebedev and Tkachenko 2012, equations (23)-(27): a circular orbit over markers about its nadir."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics import so3
from ..physics.earth import C_JT, OMEGA_EARTH, geodetic_to_itrf
from ..physics.orbit import GM_EARTH
from ..physics.units import DEG
from ..table.observations import Observations
from .still import still_frames

Array = NDArray[np.float64]
Index = NDArray[np.int64]

C_EK_TRUE = np.diag([1.0, -1.0, -1.0])
"""E and K coincide in the slides, whose camera looks along -z; ours looks along +z with y turned over."""

C_JI = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""The slides' inertial axes are (90 deg E, north, 0 deg E), ours at the moment of nadir (0 deg E, 90 deg E, north)."""


@dataclass(frozen=True)
class Nadir:
    """The moment of nadir: argument of latitude u, node and inclination (rad), height (m), and the site below (rad)."""

    u: float
    node: float
    inclination: float
    height: float
    latitude: float
    longitude: float

    @classmethod
    def over(cls, orbit: Mapping[str, Any], height: float) -> Nadir:
        """The orbit of ``slides2012.toml`` over its site, ``e_c = e_T`` of (25)."""
        latitude, inclination = orbit["latitude_deg"] * DEG, orbit["inclination_deg"] * DEG
        u = float(np.arcsin(np.sin(latitude) / np.sin(inclination)))
        if not orbit["ascending"]:
            u = np.pi - u
        up = orbital_axes(u, orbit["node_deg"] * DEG, inclination)[:, 2]
        longitude = float(np.arctan2(up[0], up[2]))
        return cls(u, orbit["node_deg"] * DEG, inclination, height, latitude, longitude)

    @property
    def site_J(self) -> Array:
        return geodetic_to_itrf(self.latitude, self.longitude, 0.0)

    @property
    def C_JT(self) -> Array:
        return C_JT(self.latitude, self.longitude)

    def at(self, time_s: float) -> tuple[Array, Array]:
        """Position r_J (3,) m and attitude C_EJ (3, 3) of a camera that keeps the orbital frame, after the nadir.

        The site's distance from the centre of the Earth stands for R of (27).
        """
        radius = float(np.linalg.norm(self.site_J)) + self.height
        turned = self.u + np.sqrt(GM_EARTH / radius**3) * time_s
        C_turning = so3.exp(np.array([0.0, 0.0, -OMEGA_EARTH * time_s])) @ C_JI
        now = C_turning @ orbital_axes(turned, self.node, self.inclination)
        start = C_JI @ orbital_axes(self.u, self.node, self.inclination)
        # the arc is laid from the point above the site, so that nadir is nadir on the ellipsoid too
        r_J = self.site_J + self.height * start[:, 2] + radius * (now[:, 2] - start[:, 2])
        return r_J, now.mT


def orbital_axes(u: float, node: float, inclination: float) -> Array:
    """C_IO (3, 3) in the slides' inertial axes: columns along track, to the left of it, and up; up is e_c of (25)."""
    ci, si = np.cos(inclination), np.sin(inclination)
    cn, sn, cu, su = np.cos(node), np.sin(node), np.cos(u), np.sin(u)
    up = np.array([cu * sn + su * cn * ci, su * si, cu * cn - su * sn * ci])
    along = np.array([-su * sn + cu * cn * ci, cu * si, -su * cn - cu * sn * ci])
    return np.stack([along, np.cross(up, along), up], axis=-1)


def photographs(
    nadir: Nadir, time_s: float, marker_T: ArrayLike, image: Index, tan_px: float, **sigmas: Any
) -> Observations:
    """True table of markers (..., n, 3) m about the site, each with its own landmark, seen in the given images (n,).

    All images are taken from the same place (only the markers differ).  ``tan_px`` and ``sigmas`` as in
    :func:`starplumb.published.still.still_frames`.
    """
    r_J, C_EJ = nadir.at(time_s)
    p_J = nadir.site_J + np.asarray(marker_T) @ nadir.C_JT.mT
    return still_frames(r_J[None], C_EJ[None], p_J, image, np.arange(image.size), C_EK_TRUE, tan_px, **sigmas)
