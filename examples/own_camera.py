"""A camera of your own: the fisheye model, where an angle is proportional to a distance.

Whatever turns pixels into tangents of the look direction, with their slope, is a camera; the geometry asks
for nothing else. The slope is what carries pixel noise into angles, so it is checked here by differences
before the camera is used.
"""

from dataclasses import dataclass, field

import matplotlib.pyplot as plt
import numpy as np
from _scene import C_EK_TRUE, flight
from numpy.typing import ArrayLike, NDArray

from starplumb.estimators.gls import Gls
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure


@dataclass(frozen=True)
class Equidistant:
    """``distance from the principal point = focal_px * angle from the boresight``."""

    focal_px: float
    principal_point_px: tuple[float, float]
    size_px: tuple[float, float]
    scans: bool = field(default=False, init=False)

    def tan_from_px(
        self, column_px: ArrayLike, row_px: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Tangents ``tan(a) u`` with a = |w|, w the offset in focal lengths, u = w / a; slope by the chain rule."""
        column, row = np.broadcast_arrays(np.asarray(column_px, float), np.asarray(row_px, float))
        w = np.stack([column, row], axis=-1) - self.principal_point_px
        w = w / self.focal_px
        a = np.linalg.norm(w, axis=-1)[..., None, None]
        ratio = np.where(a > 1e-9, np.tan(a) / np.where(a > 1e-9, a, 1.0), 1.0)
        outer = w[..., :, None] * w[..., None, :]
        turn = np.where(a > 1e-9, (1.0 + np.tan(a) ** 2 - ratio) / np.where(a > 1e-9, a, 1.0) ** 2, 0.0)
        return ratio[..., 0] * w, (ratio * np.eye(2) + turn * outer) / self.focal_px

    def px_from_tan(self, xy_K: ArrayLike) -> NDArray[np.float64]:
        xy = np.asarray(xy_K, dtype=np.float64)
        t = np.linalg.norm(xy, axis=-1, keepdims=True)
        ratio = np.where(t > 1e-9, np.arctan(t) / np.where(t > 1e-9, t, 1.0), 1.0)
        return np.asarray(self.principal_point_px + self.focal_px * ratio * xy)


camera = Equidistant(9000.0, (5999.5, 5999.5), (12000, 12000))
pixel = np.array([[100.0, 11000.0], [6000.0, 5999.0], [9000.0, 2500.0]])
xy, slope = camera.tan_from_px(*pixel.T)
steps = 0.5 * np.array([[1.0, 0.0], [0.0, 1.0]])
differences = [camera.tan_from_px(*(pixel + s).T)[0] - camera.tan_from_px(*(pixel - s).T)[0] for s in steps]
print(f"there and back: {np.abs(camera.px_from_tan(xy) - pixel).max():.1e} px")
print(f"slope against differences: {np.abs(slope - np.stack(differences, -1)).max():.1e} rad per px")

truth = observe(flight(images=4, markers=30, camera=camera))
measured = measure(truth, C_EK_TRUE, Errors.draw(truth, np.random.default_rng(2), (300,)))
estimate = Gls()(measured, C_EK_TRUE)
ratio = so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E
assert estimate.sigma_E is not None
print(f"stated sigma {np.round(estimate.sigma_E[0] / ARCSEC, 2)} arcsec")
print(f"error / sigma has sd {np.round(ratio.std(axis=0), 2)}")

figure, axis = plt.subplots(figsize=(5, 3.4), layout="constrained")
angle = np.linspace(0.0, 40.0, 50) * DEG
axis.plot(angle / DEG, camera.focal_px * angle, label="equidistant")
axis.plot(angle / DEG, camera.focal_px * np.tan(angle), ":", label="central projection")
axis.set(xlabel="angle from the boresight, deg", ylabel="distance from the principal point, px")
axis.legend(frameon=False)
figure.savefig("own-camera.svg")
