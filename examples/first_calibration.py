"""A calibration from Python, with its residuals before and after.

The demonstration campaign of `starplumb init` is estimated and its residuals are drawn on the detector.
Before, all of an image point the same way: the mounting is hundreds of arc seconds off. After, what is left
is the attitude error of each image, which no mounting can take away, and under it the noise of the single
sightings.
"""

import matplotlib.pyplot as plt
import numpy as np

from starplumb.estimators.gls import Gls
from starplumb.judge.calibrate import calibrate
from starplumb.physics.units import ARCSEC
from starplumb.plan.demo import demo

campaign, _ = demo("frame", images=8, seed=1)
done = calibrate(campaign, Gls())

assert done.estimate.sigma_E is not None
for axis, correction, sigma in zip(
    "xyz", done.correction_E / ARCSEC, done.estimate.sigma_E / ARCSEC, strict=True
):
    print(f"{axis}: correction {correction:9.3f} +- {sigma:.3f} arcsec")
print(f"status {done.status.name.lower()}, chi-square {float(done.estimate.chi2):.1f}, p = {done.chi2_p:.3f}")

figure, axes = plt.subplots(1, 2, figsize=(9, 4.5), layout="constrained", sharex=True, sharey=True)
s, used = campaign.sightings, done.residuals.used
for axis, z_px, name in zip(
    axes, (done.residuals.before_px, done.residuals.after_px), ("before", "after"), strict=True
):
    arrows = axis.quiver(
        s.column_px[used], s.row_px[used], *z_px[used].T, s.image[used], cmap="tab10", angles="xy"
    )
    length = 10.0 ** np.floor(np.log10(np.abs(z_px[used]).max()))
    axis.quiverkey(arrows, 0.8, 1.04, length, f"{length:g} px", labelpos="E")
    axis.set_title(f"residuals {name}", loc="left")
    axis.set(xlabel="column, px", aspect="equal")
axes[0].set_ylabel("row, px")
axes[0].invert_yaxis()
figure.savefig("residuals.svg", bbox_inches="tight")
