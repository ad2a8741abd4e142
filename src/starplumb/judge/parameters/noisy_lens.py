"""The sigma of an alignment beside a lens whose distortion is mostly noise.

Through a distortion a shift of the principal point differs from a turn of the camera.  A distortion that is estimated
counts for that with its noise in it: the information on the principal point, and on the turn that it is traded for,
comes out too large.  So it is taken where only the distortion remains that is surely there.  With the information
``C^-1 = R^T R`` of the coefficients, R upper triangular, the numbers ``w = R c`` are independent, of sigma 1: each
coefficient by itself, those after it in :data:`NESTED` being what they are found to be.  They are shrunk to
``w max(0, 1 - 4 / w^2)``: those within two sigmas vanish.
Source: L. Breiman, Better subset regression using the nonnegative garrote, Technometrics 37 (1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...estimators.fit import Fit
from ...estimators.protocol import AlignmentEstimate, ParameterVector
from ..trust import NORMAL_95, Finding
from .separability import UNKNOWN, YAW, Combination, inseparable

Array = NDArray[np.float64]

NESTED = ("k1", "p1", "p2", "k2", "k3")
"""Coefficients, the more usual ones first."""
SURE = 4.0
"""Square, in variances, below which a coefficient is taken for noise."""
NOTICEABLE = 1.02
"""Growth of a sigma from which on it is told."""


def findings_of_combinations(
    found: Sequence[Combination], fit: Fit, estimate: AlignmentEstimate
) -> list[Finding]:
    """What combinations that the data hardly separate mean, and how wide the interval is for it."""
    told = [inseparable(combination, estimate) for combination in found]
    if any(c.growth >= UNKNOWN and min(c.members) <= YAW for c in found):
        told += _of_lens(fit, estimate)
    return told


def _of_lens(fit: Fit, estimate: AlignmentEstimate) -> list[Finding]:
    """The wider interval of the alignment where its sigma rests on a distortion that is mostly noise."""
    p, stated = estimate.parameters, estimate.sigma_E
    if p is None or stated is None or p.names != fit.unknowns.names or not {*NESTED} & {*p.names}:
        return []
    there = Fit(fit.unknowns, fit.table, replace(fit.state, values=surely(p), errors=None), fit.C_EK_model)
    sigma = np.sqrt(np.diagonal(there.solve().covariance)[:3])
    growth = float(np.max(sigma / stated))
    if not growth > NOTICEABLE:
        return []
    sentence = (
        f"the distortion is mostly noise, and the sigmas count it as known: with what is sure of it they are "
        f"{growth:.2g} times as large, and the interval holds that"
    )
    return [Finding(sentence, True, half_E=NORMAL_95 * sigma)]


def surely(p: ParameterVector) -> Array:
    """The values (p,) with the part of the distortion that is surely there."""
    places = [p.names.index(name) for name in NESTED if name in p.names]
    block = p.covariance[3:, 3:][np.ix_(places, places)]
    sigma = np.sqrt(np.diagonal(block))
    R = np.linalg.cholesky(np.linalg.inv(block / np.outer(sigma, sigma))).T
    w = R @ (p.values[places] / sigma)
    shrunk = w * np.maximum(0.0, 1.0 - SURE / np.maximum(w**2, 1e-300))
    values = p.values.copy()
    values[places] = sigma * np.linalg.solve(R, shrunk)
    return np.asarray(values)
