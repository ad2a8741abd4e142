"""Drawn ground: how bright a plane is, at any place and as finely as wanted, a function of its seed alone.

Fields of two sizes with ploughed rows, roads between the large ones, houses, water and noise in octaves from the finest
detail to a thousand times as wide: texture of one octave would flatter whoever matches it.  Nothing is sharper than the
finest detail, so that samples half of it apart say all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .fields import Cells, cells
from .noise import hashed, in_blocks, octaves, smooth_step, waves

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK = 256
"""Rows and columns that are drawn at a time: they stay in the processor's cache."""
SMALL, LARGE, TOWN = 35.0, 130.0, 11.0
"""Sizes of a small and a large field and of a plot with a house, in finest details."""
ROAD = 2.0
"""Half the width of a road, in finest details."""
WATER = 1.35
"""Level of the slow noise above which there is water: about a tenth of the ground."""


@dataclass(frozen=True)
class Look:
    """What a ground looks like at another time or to another sensor.

    ``season`` is the standard deviation of what has come and gone on the fields over that of the ground itself;
    ``changed`` the part of the ground that has become another; ``band`` 1 sees vegetation bright where band 0 sees it
    dark.  Looks of another ``seed`` have changed elsewhere.
    """

    season: float = 0.0
    changed: float = 0.0
    band: int = 0
    seed: int = 0


NOW = Look()


