"""Error budget of one calibration: what each stated error source contributes to the covariance of its alignment.

An estimate answers a small shift dz_n of sighting n by ``K_n dz_n`` (:mod:`starplumb.solve.reliability`).  The errors
of one image, of one landmark or of one pixel shift their sightings together, so that each source has::

    attitude  sum_i (sum_n K_n H_n) S_i (...)^T,   position and markers likewise with R,   pixels  sum_n K_n S_n K_n^T

and what is left of the covariance is the part of what was known before.  The parts add up to the covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..solve.problem import TestedPart
from ..solve.whitening import accumulate
from ..table.observations import Observations

Array = NDArray[np.float64]
_LABELS = {
    "attitude": "star tracker",
    "attitude session": "star tracker, by session",
    "attitude wander": "star tracker, within an image",
    "position": "satellite position",
    "position session": "satellite position, by session",
    "survey": "marker survey",
    "neighbours": "marker survey",
    "optics": "optics, as considered",
    "look angles": "look angles, as considered",
    "trackers": "mountings of the star trackers, as considered",
    "clock": "clock, as considered",
    "refraction": "refraction, as considered",
    "time": "time of the images",
}
"""What a report calls the errors that several sightings share."""


@dataclass(frozen=True)
class Spread:
    """What the errors of a table's sightings, drawn as stated, do to its alignment; added up part by part.

    ``attitude``, ``position`` (m, 3, 3) and ``landmark`` (L, 3, 3) sum the slopes of a member's sightings, the latter
    only where landmarks are seen more than once; ``noise`` and ``own`` (3, 3) are the covariances by pixel noise, and
    by all that is a sighting's own; ``common`` (3, p) is the response to each error in common.
    """

    table: Observations
    attitude: Array
    position: Array
    landmark: Array
    noise: Array
    own: Array
    common: Array

    @classmethod
    def of(cls, o: Observations) -> Spread:
        """Of a table, with nothing added yet."""
        m, once = o.n_images, int(np.bincount(o.landmark, minlength=1).max()) < 2
        image, position, landmark, noise, own = (
            np.zeros((size, 3, 3)) for size in (m, m, 0 if once else o.n_landmarks, 1, 1)
        )
        common = np.zeros((3, 0 if o.common_px is None else o.common_px.shape[-1]))
        return cls(o, image, position, landmark, noise[0], own[0], common)

    def add(self, part: TestedPart, gain: Array) -> None:
        """Sightings that move the alignment by ``gain`` (n, 3, 2) rad per pixel."""
        model, used = part.model, part.tested.used[:, None, None]
        K, whitened = np.where(used, gain, 0.0), np.where(used, part.tested.influence[:, :3], 0.0)
        by_place, image = K @ model.R, self.table.image[part.rows]
        accumulate(self.attitude, K @ model.H, image)
        accumulate(self.position, by_place, image)
        if self.landmark.size:
            accumulate(self.landmark, by_place, self.table.landmark[part.rows])
        if part.table.common_px is not None:
            self.common[...] += np.einsum("nij,njp->ip", K, part.table.common_px)
        self.noise[...] += _square(K @ part.table.noise_root_px)
        self.own[...] += _square(whitened)

    @property
    def parts(self) -> dict[str, Array]:
        """Covariance (3, 3) rad^2 about E by source."""
        o, survey = self.table, self.own - self.noise
        if self.landmark.size:
            survey = _through(self.landmark, o.cov_landmark_J)
        parts = {
            "star tracker": _through(self.attitude, o.cov_attitude_E),
            "satellite position": _through(self.position, o.cov_position_J),
            "marker survey": survey,
            "image measurement": self.noise,
        }
        names = o.common_of or ("",) * self.common.shape[1]
        for name in dict.fromkeys(names):
            columns = self.common[:, [other == name for other in names]]
            label = _LABELS.get(name, "errors in common")
            parts[label] = parts.get(label, np.zeros((3, 3))) + columns @ columns.mT
        return parts


def _square(rows: Array) -> Array:
    """Sum of K K^T, K (n, 3, 2)."""
    flat = np.swapaxes(rows, 0, 1).reshape(3, -1)
    return np.asarray(flat @ flat.mT)


def _through(slopes: Array, covariance: Array) -> Array:
    """Sum of G S G^T over members, G the sum of the slopes of its sightings."""
    return np.asarray(np.sum(slopes @ covariance @ slopes.mT, axis=0))
