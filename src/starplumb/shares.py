"""Error budget of one calibration: what each stated error source contributes to the covariance of its alignment.

An estimate answers a small shift dz_n of sighting n by ``K_n dz_n`` (:mod:`starplumb.reliability`).  The errors of one
image, of one landmark or of one pixel shift their sightings together, so that each source has::

    attitude  sum_i (sum_n K_n H_n) S_i (...)^T,   position and markers likewise with R,   pixels  sum_n K_n K_n^T s_n^2

and what is left of the covariance is the part of what was known before.  The parts add up to the covariance; where
other parameters are estimated too, to 1e-3 of it, since H and R are taken at the camera as it was known before.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .calibration import Calibration
from .model import linearise

Array = NDArray[np.float64]
Index = NDArray[np.int64]

PRIOR = "what was known before"


def shares(calibration: Calibration) -> Mapping[str, Array]:
    """Covariance (3, 3) rad^2 about E by source; empty where the method does not say what a sighting does to it."""
    c = calibration
    if c.snooping is None or c.estimate.covariance_E is None:
        return {}
    o, tested = c.observations, c.snooping.tested
    model = linearise(o, c.estimate.C_EK)
    K = np.where(c.residuals.used[:, None, None], tested.influence[:, :3] @ tested.per_px, 0.0)
    noise = K * o.sigma_px[:, None, None]
    parts = {
        "star tracker": _shared(K @ model.H, o.image, o.cov_attitude_E),
        "satellite position": _shared(K @ model.R, o.image, o.cov_position_J),
        "marker survey": _shared(K @ model.R, o.landmark, o.cov_landmark_J),
        "image measurement": np.einsum("nij,nkj->ik", noise, noise),
    }
    if _has_prior(c):
        values, axes = np.linalg.eigh(c.estimate.covariance_E - np.sum(list(parts.values()), axis=0))
        parts[PRIOR] = (axes * np.maximum(values, 0.0)) @ axes.mT
    return parts


def _has_prior(c: Calibration) -> bool:
    """Whether something of the mounting or of the other parameters was known before."""
    parameters = c.estimate.parameters
    told = parameters is not None and bool(np.any(np.isfinite(parameters.prior_sigma)))
    return c.campaign.sigma_mounting is not None or told


def _shared(slope: Array, member: Index, covariance: Array) -> Array:
    """sum_g G_g S_g G_g^T, G_g the sum of the slopes (n, 3, 3) of the sightings of member g; covariance (m, 3, 3)."""
    G = np.zeros((len(covariance), 3, 3))
    np.add.at(G, member, slope)
    return np.asarray(np.sum(G @ covariance @ G.mT, axis=0))
