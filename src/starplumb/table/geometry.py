"""From a campaign to its geometry: the observation table, pixels to the ground, and the ground to pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics import so3
from ..physics.earth import intersect_ellipsoid
from ..physics.errors import EpochError, InputError
from ..physics.light import Corrections, apparent_direction
from ..physics.orientation import C_IF
from .cameras.known import RigKnown
from .cameras.views import moments
from .campaign import Campaign
from .equation import pixel_residual, predict
from .observations import Observations, sight

Array = NDArray[np.float64]
Index = NDArray[np.int64]


ROW_TOLERANCE_PX = 1e-4
"""Newton step after which a line scanner's row is found: epochs are whole nanoseconds, some 1e-5 of a row."""


@dataclass(frozen=True)
class Stations:
    """Where and how the camera stood when each of n pixels was exposed, as measured."""

    C_EJ: Array
    omega_E: Array
    r_J: Array
    v_J: Array
    line_period_s: Array


def stations(campaign: Campaign, image: Index, row_px: ArrayLike) -> Stations:
    """Attitude and orbit at the epochs of rows (n,) of images (n,): the image's own, plus row periods for a scanner.

    Where the mounting moves the attitude is that of a tracker that moves with it, ``exp(-turn) C_EJ``, and C_EK rests.
    Raises EpochError naming the image, the epoch and the nearest sample.
    """
    images = campaign.images
    period = images.period_s(image, row_px) if campaign.camera.scans else np.zeros(image.size)
    epochs, back = np.unique(images.exposed(image, row_px), return_inverse=True)
    try:
        C_EJ, omega_E = campaign.attitude.at(epochs)
        r_J, v_J = campaign.ephemeris.at(
            epochs, velocity=campaign.corrections.aberration or campaign.camera.scans
        )
    except EpochError as error:
        first = int(np.flatnonzero(back == error.row)[0])
        raise EpochError(f"{images.name}, image {images.ids[image[first]]!r}: {error}", first) from None
    C_EJ, omega_E = C_EJ[back], omega_E[back]
    if campaign.turn_E is not None:
        turn = so3.exp(-campaign.turn_E[image])
        C_EJ, omega_E = turn @ C_EJ, (turn @ omega_E[..., None])[..., 0]
    return Stations(C_EJ, omega_E, r_J[back], v_J[back], period)


def position_covariance(campaign: Campaign) -> Array:
    """Covariance of the position of each image in J (m, 3, 3): the stated sigmas turned out of the file's frame."""
    covariance, axes_J = np.diag(campaign.sigma_position**2), position_axes(campaign)
    if campaign.position_frame == "ITRF":
        return np.broadcast_to(covariance, axes_J.shape)
    return np.asarray(axes_J @ covariance @ axes_J.mT)


def position_axes(campaign: Campaign) -> Array:
    """Axes in J of the frame in which the sigmas of the positions hold, at each image (m, 3, 3)."""
    if campaign.position_frame == "ITRF":
        return np.broadcast_to(np.eye(3), (campaign.images.t_ns.size, 3, 3))
    if campaign.orientation is None:
        raise ValueError("an inertial ephemeris needs the orientation of the Earth")
    C_JI = campaign.orientation.C_IJ(campaign.images.t_ns).mT
    if campaign.position_frame == "GCRF":
        return C_JI
    return np.asarray(C_JI @ C_IF(campaign.position_frame, campaign.images.t_ns))


def apparent(campaign: Campaign, station: Stations, p_J: Array) -> dict[str, Any]:
    """Fields of :func:`sight` of markers p_J (n, 3) from the stations (n,) with the campaign's light effects."""
    s = station
    return sight(p_J, s.r_J, s.v_J, s.C_EJ, s.omega_E, s.line_period_s, campaign.corrections)


def observe(campaign: Campaign) -> Observations:
    """The observation table of a campaign: measured pixels as directions, markers as the measured geometry shows them.

    Raises EpochError where an exposure lies outside the orbit or attitude.
    """
    s = campaign.sightings
    station = stations(campaign, s.image, s.row_px)
    rig = campaign.rig if campaign.several else None
    xy_K, slope_K = (
        campaign.camera.tan_from_px(s.column_px, s.row_px)
        if rig is None
        else rig.tan_from_px(s.image, s.column_px, s.row_px)
    )
    p_J = campaign.landmarks.r_J[s.landmark]
    directions = apparent(campaign, station, p_J)
    return Observations(
        image=s.image if rig is None else moments(campaign)[s.image],
        landmark=s.landmark,
        xy_K=xy_K,
        slope_K=slope_K,
        line_period_s=station.line_period_s,
        C_EJ=station.C_EJ,
        omega_E=station.omega_E,
        r_J=station.r_J,
        v_J=station.v_J,
        p_J=p_J,
        **directions,
        sigma_px=s.sigma_px,
        ellipse=s.ellipse,
        weight=np.ones(s.image.size),
        cov_attitude_E=np.broadcast_to(campaign.cov_attitude_E, (campaign.images.t_ns.size, 3, 3)),
        cov_position_J=position_covariance(campaign),
        cov_landmark_J=campaign.landmarks.covariance_J,
        corrections=campaign.corrections,
        prior_E=campaign.prior_E,
        epoch_s=np.asarray((campaign.images.t_ns - campaign.images.t_ns[:1]) / 1e9),
        camera=None if rig is None else rig.of_image[s.image],
        C_KC=None if rig is None else rig.C_KC,
        rig_known=None if rig is None or rig.known_E is None else RigKnown(rig.C_KC, rig.known_E),
    )


