"""How the accuracy grows with images and markers: the closed formula against the adjustment.

Lines are the two closed formulas, crosses the covariance of `gls` on simulated scenes. More markers in an
image help only down to the attitude error that they share; more images help always. With two or three markers
an image the formula for the turn about the boresight is too good by some per cent: the spread of the markers
differs from image to image, and it takes their mean.
"""

import matplotlib.pyplot as plt
import numpy as np
from _scene import C_EK_TRUE, SIGMAS, flight

from starplumb.estimators.gls import Gls
from starplumb.judge.consistency import boresight_sigmas
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations

MARKERS = np.array([2, 3, 5, 10, 20, 50])


def closed(truth: Observations, images: int, markers: int) -> tuple[float, float]:
    """Sigma across and about the boresight, rad."""
    height = float(np.mean(truth.range_m))
    centred = truth.xy_K.reshape(images, markers, 2) - truth.xy_K.reshape(images, markers, 2).mean(
        1, keepdims=True
    )
    r2 = float(np.mean(np.sum(centred**2, axis=-1)))
    pixel = SIGMAS.pixel * 9e-6 / 2.2
    own = (SIGMAS.landmark[0] / height) ** 2 + pixel**2
    shared = SIGMAS.attitude[0] ** 2 + (SIGMAS.position[0] / height) ** 2
    across = shared / images + own / (images * markers)
    about = SIGMAS.attitude[2] ** 2 / images + own / (images * markers * r2)
    return float(np.sqrt(across)), float(np.sqrt(about))


figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
print("images markers   across: formula, gls    about z: formula, gls   arcsec")
for images, colour in ((1, "C0"), (4, "C1"), (16, "C2")):
    formula, adjusted = [], []
    for markers in MARKERS:
        truth = observe(flight(images, int(markers), tilt_deg=0.0, seed=int(markers)))
        estimate = Gls()(truth, C_EK_TRUE)
        assert estimate.covariance_E is not None
        sigma = boresight_sigmas(estimate.C_EK, estimate.covariance_E) / ARCSEC
        adjusted.append((np.sqrt(np.mean(sigma[:2] ** 2)), sigma[2]))
        formula.append(np.array(closed(truth, images, int(markers))) / ARCSEC)
        (a, b), (c, d) = formula[-1], adjusted[-1]
        print(f"{images:6d} {markers:7d}   {a:9.3f} {c:9.3f}       {b:9.3f} {d:9.3f}")
    for axis, line, cross in zip(axes, np.transpose(formula), np.transpose(adjusted), strict=True):
        axis.loglog(MARKERS, line, colour, label=f"{images} image{'s' if images > 1 else ''}")
        axis.loglog(MARKERS, cross, "x", color=colour)
for axis, title in zip(axes, ("across the boresight", "about the boresight"), strict=True):
    axis.set(title=title, xlabel="markers in each image", ylabel="sigma, arcsec")
    axis.set_xticks(MARKERS, [str(count) for count in MARKERS])
    axis.set_xticks([], minor=True)
    axis.yaxis.set_minor_formatter("{x:g}")
    axis.yaxis.set_major_formatter("{x:g}")
axes[1].legend(frameon=False, loc="upper right")
figure.savefig("closed-formula.svg")
