"""Wrong labels and wrong measurements: gls and robust side by side.

A share of the sightings is given to a place up to 300 pixels away, as mismatched markers are. `gls` believes
them all and says by its chi-square that something is wrong; `robust` finds the mounting on which most
sightings agree, tests every one and goes on without those that the others contradict.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from _scene import C_EK_TRUE, flight

from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Verdict
from starplumb.estimators.robust import Robust
from starplumb.judge.consistency import chi2_p
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

truth = observe(flight(images=6, markers=15))
rng = np.random.default_rng(5)
clean = measure(truth, C_EK_TRUE, Errors.draw(truth, rng))
shares = np.array([0.0, 0.05, 0.1, 0.2, 0.3])
order = rng.permutation(truth.n)
thrown = rng.uniform(-300.0, 300.0, (truth.n, 2)) * 9e-6 / 2.2

errors = np.empty((2, shares.size))
print("wrong   gls: error, p of chi-square   robust: error, left out: wrong ones, good ones")
for i, share in enumerate(shares):
    wrong = np.zeros(truth.n, dtype=bool)
    wrong[order[: int(share * truth.n)]] = True
    spoilt = replace(clean, xy_K=clean.xy_K + np.where(wrong[:, None], thrown, 0.0))
    gls, robust = Gls()(spoilt, C_EK_TRUE), Robust()(spoilt, C_EK_TRUE)
    for row, estimate in enumerate((gls, robust)):
        errors[row, i] = np.linalg.norm(so3.log(estimate.C_EK @ C_EK_TRUE.mT)) / ARCSEC
    assert gls.chi2 is not None
    assert gls.degrees_of_freedom is not None
    assert robust.verdict is not None
    p = chi2_p(float(gls.chi2), int(gls.degrees_of_freedom))
    out = robust.verdict != Verdict.USED
    print(
        f"{share:5.0%} {errors[0, i]:12.1f} arcsec, {p:7.1e} {errors[1, i]:12.1f} arcsec,"
        f" {np.sum(out & wrong)} of {np.sum(wrong)}, {np.sum(out & ~wrong)} of {np.sum(~wrong)}"
    )

figure, axis = plt.subplots(figsize=(6, 3.6), layout="constrained")
for name, row in zip(("gls", "robust"), errors, strict=True):
    axis.semilogy(100.0 * shares, row, "o-", label=name)
axis.set(xlabel="wrong sightings, per cent", ylabel="error of the mounting, arcsec")
axis.legend(frameon=False)
figure.savefig("blunders.svg")
