"""What a campaign states of who shares an error, brought inside."""

from __future__ import annotations

import numpy as np

from ...physics.series import Attitude
from ...physics.trackers import FusedAttitude
from ...physics.units import ARCSEC
from ...table.campaign import SharedErrors
from ..tables.cells import Array
from .attitude import Exposures
from .attitude_config import AttitudeConfig
from .config import CampaignConfig, EphemerisConfig
from .fixed_frames import way


def attitude_sharing(
    config: CampaignConfig, attitude: Attitude | FusedAttitude, exposures: Exposures
) -> SharedErrors:
    """Of [attitude], or of all [[trackers]], which share alike."""
    sections = list(config.attitudes.values())
    first = sections[0]
    session = [section.session_sigma_arcsec for section in sections]
    root: Array | None = None
    if any(s is not None for s in session):
        roots = [_root_E(config, section, s) for section, s in zip(sections, session, strict=True)]
        root = roots[0]
        if isinstance(attitude, FusedAttitude):
            root = attitude.root_E(exposures.of_image, np.stack(list(map(_matrix, roots))))
    wander = first.wander
    return SharedErrors(
        first.shared_by,
        first.correlation_time_s,
        root,
        None if wander is None else _root_E(config, first, wander.sigma_arcsec),
        1.0 if wander is None else wander.correlation_time_s,
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
