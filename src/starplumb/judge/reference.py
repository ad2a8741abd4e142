"""A method that does not weigh every stated error, held against least squares that does.

What is wrong with the inputs shows in residuals over their stated covariance.  A method without them (one-step methods,
the observer, a filter, an estimator of one's own) cannot tell; least squares of the same sightings can, and its answer
says how far off the other may be, also where the method states no sigma.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..estimators.protocol import Status
from ..physics import so3
from ..physics.units import ARCSEC
from .trust import Finding

Array = NDArray[np.float64]

FAR = 2.0
"""Distance from least squares, in half-widths of a method's own 95 % interval, from which on the interval is wrong."""
WHAT = "least squares with every stated error, of the same sightings,"


@dataclass(frozen=True)
class Reference:
    """What least squares makes of the sightings that a method used: its status, what weighs most, its mounting (3, 3)
    and the half-widths (3,) rad of its interval, None where it has none."""

    status: Status
    reason: str
    C_EK: Array
    interval_95_E: Array | None

    def findings(self, C_EK: Array, half_E: Array | None, weight: int) -> list[Finding]:
        """What it says of another answer ``C_EK`` that states the half-widths ``half_E`` (3,) rad, None for none, and
        whose own heaviest finding has this ``weight``."""
        if self.interval_95_E is None:
            refuted = Finding(f"{WHAT} has no answer that can be believed: {self.reason}", True, refutes=True)
            return [refuted] if weight < refuted.weight else []
        turn_E = so3.log(self.C_EK @ C_EK.mT)
        apart = float(np.linalg.norm(turn_E)) / ARCSEC
        reach_E = np.abs(turn_E) + self.interval_95_E
        if self.status is Status.WEAK:
            reason = f"{WHAT} is weak: {self.reason}"
            return [Finding(reason, weight == 0, informs=weight > 0, half_E=reach_E)]
        if half_E is None:
            said = (
                f"this method states no sigma: {WHAT} is {apart:.3g} arcsec away, and the interval holds both"
            )
            return [Finding(said, bool(np.any(np.abs(turn_E) > self.interval_95_E)), half_E=reach_E)]
        far = bool(np.any(np.abs(turn_E) > FAR * half_E))
        said = f"{WHAT} is {apart:.3g} arcsec away" + ", farther than the sigma of this method allows" * far
        return [Finding(f"{said}; the interval holds both", far, informs=not far, half_E=reach_E)]
