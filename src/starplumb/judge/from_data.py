"""What the images alone say of the alignment, and the interval that their scatter supports.

The sightings of an image fix a rotation d of the answer, with the covariance ``V = f_1 (A_xy + P) + f_2 A_z + f_s Q``:
A of the stated attitude across and about the boresight, P of the position, Q of the sightings.  f_s follows from the
residuals within the images; f_1 and f_2 from the scatter of the rotations, by restricted maximum likelihood, with
y = W (d - mean), W = V^-1 and T = W - W (sum W)^-1 W::

    tr(T V_s) = y^T V_s y,      solved by Fisher scoring with the information  1/2 tr(T V_s T V_t)

The answer keeps its stated weights; its variance with these factors has Satterthwaite's degrees of freedom.
Sources: H. D. Patterson, R. Thompson, Biometrika 58 (1971); F. E. Satterthwaite, Biometrics Bulletin 2 (1946).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..estimators.consensus import own_covariance
from ..estimators.fit import Fit
from ..solve.problem import Linear

Array = NDArray[np.float64]

AT_MOST = 2_000
"""Images from which factors are estimated, spread evenly; all if there are no more."""
CONDITION = 1e10
"""Of an image's normal equations up to which it fixes a rotation."""
ROUNDS = 50


@dataclass(frozen=True)
class ImageRotations:
    """Rotations ``d_E`` (m, 3) rad of the answer that each image alone would make, and their stated covariance by
    source (m, 3, 3): sightings, attitude and position.  ``squares`` is the sum of the weighted squares within the
    images, with ``degrees`` of freedom."""

    d_E: Array
    sightings_E: Array
    attitude_E: Array
    position_E: Array
    squares: float
    degrees: int

    @property
    def size(self) -> int:
        return len(self.d_E)

    @property
    def covariance_E(self) -> Array:
        """As stated (m, 3, 3)."""
        return np.asarray(self.sightings_E + self.attitude_E + self.position_E)

    def some(self, most: int) -> ImageRotations:
        """So many of them, spread evenly."""
        if self.size <= most:
            return self
        k = np.linspace(0, self.size - 1, most).astype(np.int64)
        parts = (self.d_E[k], self.sightings_E[k], self.attitude_E[k], self.position_E[k])
        return ImageRotations(*parts, self.squares, self.degrees)


def image_rotations(fit: Fit) -> ImageRotations | None:
    """Of the images used that fix a rotation; None for fewer than two, or where images share errors."""
    if fit.table.common_px is not None:
        return None
    found = [_of_part(linear) for _, linear in fit.parts()]
    d_E, sightings, attitude, position = (np.concatenate([one[k] for one in found]) for k in range(4))
    if len(d_E) < 2:
        return None
    squares, degrees = sum(one[4] for one in found), sum(one[5] for one in found)
    return ImageRotations(d_E, sightings, attitude, position, float(squares), int(degrees))


def _of_part(linear: Linear) -> tuple[Array, Array, Array, Array, float, int]:
    """The fields of :class:`ImageRotations` of some images."""
    o, model, _ = linear
    rows = np.flatnonzero(o.weight > 0.0)
    rows = rows[np.argsort(o.image[rows], kind="stable")]
    starts = np.flatnonzero(np.diff(o.image[rows], prepend=-1))
    if starts.size == 0:
        return np.empty((0, 3)), np.empty((0, 3, 3)), np.empty((0, 3, 3)), np.empty((0, 3, 3)), 0.0, 0
    z, W = model.z_px[rows][..., None], np.linalg.inv(own_covariance(o, model)[rows])
    HW = model.H[rows].mT @ W
    terms = (HW @ model.H[rows], HW @ z, HW @ model.R[rows], z.mT @ W @ z)
    N, b, toward, zz = (np.add.reduceat(term, starts) for term in terms)
    counts = np.diff(starts, append=rows.size)
    fixed = (counts > 1) & (np.linalg.cond(N) < CONDITION)
    image, Q, b = o.image[rows[starts]][fixed], np.linalg.inv(N[fixed]), b[fixed]
    gain = Q @ toward[fixed]
    squares = float(np.sum(zz[fixed] - b.mT @ Q @ b))
    position = gain @ o.cov_position_J[image] @ gain.mT
    degrees = int(np.sum(2 * counts[fixed] - 3))
    return -(Q @ b)[..., 0], Q, o.cov_attitude_E[image], position, squares, degrees


