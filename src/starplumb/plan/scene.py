"""True scenes: an orbit flown, images pointed, markers surveyed, so that every measurement follows from known truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics import so3
from ..physics.camera import Camera, LineScanCamera
from ..physics.earth import C_JT, OMEGA_EARTH, geodetic_to_itrf, itrf_to_geodetic
from ..physics.light import Corrections, inertial_velocity
from ..physics.orbit import C_RO, Orbit, pointing
from ..physics.series import Attitude, Ephemeris, Orientation
from ..table.campaign import Campaign, Images, Landmarks, SharedErrors, Sightings
from ..table.geometry import locate, project
from ..table.simulate import Errors

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Epochs = NDArray[np.int64]

SAMPLES_PER_SECOND = 8
"""Rate of the simulated attitude and orbit samples around each image, Hz."""


@dataclass(frozen=True)
class Sigmas:
    """Stated standard deviations: attitude (3,) rad about E, position (3,) m along J, markers (3,) m east, north, up,
    pixels."""

    attitude: Array
    position: Array
    landmark: Array
    pixel: float


def epochs_ns(epoch_ns: int, time_s: ArrayLike) -> Epochs:
    """Epochs ``time_s`` after a reference."""
    return epoch_ns + np.rint(1e9 * np.asarray(time_s, dtype=np.float64)).astype(np.int64)


def fly(orbit: Orbit, orientation: Orientation, epoch_ns: int, time_s: ArrayLike) -> tuple[Array, Array]:
    """Earth-fixed r_J and v_J (relative to the turning Earth) along an inertial orbit, (..., 3) each."""
    r_I, v_I = orbit.at(time_s)
    C_JI = orientation.C_IJ(epochs_ns(epoch_ns, time_s)).mT
    r_J, turning = ((C_JI @ vector[..., None])[..., 0] for vector in (r_I, v_I))
    return r_J, turning - inertial_velocity(r_J, np.zeros_like(r_J))


def burst_times(camera: Camera, image_time_s: Array, line_period_s: float) -> Array:
    """Sample times (m, s) that cover the exposure of each image with a second to spare."""
    rows = camera.size_px[1] if camera.scans and np.isfinite(camera.size_px[1]) else 0.0
    duration = rows * line_period_s
    count = int(np.ceil((duration + 2.0) * SAMPLES_PER_SECOND)) + 1
    offsets = -1.0 + np.arange(count) / SAMPLES_PER_SECOND
    return np.asarray(image_time_s[:, None] + offsets)


@dataclass(frozen=True)
class Pass:
    """Images (m,) of a scene: time of mid-exposure, s after the scene's epoch, the point aimed at (m, 3) m in J, and a
    turn about the boresight (m,) rad.  The attitude is held relative to the orbital frame while an image is taken."""

    time_s: Array
    aim_J: Array
    yaw: Array


def held_attitude(
    orbit: Orbit, orientation: Orientation, epoch_ns: int, flight: Pass, sample_s: Array, C_EK: Array
) -> Array:
    """True C_EI (m, s, 3, 3) of images that keep their orientation in the orbital frame while they are taken."""
    C_IK = aimed(orbit, orientation, epoch_ns, flight)
    C_OK = C_RO(*orbit.at(flight.time_s)).mT @ C_IK
    C_IO = C_RO(*orbit.at(sample_s))
    return np.asarray((C_IO @ C_OK[:, None] @ C_EK.mT).mT)


def aimed(orbit: Orbit, orientation: Orientation, epoch_ns: int, flight: Pass) -> Array:
    """C_IK (m, 3, 3) of a camera that looks at the aims of images at their times, rows following the ground."""
    r_I, v_I = orbit.at(flight.time_s)
    aim_I = (orientation.C_IJ(epochs_ns(epoch_ns, flight.time_s)) @ flight.aim_J[..., None])[..., 0]
    return pointing(r_I, _scene_velocity(r_I, v_I, aim_I), aim_I, flight.yaw)


def _scene_velocity(r_I: Array, v_I: Array, aim_I: Array) -> Array:
    """Velocity of the camera relative to the ground below it, along inertial axes: rows follow it on the ground."""
    carried = OMEGA_EARTH * np.stack([-aim_I[..., 1], aim_I[..., 0], np.zeros_like(aim_I[..., 0])], axis=-1)
    return np.asarray(v_I - carried)


def _across(camera: Camera) -> Array:
    """K from the axes that are flown with x across the track: a line scanner is flown with its line there."""
    if not isinstance(camera, LineScanCamera) or camera.axes[0][1] == 0.0:
        return np.eye(3)
    x, y = camera.axes[0]
    return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])


def photograph(
    camera: Camera,
    orbit: Orbit,
    orientation: Orientation,
    epoch_ns: int,
    flight: Pass,
    C_EK: Array,
    sigmas: Sigmas,
    corrections: Corrections,
    line_period_s: float = 0.0,
    name: str = "simulated",
) -> Campaign:
    """A campaign without markers yet, its series exactly true and its mounting the true one."""
    m = flight.time_s.size
    start = flight.time_s.copy()
    if camera.scans:
        start = start - 0.5 * (camera.size_px[1] - 1.0) * line_period_s
    sample_s = burst_times(camera, start, line_period_s)
    order = np.argsort(start)
    t_ns = epochs_ns(epoch_ns, sample_s)
    C_EI = held_attitude(orbit, orientation, epoch_ns, flight, sample_s, C_EK @ _across(camera))
    r_J, v_J = fly(orbit, orientation, epoch_ns, sample_s)
    t_all, first = np.unique(t_ns[order].reshape(-1), return_index=True)
    gap_s = 2.0 / SAMPLES_PER_SECOND
    return Campaign(
        name=name,
        camera=camera,
        C_EK=C_EK,
        sigma_mounting=None,
        ephemeris=Ephemeris(t_all, r_J[order].reshape(-1, 3)[first], v_J[order].reshape(-1, 3)[first], gap_s),
        sigma_position=sigmas.position,
        position_frame="ITRF",
        attitude=Attitude(
            t_all, so3.to_quaternion(C_EI[order].reshape(-1, 3, 3)[first]), "GCRF", orientation, gap_s
        ),
        cov_attitude_E=np.diag(sigmas.attitude**2),
        landmarks=Landmarks((), np.zeros((0, 3)), np.zeros((0, 3, 3))),
        images=Images(
            tuple(f"image{i + 1:02d}" for i in range(m)),
            epochs_ns(epoch_ns, start),
            np.full(m, line_period_s) if camera.scans else None,
        ),
        sightings=_no_sightings(),
        corrections=corrections,
        orientation=orientation,
        attitude_errors=SharedErrors("image"),
        position_errors=SharedErrors("image"),
    )


def _no_sightings() -> Sightings:
    none = np.zeros(0)
    return Sightings(none.astype(int), none.astype(int), none, none, none, none.astype(bool))


def survey(r_J: Array, sigma_enu: Array) -> Landmarks:
    """Landmarks at r_J (L, 3) with the same sigmas east, north and up (3,) m."""
    latitude, longitude, _ = itrf_to_geodetic(r_J)
    C = C_JT(latitude, longitude)
    covariance = C @ np.diag(sigma_enu**2) @ C.mT
    return Landmarks(tuple(f"gcp{i + 1:03d}" for i in range(len(r_J))), r_J, covariance)


def mark_pixels(
    campaign: Campaign, image: Index, pixel: Array, height: ArrayLike, sigmas: Sigmas
) -> Campaign:
    """The campaign with a landmark of its own under each of the pixels (n, 2) of images (n,)."""
    p_J = locate(campaign, campaign.C_EK, image, pixel[:, 0], pixel[:, 1], height)
    return _with_markers(campaign, survey(p_J, sigmas.landmark), image, np.arange(image.size), pixel, sigmas)


def mark_site(campaign: Campaign, p_J: Array, sigmas: Sigmas) -> Campaign:
    """The campaign with landmarks p_J (L, 3) sighted in every image whose frame they fall into."""
    m, L = len(campaign.images.ids), len(p_J)
    image, landmark = np.repeat(np.arange(m), L), np.tile(np.arange(L), m)
    return mark_pairs(campaign, p_J, image, landmark, sigmas)


def mark_pairs(campaign: Campaign, p_J: Array, image: Index, landmark: Index, sigmas: Sigmas) -> Campaign:
    """The campaign with landmarks p_J (L, 3), sighted where they fall into the frame of an image: landmarks (n,) in
    images (n,)."""
    if campaign.camera.scans:
        near = in_footprint(campaign, image, p_J[landmark])
        image, landmark = image[near], landmark[near]
    pixel = project(campaign, campaign.C_EK, image, p_J[landmark])
    columns, rows = campaign.camera.size_px
    inside = (
        (pixel[:, 0] >= 0) & (pixel[:, 0] <= columns - 1) & (pixel[:, 1] >= 0) & (pixel[:, 1] <= rows - 1)
    )
    landmarks = survey(p_J, sigmas.landmark)
    return _with_markers(campaign, landmarks, image[inside], landmark[inside], pixel[inside], sigmas)


FOOTPRINT_MARGIN = 1.1
"""Footprints are drawn this much larger, for markers that stand high; the pixels decide in the end."""


def in_footprint(campaign: Campaign, image: Index, p_J: Array) -> NDArray[np.bool_]:
    """Whether points p_J (n, 3) lie within the ground covered by images (n,), a quadrangle of their corners.

    A line scanner's search for a row needs this first: far outside its strip there is no orbit or attitude to search.
    """
    columns, rows = campaign.camera.size_px
    corners = ((0.0, 0.0), (columns - 1.0, 0.0), (columns - 1.0, rows - 1.0), (0.0, rows - 1.0))
    ground = np.stack(
        [
            locate(campaign, campaign.C_EK, image, np.full(image.size, c), np.full(image.size, r))
            for c, r in corners
        ],
        axis=-2,
    )
    centre = np.mean(ground, axis=-2)
    latitude, longitude, _ = itrf_to_geodetic(centre)
    C = C_JT(latitude, longitude)
    corner = FOOTPRINT_MARGIN * ((ground - centre[:, None]) @ C)[..., :2]
    east, north, _ = np.moveaxis(((p_J - centre)[:, None] @ C)[:, 0], -1, 0)
    edge = np.roll(corner, -1, axis=-2) - corner
    off = np.stack([east, north], axis=-1)[:, None] - corner
    side = edge[..., 0] * off[..., 1] - edge[..., 1] * off[..., 0]
    inside = np.all(side > 0.0, axis=-1) | np.all(side < 0.0, axis=-1)
    reach = 2.0 * np.max(np.linalg.norm(corner, axis=-1), axis=-1)
    return np.asarray(inside & (np.linalg.norm(p_J - centre, axis=-1) < reach))


def _with_markers(
    campaign: Campaign, landmarks: Landmarks, image: Index, landmark: Index, pixel: Array, sigmas: Sigmas
) -> Campaign:
    n = image.size
    sightings = Sightings(
        image, landmark, pixel[:, 0], pixel[:, 1], np.full(n, sigmas.pixel), np.zeros(n, dtype=bool)
    )
    return replace(campaign, landmarks=landmarks, sightings=sightings)


def measured(campaign: Campaign, errors: Errors, C_EK_model: Array) -> Campaign:
    """What is delivered of a true campaign: every series, survey and pixel with its error, and the model mounting.

    An image's attitude and position error sits on all samples of its burst; each burst must hold one image.
    """
    attitude, ephemeris, s = campaign.one_attitude, campaign.ephemeris, campaign.sightings
    first, _ = attitude.bursts.bounds
    owner = first[np.searchsorted(attitude.t_ns, campaign.images.t_ns, side="right") - 1]
    image = np.argmax(first[:, None] == owner, axis=1)
    C_EI = so3.exp(errors.alpha_E[image]) @ so3.from_quaternion(attitude.q_EF)
    return replace(
        campaign,
        C_EK=C_EK_model,
        attitude=replace(attitude, q_EF=so3.to_quaternion(C_EI)),
        ephemeris=replace(ephemeris, r_J=ephemeris.r_J + errors.rho_J[image]),
        landmarks=campaign.landmarks.moved(campaign.landmarks.r_J + errors.pi_J),
        sightings=replace(
            s, column_px=s.column_px + errors.pixel[:, 0], row_px=s.row_px + errors.pixel[:, 1]
        ),
    )


def site_grid(latitude: float, longitude: float, height: ArrayLike, east_north: Array) -> Array:
    """Points p_J (L, 3) at offsets east, north (L, 2) m from a site (rad), at heights above the ellipsoid.

    The offsets are laid along the surface, so the points follow its curvature.
    """
    offset = np.concatenate([east_north, np.zeros((len(east_north), 1))], axis=-1)
    centre = geodetic_to_itrf(latitude, longitude, 0.0)
    lat, lon, _ = itrf_to_geodetic(centre + offset @ C_JT(latitude, longitude).mT)
    return geodetic_to_itrf(lat, lon, np.broadcast_to(height, lat.shape))
