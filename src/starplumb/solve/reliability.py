"""What the adjustment says of each of its own observations: residual cofactors, and the test of every one of them.

Everything with a stated sigma is an observation and is tested alike: a sighting (2 numbers), the attitude and position
of an image (6, whose stated covariance says that their errors are zero on average) and the place of a landmark (3)::

    T = v^T Q_vv^-1 v,      chi-square with as many degrees of freedom as v has that the others control

is the fall of the whole chi-square when that one observation is left out (mean-shift test; for one number T = w^2 with
Baarda's w).  A sighting that has no part in the solution is tested by its prediction, ``T = z^T (I + B Q B^T)^-1 z``:
the same number as if it had been in and were left out.  Redundancies sum to the degrees of freedom.

Source: W. Baarda, A testing procedure for use in geodetic networks, Netherlands Geodetic Commission 2 (5), 1968.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .normal import Cofactors, Eliminated
from .whitening import Design

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

CONTROLLED = 0.05
"""Share of an error of an image or landmark that must show for its direction to be tested at all."""
UNTESTABLE = 1e-6
"""Redundancy below which a sighting is not controlled by the others: its residual is zero whatever its error."""
NOISE = 13.8
"""Chi-square with 2 degrees of freedom that noise exceeds once in a thousand."""


@dataclass(frozen=True)
class Solution:
    """The common parameters x (k,) with their ``covariance`` (k, k), and the ``shared`` errors with their
    ``cofactors``, all that the statistics of an observation are made of (no batch axes)."""

    x: Array
    covariance: Array
    shared: Eliminated
    cofactors: Cofactors

    @cached_property
    def image_cofactor(self) -> Array:
        """Covariance (m, 6, 6) of each image's estimated errors, in units of their prior."""
        return _grown(self.cofactors.image, self.shared.C_image, self.covariance)

    @cached_property
    def landmark_cofactor(self) -> Array:
        """Likewise (q, 3, 3) of the landmarks seen more than once."""
        return _grown(self.cofactors.landmark, self.shared.C_landmark, self.covariance)

    @property
    def images(self) -> tuple[Array, Index]:
        """T (m,) of each image's attitude and position taken together, and its degrees of freedom (m,)."""
        error = -(self.shared.C_image @ np.append(self.x, 1.0))
        return _mean_shift(error, np.eye(6) - self.image_cofactor, CONTROLLED)

    @property
    def landmarks(self) -> tuple[Array, Index]:
        """T (q,) of the place of each landmark seen more than once, and its degrees of freedom (q,)."""
        error = -(self.shared.C_landmark @ np.append(self.x, 1.0))
        return _mean_shift(error, np.eye(3) - self.landmark_cofactor, CONTROLLED)


def _grown(Z: Array, C: Array, Q: Array) -> Array:
    A = C[..., :-1]
    return np.asarray(Z + A @ Q @ A.mT)


@dataclass(frozen=True)
class Reliability:
    """Residuals of some sightings (no batch axes) with their cofactors, in units of the stated sigmas.

    =================== ============ ===============================================================================
    used                (n,)         whether the sighting has a part in the solution
    v                   (n, 2)       residual, of an unused sighting the misfit of its prediction; whitened
    hat                 (n, 2, 2)    ``B Q B^T``, covariance of the adjusted observation, whitened
    per_px              (n, 2, 2)    whitened shift of a residual by a pixel of column and row
    effect              (n, k, 2)    change of the common parameters by a whitened shift of the sighting
    =================== ============ ===============================================================================
    """

    used: Mask
    v: Array
    hat: Array
    per_px: Array
    effect: Array

    @cached_property
    def control(self) -> Array:
        """What an error of the sighting leaves in its residual (n, 2, 2), as if it were in the solution: I - hat.

        Of one that is not, ``I - hat_in = (I + hat_out)^-1``.
        """
        h = self.hat
        a, c, b = 1.0 + h[:, 0, 0], 1.0 + h[:, 1, 1], h[:, 0, 1]
        scale = np.where(self.used, 1.0, 1.0 / (a * c - b * b))
        R = np.empty_like(h)
        R[:, 0, 0] = np.where(self.used, 2.0 - a, c) * scale
        R[:, 1, 1] = np.where(self.used, 2.0 - c, a) * scale
        R[:, 0, 1] = R[:, 1, 0] = -b * scale
        return R

    @cached_property
    def residual(self) -> Array:
        """Whitened residual (n, 2) as if the sighting were in the solution."""
        R, v = self.control, self.v
        inside = np.stack([np.sum(R[:, i] * v, axis=-1) for i in range(2)], axis=-1)
        return np.asarray(np.where(self.used[:, None], v, inside))

    @cached_property
    def influence(self) -> Array:
        """Change (n, k, 2) of the common parameters by a whitened error of a sighting in the solution."""
        if np.all(self.used):
            return self.effect
        return np.where(self.used[:, None, None], self.effect, self.effect @ self.control)

    @property
    def redundancy(self) -> Array:
        """Share (n,) of the sighting's two numbers that the others control, 0 .. 1."""
        return np.asarray(0.5 * (self.control[:, 0, 0] + self.control[:, 1, 1]))

    @cached_property
    def sightings(self) -> tuple[Array, Index]:
        """T (n,) of each sighting and its degrees of freedom (n,)."""
        return _mean_shift_of_two(self.residual, self.control, UNTESTABLE)


