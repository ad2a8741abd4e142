"""What further errors of images, landmarks and pixels would do to an alignment, and whether the residuals allow them.

An error of image i is ``x_i = (alpha_E, rho_J)`` (6,), of its attitude and of its position; it moves the residuals of
that image's sightings by ``M x`` with ``M = [-H, R]`` of the measurement equation.  With V the covariance of an image's
residuals (pixels, landmarks, and ``M B M^T`` of the stated image errors B) and ``P_i = M^T V^-1 M``::

    N = sum_i P_i[:3, :3] + prior^-1       information on the alignment
    G_i = -N^-1 P_i[:3, :]                 the alignment answers to an error x_i by G_i x_i

Everything about an image is in its sums ``S = M^T W M`` (6, 6) and ``s = M^T W z`` (6,), W the inverse covariance of
what a sighting has for itself, by ``(W^-1 + M B M^T)^-1 = W - W M L (I + L^T S L)^-1 L^T M^T W`` with ``B = L L^T``.
Landmarks are taken as seen once: the errors weighed here are compared in size, not solved for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...physics.covariance import square_root
from ...table.equation import Linearised, linearise
from ...table.observations import Observations

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK = 1 << 15
"""Sightings linearised at a time."""
REFUTED = np.log(10.0)
"""Log of the odds against an error beyond which the residuals speak against it."""


@dataclass(frozen=True)
class OwnErrors:
    """Independent errors besides the stated ones: ``landmark_J`` (L, 3, 3) m^2 and of each pixel coordinate, px^2."""

    landmark_J: Array | None = None
    pixel: float = 0.0


@dataclass(frozen=True)
class ImageErrors:
    """The sightings of a table (no batch axes) at a mounting ``C_EK``, summed image by image.

    ``S`` (m, 6, 6), ``s`` (m, 6); ``stated`` (m, 6, 6) covariance of the image errors; ``own`` is ``sum z^T W z`` and
    ``volume`` the log of the determinant of all W^-1, of the sightings with weight.  ``chosen`` says that many others
    were rejected because they do not fit: those left fit by choice, and then speak against no error.
    """

    observations: Observations
    C_EK: Array
    S: Array
    s: Array
    stated: Array
    own: float
    volume: float
    chosen: bool = False

    @classmethod
    def of(cls, o: Observations, C_EK: Array, further: OwnErrors | None = None) -> ImageErrors:
        m = o.n_images
        S, s, own, volume = np.zeros((m, 6, 6)), np.zeros((m, 6)), 0.0, 0.0
        for part, model in _blocks(o, C_EK):
            M, noise = _moves(model), _noise(part, model, further or OwnErrors())
            W = part.weight[:, None, None] * np.linalg.inv(noise)
            z = model.z_px[..., None]
            WM = W @ M
            np.add.at(S, part.image, M.mT @ WM)
            np.add.at(s, part.image, (WM.mT @ z)[..., 0])
            own += float(np.sum(z.mT @ W @ z))
            volume += float(np.sum(np.log(np.linalg.det(noise)), where=part.weight > 0.0))
        stated = np.zeros((m, 6, 6))
        stated[:, :3, :3], stated[:, 3:, 3:] = o.cov_attitude_E, o.cov_position_J
        return cls(o, C_EK, S, s, stated, own, volume)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Images (m,) with a sighting that counts."""
        return np.asarray(np.trace(self.S, axis1=-2, axis2=-1) > 0.0)

    def reduced(self, B: Array) -> tuple[Array, Array]:
        """``C = L (I + L^T S L)^-1 L^T`` (m, 6, 6) and ``log det (I + L^T S L)`` (m,) with image errors B (m, 6, 6)."""
        L = _root(B)
        inner = np.eye(6) + L.mT @ self.S @ L
        return L @ np.linalg.solve(inner, L.mT), np.linalg.slogdet(inner)[1]

    def information(self, P: Array) -> Array:
        """Information (3, 3) on the alignment."""
        N = np.sum(P[:, :3, :3], axis=0)
        prior = self.observations.prior_E
        return np.asarray(N if prior is None else N + np.linalg.inv(prior))

    @cached_property
    def gains(self) -> Array:
        """G (m, 3, 6): the alignment's error by an error (alpha_E, rho_J) of each image."""
        C, _ = self.reduced(self.stated)
        P = self.S - self.S @ C @ self.S
        return np.asarray(-np.linalg.solve(self.information(P), P[:, :3, :]))

    def deviance(self, B: Array) -> float:
        """-2 log of the restricted likelihood of the residuals with image errors B (m, 6, 6), to a constant."""
        C, growth = self.reduced(B)
        taken = (C @ self.s[..., None])[..., 0]
        N = self.information(self.S - self.S @ C @ self.S)
        t = np.sum(self.s - (self.S @ taken[..., None])[..., 0], axis=0)[:3]
        fit = self.own - float(np.sum(self.s * taken)) - float(t @ np.linalg.solve(N, t))
        return fit + float(np.sum(growth)) + float(np.linalg.slogdet(N)[1]) + self.volume

    def allows(self, further: Array) -> bool:
        """Whether the residuals are compatible with independent image errors (m, 6, 6) besides the stated ones."""
        if self.chosen:
            return True
        odds = 0.5 * (self.deviance(self.stated + further) - self.deviance(self.stated))
        return bool(odds < REFUTED)

    def allows_own(self, further: OwnErrors) -> bool:
        """Whether the residuals are compatible with errors of landmarks and pixels besides the stated ones."""
        if self.chosen:
            return True
        wider = ImageErrors.of(self.observations, self.C_EK, further)
        odds = 0.5 * (wider.deviance(wider.stated) - self.deviance(self.stated))
        return bool(odds < REFUTED)

    def by_images(self, further: Array) -> Array:
        """Covariance (3, 3) rad^2 that independent image errors (m, 6, 6) add to the alignment."""
        G = self.gains
        return np.asarray(np.sum(G @ further @ G.mT, axis=0))

    def by_common(self, moves: Array) -> Array:
        """What one error common to all images does to the alignment (3,), given what it is in each, (m, 6)."""
        return np.asarray(np.einsum("mij,mj->i", self.gains, moves))

    def by_own(self, further: OwnErrors) -> Array:
        """Covariance (3, 3) rad^2 that further errors of landmarks and pixels add to the alignment."""
        total = np.zeros((3, 3))
        if further.pixel:
            for _, _, K in self._answers():
                total += further.pixel * np.sum(K @ K.mT, axis=0)
        if further.landmark_J is not None:
            of_landmark = self._by_landmark()
            total += np.sum(of_landmark @ further.landmark_J @ of_landmark.mT, axis=0)
        return total

    def _by_landmark(self) -> Array:
        """What an error of each landmark does to the alignment, (L, 3, 3) rad per metre."""
        out = np.zeros((self.observations.n_landmarks, 3, 3))
        for part, model, K in self._answers():
            np.add.at(out, part.landmark, K @ model.R)
        return out

    def _answers(self) -> Iterator[tuple[Observations, Linearised, Array]]:
        """Sightings, linearised, with the alignment's answer K (n, 3, 2) to an error of each of their pixels."""
        C, _ = self.reduced(self.stated)
        N = self.information(self.S - self.S @ C @ self.S)
        keep = np.linalg.solve(N, -(np.eye(6) - self.S @ C)[:, :3, :])
        for part, model in _blocks(self.observations, self.C_EK):
            W = part.weight[:, None, None] * np.linalg.inv(_noise(part, model, OwnErrors()))
            yield part, model, keep[part.image] @ (_moves(model).mT @ W)

    def by_pairs(self, pairs: Index) -> Array:
        """What it adds to the covariance (3, 3) rad^2 that pairs (q, 2) of landmarks have one error in common."""
        of_landmark = self._by_landmark()
        a, b = of_landmark[pairs[:, 0]], of_landmark[pairs[:, 1]]
        both = a @ self.observations.cov_landmark_J[pairs[:, 0]] @ b.mT
        return np.asarray(np.sum(both + both.mT, axis=0))


