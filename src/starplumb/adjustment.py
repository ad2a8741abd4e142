"""Least squares with errors that are shared: normal equations solved as the arrow they are.

The unknowns are a few common parameters x (the alignment, first of all), six per image (its attitude error alpha_E and
position error rho_J) and three per landmark (its place error pi_J), the latter two held by their stated covariances::

    v = z + A x - H alpha_i - R rho_i + R pi_l,      minimise |v|^2/sigma^2 + |S^-1 (alpha, rho, pi)|^2

Each image meets only its own six unknowns and each landmark its own three, so images are eliminated one by one (6 x 6),
a landmark seen once is folded into the noise of its one sighting (2 x 2), and what is left is as wide as x and the
landmarks seen more often.  No matrix of all observations is ever formed.  Leading batch axes pass through.

With S a square root of the stated covariance the shared unknowns have unit prior: a stated sigma of zero is allowed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .model import Linearised
from .observations import Observations

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Adjustment:
    """Solution of one linear step.

    ``x`` (..., k) step of the common parameters with ``information`` and ``covariance`` (..., k, k); shared errors
    ``alpha_E`` (..., m, 3), ``rho_J`` (..., m, 3), ``pi_J`` (..., L, 3; zero for a landmark seen once, whose error stays in
    its residual); ``v`` (..., n, 2) residuals once those are taken out, in units of their sigma; ``chi2`` (...) the
    minimum, which has 2 n - k degrees of freedom (plus those of a prior on x).
    """

    x: Array
    information: Array
    covariance: Array
    alpha_E: Array
    rho_J: Array
    pi_J: Array
    v: Array
    chi2: Array


def square_root(covariance: Array) -> Array:
    """Symmetric S with S S = covariance (..., 3, 3); works for singular ones, zeros included."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]) @ vectors.mT)


def _inverse_root_2x2(V: Array) -> Array:
    """Lower triangular W with W V W^T = I for symmetric positive definite V (..., 2, 2)."""
    a, b, c = V[..., 0, 0], V[..., 0, 1], V[..., 1, 1]
    l00 = np.sqrt(a)
    l10 = b / l00
    l11 = np.sqrt(c - l10 * l10)
    W = np.zeros_like(V)
    W[..., 0, 0], W[..., 1, 1], W[..., 1, 0] = 1.0 / l00, 1.0 / l11, -l10 / (l00 * l11)
    return W


@dataclass(frozen=True)
class Arrow:
    """Whitened design of an observation table, and which sighting belongs to which image and landmark.

    ``z`` (..., n, 2, 1), ``A`` (..., n, 2, k), ``G`` (..., n, 2, 6) for the image's errors in units of their prior,
    ``D`` (..., n, 2, 3) likewise for a landmark seen more than once (zero for one seen once).
    """

    observations: Observations
    z: Array
    A: Array
    G: Array
    D: Array
    S_attitude: Array
    S_position: Array
    S_landmark: Array

    @classmethod
    def build(cls, observations: Observations, model: Linearised, A: Array) -> Arrow:
        o = observations
        S_attitude, S_position = square_root(o.cov_attitude_E), square_root(o.cov_position_J)
        S_landmark = square_root(o.cov_landmark_J)
        RS = model.R @ S_landmark[..., o.landmark, :, :]
        once = (np.bincount(o.landmark, minlength=o.n_landmarks) == 1)[o.landmark][:, None, None]
        V = np.where(once, RS @ RS.mT, 0.0) + (o.sigma_px**2)[..., None, None] * np.eye(2)
        W = _inverse_root_2x2(V) * np.sqrt(o.weight)[..., None, None]
        attitude = -model.H @ S_attitude[..., o.image, :, :]
        position = -model.R @ S_position[..., o.image, :, :]
        G = W @ np.concatenate(np.broadcast_arrays(attitude, position), axis=-1)
        D = np.where(once, 0.0, W @ RS)
        z, A = W @ model.z_px[..., None], W @ A
        batch = np.broadcast_shapes(*(block.shape[:-3] for block in (z, A, G, D)))
        z, A, G, D = (np.broadcast_to(block, (*batch, *block.shape[-3:])) for block in (z, A, G, D))
        return cls(o, z, A, G, D, S_attitude, S_position, S_landmark)

    @cached_property
    def repeated(self) -> Index:
        """Landmarks seen more than once."""
        return np.flatnonzero(
            np.bincount(self.observations.landmark, minlength=self.observations.n_landmarks) > 1
        )

    @cached_property
    def column(self) -> Index:
        """Place of each landmark among the repeated ones, (L,)."""
        place = np.zeros(self.observations.n_landmarks, dtype=np.int64)
        place[self.repeated] = np.arange(self.repeated.size)
        return place

    def images(self) -> Iterator[tuple[Index, Index]]:
        """Groups of images with equally many sightings: images (g,) and their sightings (g, M)."""
        order = np.argsort(self.observations.image, kind="stable")
        counts = np.bincount(self.observations.image, minlength=self.observations.n_images)
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        for count in np.unique(counts[counts > 0]):
            group = np.flatnonzero(counts == count)
            yield group, order[starts[group, None] + np.arange(count)]

    def rows(self, block: Array, sightings: Index) -> Array:
        """Rows of the sightings (g, M) of a group of images stacked: (..., g, 2 M, columns)."""
        taken = block[..., sightings, :, :]
        return taken.reshape(*taken.shape[:-4], sightings.shape[0], 2 * sightings.shape[1], taken.shape[-1])


