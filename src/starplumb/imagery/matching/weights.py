"""The spread of residuals, and weights that those much larger do not have.

Source: A. E. Beaton, J. W. Tukey, The fitting of power series, Technometrics 16 (1974).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WIDTH = 4.685
"""Standard deviations beyond which a residual has no weight: 95 % of the efficiency under a normal law are left."""


def spread(residual: Array, use: Array) -> float:
    """Robust standard deviation of the residuals (n, m) in use; raises LinAlgError where there are none."""
    used = residual[use > 0.0]
    if not used.size:
        raise np.linalg.LinAlgError("no pixel is left")
    middle = used.size // 2
    return 1.4826 * float(np.partition(np.abs(used), middle)[middle]) + 1e-12


def tukey(k: Array, use: Array) -> tuple[Array, Array]:
    """Weights of residuals that are counted in the width, and the slope of what they make of a residual."""
    inside = np.maximum(1.0 - k**2, 0.0)
    return use * inside**2, use * np.where(inside > 0.0, inside * (1.0 - 5.0 * k**2), 0.0)
