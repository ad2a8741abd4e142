"""Several cameras on one satellite: bands, detector chips, telescopes side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.camera import Camera

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Rig:
    """k cameras, known by ``names``, the first being the one that a campaign's ``camera`` and ``C_EK`` are of.

    ``C_KC`` (k, 3, 3) takes coordinates from the frame C of each to that of the first, K, by the model mountings:
    ``C_EC = C_EK C_KC``.  ``of_image`` (m,) says which camera took each image.  ``known_E`` (3 k, 3 k) rad^2 is the
    covariance of what was known of all mountings beforehand, None for nothing.
    """

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    C_KC: Array
    of_image: Index
    known_E: Array | None = None

    def __post_init__(self) -> None:
        k = len(self.names)
        if len(set(self.names)) != k or len(self.cameras) != k or self.C_KC.shape != (k, 3, 3):
            raise ValueError(f"{k} names for {len(self.cameras)} cameras and C_KC of shape {self.C_KC.shape}")
        if self.of_image.size and not 0 <= self.of_image.min() <= self.of_image.max() < k:
            raise ValueError(f"an image's camera lies outside 0 .. {k - 1}")

    @property
    def several(self) -> bool:
        return len(self.names) > 1

    def tan_from_px(self, image: Index, column_px: Array, row_px: Array) -> tuple[Array, Array]:
        """Tangents (n, 2) and slopes (n, 2, 2) of pixels of images (n,), each by its own camera."""
        xy, slope = np.empty((image.size, 2)), np.empty((image.size, 2, 2))
        for k, camera in enumerate(self.cameras):
            mine = self.of_image[image] == k
            xy[mine], slope[mine] = camera.tan_from_px(column_px[mine], row_px[mine])
        return xy, slope
