"""The covariance of an estimate whose residuals are neither white nor of a known law.

``cov = B^-1 M B^-1`` with the bread B, the curvature of what is minimised, and the meat M, the long-run covariance of
the scores: their products at all lags up to :data:`LAG_PX`, tapered by a triangle along each axis so that M stays
positive.

Sources: P. J. Huber, The behavior of maximum likelihood estimates under nonstandard conditions (1967); W. K. Newey,
K. D. West, A simple, positive semi-definite covariance matrix, Econometrica 55 (1987); T. G. Conley, GMM estimation
with cross sectional dependence, Journal of Econometrics 92 (1999).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAG_PX = 5
"""Residuals farther apart than this are taken to know nothing of each other."""


def long_run(scores: Array, lag: int = LAG_PX) -> Array:
    """Covariance (p, p) of the sum of scores (h, w, p) of pixels that are correlated over at most ``lag`` pixels."""
    down, across = (_taper(n, lag) for n in scores.shape[:2])
    near = np.moveaxis(down @ np.moveaxis(scores, -1, 0) @ across, 0, -1)
    p = scores.shape[-1]
    M = scores.reshape(-1, p).mT @ near.reshape(-1, p)
    return np.asarray(0.5 * (M + M.mT))


@cache
def _taper(n: int, lag: int) -> Array:
    """Weights (n, n) of the pairs of n pixels of a line."""
    away = np.abs(np.arange(n)[:, None] - np.arange(n))
    return np.asarray(np.maximum(1.0 - away / (lag + 1.0), 0.0))


def inverted(N: Array) -> Array:
    """The inverse of a symmetric matrix (p, p) whose rows may differ by many orders in scale; raises LinAlgError."""
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diagonal(N)), 1e-300))
    return np.asarray(np.linalg.inv(N * scale[:, None] * scale) * scale[:, None] * scale)
