"""Where on the ground a pixel looks, and how well that is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics import so3
from ..physics.earth import C_JT, itrf_to_geodetic
from ..physics.units import DEG
from ..table.campaign import Campaign
from ..table.geometry import locate, position_covariance, stations

Array = NDArray[np.float64]
Index = NDArray[np.int64]

GRAZING = 3.0 * DEG
"""A line of sight that meets the ground at a smaller angle leaves no covariance: the ground bends before it ends."""


@dataclass(frozen=True)
class Location:
    """Ground points of n pixels: ``p_J`` (n, 3) m, geodetic ``latitude``, ``longitude`` (n,) rad and ``height`` (n,) m,
    and the covariance of their error along east, north, up (n, 3, 3) m^2, with its square roots ``sigma_T`` (n, 3)."""

    p_J: Array
    latitude: Array
    longitude: Array
    height: Array
    covariance_T: Array

    @property
    def sigma_T(self) -> Array:
        # a point slides on its level surface: up to rounding nothing is left of the variance upwards
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance_T, axis1=-2, axis2=-1), 0.0)))


def ground(
    campaign: Campaign,
    C_EK: Array,
    covariance_E: Array,
    image: Index,
    pixel: Array,
    height: ArrayLike,
    sigma_px: float = 0.0,
    sigma_height: float = 0.0,
    slopes: Callable[[Array], Array] | None = None,
) -> Location:
    """Ground points of pixels (n, 2) of images (n,) at heights above the ellipsoid, m, with their covariance.

    A point ``p = r + s u`` slides on the ground: ``dp = (I - u n^T / n.u) (s du + dr) + u dh / n.u`` with
    ``du = -C_JE [e_E] (d_E + alpha_E)`` plus the pixel's, dh the error of the height below it, and the normal
    ``n = up - a east - b north`` of ground that rises by (a, b) to the east and north: what ``slopes`` makes of points
    (n, 3), level where it is None.  Where a line of sight grazes the ground the covariance is NaN.
    The errors of the mounting (``covariance_E`` rad^2), of the image's attitude and of its position are taken as
    independent, as they are for an image that the mounting was not estimated from.
    Raises EpochError for an image outside the orbit or attitude; points are NaN where a line of sight misses the Earth.
    """
    station = stations(campaign, image, pixel[:, 1])
    p_J = locate(campaign, C_EK, image, pixel[:, 0], pixel[:, 1], height)
    latitude, longitude, level = itrf_to_geodetic(p_J)
    C = C_JT(latitude, longitude)
    normal = C[..., :, 2]
    if slopes is not None:
        normal = normal - (C[..., :, :2] @ slopes(p_J)[..., None])[..., 0]
    distance = np.linalg.norm(p_J - station.r_J, axis=-1)
    u_J = (p_J - station.r_J) / distance[:, None]
    e_E = station.C_EJ @ u_J[..., None]
    along = np.vecdot(normal, u_J)
    along = np.where(along < -np.sin(GRAZING) * np.linalg.norm(normal, axis=-1), along, np.nan)[:, None, None]
    slide = np.eye(3) - u_J[:, :, None] * normal[:, None, :] / along
    turn = -slide @ station.C_EJ.mT @ so3.skew(e_E[..., 0]) * distance[:, None, None]
    attitude_E = np.broadcast_to(campaign.cov_attitude_E, (len(campaign.images.ids), 3, 3))[image]
    covariance_J = turn @ (covariance_E + attitude_E) @ turn.mT
    covariance_J = covariance_J + slide @ position_covariance(campaign)[image] @ slide.mT
    pointed = slide @ _pixel_slope(campaign, C_EK, station.C_EJ, pixel) * distance[:, None, None]
    covariance_J = covariance_J + sigma_px**2 * (pointed @ pointed.mT)
    raised = u_J[:, :, None] / along
    covariance_J = covariance_J + sigma_height**2 * (raised @ raised.mT)
    return Location(p_J, latitude, longitude, level, C.mT @ covariance_J @ C)


def _pixel_slope(campaign: Campaign, C_EK: Array, C_EJ: Array, pixel: Array) -> Array:
    """d u_J / d pixel (n, 3, 2) of the unit direction; a scanner's row moves it by a pixel along the track."""
    xy_K, slope = campaign.camera.tan_from_px(pixel[:, 0], pixel[:, 1])
    if campaign.camera.scans:
        slope = slope.copy()
        slope[..., 0, 1], slope[..., 1, 1] = -slope[..., 1, 0], slope[..., 0, 0]
    norm = np.sqrt(1.0 + np.sum(xy_K**2, axis=-1))[:, None, None]
    s_K = np.concatenate([xy_K, np.ones((len(pixel), 1))], axis=-1)[..., None]
    ds_K = np.concatenate([slope, np.zeros((len(pixel), 1, 2))], axis=-2)
    tangent = ds_K / norm - s_K @ (s_K.mT @ ds_K) / norm**3
    return np.asarray(C_EJ.mT @ C_EK @ tangent)
