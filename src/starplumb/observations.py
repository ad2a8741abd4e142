"""The table that every estimator reads: what was measured, the geometry it was measured in, and who shares which error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Observations:
    """n sightings of markers in m images of L landmarks; any leading batch axes, broadcast against one another.

    Per sighting:

    =============== ============= ==================================================================================
    image           (n,)          index of its image (its tracker error and position error are that image's)
    landmark        (n,)          index of its landmark (its place error is that landmark's)
    xy_K            (..., n, 2)   measured tangents (x/z, y/z) of the look direction
    slope_K         (..., n, 2, 2) d xy_K / d (column, row) of the camera, rad per pixel
    row_rate_E      (..., n, 3)   d e_E / d row, from the motion during the scan; zero for a frame camera
    e_E             (..., n, 3)   apparent direction of the marker by the measured attitude, orbit and survey
    C_EJ            (..., n, 3, 3) measured attitude
    p_J, r_J        (..., n, 3)   surveyed marker and measured camera position, m
    range_m         (..., n)      distance between them
    sigma_px        (..., n)      standard deviation of column and of row, pixels
    weight          (..., n)      1, or 0 for a marker that was not seen, so that every batch is rectangular
    =============== ============= ==================================================================================

    Shared errors: ``cov_attitude_E`` (..., m, 3, 3) rad^2 about E's axes, ``cov_position_J`` (..., m, 3, 3) m^2,
    ``cov_landmark_J`` (..., L, 3, 3) m^2.  ``prior_E`` (3, 3) rad^2 is what was known of the model mounting's error
    ``theta_E``, None for nothing.
    """

    image: Index
    landmark: Index
    xy_K: Array
    slope_K: Array
    row_rate_E: Array
    e_E: Array
    C_EJ: Array
    p_J: Array
    r_J: Array
    range_m: Array
    sigma_px: Array
    weight: Array
    cov_attitude_E: Array
    cov_position_J: Array
    cov_landmark_J: Array
    prior_E: Array | None = None

    def __post_init__(self) -> None:
        n = self.image.size
        if n and (self.image.max() >= self.n_images or self.landmark.max() >= self.n_landmarks):
            raise ValueError("an image or landmark index points past the covariances given for them")
        for name, tail in _TAILS.items():
            shape = getattr(self, name).shape
            if shape[len(shape) - len(tail) - 1 :] != (n, *tail):
                raise ValueError(f"{name} has shape {shape}, wanted (..., {', '.join(map(str, (n, *tail)))})")

    @property
    def n(self) -> int:
        return int(self.image.size)

    @property
    def n_images(self) -> int:
        return int(self.cov_attitude_E.shape[-3])

    @property
    def n_landmarks(self) -> int:
        return int(self.cov_landmark_J.shape[-3])

    @property
    def batch(self) -> tuple[int, ...]:
        """Leading axes of the measured table."""
        return np.broadcast_shapes(self.xy_K.shape[:-2], self.e_E.shape[:-2], self.weight.shape[:-1])

    @property
    def e_K(self) -> Array:
        """Measured look directions as unit vectors (..., n, 3)."""
        e = np.concatenate([self.xy_K, np.ones((*self.xy_K.shape[:-1], 1))], axis=-1)
        return np.asarray(e / np.linalg.norm(e, axis=-1, keepdims=True))

    def select(self, keep: NDArray[np.bool_] | Index) -> Observations:
        """The sightings (n,) kept, with all images and landmarks as they were."""
        chosen: dict[str, Any] = {"image": self.image[keep], "landmark": self.landmark[keep]}
        for name, tail in _TAILS.items():
            axis = -1 - len(tail)
            indices = np.flatnonzero(keep) if np.asarray(keep).dtype == bool else keep
            chosen[name] = np.take(getattr(self, name), indices, axis=axis)
        return replace(self, **chosen)


_TAILS: dict[str, tuple[int, ...]] = {
    "xy_K": (2,),
    "slope_K": (2, 2),
    "row_rate_E": (3,),
    "e_E": (3,),
    "C_EJ": (3, 3),
    "p_J": (3,),
    "r_J": (3,),
    "range_m": (),
    "sigma_px": (),
    "weight": (),
}
"""Fields with one entry a sighting, and their axes behind it."""
