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


def pixel_covariance(sigma_px: Array, ellipse: Array | None) -> Array:
    """Covariance (..., n, 2, 2) px^2 of the noise of column and row: ``sigma_px^2`` (..., n) times its ``ellipse``
    (..., n, 2, 2), a circle for None."""
    shape = np.eye(2) if ellipse is None else ellipse
    return np.asarray((sigma_px**2)[..., None, None] * shape)


def pixel_entries(sigma_px: Array, ellipse: Array | None) -> tuple[Array, Array, Array]:
    """Its entries (..., n): variance of the column, covariance, variance of the row."""
    variance = sigma_px**2
    if ellipse is None:
        return variance, np.zeros_like(variance), variance
    return variance * ellipse[..., 0, 0], variance * ellipse[..., 0, 1], variance * ellipse[..., 1, 1]


def pixel_root(sigma_px: Array, ellipse: Array | None) -> Array:
    """Lower triangular L (..., n, 2, 2) px of that covariance, ``L L^T``."""
    root = np.eye(2) if ellipse is None else np.linalg.cholesky(ellipse)
    return np.asarray(sigma_px[..., None, None] * root)


def pixel_distance(px: Array, sigma_px: Array, ellipse: Array | None) -> Array:
    """Length (..., n) of residuals px (..., n, 2) in units of the noise: ``sqrt(px^T covariance^-1 px)``."""
    if ellipse is not None:
        px = np.linalg.solve(np.linalg.cholesky(ellipse), px[..., None])[..., 0]
    return np.asarray(np.linalg.norm(px, axis=-1) / sigma_px)


def pixel_axes(sigma_px: Array, ellipse: Array | None) -> tuple[Array, Array]:
    """Sigmas (..., n) px along the shorter and the longer axis of the noise of a pixel."""
    if ellipse is None:
        return sigma_px, sigma_px
    values = np.linalg.eigvalsh(ellipse)
    return sigma_px * np.sqrt(np.maximum(values[..., 0], 0.0)), sigma_px * np.sqrt(values[..., 1])


def ellipse_of(column_px: Array, row_px: Array, correlation: Array) -> tuple[Array, Array]:
    """``sigma_px`` (n,), the root mean square of the sigmas of column and row, and the ``ellipse`` (n, 2, 2), their
    covariance in units of its square."""
    sigma = np.sqrt(0.5 * (column_px**2 + row_px**2))
    a, b = column_px / sigma, row_px / sigma
    ellipse = np.empty((*sigma.shape, 2, 2))
    ellipse[..., 0, 0], ellipse[..., 1, 1] = a * a, b * b
    ellipse[..., 0, 1] = ellipse[..., 1, 0] = correlation * a * b
    return sigma, ellipse


def ellipse_parts(sigma_px: Array, ellipse: Array) -> tuple[Array, Array, Array]:
    """Sigma of column, sigma of row and their correlation, each (n,): the inverse of :func:`ellipse_of`."""
    a, b = np.sqrt(ellipse[..., 0, 0]), np.sqrt(ellipse[..., 1, 1])
    return sigma_px * a, sigma_px * b, ellipse[..., 0, 1] / (a * b)
