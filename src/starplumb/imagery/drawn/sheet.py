"""Ground that several pictures show alike, drawn once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .ground import NOW, Look
from .render import SPACING, Surface

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sheet:
    """Brightness ``values`` (n, n) of a square of a plane on the lattice of pictures with this ``spacing``, whose first
    sample has the indices (``first``, ``first``): what :func:`picture` asks of a ground, as long as it stays inside."""

    detail: float
    spacing: float
    first: int
    values: Array

    @classmethod
    def of(cls, ground: Surface, half_m: float, look: Look = NOW, spacing: float = SPACING) -> Sheet:
        """The ground of a look as far as ``half_m`` from the origin along both axes."""
        step = spacing * ground.detail
        last = int(np.ceil(half_m / step))
        at = step * np.arange(-last, last + 1.0)
        return cls(ground.detail, spacing, -last, ground.draw(at, at, look))

    def draw(self, x: Array, y: Array, look: Look = NOW) -> Array:
        """Brightness (r, c) at columns ``x`` (c,) and rows ``y`` (r,) of the lattice, of the look it was drawn with.

        Raises ValueError beyond the square.
        """
        step = self.spacing * self.detail
        column, row = (np.rint(values / step).astype(np.int64) - self.first for values in (x, y))
        if min(column.min(), row.min()) < 0 or max(column.max(), row.max()) >= len(self.values):
            raise ValueError("the sheet does not reach as far")
        return self.values[np.ix_(row, column)]
