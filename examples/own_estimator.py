"""An estimator of your own, held against the truth.

An estimator is a frozen set of options that is called with the observation table and the model mounting. This
one takes the closed form of every image by itself and then the median of the images about each axis: crude,
and hard to mislead by one wrong image. It states no covariance, so `covariance_E` is None; what it is worth
is found by simulation.
"""

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from _scene import C_EK_TRUE, flight
from numpy.typing import NDArray

from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import AlignmentEstimate, Status
from starplumb.estimators.wahba import Wahba
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors, measure


@dataclass(frozen=True)
class MedianOfImages:
    """``C_EK = exp(median_i log(C_i C_EK_model^T)) C_EK_model`` with C_i the closed form of image i."""

    least: int = 2
    """Sightings that an image must have."""

    def __call__(self, observations: Observations, C_EK: NDArray[np.float64]) -> AlignmentEstimate:
        o = observations
        rows = [np.flatnonzero(o.image == i) for i in range(o.n_images)]
        each = [Wahba()(o.select(r), C_EK).C_EK for r in rows if r.size >= self.least]
        if not each:
            nothing = np.broadcast_to(C_EK, (*o.batch, 3, 3))
            return AlignmentEstimate(
                nothing, None, np.full(o.batch, int(Status.SINGULAR)), np.zeros(o.batch, dtype=np.int64)
            )
        d_E = np.median([so3.log(C @ C_EK.mT) for C in each], axis=0)
        status = np.full(d_E.shape[:-1], int(Status.OK))
        return AlignmentEstimate(so3.exp(d_E) @ C_EK, None, status, np.ones_like(status))


truth = observe(flight(images=7, markers=10))
rng = np.random.default_rng(11)
measured = measure(truth, C_EK_TRUE, Errors.draw(truth, rng, (500,)))
figure, axes = plt.subplots(1, 3, figsize=(9, 3), layout="constrained")
for estimator in (MedianOfImages(), Gls()):
    name = type(estimator).__name__
    error_E = so3.log(estimator(measured, C_EK_TRUE).C_EK @ C_EK_TRUE.mT) / ARCSEC
    print(f"{name:16s} sd of 500 errors about x, y, z: {np.round(error_E.std(axis=0), 2)} arcsec")
    for axis, values, letter in zip(axes, error_E.T, "xyz", strict=True):
        axis.hist(values, 30, histtype="step", label=name)
        axis.set(xlabel=f"error about {letter}, arcsec")
axes[0].legend(frameon=False, fontsize=8, loc="upper left")
figure.savefig("own-estimator.svg")
