"""Least squares with errors that are shared.

The unknowns are a few common parameters x (the alignment, first of all), six per image (its attitude error alpha_E and
position error rho_J) and three per landmark (its place error pi_J), the latter two held by their stated covariances::

    v = z + A x + H alpha_i - R rho_i + R pi_l,      minimise |v|^2/sigma^2 + |S^-1 (alpha, rho, pi)|^2

A landmark seen once is folded into the noise of its one sighting (2 x 2); the other shared errors are eliminated
(:mod:`starplumb.solve.normal`), and what is left is as wide as x.  With S a square root of the stated covariance the
shared unknowns have unit prior: a stated sigma of zero is allowed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..table.equation import Linearised
from ..table.observations import Observations
from .normal import Eliminated, Pairs, eliminate, normal_equations
from .whitening import Roots, groups

Array = NDArray[np.float64]
Prior = tuple[Array, Array]
"""Information (..., k, k) and step (..., k): ``x ~ N(step, information^-1)``."""


@dataclass(frozen=True)
class SharedErrors:
    """``alpha_E`` (..., m, 3) rad, ``rho_J`` (..., m, 3) m and ``pi_J`` (..., L, 3) m; the latter zero for a landmark
    seen once, whose error stays in its residual."""

    alpha_E: Array
    rho_J: Array
    pi_J: Array

    @classmethod
    def of(cls, o: Observations, roots: Roots, eliminated: Eliminated, x: Array) -> SharedErrors:
        """Of a table at the solution x (..., k)."""
        y = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)[..., None, :, None]
        a, b = -(eliminated.C_image @ y), -(eliminated.C_landmark @ y)
        pi_J = np.zeros((*x.shape[:-1], o.n_landmarks, 3))
        pi_J[..., roots.repeated, :] = (roots.S_landmark @ b)[..., 0]
        attitude, position = roots.S_attitude @ a[..., :3, :], roots.S_position @ a[..., 3:, :]
        return cls(attitude[..., 0], position[..., 0], pi_J)

    @classmethod
    def unknown(cls, o: Observations) -> SharedErrors:
        """Of a table without a solution: nothing is a number."""
        images, landmarks = np.full((o.n_images, 3), np.nan), np.full((o.n_landmarks, 3), np.nan)
        return cls(images, images, landmarks)


@dataclass(frozen=True)
class Adjustment:
    """Solution of one linear step.

    ``x`` (..., k) step of the common parameters with ``information`` and ``covariance`` (..., k, k); ``chi2`` (...) the
    minimum, which has 2 n - k degrees of freedom (plus those of a prior on x).
    """

    x: Array
    information: Array
    covariance: Array
    chi2: Array

    @classmethod
    def of(cls, squares: Array, prior: Prior | None = None) -> Adjustment:
        """From the normal equations (..., k + 1, k + 1) of [A, z] less the shared errors, and a prior.

        Where the common parameters are not determined their covariance is infinite and their step zero.
        """
        information, right, chi2 = squares[..., :-1, :-1], squares[..., :-1, -1], squares[..., -1, -1]
        if prior is not None:
            pull = (prior[0] @ prior[1][..., None])[..., 0]
            information, right = information + prior[0], right - pull
            chi2 = chi2 + np.vecdot(prior[1], pull)
        covariance = invert_information(information)
        x = -(np.where(np.isfinite(covariance), covariance, 0.0) @ right[..., None])[..., 0]
        return cls(x, information, covariance, np.asarray(chi2 + np.vecdot(right, x)))

    @classmethod
    def none(cls, k: int) -> Adjustment:
        """No solution: nothing is a number, and nothing is determined."""
        return cls(np.full(k, np.nan), np.zeros((k, k)), np.full((k, k), np.inf), np.asarray(np.nan))


def solve(
    observations: Observations,
    model: Linearised,
    A: Array,
    prior_information: Array | None = None,
    prior_step: Array | None = None,
) -> Adjustment:
    """One linear step for the common parameters with design A (..., n, 2, k), px per unit, and any batch axes.

    A prior says ``x ~ N(prior_step, prior_information^-1)``, shapes (..., k) and (..., k, k).
    """
    roots = Roots.of(observations)
    squares = eliminated(observations, roots, model, A)[1]
    if prior_information is None or prior_step is None:
        return Adjustment.of(squares)
    return Adjustment.of(squares, (prior_information, prior_step))


def eliminated(o: Observations, roots: Roots, model: Linearised, A: Array) -> tuple[Eliminated, Array]:
    """The shared errors of a table with any batch axes, and the normal equations of [A, z] less them."""
    d, pairs = roots.design(o, model, A), Pairs.among(o, roots)
    found = eliminate(normal_equations(o, d, pairs), pairs)
    return found, found.squares_of(d, o.image)


def squares_by_image(o: Observations, model: Linearised, A: Array) -> Array:
    """The normal equations (..., m, k + 1, k + 1) of [A, z] image by image, less the errors of each; every landmark is
    seen once."""
    roots = Roots.of(o)
    d = roots.design(o, model, A)
    found = eliminate(normal_equations(o, d, Pairs.among(o, roots)), Pairs.among(o, roots))
    left, C = found.left(d, o.image), found.C_image
    squares = C.mT @ C
    for group, sightings in groups(o.image, o.n_images):
        rows = left[..., sightings, :, :]
        rows = rows.reshape(*rows.shape[:-3], -1, rows.shape[-1])
        squares[..., group, :, :] += rows.mT @ rows
    return np.asarray(squares)


def invert_information(information: Array) -> Array:
    """Covariance of the common parameters; infinite where a run leaves one of them undetermined."""
    if information.shape[-1] == 0:
        return information
    scale = np.sqrt(np.diagonal(information, axis1=-2, axis2=-1))
    bad = ~np.all(np.isfinite(scale) & (scale > 0.0), axis=-1)
    safe = np.where(bad[..., None], 1.0, scale)
    unit = information / (safe[..., :, None] * safe[..., None, :])
    unit = np.where(bad[..., None, None], np.eye(information.shape[-1]), unit)
    # correlations closer to one than rounding can tell leave a direction undetermined
    bad |= np.linalg.eigvalsh(unit)[..., 0] < 1e-14
    unit = np.where(bad[..., None, None], np.eye(information.shape[-1]), unit)
    inverse = np.linalg.inv(unit) / (safe[..., :, None] * safe[..., None, :])
    return np.where(bad[..., None, None], np.inf, 0.5 * (inverse + inverse.mT))
