"""The attitude of a campaign: one file, or several star trackers fused into one, with the covariance it deserves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...judge.consistency import chi2_p
from ...judge.trust import IMPLAUSIBLE_P
from ...physics.errors import InputError
from ...physics.orientation import EarthOrientation
from ...physics.series import Attitude
from ...physics.trackers import FusedAttitude, TrackerSeries, covariance_at
from ...physics.units import ARCSEC, DEG
from ...table.campaign import Images
from ..tables.cells import Array
from ..tables.read import Epochs, TableSource
from ..text.files import show
from . import motion
from .attitude_config import AttitudeConfig, Mounting
from .config import CampaignConfig
from .fixed_frames import CAMERA, Frames, way
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
        key: motion.read_attitude(files[f"{key}.file"], section, scale, notices, key, _kernels(files, key))
        for key, section in config.attitudes.items()
    }
    frames = config.joined_frames
    if config.attitude is not None:
        own, samples = config.attitude, read["attitude"]
        C_EA = way(frames, config.tracker, own.tracker)
        sigma, C_AS = _spread(settings, "attitude", own, samples, frames, notices)
        if own.tracker != config.tracker and own.sigma_frame is None and np.ptp(sigma, axis=-1).any():
            raise InputError(
                f"{settings}: attitude.sigma_frame: missing, wanted {show(own.tracker)} or {show(config.tracker)}: "
                "the attitude is that of the one and the mounting that of the other, and the sigmas differ by axis"
            )
        cov_E = covariance_at(exposures.images.t_ns, samples.t_ns, sigma, C_EA @ C_AS)
        turn = None if own.tracker == config.tracker else C_EA
        return motion.attitude_series(samples, own, orientation, turn), cov_E
    assert config.fusion is not None, "the rules want it with trackers"
    trackers = tuple(
        TrackerSeries(
            tracker.tracker,
            motion.attitude_series(read[key], tracker, orientation),
            way(frames, config.tracker, tracker.tracker),
            *_spread(settings, key, tracker, read[key], frames, notices),
        )
        for key, tracker in config.attitudes.items()
    )
    for i, tracker in enumerate(trackers):
        if np.any(tracker.sigma_S <= 0.0):
            found = "found 0, which gives the tracker all the weight"
            raise InputError(f"{settings}: trackers.{i}.sigma_arcsec: {found}, wanted positive numbers")
    fused = FusedAttitude(trackers, config.fusion.method)
    notices += _require_whole_images(settings, fused, exposures)
    notices += _require_agreement(settings, fused, exposures)
    return fused, fused.covariance_E(exposures.of_image)


def _kernels(files: Mapping[str, TableSource], section: str) -> tuple[Path, ...]:
    """The further files that a section names, in its order."""
    return tuple(
        place
        for key, place in files.items()
        if key.startswith(f"{section}.kernels.") and isinstance(place, Path)
    )


def model_mounting(config: Mounting, frames: Frames | None = None, camera: str = CAMERA) -> Array:
    """C_EK of a mounting, in whichever direction it is written; ``frames`` join K, named ``camera``, with the side of
    it that is fixed to the camera."""
    frames = frames or Frames()
    at_camera = config.source in {CAMERA, *frames.joined(camera)}
    C_EV, V = (config.C, config.source) if at_camera else (config.C.mT, config.target)
    return C_EV if V in (CAMERA, camera) else C_EV @ way(frames, V, camera)


def _spread(
    settings: str,
    key: str,
    config: AttitudeConfig,
    samples: AttitudeSamples,
    frames: Frames,
    notices: list[str],
) -> tuple[Array, Array]:
    """Sigmas (3,) or those of the table (n, 3), rad, about the axes of S, and ``C_AS`` (3, 3) to the attitude's own.

    Raises InputError where none is stated.  A covariance is sigmas about its own principal axes.
    """
    C_AS = way(frames, config.tracker, config.sigma_frame or config.tracker)
    own, covariance = samples.sigma, config.covariance_arcsec2
    stated = "sigma_arcsec" if covariance is None else "covariance_arcsec2"
    if own is not None:
        if (config.sigma_arcsec or covariance) is not None:
            notices.append(f"{settings}: {key}.{stated} is not used: {config.file} has a sigma for each row")
        return own, C_AS
    if covariance is not None:
        variance, axes = np.linalg.eigh(np.array(covariance))
        right_handed = axes * np.sign(np.linalg.det(axes))
        return ARCSEC * np.sqrt(np.maximum(variance, 0.0)), C_AS @ right_handed
    if config.sigma_arcsec is None:
        raise InputError(
            f"{settings}: {key}.sigma_arcsec: missing, wanted one number or three, which the solution needs "
            f"(or the columns {', '.join(motion.SIGMA_ATTITUDE)} in {config.file})"
        )
    return ARCSEC * np.array(config.sigma_arcsec), C_AS


def _require_whole_images(settings: str, fused: FusedAttitude, exposures: Exposures) -> list[str]:
    """A notice for each tracker that misses images; a tracker must not come and go within one image."""
    names, used = exposures.images.ids, fused.used(exposures.t_ns)
    seen = np.any(used, axis=0)  # marks that no tracker covers are told elsewhere
    image, used = exposures.image[seen], used[:, seen]
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
