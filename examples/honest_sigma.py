"""Why a sigma must know which errors are shared.

A thousand campaigns are simulated with their stated errors and estimated twice: by `gls`, which knows that
the markers of one image share its attitude and position error, and by textbook least squares, whose sigma
comes from its residuals. The error divided by the stated sigma should be spread like a standard normal
variable. That of the textbook is not: the shared errors move all markers of an image together, so its
residuals do not show them.
"""

import matplotlib.pyplot as plt
import numpy as np
from _scene import C_EK_TRUE, flight

from starplumb.estimators.gls import Gls
from starplumb.estimators.published.least_squares import LeastSquares
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

truth = observe(flight(images=4, markers=12))
rng = np.random.default_rng(7)
measured = measure(truth, C_EK_TRUE, Errors.draw(truth, rng, (1000,)))

figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained", sharey=True)
for axis, name, estimator in (
    (axes[0], "gls", Gls()),
    (axes[1], "textbook least squares", LeastSquares(covariance="naive")),
):
    estimate = estimator(measured, C_EK_TRUE)
    error_E = so3.log(estimate.C_EK @ C_EK_TRUE.mT)
    ratio = error_E / estimate.sigma_E
    print(f"{name}, about x, y, z:")
    print(f"  sd of the error {np.round(error_E.std(axis=0) / ARCSEC, 2)} arcsec")
    print(f"  sd of error / stated sigma {np.round(ratio.std(axis=0), 2)}")
    edges = np.linspace(-8.0, 8.0, 81)
    for values, label in zip(np.clip(ratio, -8.0, 8.0).T, "xyz", strict=True):
        axis.hist(values, edges, density=True, histtype="step", label=f"about {label}")
    axis.plot(edges, np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi), "k:", label="as it should be")
    axis.set(title=name, xlabel="error / stated sigma (beyond 8: at 8)")
axes[0].legend(frameon=False)
figure.savefig("honest-sigma.svg")
