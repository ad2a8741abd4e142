"""Do images scatter along the one direction in which a wrong time of each would turn it?

A time t_i too late turns what image i implies by ``t_i u_i``.  With P the projector of the residuals d and U the
columns u_i, one an image, the free times lower chi-square by::

    q = r^T K^+ r,    r = U^T P d,    K = U^T P U

a chi-square of as many degrees of freedom as K has rank, whatever the sigmas are.  A test of all directions together
has three times as many, and sees half of the images 4 sigmas off less surely.  Times of the variance s^2 raise the mean
of q by ``s^2 tr K``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..trust import NORMAL_95
from .variances import Projector

Array = NDArray[np.float64]

RANK = 1e-9
"""Eigenvalue of K, over the largest, below which a combination of times turns nothing."""


@dataclass(frozen=True)
class TimesFound:
    """Probability ``p`` of at least such a scatter along the flight, the standard deviation ``sigma_s`` of the times
    that would explain it, and what they would do to the answer, (3, 3) rad^2 about E: its 95 % interval is 1.96 times
    the root, as Student's t of the rank has it."""

    p: float
    sigma_s: float
    covariance_E: Array


def times_found(residual: Projector, d_E: Array, per_second_E: Array) -> TimesFound | None:
    """What rotations d_E (m, 3) rad say of the times of images, which turn them by per_second_E (m, 3) rad/s; None
    where times turn nothing."""
    from ...solve.probability import chdtrc, stdtrit

    m = len(d_E)
    U = np.zeros((m, 3, m))
    U[np.arange(m), :, np.arange(m)] = per_second_E
    r, K = (np.einsum("iak,ia...->k...", U, residual.of(X)) for X in (d_E[..., None], U))
    values, axes = np.linalg.eigh(K)
    told = values > RANK * values[-1]
    if not np.any(told) or values[-1] <= 0.0:
        return None
    q, rank = float(np.sum((axes.T @ r[:, 0])[told] ** 2 / values[told])), int(np.sum(told))
    sigma_s = float(np.sqrt(max(q - rank, 0.0) / np.sum(values)))
    student = float(stdtrit(rank, 0.975)) / NORMAL_95
    moved = student * sigma_s * (residual.gain @ per_second_E[..., None])[..., 0]
    return TimesFound(float(chdtrc(rank, q)), sigma_s, moved.T @ moved)
