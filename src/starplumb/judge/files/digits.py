"""Digits of a file's numbers against the sigmas it states: rounding is an error, uniform over one step.

The step of a column is the largest power of ten of which all its values are multiples.  A number rounded to it is off
by a uniform error of standard deviation ``step / sqrt(12)``; a time that was cut rather than rounded is late by half a
step besides, the same for all images.  Numbers may be round by design (images at whole seconds, samples on a grid, a
fixed attitude), so that the residuals have the last word: where they speak 10 to 1 against errors of that size, nothing
is said.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.covariance import pixel_axes
from ...physics.earth import C_JT, OMEGA_EARTH, WGS84_A, itrf_to_geodetic
from ...physics.rounding import ROUNDING, decimal_step, is_grid, time_step
from ...physics.units import ARCSEC, DEG
from ...table.campaign import Campaign
from ...table.observations import Observations, first_of_image
from .evidence import NOTICEABLE, Evidence, growth, worst
from .image_errors import ImageErrors, OwnErrors

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]

CUT = 0.4
"""Standard deviation over a step of what all times have in common where they were cut: a bias of half a step, which
1.96 of this hold together with the other errors of the answer."""
DESIGNED_QUATERNION = 0.01
"""Quaternions of fewer digits than two are written by hand, not by a tracker."""


def digits(
    campaign: Campaign,
    o: Observations,
    errors: ImageErrors,
    covariance_E: Array,
    estimated: Collection[str] = (),
) -> Iterator[Evidence]:
    """Every column whose digits are too few for the stated sigmas; ``estimated`` names the further parameters."""
    yield from _times(campaign, o, errors, covariance_E, estimated)
    yield from _quaternions(campaign, errors, covariance_E)
    yield from _places(campaign, errors, covariance_E)
    yield from _pixels(campaign, errors, covariance_E)


def with_rounding(campaign: Campaign) -> Campaign:
    """The campaign with the rounding of quaternions, places and pixels among its stated errors."""
    steps = [a.quaternion_step for a in campaign.attitudes if a.quaternion_step <= DESIGNED_QUATERNION]
    turn = 2.0 * max(steps, default=0.0) * ROUNDING
    landmarks, found = campaign.landmarks, landmark_rounding(campaign.landmarks.r_J)
    if found is not None:
        landmarks = replace(landmarks, covariance_J=landmarks.covariance_J + found[1])
    s = campaign.sightings
    pixel = step_px(np.stack([s.column_px, s.row_px])) * ROUNDING
    return replace(
        campaign,
        cov_attitude_E=campaign.cov_attitude_E + turn**2 * np.eye(3),
        landmarks=landmarks,
        sightings=s.blurred(pixel),
    )


def _times(
    campaign: Campaign,
    o: Observations,
    errors: ImageErrors,
    covariance_E: Array,
    estimated: Collection[str],
) -> Iterator[Evidence]:
    for name, what, step, moves in _clocks(campaign, o):
        x = moves * step * ROUNDING
        own, common = x[:, :, None] * x[:, None, :], errors.by_common(moves * step * CUT)
        further = errors.by_images(own)
        if "time_offset" not in estimated:
            further = further + np.outer(common, common)
        if growth(covariance_E, further) <= NOTICEABLE or not errors.allows(own):
            continue
        turned, moved = (np.median(np.linalg.norm(moves[errors.seen, k : k + 3], axis=-1)) for k in (0, 3))
        size = (
            f"{moved * step:.2g} m of orbit" if moved else f"{turned * step / ARCSEC:.2g} arcsec of rotation"
        )
        yield Evidence(
            "digits",
            f"{name}: the {what} are whole multiples of {_seconds(step)}, that is {size}; rounded or cut to it, they "
            f"are wrong by {worst(covariance_E, further)}",
            f"give them more digits, or use --estimate time_offset={_seconds(step).replace(' ', '')}",
            covariance_E=further,
        )


def _clocks(campaign: Campaign, o: Observations) -> Iterator[tuple[str, str, float, Array]]:
    """Name, column, step (s) of each column of times, and what a second of it moves in each image (m, 6)."""
    omega, v = first_of_image(o, o.omega_E), first_of_image(o, o.v_J)
    still = np.zeros_like(v)
    images, orbit = campaign.images, campaign.ephemeris
    yield images.name, "image times", written_step(images.t_ns), np.concatenate([omega, v], axis=-1)
    inertial = omega - OMEGA_EARTH * first_of_image(o, o.C_EJ[..., 2])
    for series in campaign.attitudes:
        turn = inertial if series.frame == "GCRF" else omega
        yield series.name, "attitude times", written_step(series.t_ns), np.concatenate([turn, still], axis=-1)
    yield orbit.name, "orbit times", written_step(orbit.t_ns), np.concatenate([still, v], axis=-1)


def written_step(t_ns: Epochs) -> float:
    """Step of epochs, s; 0 where they are exact by design.  One epoch alone may be round by chance or by design."""
    step = time_step(t_ns)
    return 0.0 if t_ns.size < 2 or is_grid(t_ns, step) else step


def _seconds(step: float) -> str:
    return f"{step * 1e3:g} ms" if step >= 1e-3 else f"{step * 1e6:g} us"


def _quaternions(campaign: Campaign, errors: ImageErrors, covariance_E: Array) -> Iterator[Evidence]:
    for series in campaign.attitudes:
        step = series.quaternion_step
        if not 0.0 < step <= DESIGNED_QUATERNION:
            continue
        sigma = 2.0 * step * ROUNDING
        own = np.zeros_like(errors.stated)
        own[:, :3, :3] = sigma**2 * np.eye(3) / len(campaign.attitudes)
        further = errors.by_images(own)
        if growth(covariance_E, further) <= NOTICEABLE or not errors.allows(own):
            continue
        yield Evidence(
            "digits",
            f"{series.name}: the quaternions have {-round(np.log10(step))} decimals, which is "
            f"{sigma / ARCSEC:.2g} arcsec rms about each axis; that adds {worst(covariance_E, further)}",
            "write them with at least 8 decimals",
            covariance_E=further,
        )


def _places(campaign: Campaign, errors: ImageErrors, covariance_E: Array) -> Iterator[Evidence]:
    found = landmark_rounding(campaign.landmarks.r_J)
    if found is None:
        return
    words, covariance_J = found
    own = OwnErrors(landmark_J=covariance_J)
    further = errors.by_own(own)
    if growth(covariance_E, further) <= NOTICEABLE or not errors.allows_own(own):
        return
    yield Evidence(
        "digits",
        f"the places of the landmarks are whole multiples of {words}; rounding adds {worst(covariance_E, further)}",
        "give them more digits, or a sigma that contains their rounding",
        covariance_E=further,
    )


def landmark_rounding(r_J: Array) -> tuple[str, Array] | None:
    """The steps of surveyed places r_J (L, 3) in words and the covariance (L, 3, 3) m^2 of their rounding."""
    if len(r_J) < 2:
        return None
    cartesian = decimal_step(r_J)
    if cartesian:
        return f"{cartesian:g} m", np.tile((cartesian * ROUNDING) ** 2 * np.eye(3), (len(r_J), 1, 1))
    latitude, longitude, height = itrf_to_geodetic(r_J)
    north, east = (decimal_step(angle / DEG, 2e-10) for angle in (latitude, longitude))
    up = decimal_step(height, 1e-7) if np.ptp(height) > 0.0 else 0.0
    if not (north or east or up):
        return None
    per_deg = WGS84_A * DEG * ROUNDING
    sigma = np.stack(
        np.broadcast_arrays(east * per_deg * np.cos(latitude), north * per_deg, up * ROUNDING), axis=-1
    )
    C = C_JT(latitude, longitude)
    words = [f"{step:g} {unit}" for step, unit in ((max(north, east), "deg"), (up, "m")) if step]
    return " and ".join(words), (C * sigma[:, None, :] ** 2) @ C.mT


def _pixels(campaign: Campaign, errors: ImageErrors, covariance_E: Array) -> Iterator[Evidence]:
    s = campaign.sightings
    step = step_px(np.stack([s.column_px, s.row_px]))
    own = OwnErrors(pixel=(step * ROUNDING) ** 2)
    stated = float(np.median(pixel_axes(s.sigma_px, s.ellipse)[0]))
    if step * ROUNDING < 0.1 * stated:
        return
    further = errors.by_own(own)
    if growth(covariance_E, further) <= NOTICEABLE or not errors.allows_own(own):
        return
    yield Evidence(
        "digits",
        f"the pixels of the observations are whole multiples of {step:g} px against a stated sigma of "
        f"{stated:.2g} px; rounding adds {worst(covariance_E, further)}",
        "give them more digits, or a sigma_px that contains their rounding",
        covariance_E=further,
    )


def step_px(marks: Array) -> float:
    """Step of pixels that were counted from the centre of the first one or from its corner."""
    return max(decimal_step(marks), decimal_step(marks + 0.5))
