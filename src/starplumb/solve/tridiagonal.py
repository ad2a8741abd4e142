"""Symmetric positive definite matrices that are block tridiagonal: factor, solution, and the blocks of the inverse.

With diagonal blocks D_k and O_k = T_(k+1,k) below them, elimination from the top leaves::

    D'_(k+1) = D_(k+1) + O_k J_k,   J_k = -D'_k^-1 O_k^T

and back from the bottom come the blocks of the inverse where T has its own (the whole of it would be dense; SciPy has
banded solvers but no such inverse, see ``docs/design/solver.md``)::

    Z_kk = D'_k^-1 + J_k Z_(k+1)(k+1) J_k^T,   Z_k(k+1) = J_k Z_(k+1)(k+1)

Source: K. Takahashi, J. Fagan, M. Chen, Formation of a sparse bus impedance matrix, Proc. 8th PICA Conf. (1973).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RIDGE = 1e-16
"""Relative addition to the diagonal, per unit of width: rounding must not make a matrix indefinite."""


@dataclass(frozen=True)
class BlockTridiagonal:
    """Factored T: lower Cholesky factors ``L`` of D'_k (w_k, w_k) and ``J`` (w_k, w_(k+1)), one fewer."""

    L: list[Array]
    J: list[Array]

    @classmethod
    def factor(cls, diagonal: list[Array], below: list[Array]) -> BlockTridiagonal:
        """Of the blocks D_k and O_k, which are overwritten.  Raises LinAlgError where T is not positive definite."""
        from scipy.linalg import cho_factor, cho_solve

        factors, back = [], []
        for k, D in enumerate(diagonal):
            D[np.diag_indices_from(D)] *= 1.0 + RIDGE * D.shape[0]
            L, _ = cho_factor(D, lower=True, overwrite_a=True, check_finite=False)
            factors.append(L)
            if k < len(below):
                J = -cho_solve((L, True), below[k].mT, check_finite=False)
                diagonal[k + 1] += below[k] @ J
                back.append(J)
        return cls(factors, back)

    def solve(self, right: Array) -> Array:
        """T^-1 right, (w, s)."""
        from scipy.linalg import cho_solve

        ends = np.cumsum([L.shape[0] for L in self.L])[:-1]
        parts = np.split(right, ends)
        for k, J in enumerate(self.J):
            parts[k + 1] = parts[k + 1] + J.mT @ parts[k]
        for k in reversed(range(len(self.L))):
            parts[k] = cho_solve((self.L[k], True), parts[k], check_finite=False)
            if k < len(self.J):
                parts[k] += self.J[k] @ parts[k + 1]
        return np.concatenate(parts)

    def inverse_blocks(self) -> tuple[list[Array], list[Array]]:
        """Blocks Z_kk and, one fewer, Z_k(k+1) of T^-1."""
        from scipy.linalg import cho_solve

        diagonal: list[Array] = [np.empty((0, 0))] * len(self.L)
        above: list[Array] = [np.empty((0, 0))] * len(self.J)
        for k in reversed(range(len(self.L))):
            own = cho_solve((self.L[k], True), np.eye(self.L[k].shape[0]), check_finite=False)
            if k < len(self.J):
                above[k] = self.J[k] @ diagonal[k + 1]
                own += above[k] @ self.J[k].mT
            diagonal[k] = own
        return diagonal, above
