"""What the images of a campaign say of an answer, by the groups that may share an error."""

from __future__ import annotations

import numpy as np

from ...estimators.fit import Fit
from ...estimators.protocol import AlignmentEstimate
from ...table.campaign import Campaign
from ...table.sharing import passes, sessions
from .from_data import FromData, from_data, levels_of
from .rotations import image_rotations


def scatter_of(campaign: Campaign, fit: Fit, estimate: AlignmentEstimate) -> FromData | None:
    """What the images alone say of an answer; None where fewer than two of them fix a rotation."""
    images = image_rotations(fit)
    if images is None or estimate.sigma_E is None:
        return None
    groups = [("session", sessions(campaign)), ("pass", passes(campaign))]
    stated, own = campaign.attitude_errors, campaign.attitude_errors.session_estimated
    told = own and np.any(stated.session_sigma)
    if stated.moved or campaign.position_errors.moved or told:
        groups = []  # what else images may share is not to be told from what they do
    elif stated.session_sigma is not None:
        groups = groups[:1] if own else groups[1:]
    return from_data(images, estimate.C_EK, estimate.sigma_E, levels_of(images, groups), estimated=own)