def _blocks(o: Observations, C_EK: Array) -> Iterator[tuple[Observations, Linearised]]:
    for start in range(0, o.n, BLOCK):
        part = o if o.n <= BLOCK else o.select(np.arange(start, min(start + BLOCK, o.n)))
        yield part, linearise(part, C_EK)


def _moves(model: Linearised) -> Array:
    """M (n, 2, 6): the residual by an error (alpha_E, rho_J) of the image."""
    return np.concatenate([-model.H, model.R], axis=-1)


def _noise(o: Observations, model: Linearised, further: OwnErrors) -> Array:
    """Covariance (n, 2, 2) px^2 of what each sighting has for itself: pixels and landmark."""
    landmark = o.cov_landmark_J if further.landmark_J is None else o.cov_landmark_J + further.landmark_J
    place = model.R @ landmark[o.landmark] @ model.R.mT
    return np.asarray(place + (o.noise_px + further.pixel * np.eye(2)))


def _root(B: Array) -> Array:
    """L (m, 6, 6) with ``L L^T = B``: attitude and position apart where nothing joins them, else as one."""
    if not np.any(B[:, :3, 3:]):
        L = np.zeros_like(B)
        L[:, :3, :3], L[:, 3:, 3:] = square_root(B[:, :3, :3]), square_root(B[:, 3:, 3:])
        return L
    scale = np.sqrt(np.maximum(np.diagonal(B, axis1=-2, axis2=-1), 1e-300))
    values, vectors = np.linalg.eigh(B / (scale[:, :, None] * scale[:, None, :]))
    return np.asarray(scale[:, :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])
