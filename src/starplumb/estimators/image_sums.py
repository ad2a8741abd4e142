"""What each image's own sightings say of the attitude: the sums that its errors in common are parted from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..table.equation import Linearised
from ..table.observations import Observations
from .consensus import own_covariance

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

CONDITION = 1e10
"""Condition of the information on a rotation from which an image fixes none."""


@dataclass(frozen=True)
class ImageSums:
    """Sums over the sightings of ``image`` (m,), with ``W`` the inverse covariance of a sighting's own errors.

    ``N = sum H^T W H`` (m, 3, 3) rad^-2, ``b = sum H^T W z`` (m, 3, 1), ``toward = sum H^T W R`` (m, 3, 3) for a common
    error of place in J, ``squares = sum z^T W z`` (m,) and their ``count`` (m,).  The sightings ``rows`` (k,) stand
    image by image, each image's from ``starts`` (m,) on; ``HW`` (k, 3, 2) are their products.
    """

    image: Index
    N: Array
    b: Array
    toward: Array
    squares: Array
    count: Index
    rows: Index
    starts: Index
    HW: Array

    @property
    def fixed(self) -> Mask:
        """Which images (m,) fix a rotation by themselves."""
        if self.image.size == 0:
            return np.zeros(0, dtype=np.bool_)
        return np.asarray((self.count > 1) & (np.linalg.cond(self.N) < CONDITION))

    def of(self, values: Array) -> Array:
        """Sums (m, ...) of values (k, ...) of the sightings."""
        return np.add.reduceat(values, self.starts) if self.starts.size else values


def image_sums(o: Observations, model: Linearised, rows: Index, z_px: Array) -> ImageSums:
    """The sums of the sightings ``rows`` (k,) of a table, with the residuals ``z_px`` (n, 2) of all its sightings."""
    rows = rows[np.argsort(o.image[rows], kind="stable")]
    starts = np.flatnonzero(np.diff(o.image[rows], prepend=-1))
    W, H, z = np.linalg.inv(own_covariance(o, model)[rows]), model.H[rows], z_px[rows][..., None]
    HW = H.mT @ W
    terms = [HW @ H, HW @ z, HW @ model.R[rows], (z.mT @ W @ z)[:, 0, 0]]
    if starts.size:
        terms = [np.add.reduceat(term, starts) for term in terms]
    N, b, toward, squares = terms
    count = np.diff(starts, append=rows.size) if starts.size else starts
    return ImageSums(o.image[rows[starts]], N, b, toward, squares, count, rows, starts, HW)
