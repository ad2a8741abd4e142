"""Where one image really looked: the rotation that carries the pixels of its chips onto their ground.

``C s_K(p) = e_E``: the direction of the pixel p at which a chip was found is that of its ground from where the camera
stood.  Attitude errors of single images are many pixels, and all images of a campaign share the mounting's; both are in
the rotation of an image, with which its chips are then predicted to a fraction of a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..table.campaign import Campaign
from ..table.geometry import apparent, stations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

LEAST_CHIPS = 4
"""An image that fewer chips agree about is not acquired."""
_ROUNDS = 4


@dataclass(frozen=True)
class Pointing:
    """The rotation ``C_EK`` (3, 3) of an image, which of its chips agree with it (n,), and what is left of each
    ``residual_px`` (n, 2)."""

    C_EK: Array
    agrees: Bools
    residual_px: Array


def pointed(
    campaign: Campaign,
    C_EK: Array,
    image: int,
    pixel: Array,
    p_J: Array,
    tolerance_px: float | Array,
    prior: Array,
) -> Pointing:
    """The rotation of an image from pixels (n, 2) at which ground points (n, 3) were found, some of them wrongly.

    ``prior`` (3,) rad are the sigmas about K's axes to which C_EK was known; the rotation begins with the shift about
    which most chips agree within ``tolerance_px`` (one, or (n,)), and then is that of all that agree.
    """
    found = _Found.of(campaign, C_EK, image, pixel, p_J)
    tolerance = np.broadcast_to(np.asarray(tolerance_px, dtype=np.float64), (len(pixel),))
    near = np.abs(found.shift_px[:, None] - found.shift_px).max(axis=-1) < 2.0 * tolerance[:, None]
    agrees = near[int(np.argmax(near.sum(axis=1)))] if len(pixel) else np.zeros(0, np.bool_)
    turned = np.eye(3)
    for _ in range(_ROUNDS):
        turned = found.turn(agrees, 1.0 / tolerance, prior)
        agrees = np.all(np.abs(found.left(turned)) < 3.0 * tolerance[:, None], axis=-1)
    return Pointing(C_EK @ turned, agrees, found.left(turned))


@dataclass(frozen=True)
class _Found:
    """Directions in K of the pixels and, by the present C_EK, of the ground (n, 3), unit vectors; angle of a pixel."""

    s_K: Array
    e_K: Array
    pixel_rad: float

    @classmethod
    def of(cls, campaign: Campaign, C_EK: Array, image: int, pixel: Array, p_J: Array) -> _Found:
        station = stations(campaign, np.full(len(pixel), image), pixel[:, 1])
        e_E = apparent(campaign, station, p_J)["e_E"]
        xy_K, slope = campaign.camera.tan_from_px(pixel[:, 0], pixel[:, 1])
        s_K = np.concatenate([xy_K, np.ones((len(pixel), 1))], axis=-1)
        s_K = s_K / np.linalg.norm(s_K, axis=-1, keepdims=True)
        e_K = e_E @ C_EK / np.linalg.norm(e_E, axis=-1, keepdims=True)
        return cls(s_K, e_K, float(np.mean(np.linalg.norm(slope[..., 0], axis=-1))) if len(pixel) else 1.0)

    @property
    def shift_px(self) -> Array:
        """How far the ground lies from the pixels (n, 2)."""
        return (self.e_K - self.s_K)[:, :2] / self.pixel_rad

    def left(self, turned: Array) -> Array:
        """How far it does once the camera is turned."""
        return (self.e_K @ turned - self.s_K)[:, :2] / self.pixel_rad

    def turn(self, chosen: Bools, weight: Array, prior: Array) -> Array:
        """The rotation R with ``R s_K = e_K`` for those chosen, and a prior about no rotation."""
        R = np.eye(3)
        for _ in range(3):
            s, e = (self.s_K @ R.T)[chosen], self.e_K[chosen]
            w = (weight[chosen] / self.pixel_rad) ** 2
            J = -so3.skew(s)
            N = np.einsum("n,nki,nkj->ij", w, J, J) + np.diag(prior**-2.0)
            b = np.einsum("n,nki,nk->i", w, J, e - s) - so3.log(R) / prior**2
            R = so3.exp(np.linalg.solve(N, b)) @ R
        return R
