"""Whether an answer may be used: one rule for every method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..physics.units import DEG
from ..table.equation import in_front
from ..table.observations import Observations
from .protocol import Status

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

EXACT = 1.02
"""Residuals over what is stated up to which an improbable chi-square means nothing: 1e5 sightings show a factor that
changes nothing."""
SINGULAR_SIGMA = 10.0 * DEG
"""An alignment known no better than this is not determined: a covariance of linear errors means nothing there."""


def determined(covariance_E: Array) -> Mask:
    """Where a covariance (..., 3, 3) says that the alignment is known: finite, root sum of squares below 10 deg."""
    return np.asarray(np.trace(covariance_E, axis1=-2, axis2=-1) < SINGULAR_SIGMA**2)


def status_of(
    observations: Observations,
    C_EK: Array,
    *,
    determined: Mask,
    converged: Mask | bool = True,
    chi2: Array | None = None,
) -> NDArray[np.int64]:
    """Status (...) of answers C_EK (..., 3, 3): OK, SINGULAR or NOT_CONVERGED.

    SINGULAR where the observations do not determine the alignment (``determined``, see :func:`determined`).
    NOT_CONVERGED where the iterations did not settle, where the mounting or chi-square is not a number, or where a
    sighting in the solution lies behind the camera: no camera sees that, so the answer cannot be the true one.
    """
    ahead = in_front(C_EK, observations.e_E) | (observations.weight == 0.0)
    settled = converged & np.all(ahead, axis=-1) & np.all(np.isfinite(C_EK), axis=(-2, -1))
    if chi2 is not None:
        settled = settled & np.isfinite(chi2)
    answered = np.where(settled, int(Status.OK), int(Status.NOT_CONVERGED))
    return np.asarray(np.where(determined, answered, int(Status.SINGULAR)))
