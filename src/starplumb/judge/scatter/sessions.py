"""The error that the images of a session share, where it is to be taken from the data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...estimators.fit import Fit
from ...physics.covariance import square_root
from ...physics.errors import InputError
from ...physics.units import ARCSEC
from ...table.campaign import Campaign
from ...table.sharing import sessions
from ..trust import Finding
from . import variances
from .from_data import SESSION, components, levels_of
from .next_session import FEW_SESSIONS
from .rotations import image_rotations

LEAST = 0.01
"""Variance of what a session's images share, over that of one image, below which it is taken for none."""


def with_session(campaign: Campaign, fit: Fit) -> Campaign:
    """The campaign with the error of a session as its images tell it at a fit: distributed about the axes as the errors
    of attitude and orbit are, times a factor by restricted maximum likelihood (two of several sessions).

    Raises InputError where there is no session beside another, or none of several images.
    """
    images = image_rotations(fit)
    levels = {} if images is None else levels_of(images, [(SESSION, sessions(campaign))])
    if images is None or not levels:
        raise InputError(
            f'campaign {campaign.name!r}: found attitude.session_sigma_arcsec = "estimate" with '
            f"{np.unique(sessions(campaign)).size} sessions of {len(campaign.images.ids)} images, wanted two sessions "
            "or more, one of them with several images (column session of the images)"
        )
    sources = components(images, fit.state.C_EK, levels)
    factors = variances.estimate(images.d_E, sources).f
    factors = np.where(factors < LEAST, 0.0, factors)
    shared = [(f, c.common[0]) for f, c in zip(factors, sources, strict=True) if c.name.startswith(SESSION)]
    root = square_root(np.sum([f * Z @ Z.T for f, Z in shared], axis=0))
    return replace(campaign, attitude_errors=replace(campaign.attitude_errors, session_sigma=root))


def finding_of_session(campaign: Campaign) -> list[Finding]:
    """What the data say of the error of a session, where that was asked for."""
    root = campaign.attitude_errors.session_sigma
    if not campaign.attitude_errors.session_estimated or root is None:
        return []
    count = np.unique(sessions(campaign)).size
    sigma = ", ".join(f"{s:.2g}" for s in np.sqrt(np.sum(root**2, axis=-1)) / ARCSEC)
    few = f"; {FEW_SESSIONS} sessions or more would narrow the interval" if count < FEW_SESSIONS else ""
    return [
        Finding(
            f"the images of a session share [{sigma}] arcsec about x, y, z, estimated from {count} sessions{few}",
            False,
        )
    ]
