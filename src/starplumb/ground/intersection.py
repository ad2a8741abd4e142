"""Ground points from several images: the only check of heights that single lines of sight allow.

Each sighting gives a line through the air along which its ray arrives; a landmark seen from directions far enough apart
is where its lines meet: ``p = (sum Q_i)^-1 sum Q_i a_i`` with ``Q_i = I - u_i u_i^T`` (a_i a point on line i, u_i its
direction), which minimises the sum of squared distances to the lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.earth import C_JT, itrf_to_geodetic
from ..physics.units import DEG
from ..table.campaign import Campaign
from ..table.geometry import locate

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEAST_ANGLE = 5.0 * DEG
"""Lines of sight nearer to each other than this give no height worth the name (the error grows with 1/sin)."""
_APART_M = 1000.0
"""Height between the two points that define a line near the ground: the ray is straight between them."""


@dataclass(frozen=True)
class Intersections:
    """``landmark`` (k,) those seen from directions at least LEAST_ANGLE apart; ``error_T`` (k, 3) m east, north, up of
    the place where their lines of sight meet, against the survey."""

    landmark: Index
    error_T: Array

    @property
    def ce90(self) -> float:
        """Radius that holds 90 % of the horizontal errors, m."""
        return float(np.quantile(np.hypot(self.error_T[:, 0], self.error_T[:, 1]), 0.9))

    @property
    def le90(self) -> float:
        """Height error that 90 % of the points do not exceed, m."""
        return float(np.quantile(np.abs(self.error_T[:, 2]), 0.9))


def intersect(campaign: Campaign, C_EK: Array, chosen: NDArray[np.bool_]) -> Intersections:
    """Intersect the lines of sight of the sightings ``chosen`` (n,) of each landmark seen more than once."""
    s, L = campaign.sightings, len(campaign.landmarks.ids)
    often = np.bincount(s.landmark[chosen], minlength=L) > 1
    rows = np.flatnonzero(chosen & often[s.landmark])
    a_J, u_J = _lines(campaign, C_EK, rows)
    seen = np.all(np.isfinite(a_J) & np.isfinite(u_J), axis=-1)
    rows, a_J, u_J = rows[seen], a_J[seen], u_J[seen]
    Q = np.eye(3) - u_J[:, :, None] * u_J[:, None, :]
    N, b = np.zeros((L, 3, 3)), np.zeros((L, 3))
    place_J = campaign.landmarks.r_J
    landmark = s.landmark[rows]
    np.add.at(N, landmark, Q)
    np.add.at(b, landmark, (Q @ (a_J - place_J[landmark])[..., None])[..., 0])
    # two lines at an angle g have 1 - cos g as the smallest eigenvalue of N
    wide = np.flatnonzero(np.linalg.eigvalsh(N)[:, 0] >= 1.0 - np.cos(LEAST_ANGLE))
    error_J = np.linalg.solve(N[wide], b[wide, :, None])
    latitude, longitude, _ = itrf_to_geodetic(place_J[wide])
    return Intersections(wide, np.asarray((C_JT(latitude, longitude).mT @ error_J)[..., 0]))


def _lines(campaign: Campaign, C_EK: Array, rows: Index) -> tuple[Array, Array]:
    """A point (r, 3) on the line of each sighting, at its landmark's own height, and the line's direction (r, 3)."""
    s = campaign.sightings
    _, _, height = itrf_to_geodetic(campaign.landmarks.r_J[s.landmark[rows]])
    low, high = (
        locate(campaign, C_EK, s.image[rows], s.column_px[rows], s.row_px[rows], height + rise)
        for rise in (0.0, _APART_M)
    )
    along = high - low
    return low, along / np.linalg.norm(along, axis=-1, keepdims=True)
