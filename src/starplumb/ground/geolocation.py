"""Where a whole image lies on the ground: longitude, latitude and height of its pixels, some rows at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ..physics.errors import InputError
from ..table.campaign import Campaign
from .grid import Terrain, geodetic_rows, locate_on_terrain
from .terrain import HIGHEST, LOWEST, HeightAt

Array = NDArray[np.float64]

BLOCK = 1 << 20
"""Pixels that are located at a time."""
MOST_POSTS = 100_000_000
"""Posts of the widest terrain that is held in memory (0.8 GB)."""
_FRINGE_M = 300.0
"""By how much a first, coarse look at the ground may have missed its highest and its lowest point."""
EARTH_RADIUS_M = 6.371e6


def block_count(row_px: Array, column_px: Array) -> int:
    """In how many blocks the rows of an image are located."""
    return int(np.clip(row_px.size * column_px.size // BLOCK, 1, row_px.size))


def positions(
    campaign: Campaign, C_EK: Array, image: int, row_px: Array, column_px: Array, ground: float | Terrain
) -> Iterator[Array]:
    """Longitude, latitude (rad) and height (m) (r, c, 3) of columns (c,) and of rows (r,), these in blocks.

    ``ground`` is a height above the ellipsoid or a terrain, beside which pixels are NaN, as they are past
    the Earth.  Raises EpochError for a row outside the orbit or attitude.
    """
    for rows in np.array_split(row_px, block_count(row_px, column_px)):
        if isinstance(ground, Terrain):
            place, height = locate_on_terrain(campaign, C_EK, image, rows, column_px, ground)
        else:
            place = geodetic_rows(campaign, C_EK, image, rows, column_px, ground)
            height = np.where(np.isnan(place[..., 0]), np.nan, ground)
        place = np.where(np.isnan(height)[..., None], np.nan, place)
        longitude = np.remainder(place[..., 1] + np.pi, 2.0 * np.pi) - np.pi
        yield np.stack([longitude, place[..., 0], height], axis=-1)


def beside_gaps(
    covered: NDArray[np.bool_], columns: int, located: Callable[[NDArray[np.bool_]], Iterator[Array]]
) -> Iterator[Array]:
    """Blocks of all rows (r,): of those ``covered`` what ``located`` makes of a choice of rows, of the others NaN."""
    ends = np.flatnonzero(np.diff(covered)) + 1
    for run in np.split(np.arange(covered.size), ends):
        if covered[run[0]]:
            chosen = np.zeros(covered.size, dtype=np.bool_)
            chosen[run] = True
            yield from located(chosen)
            continue
        for rows in np.array_split(run, max(run.size * columns // BLOCK, 1)):
            yield np.full((rows.size, columns, 3), np.nan)


def terrain_below(
    campaign: Campaign,
    C_EK: Array,
    image: int,
    row_px: Array,
    column_px: Array,
    height_at: HeightAt,
    step_m: float,
) -> Terrain:
    """The ground that an image may see, on a geographic grid with posts ``step_m`` apart.

    A coarse grid below every line of sight, wherever the ground may lie, tells the range of heights; the fine one
    covers what is seen within it.  Raises InputError where no ground is known there, or too many posts are needed.
    """

    def bounds(low: float, high: float) -> tuple[Array, Array]:
        rows, columns = _thinned(row_px), _thinned(column_px)
        seen = [geodetic_rows(campaign, C_EK, image, rows, columns, level) for level in (low, high)]
        places = np.concatenate(seen).reshape(-1, 2)
        places = places[np.isfinite(places).all(axis=1)]
        if not places.size:
            name = campaign.images.ids[image]
            raise InputError(f"image {name!r}: found no line of sight that meets the Earth, wanted some")
        places[:, 1] = np.unwrap(places[:, 1])
        margin = 3.0 * step_m / EARTH_RADIUS_M * np.array([1.0, 1.0 / np.cos(np.abs(places[:, 0]).max())])
        return places.min(axis=0) - margin, places.max(axis=0) + margin

    low, high = bounds(LOWEST, HIGHEST)
    coarse = _sampled(height_at, low, high, (high - low) / 200.0)
    if not np.any(np.isfinite(coarse.height)):
        name = campaign.images.ids[image]
        raise InputError(f"image {name!r}: found no ground height below it, wanted a DEM that covers it")
    low, high = bounds(
        float(np.nanmin(coarse.height)) - _FRINGE_M, float(np.nanmax(coarse.height)) + _FRINGE_M
    )
    step = step_m / EARTH_RADIUS_M * np.array([1.0, 1.0 / np.cos(np.abs([low[0], high[0]]).max())])
    if np.prod((high - low) / step) > MOST_POSTS:
        found = f"{np.prod((high - low) / step):.2g} posts of {step_m:g} m below it"
        raise InputError(
            f"image {campaign.images.ids[image]!r}: found {found}, wanted {MOST_POSTS:.1g} at most (a coarser DEM)"
        )
    return _sampled(height_at, low, high, step)


def _thinned(pixel: Array) -> Array:
    """A dozen of the pixels, both ends among them."""
    return pixel[np.unique(np.linspace(0, pixel.size - 1, 12).astype(np.int64))]


def _sampled(height_at: HeightAt, low: Array, high: Array, step: Array) -> Terrain:
    """Heights on the grid from ``low`` to beyond ``high``, latitude and longitude (2,) rad."""
    latitude, longitude = (
        low[i] + step[i] * np.arange(np.ceil((high[i] - low[i]) / step[i]) + 2) for i in range(2)
    )
    height = np.empty((latitude.size, longitude.size))
    for row, at in enumerate(latitude):
        height[row] = height_at(np.full(longitude.size, at), longitude)
    return Terrain(height, float(low[0]), float(low[1]), (float(step[0]), float(step[1])))