def _mean_shift(v: Array, Q: Array, floor: float) -> tuple[Array, Index]:
    """v^T Q^+ v over the directions whose eigenvalue exceeds ``floor``, and how many they are; v (..., d)."""
    values, vectors = np.linalg.eigh(Q)
    tested = values > floor
    along = (vectors.mT @ v[..., None])[..., 0]
    T = np.sum(np.where(tested, along**2 / np.where(tested, values, 1.0), 0.0), axis=-1)
    return np.asarray(T), np.sum(tested, axis=-1)


def _mean_shift_of_two(v: Array, Q: Array, floor: float) -> tuple[Array, Index]:
    """The same for two numbers each, written out: v (n, 2), Q (n, 2, 2)."""
    a, b, c = Q[:, 0, 0], Q[:, 0, 1], Q[:, 1, 1]
    middle, reach = 0.5 * (a + c), np.hypot(0.5 * (a - c), b)
    dof = (middle + reach > floor).astype(np.int64) + (middle - reach > floor)
    x, y = v[:, 0], v[:, 1]
    determinant = np.where(dof == 2, a * c - b * b, 1.0)
    T = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant
    one = np.flatnonzero(dof == 1)
    if one.size:  # along the eigenvector of the larger eigenvalue l: v^T (Q - l_2) v / (l - l_2) / l
        x, y, low, high = x[one], y[one], (middle - reach)[one], (middle + reach)[one]
        share = a[one] * x * x + 2.0 * b[one] * x * y + c[one] * y * y - low * (x * x + y * y)
        T[one] = share / ((high - low) * high)
    T[dof == 0] = 0.0
    return np.maximum(T, 0.0), dof


def reliability(used: Mask, d: Design, image: Index, pair: Index, solution: Solution) -> Reliability:
    """Of sightings in their images (n,), with the number of their pair (n,), -1 for a landmark seen once.

    ``d`` is their design whatever their weight, ``used`` (n,) whether they have a part in the solution.  With
    C of :mod:`starplumb.solve.normal` and Q the covariance of x, a row (G, D, A) has the cofactor
    ``R Q R^T + (G, D) Z (G, D)^T``, R = A - (G, D) C, Z the cofactors of the shared errors.
    """
    left, Z, G = solution.shared.left(d, image), solution.cofactors, d.P[..., :6]
    R = left[..., :-1]
    spread = R @ solution.covariance
    hat = _outer(R, spread) + _outer(G, _by_image(G, Z.image, image))
    again = np.flatnonzero(pair >= 0)
    if again.size:
        D = d.D[again]
        cross = G[again] @ Z.pair[pair[again]] @ D.mT
        hat[again] += cross + cross.mT + D @ Z.landmark[d.place[again]] @ D.mT
    return Reliability(used, left @ np.append(solution.x, 1.0), hat, d.W, -spread.mT)


def _outer(a: Array, b: Array) -> Array:
    """The symmetric products a b^T (n, 2, 2) of rows (n, 2, w), entry by entry: they are many and small."""
    product = np.empty((len(a), 2, 2))
    for i, j in ((0, 0), (0, 1), (1, 1)):
        product[:, i, j] = product[:, j, i] = np.vecdot(a[:, i], b[:, j])
    return product


def _by_image(G: Array, Z: Array, image: Index) -> Array:
    """G Z of the sighting's image, (n, 2, 6): at once for all of an image where they stand together, as many each."""
    runs = np.flatnonzero(np.diff(image, prepend=-1))
    count = image.size // max(1, runs.size)
    if runs.size and np.array_equal(runs, count * np.arange(runs.size)) and count * runs.size == image.size:
        return np.asarray((G.reshape(runs.size, -1, 6) @ Z[image[runs]]).reshape(G.shape))
    return np.asarray(G @ Z[image])


@dataclass(frozen=True)
class Tested:
    """T and its degrees of freedom, of n sightings, of m images, and of the q landmarks ``repeated``."""

    sightings: tuple[Array, Index]
    images: tuple[Array, Index]
    landmarks: tuple[Array, Index]
    repeated: Index


def excess(tested: Tested, seen: Mask, alpha: float, alpha_group: float) -> tuple[Array, tuple[Array, Array]]:
    """Statistics over their critical values: of sightings (n,), and of images (m,) and repeated landmarks (q,).

    The critical values grow with :func:`variance_factor`, as Pope's tau has it.
    """
    from .probability import chdtri

    factor = variance_factor(tested.sightings[0][seen])

    def over(statistic: tuple[Array, Index], level: float) -> Array:
        T, dof = statistic
        return np.asarray(np.where(dof > 0, T / (factor * chdtri(np.maximum(dof, 1), level)), 0.0))

    groups = over(tested.images, alpha_group), over(tested.landmarks, alpha_group)
    return over(tested.sightings, alpha), groups


def variance_factor(T: Array) -> float:
    """The noise of sightings over what is stated, from the median of their T; 1 unless it is clearly larger.

    The median of chi-square with 2 degrees of freedom is ``2 ln 2``, that of n values is good to ``2 / sqrt(n)``; those
    that noise would hardly reach are left out, so that a majority of blunders is not taken for it.  Sigmas stated too
    small must not turn good sightings into blunders; the estimate's own chi-square tells of them.
    """
    factor = 1.0
    for _ in range(20):
        noise = T[NOISE * factor > T]
        if noise.size == 0:
            return 1.0
        before, factor = factor, max(1.0, float(np.median(noise)) / (2.0 * np.log(2.0)))
        if abs(factor - before) < 1e-3 * before:
            break
    return factor if factor > 1.0 + 3.0 / (np.log(2.0) * np.sqrt(noise.size)) else 1.0
