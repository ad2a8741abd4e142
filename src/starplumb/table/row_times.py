"""When the rows of a line scanner are exposed that do not follow one another evenly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]


@dataclass(frozen=True)
class RowTimes:
    """Row ``row`` (k,), k > 1, increasing, of one image is exposed ``late_ns`` (k,) after the image's own epoch.

    Linear between the rows, and on by the outermost step beyond them.  ``name`` is what messages call it.
    """

    row: Array
    late_ns: Epochs
    name: str = "the times of its rows"

    def __post_init__(self) -> None:
        if self.row.shape != self.late_ns.shape or self.row.ndim != 1 or self.row.size < 2:
            raise ValueError("row and late_ns must be (k,) with k > 1")
        steps = np.diff(self.late_ns)
        if np.any(np.diff(self.row) <= 0.0) or not (np.all(steps > 0) or np.all(steps < 0)):
            raise ValueError("row must increase, and late_ns go one way")

    def late(self, row: ArrayLike) -> Epochs:
        """Nanoseconds (n,) after the image's epoch at which rows (n,) are exposed."""
        at, row = self._step(row), np.asarray(row, dtype=np.float64)
        beyond = (row - self.row[at]) * self._period_ns[at]
        return np.asarray(self.late_ns[at] + np.rint(beyond).astype(np.int64))

    def period_s(self, row: ArrayLike) -> Array:
        """Duration (n,) of rows (n,)."""
        return np.asarray(1e-9 * self._period_ns[self._step(row)])

    def row_at(self, late_ns: ArrayLike) -> Array:
        """Rows (n,) exposed at nanoseconds (n,) after the image's epoch."""
        late = np.asarray(late_ns, dtype=np.int64)
        sign = 1 if self.late_ns[-1] > self.late_ns[0] else -1
        at = np.searchsorted(sign * self.late_ns, sign * late, side="right") - 1
        at = np.clip(at, 0, self.row.size - 2)
        return np.asarray(self.row[at] + (late - self.late_ns[at]) / self._period_ns[at])

    @property
    def mean_period_s(self) -> float:
        """From the first row to the last."""
        return float(1e-9 * (self.late_ns[-1] - self.late_ns[0]) / (self.row[-1] - self.row[0]))

    @property
    def _period_ns(self) -> Array:
        return np.asarray(np.diff(self.late_ns) / np.diff(self.row))

    def _step(self, row: ArrayLike) -> NDArray[np.int64]:
        """The step in which each row lies, or that it is beyond."""
        at = np.searchsorted(self.row, np.asarray(row, dtype=np.float64), side="right") - 1
        return np.asarray(np.clip(at, 0, self.row.size - 2))
