"""Statistics of any number of runs, each with its own uncertainty: moments, which merge, and quantiles.

Parts are merged in a fixed order, so that a result depends on the draws alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

Z95 = 1.959963984540054
"""Two-sided 95 % point of the standard normal."""


@dataclass(frozen=True)
class Moments:
    """Sums of d quantities over n draws from which mean to kurtosis follow.

    ``n`` (); ``mean`` (d,); ``M2``, ``M3``, ``M4`` (d,) sums of powers of the deviation from the mean;
    ``low``, ``high`` (d,) extremes.  Source of the merging formulas: P. Pebay, Formulas for robust, one-pass parallel
    computation of covariances and arbitrary-order statistical moments, Sandia report SAND2008-6212 (2008).
    """

    n: Index
    mean: Array
    M2: Array
    M3: Array
    M4: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, values: Array) -> Moments:
        """Of draws (n, d); of none where n is 0."""
        n, d = values.shape
        if n == 0:
            zero = np.zeros(d)
            return cls(np.array(0), zero, zero, zero, zero, zero + np.inf, zero - np.inf)
        mean = np.mean(values, axis=0)
        deviation = values - mean
        square = deviation * deviation
        M2, M3, M4 = (np.sum(power, axis=0) for power in (square, square * deviation, square * square))
        return cls(np.array(n), mean, M2, M3, M4, np.min(values, axis=0), np.max(values, axis=0))

    def merge(self, other: Moments) -> Moments:
        """Of the draws of both."""
        a, b = float(self.n), float(other.n)
        n = a + b
        if n == 0.0:
            return self
        d = other.mean - self.mean
        M2 = self.M2 + other.M2 + d**2 * a * b / n
        M3 = self.M3 + other.M3 + d**3 * a * b * (a - b) / n**2 + 3.0 * d * (a * other.M2 - b * self.M2) / n
        M4 = (
            self.M4
            + other.M4
            + d**4 * a * b * (a * a - a * b + b * b) / n**3
            + 6.0 * d**2 * (a * a * other.M2 + b * b * self.M2) / n**2
            + 4.0 * d * (a * other.M3 - b * self.M3) / n
        )
        low, high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        return Moments(np.asarray(self.n + other.n), self.mean + d * b / n, M2, M3, M4, low, high)

    @property
    def variance(self) -> Array:
        return np.asarray(self.M2 / max(float(self.n) - 1.0, 1.0))

    @property
    def sigma(self) -> Array:
        return np.sqrt(self.variance)

    @property
    def mean_square(self) -> Array:
        return np.asarray(self.mean**2 + self.M2 / max(float(self.n), 1.0))

    @property
    def rms(self) -> Array:
        return np.sqrt(self.mean_square)

    @property
    def largest(self) -> Array:
        """Largest magnitude."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    @property
    def kurtosis(self) -> Array:
        """Fourth moment over the squared variance: 3 for a Gaussian, more for heavier tails; 3 where nothing varies."""
        spread = self.M2 > 0.0
        return np.where(spread, float(self.n) * self.M4 / np.where(spread, self.M2, 1.0) ** 2, 3.0)

    @property
    def mean_error(self) -> Array:
        """Standard error of the mean."""
        return np.asarray(self.sigma / np.sqrt(max(float(self.n), 1.0)))

    @property
    def sigma_error(self) -> Array:
        """Standard error of sigma for any distribution: ``sigma/2 sqrt((kurtosis - 1) / n)``."""
        excess = np.maximum(self.kurtosis - 1.0, 0.0)
        return np.asarray(0.5 * self.sigma * np.sqrt(excess / max(float(self.n), 1.0)))

    @property
    def rms_error(self) -> Array:
        """Standard error of the rms: that of the mean square, ``(m4 - m2^2)/n`` about zero, over twice the rms."""
        n = max(float(self.n), 1.0)
        m2, m3, m4 = self.M2 / n, self.M3 / n, self.M4 / n
        fourth = m4 + 4.0 * self.mean * m3 + 6.0 * self.mean**2 * m2 + self.mean**4
        spread = np.sqrt(np.maximum(fourth - self.mean_square**2, 0.0) / n)
        return np.divide(0.5 * spread, self.rms, out=np.zeros_like(spread), where=self.rms > 0.0)


def quantile(values: Array, q: float) -> tuple[float, float, float]:
    """Quantile q of draws (n,) with the ends of its 95 % confidence interval, which assumes no distribution.

    The number of draws below the true quantile is binomial, so the interval's ends are the draws of rank
    ``n q -+ 1.96 sqrt(n q (1 - q))``; NaN where there is no draw.
    """
    n = values.size
    if n == 0:
        return (float("nan"),) * 3
    spread = Z95 * np.sqrt(n * q * (1.0 - q))
    wanted = np.array([np.ceil(n * q) - 1.0, np.floor(n * q - spread), np.ceil(n * q + spread)])
    rank = np.clip(wanted, 0, n - 1).astype(np.int64)
    value, low, high = np.partition(values, np.unique(rank))[rank]
    return float(value), float(low), float(high)


def chi2_band(degrees_of_freedom: float, level: float = 0.95) -> tuple[float, float]:
    """Limits within which chi-square over its degrees of freedom falls with probability ``level``."""
    from ..solve.probability import chdtri

    tail = 0.5 * (1.0 - level)
    low, high = chdtri(degrees_of_freedom, 1.0 - tail), chdtri(degrees_of_freedom, tail)
    return float(low / degrees_of_freedom), float(high / degrees_of_freedom)


def trials_for(precision: float, t: float = 3.0, kurtosis: float = 3.0) -> int:
    """Draws that give a sigma to a relative ``precision`` at ``t`` standard errors.

    ``n >= t^2 (kurtosis - 1) / (4 eps^2)``, which for a Gaussian (kurtosis 3) is the rule ``n >= t^2 / (2 eps^2)``;
    t = 3, eps = 0.01: 45000.
    """
    return int(np.ceil(t * t * (kurtosis - 1.0) / (4.0 * precision**2) * (1.0 - 1e-12)))
