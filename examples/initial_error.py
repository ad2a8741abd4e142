"""What one linear step leaves behind, and what iterating takes away.

The published linear methods take one step. Without any noise their answer is off by `1/2 theta_z (z x
theta)`, which grows with the square of the initial error: harmless at a minute of arc, arc seconds at half a
degree. A second step removes it, as does `gls`, which starts from the closed form and iterates on the
rotation group.
"""

import matplotlib.pyplot as plt
import numpy as np
from _scene import C_EK_TRUE, flight

from starplumb.estimators.gls import Gls
from starplumb.estimators.published.cross_product import CrossProduct
from starplumb.estimators.published.image_plane import ImagePlane
from starplumb.physics import so3
from starplumb.physics.units import ARCMIN, ARCSEC
from starplumb.table.geometry import observe

truth = observe(flight(images=3, markers=8))
size = np.geomspace(1.0, 120.0, 9) * ARCMIN
theta_K = size[:, None] * np.array([0.6, 0.0, 0.8])
C_EK_model = so3.exp(theta_K @ C_EK_TRUE.mT) @ C_EK_TRUE
formula = 0.5 * theta_K[:, 2] * theta_K[:, 0]

figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
for name, estimator in (
    ("image-plane, 1 step", ImagePlane(covariance="none")),
    ("cross-product, 1 step", CrossProduct(covariance="none")),
    ("cross-product, 2 steps", CrossProduct(iterations=2, covariance="none")),
    ("gls", Gls()),
):
    left = np.linalg.norm(so3.log(estimator(truth, C_EK_model).C_EK @ C_EK_TRUE.mT), axis=-1)
    axis.loglog(size / ARCMIN, np.maximum(left / ARCSEC, 1e-9), "o-", label=name, markersize=3)
    print(f"{name:24s} left of 10 arcmin: {np.interp(10 * ARCMIN, size, left) / ARCSEC:.2g} arcsec")
axis.loglog(size / ARCMIN, formula / ARCSEC, "k:", label="1/2 theta_z (z x theta)")
axis.set(xlabel="initial error, arcmin", ylabel="error left without any noise, arcsec")
axis.legend(frameon=False)
figure.savefig("initial-error.svg")
