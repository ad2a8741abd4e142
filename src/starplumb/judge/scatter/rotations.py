"""The rotation of the answer that each image alone would make, and the covariance of that by source."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...estimators.consensus import own_covariance
from ...estimators.fit import Fit
from ...estimators.image_sums import ImageSums, image_sums
from ...physics.covariance import square_root
from ...solve.chunks import repeated_landmarks
from ...solve.problem import Linear
from ...solve.whitening import sums
from ...table.equation import Linearised
from ...table.observations import Observations

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LANDMARKS_AT_MOST = 100
"""Landmarks seen again whose errors images are taken to share; more of them count as the images' own."""


@dataclass(frozen=True)
class ImageRotations:
    """Rotations ``d_E`` (m, 3) rad of the answer that each image alone would make, and their stated covariance by
    source (m, 3, 3): sightings, attitude and position.

    ``common`` (m, 3, p) is what the errors in common, named ``common_of``, do to them, ``landmarks`` (m, 3, 3 q) what
    those of landmarks seen again do, which is part of ``sightings_E`` too, and ``per_second_E`` (m, 3) rad/s what a
    time too late does.  ``squares`` is the sum of the weighted
    squares within the images, with ``degrees`` of freedom, errors in common among them; ``image`` (m,) are the images,
    ``sigma_px`` that of their
    sightings.
    """

    image: Index
    d_E: Array
    sightings_E: Array
    attitude_E: Array
    position_E: Array
    common: Array
    landmarks: Array
    per_second_E: Array
    common_of: tuple[str, ...]
    squares: float
    degrees: float
    sigma_px: float

    @property
    def size(self) -> int:
        return len(self.d_E)

    def some(self, most: int) -> ImageRotations:
        """So many of them, spread evenly."""
        if self.size <= most:
            return self
        k = np.linspace(0, self.size - 1, most).astype(np.int64)
        return replace(self, **{name: getattr(self, name)[k] for name in _PER_IMAGE})


_PER_IMAGE = (
    "image",
    "d_E",
    "sightings_E",
    "attitude_E",
    "position_E",
    "common",
    "landmarks",
    "per_second_E",
)


def image_rotations(fit: Fit) -> ImageRotations | None:
    """Of the images used that fix a rotation; None for fewer than two."""
    o = fit.table
    again = repeated_landmarks(o)
    place = np.full(o.n_landmarks, -1)
    if again.size <= LANDMARKS_AT_MOST:
        place[again] = np.arange(again.size)
    found = [_of_part(linear, place) for _, linear in fit.parts()]
    columns: list[Any] = [np.concatenate([one[k] for one in found]) for k in range(len(_PER_IMAGE))]
    if len(columns[0]) < 2:
        return None
    names = o.common_of or ("",) * columns[5].shape[-1]
    squares, degrees = _with_common(*(sum(one[k] for one in found) for k in (-3, -2, -1)))
    sigma = float(np.sqrt(np.mean(o.sigma_px**2)))
    fields = dict(zip(_PER_IMAGE, columns, strict=True))
    return ImageRotations(**fields, common_of=names, squares=squares, degrees=degrees, sigma_px=sigma)


def _of_part(linear: Linear, place: Index) -> tuple[Any, ...]:
    """The arrays of :class:`ImageRotations` of some images, squares and degrees; ``place`` (L,) numbers the landmarks
    whose errors are shared."""
    o, model, _ = linear
    sums_of = image_sums(o, model, np.flatnonzero(o.weight > 0.0), model.z_px)
    fixed, rows = sums_of.fixed, sums_of.rows
    image, b = sums_of.image[fixed], sums_of.b[fixed]
    Q = np.linalg.inv(sums_of.N[fixed])
    gain = Q @ sums_of.toward[fixed]
    common, within = np.zeros((image.size, 3, 0)), np.zeros((0, 0))
    if o.common_px is not None:
        HWC = sums_of.of(sums_of.HW @ o.common_px[rows])[fixed]
        common, within = -(Q @ HWC), _within(o, model, sums_of) - np.sum(HWC.mT @ Q @ HWC, axis=0)
    landmarks = Q @ _of_landmarks(o, model, sums_of, place)[fixed]
    moved = model.H[rows] @ o.omega_E[rows, :, None] - model.R[rows] @ o.v_J[rows, :, None]
    per_second = Q @ sums_of.of(sums_of.HW @ moved)[fixed]
    squares = np.sum(sums_of.squares[fixed] - (b.mT @ Q @ b)[:, 0, 0])
    position = gain @ o.cov_position_J[image] @ gain.mT
    degrees = np.sum(2 * sums_of.count[fixed] - 3)
    d_E, attitude = -(Q @ b)[..., 0], o.cov_attitude_E[image]
    own = (image, d_E, Q, attitude, position, common, landmarks, per_second[..., 0])
    return (*own, squares, degrees, within)


def _within(o: Observations, model: Linearised, images: ImageSums) -> Array:
    """Sum of ``C^T W C`` (p, p) over the images that fix a rotation, C what the errors in common do."""
    rows = images.rows[np.repeat(images.fixed, images.count)]
    root = np.linalg.cholesky(np.linalg.inv(own_covariance(o, model)[rows])).mT
    C = (root @ (0.0 if o.common_px is None else o.common_px[rows])).reshape(2 * rows.size, -1)
    return np.asarray(C.T @ C)


def _with_common(squares: float, degrees: int, within: Array) -> tuple[float, float]:
    """Squares and degrees of freedom of a chi-square like what is left within the images, to which the errors in common
    add: with ``within`` (p, p) what they do there, of trace a and square b, the squares are ``(n + a)`` on average and
    their variance is ``2 (n + 2 a + b)``."""
    a, b = float(np.trace(within)), float(np.sum(within**2))
    scale = (degrees + a) / (degrees + 2.0 * a + b) if degrees else 1.0
    return float(squares) * scale, (degrees + a) * scale


def _of_landmarks(o: Observations, model: Linearised, images: ImageSums, place: Index) -> Array:
    """What the errors of the landmarks whose number ``place`` (L,) is not negative do to each image (m, 3, 3 q)."""
    m, q, rows = images.image.size, int(np.max(place, initial=-1)) + 1, images.rows
    if not q:
        return np.zeros((m, 3, 0))
    number = np.repeat(np.arange(m), images.count)
    seen = place[o.landmark[rows]]
    shared = np.flatnonzero(seen >= 0)
    root = square_root(o.cov_landmark_J[o.landmark[rows[shared]]])
    by_pair = sums(images.HW[shared] @ model.R[rows[shared]] @ root, number[shared] * q + seen[shared], m * q)
    return np.moveaxis(by_pair.reshape(m, q, 3, 3), 1, 2).reshape(m, 3, 3 * q)
