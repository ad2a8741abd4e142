"""The aberration switch: what a wrong setting does, and when the data can tell.

The light of a marker arrives tilted by about 5 arcsec, since the camera moves at 7.5 km/s. An attitude
product may or may not contain that already. A wrong switch is a constant rotation as long as all views look
the same way, so it vanishes in the mounting and the residuals stay as good as ever. Views turned about the
boresight betray it, and only when there are enough of them: here thirty images whose attitude is known to 5
arcsec each.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from _scene import C_EK_TRUE, flight

from starplumb.estimators.gls import Gls
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

TURNS = np.array([0.0, 15.0, 45.0, 90.0, 180.0])
wrong, rise = [], []
print("turn of every other image   mounting wrong by   chi-square rises by (mean and sd of 100 campaigns)")
for turn in TURNS:
    truth = observe(flight(images=30, markers=6, tilt_deg=3.0, turn_deg=float(turn)))
    measured = measure(truth, C_EK_TRUE, Errors.draw(truth, np.random.default_rng(3), (100,)))
    switched = measured.with_geometry(corrections=replace(truth.corrections, aberration=False))
    right, off = Gls()(measured, C_EK_TRUE), Gls()(switched, C_EK_TRUE)
    assert right.chi2 is not None
    assert off.chi2 is not None
    shift = np.linalg.norm(so3.log(off.C_EK @ right.C_EK.mT), axis=-1) / ARCSEC
    wrong.append(shift.mean())
    rise.append(off.chi2 - right.chi2)
    print(f"{turn:15.0f} deg {wrong[-1]:19.2f} arcsec {rise[-1].mean():16.1f} +- {rise[-1].std():.1f}")

figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
axes[0].plot(TURNS, wrong, "o-")
axes[0].set(xlabel="turn of every other image, deg", ylabel="mounting wrong by, arcsec")
axes[1].errorbar(TURNS, np.mean(rise, axis=-1), np.std(rise, axis=-1), fmt="o-", color="C1", capsize=3)
axes[1].axhline(12.0, color="k", linestyle=":", label="starplumb calls the switch wrong")
axes[1].set(xlabel="turn of every other image, deg", ylabel="rise of chi-square by the wrong switch")
axes[1].legend(frameon=False)
figure.savefig("aberration-switch.svg")
