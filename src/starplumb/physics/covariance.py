"""Covariances and their roots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def square_root(covariance: Array) -> Array:
    """Symmetric S with S S = covariance (..., 3, 3); works for singular ones, zeros included."""
    if not np.any(
        covariance[..., [0, 0, 1], [1, 2, 2]]
    ):  # a diagonal, as most are: no need of its eigenvectors
        return np.asarray(np.sqrt(np.maximum(covariance, 0.0)))
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]) @ vectors.mT)
