"""Least squares with errors that are shared: normal equations solved as the arrow they are.

The unknowns are a few common parameters x (the alignment, first of all), six per image (its attitude error alpha_E and
position error rho_J) and three per landmark (its place error pi_J), the latter two held by their stated covariances::

    v = z + A x + H alpha_i - R rho_i + R pi_l,      minimise |v|^2/sigma^2 + |S^-1 (alpha, rho, pi)|^2

Each image meets only its own six unknowns and each landmark its own three, so images are eliminated one by one
(6 x 6), a landmark seen once is folded into the noise of its one sighting (2 x 2), and what is left is as wide as x and
the landmarks seen more often; it is summed, sighting by sighting.  Leading batch axes pass through.  A large table is
read in chunks instead, and its images or its landmarks eliminated, whichever leaves less
(:mod:`starplumb.solve.arrow`).

With S a square root of the stated covariance the shared unknowns have unit prior: a stated sigma of zero is allowed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..table.equation import Linearised
from ..table.observations import Observations
from .arrow import Read, Shared
from .whitening import Design, Roots, groups, sums, whiten

Array = NDArray[np.float64]

LARGE = 20_000
"""Sightings from which a table without batch axes is taken in chunks."""
MANY = 60
"""Landmarks seen more than once from which it is taken as the sparse matter it is."""


@dataclass(frozen=True)
class Adjustment:
    """Solution of one linear step.

    ``x`` (..., k) step of the common parameters with ``information`` and ``covariance`` (..., k, k); shared errors
    ``alpha_E`` (..., m, 3), ``rho_J`` (..., m, 3), ``pi_J`` (..., L, 3; zero for a landmark seen once, whose error
    stays in its residual); ``v`` (..., n, 2) residuals once those are taken out, in units of their sigma; ``chi2``
    (...) the minimum, which has 2 n - k degrees of freedom (plus those of a prior on x).
    """

    x: Array
    information: Array
    covariance: Array
    alpha_E: Array
    rho_J: Array
    pi_J: Array
    v: Array
    chi2: Array


@dataclass(frozen=True)
class Normal:
    """Normal equations, images first: ``inverse`` (..., m, 6, 6) of G^T G + I; ``GY``, ``Gz`` (..., m, 6, .) couple an
    image to y = (x, landmarks); ``YY``, ``Yz``, ``zz`` what the images leave of y, (..., w, w) and (..., w, 1), and of
    chi-square, (...)."""

    inverse: Array
    GY: Array
    Gz: Array
    YY: Array
    Yz: Array
    zz: Array


def normal_equations(o: Observations, d: Design) -> Normal:
    """Sum the normal equations and eliminate the images.

    With C = (G^T G + I)^-1 G^T Y the images leave ``Y^T (I + G G^T)^-1 Y = (Y - G C)^T (Y - G C) + C^T C``: a sum of
    squares, which keeps its digits where an attitude error many times the pixel noise makes ``Y^T Y`` less
    ``Y^T G C`` lose them.
    """
    m, q, k, batch = o.n_images, d.repeated.size, d.P.shape[-1] - 7, d.P.shape[:-3]
    inverse = np.array(np.broadcast_to(np.eye(6), (*batch, m, 6, 6)))
    coupled, common = np.zeros((*batch, m, 6, k + 1)), np.zeros((*batch, k + 1, k + 1))
    left = np.empty((*batch, o.n if q else 0, 2, k + 1))  # only landmarks seen again ask for it
    for group, sightings in groups(o.image, m):
        rows = d.P[..., sightings, :, :].reshape(*batch, group.size, -1, 7 + k)
        squares = rows.mT @ rows
        inverse[..., group, :, :] = np.linalg.inv(squares[..., :6, :6] + np.eye(6))
        coupled[..., group, :, :] = squares[..., :6, 6:]
        C = inverse[..., group, :, :] @ squares[..., :6, 6:]
        rest = rows[..., 6:] - rows[..., :6] @ C
        common += np.sum(rest.mT @ rest + C.mT @ C, axis=-3)
        if q:
            left[..., sightings, :, :] = rest.reshape(*batch, *sightings.shape, 2, k + 1)
    YY, Yz = np.zeros((*batch, k + 3 * q, k + 3 * q)), np.zeros((*batch, k + 3 * q, 1))
    YY[..., :k, :k], Yz[..., :k, :] = common[..., :k, :k], common[..., :k, k:]
    seen = np.flatnonzero(d.place >= 0)
    place, D = d.place[seen], d.D[..., seen, :, :]
    across = sums(D.mT @ left[..., seen, :, :], place, q).reshape(*batch, 3 * q, k + 1)
    YY[..., k:, :k], YY[..., :k, k:], Yz[..., k:, :] = across[..., :k], across[..., :k].mT, across[..., k:]
    GD = sums(d.P[..., seen, :, :6].mT @ D, o.image[seen] * q + place, m * q).reshape(*batch, m, q, 6, 3)
    GD = np.moveaxis(GD, -3, -2).reshape(*batch, m, 6, 3 * q)
    landmark = k + 3 * np.arange(q)[:, None] + np.arange(3)
    YY[..., landmark[:, :, None], landmark[:, None, :]] = sums(D.mT @ D, place, q) + np.eye(3)
    YY[..., k:, k:] -= (inverse @ GD).reshape(*batch, 6 * m, -1).mT @ GD.reshape(*batch, 6 * m, -1)
    GY = np.concatenate([coupled[..., :-1], GD], axis=-1)
    return Normal(inverse, GY, coupled[..., -1:], YY, Yz, common[..., k, k])


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


def solve(
    observations: Observations,
    model: Linearised,
    A: Array,
    prior_information: Array | None = None,
    prior_step: Array | None = None,
) -> Adjustment:
    """One linear step for the common parameters with design A (..., n, 2, k), px per unit.

    k may be 0, which leaves the shared errors at the mounting as it stands.  A prior says
    ``x ~ N(prior_step, prior_information^-1)``, shapes (..., k) and (..., k, k).  Where the common
    parameters are not determined their covariance is infinite and their step zero.
    """
    if model.H.ndim == A.ndim == 3 and is_large(observations):
        prior = None if prior_information is None or prior_step is None else (prior_information, prior_step)
        return solve_large(observations, lambda roots, rows: roots.rows(observations, model, A, rows), prior)
    d = whiten(observations, model, A)
    n, k = normal_equations(observations, d), A.shape[-1]
    # landmarks seen repeatedly go next, x is left
    N_ll, N_lx = n.YY[..., k:, k:], n.YY[..., k:, :k]
    back = np.linalg.solve(N_ll, np.concatenate([N_lx, n.Yz[..., k:, :]], axis=-1))
    information = n.YY[..., :k, :k] - N_lx.mT @ back[..., :k]
    right = (n.Yz[..., :k, :] - N_lx.mT @ back[..., k:])[..., 0]
    if prior_information is not None and prior_step is not None:
        information = information + prior_information
        right = right - (prior_information @ prior_step[..., None])[..., 0]
    covariance = invert_information(information)
    x = -(np.where(np.isfinite(covariance), covariance, 0.0) @ right[..., None])[..., 0]
    b = -(back[..., k] + (back[..., :k] @ x[..., None])[..., 0])
    chi2 = np.zeros(x.shape[:-1])
    if prior_information is not None and prior_step is not None:
        off = x - prior_step
        chi2 = np.sum(off * (prior_information @ off[..., None])[..., 0], axis=-1)
    return _with_shared_errors(observations, d, n, (x, information, covariance, chi2), b)


def is_large(o: Observations) -> bool:
    """Whether a table is without batch axes and too large for dense matrices."""
    if o.batch or not o.cov_attitude_E.ndim == o.cov_position_J.ndim == o.cov_landmark_J.ndim == 3:
        return False
    return o.n > LARGE or int(np.sum(np.bincount(o.landmark) > 1)) > MANY


def solve_large(o: Observations, read: Read, prior: tuple[Array, Array] | None = None) -> Adjustment:
    """:func:`solve` of a large table without batch axes, which is read in chunks (:mod:`starplumb.solve.arrow`)."""
    try:
        shared = Shared.of(o, read)
    except np.linalg.LinAlgError:
        return _nothing(o, read(Roots.of(o), slice(0, 1)).P.shape[-1] - 7)
    x, information, covariance = solve_common(shared.squares, prior)
    known = 0.0
    if prior is not None:
        known = float((x - prior[1]) @ prior[0] @ (x - prior[1]))
    y = np.append(x, 1.0)
    a, b, v = -(shared.C_image @ y), -(shared.C_landmark @ y), shared.left @ y
    roots = shared.table.roots
    pi_J = np.zeros((o.n_landmarks, 3))
    pi_J[roots.repeated] = (roots.S_landmark @ b[..., None])[..., 0]
    return Adjustment(
        x=x,
        information=information,
        covariance=covariance,
        alpha_E=(roots.S_attitude @ a[:, :3, None])[..., 0],
        rho_J=(roots.S_position @ a[:, 3:, None])[..., 0],
        pi_J=pi_J,
        v=v,
        chi2=np.asarray(known + np.sum(v * v) + np.sum(a * a) + np.sum(b * b)),
    )


def solve_common(squares: Array, prior: tuple[Array, Array] | None) -> tuple[Array, Array, Array]:
    """x (k,), information and covariance (k, k) from the squares (k + 1, k + 1) of [A, z] less all shared errors."""
    information, right = squares[:-1, :-1], squares[:-1, -1]
    if prior is not None:
        information, right = information + prior[0], right - prior[0] @ prior[1]
    covariance = invert_information(information)
    return -(np.where(np.isfinite(covariance), covariance, 0.0) @ right), information, covariance


def _nothing(o: Observations, k: int) -> Adjustment:
    """No solution: nothing is a number, and nothing is determined."""
    none = np.full(k, np.nan)
    images, landmarks = np.full((o.n_images, 3), np.nan), np.full((o.n_landmarks, 3), np.nan)
    covariance, v = np.full((k, k), np.inf), np.full((o.n, 2), np.nan)
    return Adjustment(none, np.zeros((k, k)), covariance, images, images, landmarks, v, np.asarray(np.nan))


def _with_shared_errors(
    o: Observations, d: Design, n: Normal, common: tuple[Array, Array, Array, Array], b: Array
) -> Adjustment:
    """The solution with the errors of images and landmarks behind it, and the residuals once they are taken out."""
    x, information, covariance, chi2 = common
    batch = x.shape[:-1]
    y = np.concatenate([x, b], axis=-1)[..., None, :, None]
    a = -(n.inverse @ (n.Gz + n.GY @ y))[..., 0]
    b = b.reshape(*batch, -1, 3)
    pi_J = np.zeros((*batch, o.n_landmarks, 3))
    pi_J[..., d.repeated, :] = (d.S_landmark @ b[..., None])[..., 0]
    unknown = np.concatenate(
        [a, np.broadcast_to(x[..., None, :], (*batch, o.n_images, x.shape[-1]))], axis=-1
    )
    v = d.P[..., -1:] + d.P[..., :-1] @ unknown[..., o.image, :, None]
    again = np.flatnonzero(d.place >= 0)
    v[..., again, :, :] += d.D[..., again, :, :] @ b[..., d.place[again], :, None]
    return Adjustment(
        x=x,
        information=information,
        covariance=covariance,
        alpha_E=(d.S_attitude @ a[..., :3, None])[..., 0],
        rho_J=(d.S_position @ a[..., 3:, None])[..., 0],
        pi_J=pi_J,
        v=v[..., 0],
        chi2=chi2
        + np.sum(v * v, axis=(-3, -2, -1))
        + np.sum(a * a, axis=(-2, -1))
        + np.sum(b * b, axis=(-2, -1)),
    )