def locate(
    campaign: Campaign,
    C_EK: Array,
    image: Index,
    column_px: ArrayLike,
    row_px: ArrayLike,
    height: ArrayLike = 0.0,
) -> Array:
    """Ground points p_J (n, 3) of pixels of images (n,) at a height above the ellipsoid, m; NaN where a ray misses."""
    e_J, station = looks(campaign, C_EK, image, column_px, row_px)
    return ground_points(e_J, station.r_J, station.v_J, campaign.corrections, height)


def looks(
    campaign: Campaign, C_EK: Array, image: Index, column_px: ArrayLike, row_px: ArrayLike
) -> tuple[Array, Stations]:
    """Apparent directions e_J (n, 3) in which pixels of images (n,) look, and from where."""
    station = stations(campaign, image, row_px)
    xy_K, _ = campaign.camera.tan_from_px(column_px, row_px)
    s_K = np.concatenate([xy_K, np.ones((*xy_K.shape[:-1], 1))], axis=-1)
    C_JK = station.C_EJ.mT @ C_EK
    e_J = (C_JK @ s_K[..., None])[..., 0]
    return e_J / np.linalg.norm(e_J, axis=-1, keepdims=True), station


def ground_points(
    e_J: Array, r_J: Array, v_J: Array, corrections: Corrections, height: ArrayLike = 0.0
) -> Array:
    """Points p_J (n, 3) at a height above the ellipsoid seen in the apparent directions e_J (n, 3); NaN where none is.

    The light effects are undone by iteration: the point is moved until its apparent direction is the one wanted
    (each pass gains five digits: half a millimetre is left of the first, of the second what rounding leaves, or a few
    tenths of a millimetre where refraction grows steep above the horizon).
    """
    u_J = e_J
    p_J = intersect_ellipsoid(r_J, u_J, height)
    for _ in range(2):
        seen, _ = apparent_direction(p_J, r_J, v_J, corrections)
        u_J = u_J + e_J - seen
        u_J = u_J / np.sqrt(np.vecdot(u_J, u_J))[..., None]
        p_J = intersect_ellipsoid(r_J, u_J, height)
    return p_J


def project(
    campaign: Campaign, C_EK: Array, image: Index, p_J: Array, start_px: ArrayLike | None = None
) -> Array:
    """Pixels (column, row) (n, 2) at which points p_J (n, 3) appear in images (n,).

    A frame camera needs one evaluation; a line scanner is solved for the row whose exposure has the point on the line,
    by Newton's method from ``start_px`` (n, 2), by default the middle of what the attitude covers.
    Raises EpochError when the search leaves the orbit or attitude.
    """
    pixel = middle_px(campaign, image) if start_px is None else np.array(start_px, dtype=np.float64)
    for _ in range(1 if not campaign.camera.scans else 20):
        station = stations(campaign, image, pixel[:, 1])
        directions = apparent(campaign, station, p_J)
        if not campaign.camera.scans:
            return campaign.camera.px_from_tan(predict(C_EK, directions["e_E"]))
        step = scan_step(campaign, C_EK, pixel, directions)
        pixel = pixel + step
        if np.all(np.abs(step) < ROW_TOLERANCE_PX):
            return pixel
    raise InputError("the search for the row of a point did not converge; the point is not in the image")


def middle_px(campaign: Campaign, image: Index) -> Array:
    """A pixel of each image to start from: its centre, or row 0 where the number of rows is not known."""
    columns, rows = campaign.camera.size_px
    middle = np.array([(columns - 1.0) / 2.0, (rows - 1.0) / 2.0 if np.isfinite(rows) else 0.0])
    return np.array(np.broadcast_to(middle, (image.size, 2)))


def scan_step(campaign: Campaign, C_EK: Array, pixel: Array, directions: dict[str, Array]) -> Array:
    """Newton step (n, 2) of the pixel at which a point crosses the line of detectors."""
    xy_K, slope = campaign.camera.tan_from_px(pixel[:, 0], pixel[:, 1])
    return pixel_residual(C_EK, directions["e_E"], xy_K, slope, directions["row_rate_E"])
