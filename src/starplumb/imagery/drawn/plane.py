"""The plane on which ground is drawn: longitude and latitude as metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.earth import WGS84_A, WGS84_F

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plane:
    """Longitude and latitude as metres about a place (rad): ``x`` grows with the longitude, ``y`` with the latitude.

    Both are linear, so that a grid of the plane is one of longitude and latitude; true to scale at the place itself.
    """

    latitude: float
    longitude: float

    @property
    def radii(self) -> tuple[float, float]:
        """Metres per radian of longitude and of latitude."""
        squared = WGS84_F * (2.0 - WGS84_F)
        bend = 1.0 - squared * np.sin(self.latitude) ** 2
        east = WGS84_A / np.sqrt(bend) * np.cos(self.latitude)
        return float(east), float(WGS84_A * (1.0 - squared) / bend**1.5)

    def metres(self, latitude: Array, longitude: Array) -> tuple[Array, Array]:
        """x and y (...) of places (...)."""
        east, north = self.radii
        return east * (longitude - self.longitude), north * (latitude - self.latitude)

    def geodetic(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Latitude and longitude (...) of places (...)."""
        east, north = self.radii
        return self.latitude + y / north, self.longitude + x / east