@dataclass(frozen=True)
class Ground:
    """Ground of its ``seed`` whose finest detail is ``detail`` m, brightness about 0 and its deviation near 1."""

    seed: int
    detail: float

    def draw(self, x: Array, y: Array, look: Look = NOW) -> Array:
        """Brightness (r, c) at columns ``x`` (c,) and rows ``y`` (r,) m of the plane, in any order and spacing."""
        drawn = np.empty((y.size, x.size))
        for row in in_blocks(y.size, BLOCK):
            for column in in_blocks(x.size, BLOCK):
                block = slice(row[0], row[-1] + 1), slice(column[0], column[-1] + 1)
                drawn[block] = self._looked_at(x[column], y[row], look)
        return drawn

    def _looked_at(self, x: Array, y: Array, look: Look) -> Array:
        now = self._surface(x, y, look, self.seed)
        if look.changed <= 0.0:
            return now
        level = _level_above(look.changed)
        patch = octaves(self.seed + 31 * look.seed + 5, 60.0 * self.detail, 120.0 * self.detail, 0.0, x, y)
        changed = smooth_step((patch - level) / 0.05)
        if not changed.any():
            return now
        other = self._surface(x, y, look, self.seed + 104729 * (look.seed + 1))
        return np.asarray(now + changed * (other - now))

    def _surface(self, x: Array, y: Array, look: Look, seed: int) -> Array:
        d, shape = self.detail, (y.size, x.size)
        small, large = cells(seed + 11, SMALL * d, x, y), cells(seed + 13, LARGE * d, x, y)
        rough = small.blended(0.1 + 0.5 * small.number(seed + 17) ** 2, d).reshape(shape)
        bright = self._crops(small, look, seed) + self._crops(large, look, seed + 1)
        fine = octaves(seed + 19, 2.0 * d, 32.0 * d, 0.0, x, y)
        slow = octaves(seed + 23, 64.0 * d, 2048.0 * d, 0.0, x, y)
        land = bright.reshape(shape) + self._rows(small, x, y, look, seed).reshape(shape)
        land += rough * fine + 0.45 * slow + self._houses(large, x, y, seed)
        land += self._roads(large, land.ravel(), seed).reshape(shape) - land
        return self._flooded(land, x, y, seed)

    def _crops(self, fields: Cells, look: Look, seed: int) -> Array:
        """Brightness of the fields, of which half are green: dark in one band, bright in the other."""
        value = 1.9 * (fields.number(seed + 29) - 0.5)
        green = fields.number(seed + 37) < 0.5
        if look.band:
            value = np.where(green, 0.3 - value, 0.8 * value)
        grown = 2.0 * np.sqrt(3.0) * (fields.number(seed + 41 + look.seed) - 0.5)
        return fields.blended(value + np.sqrt(0.5) * look.season * grown, self.detail)

    def _rows(self, fields: Cells, x: Array, y: Array, look: Look, seed: int) -> Array:
        """Ploughed rows of some fields, 4 to 10 details apart, each field in its own direction of the season."""
        ploughed = seed + 43 + (1000 * (look.seed + 1) if look.season > 0.0 else 0)
        angle, apart, strength = (fields.number(s) for s in (ploughed, seed + 47, seed + 53))
        length = self.detail * (4.0 + 6.0 * apart)
        kx, ky = 2.0 * np.pi * np.cos(np.pi * angle) / length, 2.0 * np.pi * np.sin(np.pi * angle) / length
        phase = (
            kx[fields.own].reshape(y.size, -1) * x + ky[fields.own].reshape(y.size, -1) * y[:, None]
        ).ravel()
        inside = smooth_step(fields.gap / self.detail - 1.0)
        return np.asarray(0.35 * np.where(strength < 0.5, strength, 0.0)[fields.own] * inside * np.sin(phase))

    def _houses(self, fields: Cells, x: Array, y: Array, seed: int) -> Array:
        """Roofs, bright to one side and dark to the other, on half the plots of every fourth large field."""
        size, edge = TOWN * self.detail, self.detail
        i, j = np.floor(x / size).astype(np.int64), np.floor(y / size).astype(np.int64)
        wide, deep, high, right, down, built = _on_plots(seed + 59, 6, i, j)
        half_x, half_y = (0.1 + 0.15 * wide) * size, (0.1 + 0.15 * deep) * size
        u = np.abs(x - (i + 0.35 + 0.3 * right) * size)
        v = y[:, None] - (j[:, None] + 0.35 + 0.3 * down) * size
        roof = smooth_step((half_x - u) / edge) * smooth_step((half_y - np.abs(v)) / edge)
        lit = np.where(built < 0.5, 0.6 + 1.2 * high - 1.2 * smooth_step(v / edge), 0.0)
        town = fields.blended((fields.number(seed + 71) < 0.25).astype(np.float64), edge)
        return np.asarray(town.reshape(y.size, -1) * roof * lit)

    def _roads(self, fields: Cells, land: Array, seed: int) -> Array:
        """The land with a bright or dark road along the borders of the large fields."""
        tone = np.where(fields.number(seed + 73) < 0.5, 1.1, -1.1)
        on = smooth_step((ROAD * self.detail - fields.gap) / self.detail)
        return np.asarray(land + on * (fields.blended(tone, self.detail) - land))

    def _flooded(self, land: Array, x: Array, y: Array, seed: int) -> Array:
        """The land with lakes, dark and nearly without texture."""
        depth = waves(seed + 79, 200.0 * self.detail, x, y) + 0.1 * octaves(
            seed + 83, 8.0 * self.detail, 64.0 * self.detail, 0.5, x, y
        )
        return np.asarray(land + smooth_step((depth - WATER) / 0.02) * (-1.8 - land))


def _on_plots(seed: int, count: int, i: Index, j: Index) -> list[Array]:
    """Some numbers (r, c) between 0 and 1 for the plots in columns ``i`` (c,) and rows ``j`` (r,)."""
    columns, rows = np.arange(i.min(), i.max() + 1), np.arange(j.min(), j.max() + 1)
    chosen = np.ix_(j - rows[0], i - columns[0])
    return [hashed(seed + 89 * k, columns[None, :], rows[:, None])[chosen] for k in range(count)]


def _level_above(part: float) -> float:
    """Level that normal noise exceeds over a ``part`` of the plane."""
    from ...solve.probability import ndtri

    return float(-ndtri(part))
