"""What a campaign states of who shares an error, brought inside."""

from __future__ import annotations

import numpy as np

from ...physics.series import Attitude
from ...physics.trackers import FusedAttitude
from ...physics.units import ARCSEC
from ...table.campaign import SharedErrors
from ..tables.cells import Array
from .attitude import Exposures
from .attitude_config import ESTIMATE, AttitudeConfig
from .config import CampaignConfig, EphemerisConfig
from .fixed_frames import way


def attitude_sharing(
    config: CampaignConfig, attitude: Attitude | FusedAttitude, exposures: Exposures
) -> SharedErrors:
    """Of [attitude], or of all [[trackers]], which share alike."""
    sections = list(config.attitudes.values())
    first = sections[0]

    def fused(sigmas: list[tuple[float, ...] | None]) -> Array | None:
        """Their square root, of several trackers as their average has it; None where none is stated."""
        if all(sigma is None for sigma in sigmas):
            return None
        roots = [_root_E(config, section, s) for section, s in zip(sections, sigmas, strict=True)]
        if isinstance(attitude, FusedAttitude):
            return attitude.root_E(exposures.of_image, np.stack(list(map(_matrix, roots))))
        return roots[0]

    estimated = any(section.session_sigma_arcsec == ESTIMATE for section in sections)
    session = [section.session_sigma_arcsec for section in sections]
    wander = [section.wander for section in sections]
    times = [each.correlation_time_s for each in wander if each is not None]
    return SharedErrors(
        first.shared_by,
        first.correlation_time_s,
        fused([None if isinstance(s, str) else s for s in session]),
        fused([None if each is None else each.sigma_arcsec for each in wander]),
        times[0] if times else 1.0,
        estimated,
    )


def _root_E(config: CampaignConfig, section: AttitudeConfig, sigma_arcsec: tuple[float, ...] | None) -> Array:
    """Sigmas (3,) rad about E's axes, or where a section's sigmas are about other ones their root (3, 3): C_ES diag."""
    sigma = ARCSEC * np.array(sigma_arcsec or (0.0, 0.0, 0.0))
    axes = section.sigma_frame or section.tracker
    return sigma if axes == config.tracker else way(config.joined_frames, config.tracker, axes) * sigma


def _matrix(root: Array) -> Array:
    return np.diag(root) if root.ndim == 1 else root


def position_sharing(config: EphemerisConfig) -> SharedErrors:
    """Of [ephemeris]."""
    session = config.session_sigma_m
    return SharedErrors(
        config.shared_by, config.correlation_time_s, None if session is None else np.array(session)
    )
