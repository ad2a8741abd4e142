"""What a campaign states of who shares an error, brought inside."""

from __future__ import annotations

import numpy as np

from ...physics.series import Attitude
from ...physics.trackers import FusedAttitude
from ...physics.units import ARCSEC
from ...table.campaign import SharedErrors
from ..tables.cells import Array
from .attitude import Exposures
from .config import CampaignConfig, EphemerisConfig


def attitude_sharing(
    config: CampaignConfig, attitude: Attitude | FusedAttitude, exposures: Exposures
) -> SharedErrors:
    """Of [attitude], or of all [[trackers]], which share alike."""
    sections = list(config.attitudes.values())
    first = sections[0]
    session = [section.session_sigma_arcsec for section in sections]
    sigma: Array | None = None
    if any(s is not None for s in session):
        own = ARCSEC * np.array([s or (0.0, 0.0, 0.0) for s in session])
        sigma = own[0]
        if isinstance(attitude, FusedAttitude):
            sigma = attitude.root_E(exposures.of_image, own)
    wander = first.wander
    return SharedErrors(
        first.shared_by,
        first.correlation_time_s,
        sigma,
        None if wander is None else ARCSEC * np.array(wander.sigma_arcsec),
        1.0 if wander is None else wander.correlation_time_s,
    )


def position_sharing(config: EphemerisConfig) -> SharedErrors:
    """Of [ephemeris]."""
    session = config.session_sigma_m
    return SharedErrors(
        config.shared_by, config.correlation_time_s, None if session is None else np.array(session)
    )
