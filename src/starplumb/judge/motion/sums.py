"""What each image says of the mounting, its own errors eliminated: all that a model of its motion needs.

An image i leaves ``z + H x + A o`` of a rotation x of the mounting and of what it shares with others, o (parameters,
errors in common, places of landmarks seen again, each in units of what is known of it).  A mounting that moves by
``x_i = sum_a f_ia c_a`` has, with the images' normal equations ``N_i, b_i`` (:mod:`starplumb.solve.normals`), those of
its coefficients c, in which o is eliminated::

    M = sum_i f_i f_i^T (x) N_i - W^T W,   v = sum_i f_i (x) b_i - W^T g,   W = sum_i f_i^T (x) W_i

with ``W_i = L^-1 B_i^T``, ``g = L^-1 b_o``, ``L L^T`` the information on o.  The best c is ``-M^-1 v``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...estimators.fit import Fit
from ...physics.covariance import square_root
from ...solve.chunks import repeated_landmarks
from ...solve.normals import ImageNormals, image_normals

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AT_MOST = 1_000
"""Images that are used, spread evenly over the list; all if there are no more."""
LANDMARKS_AT_MOST = 100
"""Landmarks seen again whose errors images are taken to share; more of them count as the images' own."""
WELL = 1e-9
"""Part of the largest eigenvalue of an image's information below which it says nothing along that axis."""


@dataclass(frozen=True)
class ImageSums:
    """Of m images with the numbers ``image`` (m,): ``N`` (m, 3, 3), ``b`` (m, 3), ``W`` (m, c, 3), ``g`` (c,); what is
    known of the mounting beforehand is ``prior`` (3, 3) and ``prior_vector`` (3,)."""

    image: Index
    N: Array
    b: Array
    W: Array
    g: Array
    prior: Array
    prior_vector: Array

    @property
    def size(self) -> int:
        return len(self.N)

    def equations(self, F: Array) -> tuple[Array, Array]:
        """M (..., 3 q, 3 q) and v (..., 3 q) of coefficients of the columns F (..., m, q), q blocks of three."""
        *batch, m, q = F.shape
        pairs = (F[..., :, None] * F[..., None, :]).reshape(*batch, m, q * q)
        blocks = (pairs.mT @ self.N.reshape(m, 9)).reshape(*batch, q, q, 3, 3)
        M = np.moveaxis(blocks, -2, -3).reshape(*batch, 3 * q, 3 * q)
        v = (F.mT @ self.b).reshape(*batch, 3 * q)
        if self.g.size:
            W = (F.mT @ self.W.reshape(m, -1)).reshape(*batch, q, self.g.size, 3)
            W = np.moveaxis(W, -2, -3).reshape(*batch, self.g.size, 3 * q)
            M, v = M - W.mT @ W, v - (W.mT @ self.g[:, None])[..., 0]
        return M, v

    @property
    def own_rotations(self) -> tuple[float, int]:
        """How much chi-square falls from a mounting without error if every image has a rotation of its own, and the
        number of these that are determined."""
        values, axes = np.linalg.eigh(self.N)
        kept = values > WELL * values[:, -1:]
        inverse = (axes * np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)[:, None, :]) @ axes.mT
        Nb = (inverse @ self.b[..., None])[..., 0]
        gained = float(np.sum(self.b * Nb))
        if self.g.size:
            H = np.eye(self.g.size) - np.sum(self.W @ inverse @ self.W.mT, axis=0)
            w = self.g - np.einsum("mck,mk->c", self.W, Nb)
            gained += float(w @ np.linalg.lstsq(H, w, rcond=None)[0] - self.g @ self.g)
        return gained, int(np.sum(kept))

    def moved(self, x: Array) -> ImageSums:
        """The same about mountings that differ by rotations x (m, 3) rad: of ``exp(-x)`` times each image's."""
        g = self.g - np.einsum("mck,mk->c", self.W, x) if self.g.size else self.g
        return replace(self, b=self.b - (self.N @ x[..., None])[..., 0], g=g)

    def scaled(self, variance: float) -> ImageSums:
        """With all errors larger by this factor of their variance; what is known beforehand stays."""
        s = 1.0 / variance
        return replace(self, N=s * self.N, b=s * self.b, W=np.sqrt(s) * self.W, g=np.sqrt(s) * self.g)


def image_sums(fit: Fit) -> ImageSums | None:
    """Of the images used in an adjustment; None where there is none."""
    o = fit.table
    seen = np.unique(o.image[o.weight > 0.0])
    if seen.size > AT_MOST:
        seen = seen[np.linspace(0, seen.size - 1, AT_MOST).astype(np.int64)]
        chosen = np.isin(o.image, seen)
        fit = replace(fit, table=o.select(chosen))
    again = repeated_landmarks(fit.table)
    again = again if again.size <= LANDMARKS_AT_MOST else again[:0]
    found = list(image_normals(fit.whole, again))
    return _eliminated(fit, again, found) if found else None


def _eliminated(fit: Fit, again: Index, found: list[ImageNormals]) -> ImageSums:
    information, step = fit.whole.prior
    k = information.shape[-1]
    scale = np.concatenate([1.0 / np.sqrt(np.diagonal(information)[3:]), np.ones(3 * again.size)])
    roots = square_root(fit.table.cov_landmark_J[again])
    width, m = scale.size, len(found)
    N, b, B = np.zeros((m, 3, 3)), np.zeros((m, 3)), np.zeros((m, 3, width))
    C, g = np.eye(width), np.zeros(width)
    g[: k - 3] = -step[3:] / scale[: k - 3]
    for i, one in enumerate(found):
        T, where = _unit(one, again, roots, scale, k)
        own = T.T @ one.information @ T
        v = T.T @ one.vector
        N[i], b[i], B[i][:, where] = own[:3, :3], v[:3], own[:3, 3:]
        C[np.ix_(where, where)] += own[3:, 3:]
        g[where] += v[3:]
    L = np.linalg.cholesky(C)
    W = np.linalg.solve(L, B.mT) if width else np.zeros((m, 0, 3))
    image = np.array([one.image for one in found])
    prior = information[:3, :3]
    return ImageSums(image, N, b, W, np.linalg.solve(L, g) if width else g, prior, -prior @ step[:3])


def _unit(one: ImageNormals, again: Index, roots: Array, scale: Array, k: int) -> tuple[Array, Index]:
    """Takes the unknowns of an image to units of what is known of them, and their places among all others."""
    T = np.eye(len(one.vector))
    T[np.arange(3, k), np.arange(3, k)] = scale[: k - 3]
    places = np.searchsorted(again, one.landmarks)
    for j, place in enumerate(places.tolist()):
        at = slice(k + 3 * j, k + 3 * j + 3)
        T[at, at] = roots[place]
    landmarks = k - 3 + (3 * places[:, None] + np.arange(3)).reshape(-1)
    return T, np.concatenate([np.arange(k - 3), landmarks]).astype(np.int64)
