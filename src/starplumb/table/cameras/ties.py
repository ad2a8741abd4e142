"""Tie points: places nobody surveyed, seen in several images or by several cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.earth import C_JT, intersect_ellipsoid, itrf_to_geodetic
from ...physics.errors import EpochError
from ..campaign import Campaign
from ..geometry import locate
from ..observations import Observations
from .views import of_camera

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RAYS_M, HEIGHTS_M = 10.0, 3000.0
"""Sigmas of the distance of a ray from its tie point and of this point's height, which decides where the rays are
parallel."""


def guessed(campaign: Campaign) -> Campaign:
    """The campaign with its tie points where the model mountings see them, at the mean height of the landmarks."""
    landmarks, s = campaign.landmarks, campaign.sightings
    if landmarks.tie is None:
        return campaign
    height, r_J = mean_height(campaign), np.array(landmarks.r_J)
    r_J[landmarks.tie] = _below(campaign)
    seen, rows = np.unique(s.landmark, return_index=True)
    rows = rows[landmarks.tie[seen]]
    of_image = np.zeros_like(s.image) if campaign.rig is None else campaign.rig.of_image[s.image]
    for k in np.unique(of_image[rows]).tolist():
        mine = rows[of_image[rows] == k]
        own = of_camera(campaign, k)
        try:
            p_J = locate(own, own.C_EK, s.image[mine], s.column_px[mine], s.row_px[mine], height)
        except EpochError:  # whoever needs these images says so
            continue
        there = np.all(np.isfinite(p_J), axis=-1)
        r_J[s.landmark[mine][there]] = p_J[there]
    return replace(campaign, landmarks=replace(landmarks, r_J=r_J))


def mean_height(campaign: Campaign) -> float:
    """Of the surveyed landmarks, m; 0 without any."""
    known = campaign.landmarks.r_J[campaign.landmarks.surveyed]
    return float(np.mean(itrf_to_geodetic(known)[2])) if len(known) else 0.0


def _below(campaign: Campaign) -> Array:
    """A place on the ground (3,) below the orbit."""
    r_J = campaign.ephemeris.r_J[0]
    return np.asarray(6.371e6 * r_J / np.linalg.norm(r_J))


def meeting_points(o: Observations, C_EK: Array, landmarks: NDArray[np.int64], height: float) -> Array:
    """Where the rays of the sightings of landmarks (q,) meet, (q, 3) m; NaN where they miss the ground.

    With e the look directions from r, u the vertical and p_0 the place at ``height`` on one of the rays::

        sum_i |(I - e e^T)(p - r)|^2 / 10^2 + (u^T (p - p_0))^2 / 3000^2  ->  min
    """
    e_J = (o.C_EJ.mT @ (o.e_K @ C_EK.mT)[..., None])[..., 0]
    found = np.full((landmarks.size, 3), np.nan)
    ground = intersect_ellipsoid(o.r_J, e_J, height)
    across = np.eye(3) - e_J[:, :, None] * e_J[:, None, :]
    for at, landmark in enumerate(landmarks.tolist()):
        rows = np.flatnonzero(o.landmark == landmark)
        rows = rows[np.all(np.isfinite(ground[rows]), axis=-1)]
        if rows.size:
            p_0 = ground[rows[0]]
            latitude, longitude, _ = itrf_to_geodetic(p_0)
            u = (RAYS_M / HEIGHTS_M) * C_JT(latitude, longitude)[..., 2]
            N = np.sum(across[rows], axis=0) + u[:, None] * u
            right = np.sum((across[rows] @ (o.r_J[rows] - p_0)[..., None])[..., 0], axis=0)
            found[at] = p_0 + np.linalg.solve(N, right)
    return found
