"""Conjugate gradients for many right-hand sides at once, where a matrix is too large and too woven to be factored."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Map = Callable[[Array], Array]

TOLERANCE = 1e-11
"""Residual left, in the norm of the preconditioner, as a share of the right-hand side's."""
MOST = 3000
"""Iterations."""


def conjugate_gradients(matrix: Map, preconditioner: Map, right: Array) -> Array:
    """Solution (w, s) of ``S y = right`` for symmetric positive definite S; ``preconditioner`` is close to its inverse.

    Raises LinAlgError where MOST iterations do not reach it, or numbers are not finite.
    Source: M. R. Hestenes, E. Stiefel, Methods of conjugate gradients for solving linear systems, J. Research of the
    National Bureau of Standards 49 (1952).
    """
    y, r = np.zeros_like(right), right.copy()
    p = d = preconditioner(r)
    rd = np.sum(r * d, axis=0)
    target = TOLERANCE**2 * rd
    for _ in range(MOST):
        if np.all(rd <= target):
            return y
        if not np.all(np.isfinite(rd)):
            break
        Sp = matrix(p)
        pSp = np.sum(p * Sp, axis=0)
        step = np.divide(rd, pSp, out=np.zeros_like(rd), where=pSp > 0.0)
        y += step * p
        r -= step * Sp
        d = preconditioner(r)
        before, rd = rd, np.sum(r * d, axis=0)
        turn = np.divide(rd, before, out=np.zeros_like(rd), where=before > 0.0)
        p = d + turn * p
    raise np.linalg.LinAlgError("conjugate gradients did not converge")