def _landmark_rows(arrow: Arrow, sightings: Index) -> Array:
    """D of a group of images spread over the columns of the repeated landmarks: (..., g, 2 M, 3 q)."""
    q = arrow.repeated.size
    D = arrow.D[..., sightings, :, :]
    g, M = sightings.shape
    spread = np.zeros((*D.shape[:-4], g, M, 2, q, 3))
    place = arrow.column[arrow.observations.landmark[sightings]]
    image, sighting = np.ogrid[:g, :M]
    # indices on both sides of a slice go to the front: (g, M, ..., 2, 3)
    spread[..., image, sighting, :, place, :] = np.moveaxis(D, (-4, -3), (0, 1))
    return spread.reshape(*D.shape[:-4], g, 2 * M, 3 * q)


@dataclass(frozen=True)
class _Image:
    """What elimination leaves of a group of images: (G^T G + I)^-1, G^T Y and G^T z."""

    images: Index
    inverse: Array
    GY: Array
    Gz: Array


def _eliminate_images(arrow: Arrow, k: int) -> tuple[Array, Array, Array, list[_Image]]:
    """Reduced normal matrix and right side over (x, repeated landmarks), and the constant of chi-square."""
    width = k + 3 * arrow.repeated.size
    batch = arrow.z.shape[:-3]
    N, g, constant = np.zeros((*batch, width, width)), np.zeros((*batch, width, 1)), np.zeros(batch)
    eliminated = []
    for images, sightings in arrow.images():
        z, G, Y = (arrow.rows(block, sightings) for block in (arrow.z, arrow.G, arrow.A))
        if arrow.repeated.size:
            Y = np.concatenate([Y, _landmark_rows(arrow, sightings)], axis=-1)
        inverse: Array = np.asarray(np.linalg.inv(G.mT @ G + np.eye(6)), dtype=np.float64)
        GY, Gz = G.mT @ Y, G.mT @ z
        N += np.sum(Y.mT @ Y - GY.mT @ inverse @ GY, axis=-3)
        g += np.sum(Y.mT @ z - GY.mT @ inverse @ Gz, axis=-3)
        constant += np.sum(z * z, axis=(-3, -2, -1)) - np.sum(Gz * (inverse @ Gz), axis=(-3, -2, -1))
        eliminated.append(_Image(images, inverse, GY, Gz))
    landmarks = np.arange(k, width)
    N[..., landmarks, landmarks] += 1.0
    return N, g, constant, eliminated


def _invert_information(information: Array) -> Array:
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
    arrow = Arrow.build(observations, model, A)
    k = A.shape[-1]
    N, g, constant, eliminated = _eliminate_images(arrow, k)
    # landmarks seen repeatedly go next, x is left
    N_ll, N_lx = N[..., k:, k:], N[..., k:, :k]
    back = np.linalg.solve(N_ll, np.concatenate([N_lx, g[..., k:, :]], axis=-1))
    information = N[..., :k, :k] - N_lx.mT @ back[..., :k]
    right = (g[..., :k, :] - N_lx.mT @ back[..., k:])[..., 0]
    constant = constant - np.sum(g[..., k:, 0] * back[..., k], axis=-1)
    if prior_information is not None and prior_step is not None:
        information = information + prior_information
        pull = (prior_information @ prior_step[..., None])[..., 0]
        right = right - pull
        constant = constant + np.sum(prior_step * pull, axis=-1)
    covariance = _invert_information(information)
    x = -(np.where(np.isfinite(covariance), covariance, 0.0) @ right[..., None])[..., 0]
    chi2 = constant + np.sum(right * x, axis=-1)
    b = -(back[..., k] + (back[..., :k] @ x[..., None])[..., 0])
    return _shared_errors(arrow, eliminated, (x, information, covariance, chi2), b)


def _shared_errors(
    arrow: Arrow, eliminated: list[_Image], common: tuple[Array, Array, Array, Array], b: Array
) -> Adjustment:
    """Errors of images and landmarks behind a solution, and the residuals once they are taken out."""
    o, (x, information, covariance, chi2) = arrow.observations, common
    batch = x.shape[:-1]
    y = np.concatenate([x, b], axis=-1)
    a = np.zeros((*batch, o.n_images, 6))
    for group in eliminated:
        right = group.Gz + group.GY @ y[..., None, :, None]
        a[..., group.images, :] = -(group.inverse @ right)[..., 0]
    landmark = np.zeros((*batch, o.n_landmarks, 3))
    landmark[..., arrow.repeated, :] = b.reshape(*batch, -1, 3)
    v = arrow.z + arrow.A @ x[..., None, :, None] + arrow.G @ a[..., o.image, :, None]
    v = v + arrow.D @ landmark[..., o.landmark, :, None]
    return Adjustment(
        x=x,
        information=information,
        covariance=covariance,
        alpha_E=(arrow.S_attitude @ a[..., :3, None])[..., 0],
        rho_J=(arrow.S_position @ a[..., 3:, None])[..., 0],
        pi_J=(arrow.S_landmark @ landmark[..., None])[..., 0],
        v=v[..., 0],
        chi2=chi2,
    )
