"""Residuals made white by what they predict of each other.

What is left of another season is broad: neighbours say the same, and are worth less than as many independent numbers.

Each residual is predicted from those before it, ``e(p) = r(p) - sum_k a_k r(p - k)`` over a half plane of :data:`ORDER`
pixels, the coefficients by least squares.  The filter is laid over residuals and Jacobian alike: the estimate stays
unbiased whatever the filter, and is the best there is where the residuals obey it.

Source: P. Whittle, On stationary processes in the plane, Biometrika 41 (1954).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

ORDER = 2
"""Rows and columns that a prediction reaches back."""
CORRELATED = 0.08
"""Correlation of neighbours from which residuals are worth whitening: less is what white noise of a chip shows."""
_LEAST = 200
"""So many residuals with all their neighbours are needed to find the coefficients by."""
_BEFORE = [
    *((0, -k) for k in range(1, ORDER + 1)),
    *((-i, j) for i in range(1, ORDER + 1) for j in range(-ORDER, ORDER + 1)),
]
"""The half plane: rows and columns from a pixel to those before it."""

_BESIDE = (
    (np.s_[:, 1:], np.s_[:, :-1]),
    (np.s_[1:], np.s_[:-1]),
)
"""Pixels and those beside them, and pixels and those above them."""


@dataclass(frozen=True)
class Whitener:
    """A prediction by coefficients (k,) of the pixels before each; that of none leaves all as it is."""

    coefficients: Array

    @classmethod
    def none(cls) -> Whitener:
        return cls(np.empty(0))

    @classmethod
    def of(cls, residual: Array, good: Bools) -> Whitener:
        """The filter for residuals (n, m) where they are ``good``; none where these are about white, or too few."""
        if not correlated(residual, good):
            return cls.none()
        q, whole = np.where(good, residual, 0.0), _whole(good)
        if np.sum(whole) < _LEAST:
            return cls.none()
        before = np.stack([moved[whole] for moved in _each_before(q)], axis=-1)
        N = before.mT @ before
        N += 1e-6 * np.trace(N) / len(N) * np.eye(len(N))
        return cls(np.asarray(np.linalg.solve(N, before.mT @ q[whole])))

    @property
    def acts(self) -> bool:
        return self.coefficients.size > 0

    def reach(self, good: Bools) -> Bools:
        """The pixels (n, m) whose filtered values come from good ones only."""
        return _whole(good) if self.acts else good

    def __call__(self, values: Array) -> Array:
        """Values (n, m) or (n, m, p) filtered along the first two axes; what lies beyond the border counts as 0."""
        if not self.acts:
            return values
        filtered = values.copy()
        for a, lag in zip(self.coefficients.tolist(), _BEFORE, strict=True):
            to, of = _overlap(values.shape, *lag)
            filtered[to] -= a * values[of]
        return filtered


def _overlap(
    shape: tuple[int, ...], rows: int, columns: int
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The pixels that have another ``rows`` and ``columns`` on, and those others."""
    n, m = shape[:2]
    to = slice(max(-rows, 0), n - max(rows, 0)), slice(max(-columns, 0), m - max(columns, 0))
    return to, (slice(max(rows, 0), n - max(-rows, 0)), slice(max(columns, 0), m - max(-columns, 0)))


def _each_before(values: Array) -> Iterator[Array]:
    """Of values (n, m) those at each of the places before every pixel, 0 beyond the border."""
    n, m = values.shape
    wide = np.pad(values, ((ORDER, 0), (ORDER, ORDER)))
    for rows, columns in _BEFORE:
        yield wide[ORDER + rows : ORDER + rows + n, ORDER + columns : ORDER + columns + m]


def _whole(good: Bools) -> Bools:
    """The pixels all of whose neighbours before them are good, as they are themselves."""
    return np.asarray(good & (sum(_each_before(good.astype(np.float64))) == len(_BEFORE)))


def correlated(residual: Array, good: Bools) -> bool:
    """Whether residuals (n, m) are worth whitening where they are ``good``."""
    q = np.where(good, residual, 0.0)
    power = _mean(q * q, good)
    beside = (_mean(q[a] * q[b], good[a] & good[b]) for a, b in _BESIDE)
    return max(map(abs, beside)) >= CORRELATED * max(power, 1e-300)


def _mean(values: Array, good: Bools) -> float:
    """Mean of values (n, m) that are 0 where they are not good."""
    return float(np.sum(values)) / max(float(np.count_nonzero(good)), 1.0)
