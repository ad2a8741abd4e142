"""All that a campaign's own files tell of how far its answer can be trusted, heaviest first."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...table.campaign import Campaign
from ...table.observations import Observations
from .digits import digits
from .evidence import Evidence
from .image_errors import ImageErrors
from .places import places
from .sampling import sampling
from .sharing import close_in_time, trackers

Array = NDArray[np.float64]

CHOSEN = 1.0 / 3.0
"""Share of the control sightings from which on those that are rejected make the others fit by choice."""


def findings_of_files(
    campaign: Campaign,
    observations: Observations,
    C_EK: Array,
    covariance_E: Array,
    estimated: Collection[str] = (),
) -> list[Evidence]:
    """What the files tell of an answer ``C_EK`` with ``covariance_E`` (3, 3) rad^2.

    ``observations`` is the whole table of the campaign, in its order, with weight 0 for what has no part in the answer;
    ``estimated`` names what was estimated beside the alignment.
    """
    o, control = observations, ~campaign.sightings.check
    rejected = np.mean(o.weight[control] == 0.0)
    errors = replace(ImageErrors.of(o, C_EK), chosen=bool(rejected > CHOSEN))
    found = [
        *trackers(campaign, errors, covariance_E, estimated),
        *places(campaign, o, errors, covariance_E),
        *sampling(campaign, errors, covariance_E),
        *digits(campaign, o, errors, covariance_E, estimated),
        *close_in_time(campaign, errors, covariance_E),
    ]
    return sorted(found, key=_weight, reverse=True)


def _weight(evidence: Evidence) -> tuple[bool, bool, float]:
    size = 0.0 if evidence.covariance_E is None else float(np.trace(evidence.covariance_E))
    return evidence.refuses, evidence.weakens, size
