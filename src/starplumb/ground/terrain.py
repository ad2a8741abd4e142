"""Where lines of sight first meet the ground, given the ground's heights.

A ray is walked down from above the highest ground that it may meet in steps no longer on the ground than one cell of
the height model, so that no ridge is stepped over, and the first crossing is closed in on by false position.  Many rays
are walked at once.  While they walk, a ray is a parabola in height, as long as it lies within a micrometre of one; the
crossing is that of the ray itself.

Source: M. Dowell, P. Jarratt, A modified regula falsi method for computing the root of an equation, BIT 11 (1971).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.earth import C_JT, itrf_to_geodetic
from ..physics.light import Corrections
from ..table.campaign import Campaign
from ..table.geometry import ground_points, looks

Array = NDArray[np.float64]
Index = NDArray[np.int64]

HeightAt = Callable[[Array, Array], Array]
"""Heights (n,) m above the ellipsoid at latitudes and longitudes (n,) rad; NaN where they are not known."""

HIGHEST, LOWEST = 9000.0, -500.0
"""No ground lies above or below, m."""
_ROUGH = 96
"""Steps of the first walk, which finds the range of heights along the ray."""
_MOST = 4000
"""Steps of the second walk at most."""
_AT_ONCE = 1 << 18
"""Places that are looked up at a time, more only where one ray has more."""
_STRAIGHT_M = 1e-6
"""How far a ray may lie from its parabola."""
_CLOSE_M = 1e-9
"""Height above the ground at which a ray has met it, and length of what is left of its walk."""
_ROUNDS = 150
"""Rounds of false position at most: every third one halves what is left."""


@dataclass(frozen=True)
class _Rays:
    """Lines of sight of n pixels: apparent directions, from where, and their ``parabola`` (3, n, 2) in latitude and
    longitude, rad, over the height in units of half the range from LOWEST to HIGHEST; NaN where a ray is none."""

    e_J: Array
    r_J: Array
    v_J: Array
    corrections: Corrections
    parabola: Array

    @classmethod
    def of(cls, campaign: Campaign, C_EK: Array, image: Index, pixel: Array) -> _Rays:
        """Raises EpochError for an image outside the orbit or attitude."""
        e_J, station = looks(campaign, C_EK, image, pixel[:, 0], pixel[:, 1])
        rays = cls(e_J, station.r_J, station.v_J, campaign.corrections, np.full((3, len(pixel), 2), np.nan))
        middle, half = 0.5 * (HIGHEST + LOWEST), 0.5 * (HIGHEST - LOWEST)
        every = np.arange(len(pixel))
        levels = (middle, LOWEST, HIGHEST, middle + 0.5 * half, middle - 0.5 * half)
        at = np.stack([rays.exactly(every, np.full(every.size, level)) for level in levels])
        at[..., 1] = np.unwrap(at[..., 1], axis=0)
        found = np.stack([at[0], 0.5 * (at[2] - at[1]), 0.5 * (at[2] + at[1]) - at[0]])
        tested = np.stack([found[0] + side * (found[1] + side * found[2]) for side in (0.5, -0.5)])
        departure = np.abs(tested - at[3:]) * 6.4e6
        found[:, ~(np.max(departure, axis=(0, 2)) < _STRAIGHT_M)] = np.nan
        rays.parabola[...] = found
        return rays

    def points(self, ray: Index, height: Array) -> Array:
        """Places p_J (k, 3) of rays (k,) at heights (k,)."""
        return ground_points(self.e_J[ray], self.r_J[ray], self.v_J[ray], self.corrections, height)

    def exactly(self, ray: Index, height: Array) -> Array:
        """Latitude and longitude (k, 2) rad of rays (k,) at heights (k,)."""
        latitude, longitude, _ = itrf_to_geodetic(self.points(ray, height))
        return np.stack([latitude, longitude], axis=-1)

    def nearly(self, ray: Index, height: Array) -> Array:
        """The same by the parabola of each ray that is one."""
        t = ((height - 0.5 * (HIGHEST + LOWEST)) / (0.5 * (HIGHEST - LOWEST)))[:, None]
        place = self.parabola[0, ray] + t * (self.parabola[1, ray] + t * self.parabola[2, ray])
        bent = np.flatnonzero(np.isnan(place[:, 0]))
        if bent.size:
            place[bent] = self.exactly(ray[bent], height[bent])
        return np.asarray(place)


def ground_heights(
    campaign: Campaign, C_EK: Array, image: Index, pixel: Array, height_at: HeightAt, step_m: float
) -> Array:
    """Heights (n,) m of the ground that pixels (n, 2) of images (n,) see; NaN where a ray meets no known ground.

    ``step_m`` is the cell of the height model.  Raises EpochError for an image outside the orbit or attitude.
    """
    rays, met = _Rays.of(campaign, C_EK, image, pixel), np.full(len(pixel), np.nan)
    for some in np.array_split(np.arange(len(pixel)), 1 + _ROUGH * len(pixel) // _AT_ONCE):
        known, top, bottom = _range(rays, some, height_at)
        for ray, high, low in _crossings(rays, known, top, bottom, height_at, step_m):
            met[ray] = _met(rays, ray, high, low, height_at)
    return met


def ground_height(
    campaign: Campaign, C_EK: Array, image: int, pixel: Array, height_at: HeightAt, step_m: float
) -> float:
    """The height of a single pixel (2,) of an image."""
    return float(ground_heights(campaign, C_EK, np.array([image]), pixel[None], height_at, step_m)[0])


def _range(rays: _Rays, some: Index, height_at: HeightAt) -> tuple[Index, Array, Array]:
    """Of some rays, those below which any ground is known, and between which heights all of it lies."""
    rough = np.linspace(HIGHEST, LOWEST, _ROUGH)
    place = rays.nearly(np.repeat(some, _ROUGH), np.tile(rough, some.size))
    ground = height_at(place[:, 0], place[:, 1]).reshape(-1, _ROUGH)
    known = np.any(np.isfinite(ground), axis=1)
    margin = rough[0] - rough[1]
    return (
        some[known],
        np.nanmax(ground[known], axis=1) + margin,
        np.nanmin(ground[known], axis=1) - margin,
    )


def _crossings(
    rays: _Rays, ray: Index, top: Array, bottom: Array, height_at: HeightAt, step_m: float
) -> Iterator[tuple[Index, Array, Array]]:
    """Of rays (n,) walked from top to bottom those that cross the ground, and the heights of the ends of the step in
    which each first does."""
    walked = np.linalg.norm(rays.points(ray, top) - rays.points(ray, bottom), axis=-1)
    steps = np.clip(np.ceil(np.nan_to_num(walked / step_m)), 2, _MOST).astype(np.int64)
    blocks = np.cumsum(steps + 1) // _AT_ONCE
    for block in np.unique(blocks):
        mine = np.flatnonzero(blocks == block)
        count = steps[mine] + 1
        owner = np.repeat(np.arange(mine.size), count)
        number = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
        fall = ((bottom - top) / steps)[mine]
        height = top[mine][owner] + number * fall[owner]
        place = rays.nearly(ray[mine][owner], height)
        gap = height - height_at(place[:, 0], place[:, 1])
        crossed = np.flatnonzero((gap[:-1] > 0.0) & (gap[1:] <= 0.0) & (owner[1:] == owner[:-1]))
        which, first = np.unique(owner[crossed], return_index=True)
        at = crossed[first]
        yield ray[mine][which], height[at], height[at + 1]


def _met(rays: _Rays, ray: Index, high: Array, low: Array, height_at: HeightAt) -> Array:
    """Heights (n,) between ``high`` and ``low`` at which rays (n,) meet the ground: false position, of which the end
    that stays counts half (Illinois), and every third time the middle."""

    def above(rows: Index, height: Array) -> Array:
        place = rays.exactly(ray[rows], height)
        return height - height_at(place[:, 0], place[:, 1])

    high, low, open_ = high.copy(), low.copy(), np.arange(ray.size)
    up, down, before = above(open_, high), above(open_, low), np.zeros(ray.size)
    met = 0.5 * (high + low)
    for turn in range(_ROUNDS):
        if open_.size == 0:
            break
        a, b, fa, fb = high[open_], low[open_], up[open_], down[open_]
        with np.errstate(divide="ignore", invalid="ignore"):
            at = b - fb * (a - b) / (fa - fb)
        at = np.where((at > b) & (at < a) & (turn % 3 < 2), at, 0.5 * (a + b))
        value = above(open_, at)
        rises = value > 0.0
        again = np.where(rises, 1.0, -1.0) == before[open_]
        high[open_], up[open_] = np.where(rises, at, a), np.where(rises, value, np.where(again, 0.5 * fa, fa))
        low[open_], down[open_] = (
            np.where(rises, b, at),
            np.where(rises, np.where(again, 0.5 * fb, fb), value),
        )
        before[open_], met[open_] = np.where(rises, 1.0, -1.0), at
        open_ = open_[(np.abs(value) > _CLOSE_M) & (high[open_] - low[open_] > _CLOSE_M) | np.isnan(value)]
    return met


def slopes(height_at: HeightAt, p_J: Array, step_m: float) -> Array:
    """How much the ground rises to the east and to the north of points p_J (n, 3), (n, 2) m per m.

    By its heights one cell, ``step_m``, to either side, or to the one that is known; NaN where neither is.
    """
    latitude, longitude, _ = itrf_to_geodetic(p_J)
    here, C = height_at(latitude, longitude), C_JT(latitude, longitude)
    rise = np.empty((len(p_J), 2))
    for axis in range(2):
        sides = (p_J + side * step_m * C[..., :, axis] for side in (-1.0, 1.0))
        before, after = (height_at(*itrf_to_geodetic(p)[:2]) for p in sides)
        known = np.isfinite(before).astype(np.float64) + np.isfinite(after)
        run = np.where(known > 0.0, known * step_m, np.nan)
        rise[:, axis] = (
            np.where(np.isnan(after), here, after) - np.where(np.isnan(before), here, before)
        ) / run
    return rise
