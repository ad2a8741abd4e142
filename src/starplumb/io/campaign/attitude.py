"""The attitude of a campaign: one file, or several star trackers fused into one, with the covariance it deserves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...judge.consistency import IMPLAUSIBLE_P, chi2_p
from ...physics import so3
from ...physics.errors import InputError
from ...physics.orientation import EarthOrientation
from ...physics.series import Attitude
from ...physics.trackers import FusedAttitude, TrackerSeries, sigma_at
from ...physics.units import ARCSEC, DEG
from ...table.campaign import Images
from ..tables.cells import Array
from ..tables.read import Epochs, TableSource
from ..text.files import show
from . import motion
from .attitude_config import CAMERA, AttitudeConfig, Mounting, Rotation, TrackerConfig
from .config import CampaignConfig
from .motion import AttitudeSamples

Index = NDArray[np.int64]

APART = 1.0 * DEG
"""Star trackers farther apart than this do not disagree: one of their mountings or attitudes is wrong."""


@dataclass(frozen=True)
class Exposures:
    """The marks of a campaign as its attitude needs them: image (n,) and epoch ``t_ns`` (n,) of each."""

    images: Images
    image: Index
    t_ns: Epochs

    @property
    def of_image(self) -> Epochs:
        """An epoch (m,) of each image: that of its first mark, else the one stated."""
        t_ns = self.images.t_ns.copy()
        t_ns[self.image[::-1]] = self.t_ns[::-1]
        return t_ns


def read_attitude(
    settings: str,
    config: CampaignConfig,
    files: Mapping[str, TableSource],
    orientation: EarthOrientation | None,
    exposures: Exposures,
    notices: list[str],
) -> tuple[Attitude | FusedAttitude, Array]:
    """The attitude that the document ``settings`` names and its covariance about E, (3, 3) or (m, 3, 3) rad^2.

    Raises InputError for a file that contradicts the campaign, a sigma that is nowhere stated, a tracker that covers
    only a part of an image, and trackers that contradict each other.
    """
    scale = config.campaign.time_scale
    read = {
        key: motion.read_attitude(files[f"{key}.file"], section, scale, notices, key)
        for key, section in config.attitudes.items()
    }
    if config.attitude is not None:
        samples = read["attitude"]
        sigma = _sigma(settings, "attitude", config.attitude, samples, notices)
        cov_E = sigma_at(exposures.images.t_ns, samples.t_ns, sigma)[..., None] ** 2 * np.eye(3)
        return motion.attitude_series(samples, config.attitude, orientation), cov_E
    assert config.fusion is not None, "the rules want it with trackers"
    trackers = tuple(
        TrackerSeries(
            tracker.tracker,
            motion.attitude_series(read[f"trackers.{i}"], tracker, orientation),
            tracker_mounting(tracker),
            _sigma(settings, f"trackers.{i}", tracker, read[f"trackers.{i}"], notices),
        )
        for i, tracker in enumerate(config.trackers or ())
    )
    for i, tracker in enumerate(trackers):
        if np.any(tracker.sigma_A <= 0.0):
            found = "found 0, which gives the tracker all the weight"
            raise InputError(f"{settings}: trackers.{i}.sigma_arcsec: {found}, wanted positive numbers")
    fused = FusedAttitude(trackers, config.fusion.method)
    notices += _require_whole_images(settings, fused, exposures)
    notices += _require_agreement(settings, fused, exposures)
    return fused, fused.covariance_E(exposures.of_image)


def rotation(config: Rotation) -> Array:
    """The matrix that takes coordinates in ``from`` to those in ``to``, whichever way the section is written."""
    if config.quaternion_xyzw is not None:
        return so3.from_quaternion(config.quaternion_xyzw)
    if config.quaternion_wxyz is not None:
        return so3.from_quaternion(np.roll(config.quaternion_wxyz, -1))
    if config.matrix is not None:
        return so3.nearest(config.matrix)
    if config.rotation_vector_deg is not None:
        return so3.exp(DEG * np.array(config.rotation_vector_deg))
    if config.euler_deg is not None and config.euler_order is not None:
        return _from_euler(config.euler_deg, config.euler_order)
    raise ValueError("the section states no rotation")


def model_mounting(config: Mounting) -> Array:
    """C_EK of the [mounting] section, in whichever direction it is written."""
    C = rotation(config)
    return C if config.source == CAMERA else C.mT


def tracker_mounting(config: TrackerConfig) -> Array:
    """C_EA of a tracker's own mounting; the identity where its frame is E."""
    if config.mounting is None:
        return np.eye(3)
    C = rotation(config.mounting)
    return C if config.mounting.source == config.tracker else C.mT


