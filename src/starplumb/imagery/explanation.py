"""Why an image was not found, as far as that can be told: ground beyond the reference, or pixels in another order."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..physics.units import DEG
from ..table.geometry import locate
from .acquisition import Acquisition, acquire, search_factor
from .coarse import Coarse, coarse_images
from .library.expected import expected
from .scene import Scene, geodetic

Array = NDArray[np.float64]

SURE, APART = 9.0, 1.5
"""How far the place of images in another order must stand above the rest, and how much farther than the next: seven
orders are tried, and the answer is an accusation."""
_PLACES = 9
"""Places along each side of an image at which reference and heights are asked for."""

Order = Callable[[Array], Array]
MIRRORS: Mapping[str, Order] = {
    "mirrored left to right": lambda a: a[:, ::-1],
    "mirrored top to bottom": lambda a: a[::-1],
    "turned by 180 deg": lambda a: a[::-1, ::-1],
}
TRANSPOSED: Mapping[str, Order] = {
    "transposed": lambda a: a.T,
    "turned by 90 deg": lambda a: np.rot90(a, 1),
    "turned by -90 deg": lambda a: np.rot90(a, -1),
    "transposed and turned by 180 deg": lambda a: a[::-1, ::-1].T,
}
"""What else the pixels of a file may be; those of the second kind only where images are square."""


@dataclass(frozen=True)
class Explanation:
    """What can be told of images that were not found: of all together, or of one among others that were."""

    scene: Scene
    acquired: Acquisition
    sigma_K: Array
    own_K: Array

    def of(self, image: int, reason: str) -> str:
        """A better reason why an image was left out, or the one given."""
        if unfit := self.acquired.unfit[image]:
            return unfit
        if beyond := self._beyond(image):
            return beyond
        order = self._alone(image) if self.acquired.clear else self._together
        if not order:
            return reason
        return (
            f"{order} it is found: its file is not as the camera took it, or the mounting takes the camera's axes for "
            "others; write the file in the camera's columns and rows, or let starplumb diagnose try the mounting"
        )

    def _beyond(self, image: int) -> str:
        """Which of heights and orthoimage covers none of an image's ground."""
        if self.scene.chip_half_m is not None:
            return self._without_chips(image)
        columns, rows = self.scene.raws[image].size_px
        x, y = (
            grid.ravel()
            for grid in np.meshgrid(*(np.linspace(0.0, n - 1.0, _PLACES) for n in (columns, rows)))
        )
        C_EK = self.acquired.C_EK[image] if self.acquired.clear else self.scene.campaign.C_EK
        place = geodetic(locate(self.scene.campaign, C_EK, np.full(x.size, image), x, y, 0.0))
        known = np.isfinite(self.scene.height_at(*place))
        near = f"about latitude {np.median(place[0]) / DEG:.3f}, longitude {np.median(place[1]) / DEG:.3f}"
        if not known.any():
            return f"the heights (reference.dem) cover none of the ground where it looks, {near}"
        spacing = self.scene.pixel_m(C_EK, image, 0.5 * np.array([columns - 1.0, rows - 1.0]))
        latitude, longitude = (value.reshape(_PLACES, _PLACES) for value in place)
        if not np.isfinite(self.scene.reference.sample(latitude, longitude, spacing)).any():
            return f"the orthoimage (reference.files) covers none of the ground where it looks, {near}"
        return ""

    def _without_chips(self, image: int) -> str:
        """That no chip of the library lies where an image looks, if it is so."""
        scene = self.scene
        C_EK = self.acquired.C_EK[image] if self.acquired.clear else scene.campaign.C_EK
        if expected(scene, C_EK, image, 0.0).landmark.size:
            return ""
        middle = 0.5 * (np.array(scene.raws[image].size_px) - 1.0)
        p_J = locate(scene.campaign, C_EK, np.array([image]), middle[:1], middle[1:], 0.0)
        near = " longitude ".join(f"{float(angle[0]) / DEG:.3f}," for angle in geodetic(p_J))
        return f"the library has no chip where it looks, about latitude {near.rstrip(',')}"

    @cached_property
    def coarse(self) -> Sequence[Coarse]:
        """The images, binned as they were looked for."""
        return coarse_images(self.scene, search_factor(self.scene, self.sigma_K, self.own_K))

    @cached_property
    def _together(self) -> str:
        return self._order(self.scene, range(len(self.coarse)), self.sigma_K)

    def _alone(self, image: int) -> str:
        campaign = replace(self.scene.campaign, C_EK=self.acquired.C_EK[image])
        return self._order(replace(self.scene, campaign=campaign), [image], self.own_K)

    def _order(self, scene: Scene, images: Sequence[int], sigma_K: Array) -> str:
        """The order of their pixels in which images are found; empty where there is none."""
        square = all(scene.raws[k].size_px[0] == scene.raws[k].size_px[1] for k in images)
        best, told = SURE, ""
        for name, order in ({**MIRRORS, **TRANSPOSED} if square else MIRRORS).items():
            tried = [
                replace(each, values=np.ascontiguousarray(order(each.values)))
                if k in images
                else replace(each, unfit="not asked for")
                for k, each in enumerate(self.coarse)
            ]
            found = acquire(scene, sigma_K, self.own_K, tried).together
            if found.height > max(best, APART * found.second):
                best, told = found.height, name
        return told
