"""What each source of error contributes to the covariance of a judged answer."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .calibrate import Calibration

Array = NDArray[np.float64]

PRIOR, MOTION, LENS = "what was known before", "motion of the mounting", "lens, as noise bends it"
"""Names of what a prior, an estimated motion and a lens that is mostly noise contribute to a covariance."""


def shares(calibration: Calibration) -> Mapping[str, Array]:
    """Covariance (3, 3) rad^2 about E by source; empty where the method does not say what a sighting does to it."""
    c = calibration
    if c.snooping is None or c.estimate.covariance_E is None or not c.status.usable:
        return {}
    parts = c.snooping.spread.parts
    if c.moves is not None and c.moves.further_E is not None:
        parts[MOTION] = c.moves.further_E
    vector = c.estimate.parameters
    if vector is not None and vector.straight is not None:
        parts[LENS] = _positive((vector.covariance - vector.straight)[:3, :3])
    if _has_prior(c):
        parts[PRIOR] = _positive(c.estimate.covariance_E - np.sum(list(parts.values()), axis=0))
    return parts


def _positive(S: Array) -> Array:
    """The part of a symmetric matrix (3, 3) that is a covariance."""
    values, axes = np.linalg.eigh(S)
    return np.asarray((axes * np.maximum(values, 0.0)) @ axes.mT)


def _has_prior(c: Calibration) -> bool:
    """Whether something of the mounting or of the other parameters was known before."""
    parameters = c.estimate.parameters
    known = parameters is not None and bool(np.any(np.isfinite(parameters.prior_sigma)))
    return c.campaign.prior_E is not None or known