def disagreement_p(images: ImageRotations) -> float:
    """Probability that images scatter about some axis of E at least as much as they do, by Bonferroni's bound."""
    from scipy.special import chdtrc

    V = images.covariance_E
    W = np.linalg.inv(V)
    mean = np.linalg.solve(np.sum(W, axis=0), np.sum(W @ images.d_E[..., None], axis=0)[:, 0])
    squares = np.sum((images.d_E - mean) ** 2 / np.diagonal(V, axis1=-2, axis2=-1), axis=0)
    return min(1.0, 3.0 * float(np.min(chdtrc(images.size - 1, squares))))


@dataclass(frozen=True)
class _Scatter:
    """Rotations d (m, 3) with the covariance ``V(f) = f_1 V_1 + f_2 V_2 + own`` (m, 3, 3)."""

    d: Array
    sources: tuple[Array, Array]
    own: Array

    def V(self, f: Array) -> Array:
        return np.asarray(f[0] * self.sources[0] + f[1] * self.sources[1] + self.own)

    def scores(self, f: Array) -> tuple[Array, Array]:
        """Gradient (2,) and twice the information (2, 2) of the restricted likelihood at f."""
        W = np.linalg.inv(self.V(f))
        C = np.linalg.inv(np.sum(W, axis=0))
        mean = C @ np.sum(W @ self.d[..., None], axis=0)
        y = W @ (self.d[..., None] - mean)
        through = [W @ V for V in self.sources]
        inner = [np.sum(WV @ W, axis=0) for WV in through]
        traces = [_trace(WV) - np.trace(C @ M) for WV, M in zip(through, inner, strict=True)]
        gradient = np.array([np.sum(y.mT @ V @ y) for V in self.sources]) - traces
        twice = np.empty((2, 2))
        for s in range(2):
            for t in range(2):
                both = np.sum(through[s] @ through[t] @ W, axis=0)
                across = np.trace(C @ (both + both.mT)) - np.trace(C @ inner[s] @ C @ inner[t])
                twice[s, t] = _trace(through[s] @ through[t]) - across
        return gradient, twice

    def factors(self) -> tuple[Array, Array]:
        """The factors (2,) and their covariance (2, 2)."""
        f, twice = np.ones(2), np.eye(2)
        for _ in range(ROUNDS):
            gradient, twice = self.scores(f)
            step = np.linalg.lstsq(twice, gradient, rcond=None)[0]
            before, f = f, np.maximum(f + step, np.maximum(1e-2, 0.1 * f))
            if np.max(np.abs(f - before) / before) < 1e-3:
                break
        return f, np.asarray(2.0 * np.linalg.pinv(twice))


def _trace(M: Array) -> float:
    return float(np.sum(np.trace(M, axis1=-2, axis2=-1)))


def half_widths_95(images: ImageRotations, C_EK: Array, sigma_E: Array) -> Array:
    """Half-widths (3,) rad of the 95 % intervals by the scatter of the images; ``sigma_E`` (3,) is as stated."""
    from scipy.special import stdtrit

    some = images.some(AT_MOST)
    z = C_EK[:, 2]
    about = np.outer(z, z)
    across = np.eye(3) - about
    own = max(some.squares / max(some.degrees, 1), 1e-3)
    sources = across @ some.attitude_E @ across + some.position_E, about @ some.attitude_E @ about
    scatter = _Scatter(some.d_E, sources, own * some.sightings_E)
    f, spread = scatter.factors()
    weights = np.linalg.inv(some.covariance_E)

    def variance(g: Array) -> Array:
        """Of the stated weights with factors g, (3,)."""
        C = np.linalg.inv(np.sum(weights, axis=0))
        return np.diagonal(C @ np.sum(weights @ scatter.V(g) @ weights, axis=0) @ C)

    found = variance(f)
    slopes = np.stack([variance(f + unit) - found for unit in np.eye(2)])  # linear in the factors
    freedom = 2.0 * found**2 / np.maximum(np.einsum("si,st,ti->i", slopes, spread, slopes), 1e-300)
    stated = np.diagonal(np.linalg.inv(np.sum(weights, axis=0)))
    return np.asarray(sigma_E * np.sqrt(found / stated) * stdtrit(np.clip(freedom, 1.0, 1e6), 0.975))