def _from_euler(angles_deg: tuple[float, ...], order: str) -> Array:
    """Product of the three turns, in the order written about turned axes (capitals), else about fixed
    ones."""
    axes = np.eye(3)
    turns = [
        so3.exp(a * DEG * axes["xyz".index(axis)]) for a, axis in zip(angles_deg, order.lower(), strict=True)
    ]
    first, second, third = turns if order.isupper() else reversed(turns)
    return np.asarray(first @ second @ third)


def _sigma(
    settings: str, key: str, config: AttitudeConfig, samples: AttitudeSamples, notices: list[str]
) -> Array:
    """The table's own sigmas (n, 3) rad, else the campaign's (3,); one of them must be stated."""
    stated, own = config.sigma_arcsec, samples.sigma
    if own is None and stated is None:
        raise InputError(
            f"{settings}: {key}.sigma_arcsec: missing, wanted one number or three, which the solution needs "
            f"(or the columns {', '.join(motion.SIGMA_ATTITUDE)} in {config.file})"
        )
    if own is not None and stated is not None:
        notices.append(f"{settings}: {key}.sigma_arcsec is not used: {config.file} has a sigma for each row")
    return own if own is not None else ARCSEC * np.array(stated)


def _require_whole_images(settings: str, fused: FusedAttitude, exposures: Exposures) -> list[str]:
    """A notice for each tracker that misses images; a tracker must not come and go within one image."""
    names, image = exposures.images.ids, exposures.image
    used = fused.used(exposures.t_ns)
    whole = np.ones((len(names), len(fused.trackers)), dtype=np.bool_)
    some = np.zeros_like(whole)
    np.logical_and.at(whole, image, used.mT)
    np.logical_or.at(some, image, used.mT)
    notices = []
    for j, tracker in enumerate(fused.trackers):
        if np.any(part := some[:, j] & ~whole[:, j]):
            raise InputError(
                f"{settings}: found the tracker {show(tracker.name)} ({tracker.attitude.name}) to cover only a part of "
                f"image {show(names[int(np.argmax(part))])}, wanted all of its markers or none of them"
            )
        missed = np.flatnonzero(~whole[:, j] & np.any(some, axis=1))
        if missed.size:
            more = f" and {missed.size - 3} more" if missed.size > 3 else ""
            listed = ", ".join(names[i] for i in missed[:3]) + more
            notices.append(
                f"{tracker.attitude.name}: found no attitude at {listed}; "
                "the attitude there is that of the other trackers"
            )
    return notices


def _require_agreement(settings: str, fused: FusedAttitude, exposures: Exposures) -> list[str]:
    """A notice where the trackers disagree by more than their sigmas allow; InputError beyond a degree."""
    t_ns = exposures.of_image
    images = np.flatnonzero(np.any(fused.used(t_ns), axis=0))
    try:
        residual, chi2 = fused.residuals(t_ns[images]), fused.disagreement(t_ns[images])
    except InputError as error:
        raise InputError(f"{settings}: trackers: {error}") from None
    angle = np.nan_to_num(np.linalg.norm(residual, axis=-1))
    if not angle.size:
        return []
    j, i = np.unravel_index(np.argmax(angle), angle.shape)
    where = f"the tracker {show(fused.trackers[j].name)} at image {show(exposures.images.ids[images[i]])}"
    if angle[j, i] > APART:
        found = f"found {where} {angle[j, i] / DEG:.3g} deg from the trackers' average"
        raise InputError(f"{settings}: {found}, wanted mountings and attitudes of the trackers that agree")
    freedom = int(3 * np.sum(np.isfinite(residual[..., 0])) - 3 * images.size)
    total = float(np.sum(chi2))
    if chi2_p(total, freedom) > IMPLAUSIBLE_P:
        return []
    times = np.sqrt(total / freedom)
    return [
        f"{settings}: the star trackers disagree, {times:.2g} times what their sigmas allow: found {where} "
        f"{angle[j, i] / ARCSEC:.3g} arcsec from their average; a mounting of theirs may be off"
    ]
