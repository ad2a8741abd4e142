"""Direct location of whole images: where every pixel looks, on the ellipsoid or on a terrain.

A row's ground points are a smooth curve, so they are computed exactly at a few Chebyshev nodes of each row and
interpolated between (barycentric weights, the same for all rows: one matrix product).  The error is measured between
the nodes, and the nodes are doubled until it is below :data:`TOLERANCE_M`.  Detectors need not lie on a smooth line:
the interpolation is over the tangents of the look direction, and only the tangents come from the detector's column.

Source: J.-P. Berrut, L. N. Trefethen, Barycentric Lagrange interpolation, SIAM Review 46 (2004).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.earth import itrf_to_geodetic
from ..table.campaign import Campaign
from ..table.geometry import Stations, ground_points, stations

Array = NDArray[np.float64]

TOLERANCE_M = 1e-4
"""Largest error of the interpolation between nodes."""
MOST_NODES = 128
LOOKUPS = 40
"""Most look-ups of the terrain along a line of sight."""


OBLIQUE = 0.25
"""Part of a line's longer side from which on its shorter one takes as many nodes."""


@dataclass(frozen=True)
class Terrain:
    """Heights above the ellipsoid (m) at the nodes of a grid: ``height`` (a, b), rows of latitude, columns of
    longitude.

    ``latitude`` and ``longitude`` (rad) of the first node with their ``step`` (rad each, negative latitude steps for a
    grid from the north, longitudes growing eastwards); between nodes heights are bilinear.
    """

    height: Array
    latitude: float
    longitude: float
    step: tuple[float, float]

    def at(self, latitude: Array, longitude: Array) -> Array:
        """Height (...) at places (rad); NaN outside the grid."""
        row = (latitude - self.latitude) / self.step[0]
        column = np.mod(longitude - self.longitude, 2.0 * np.pi) / self.step[1]
        rows, columns = self.height.shape
        inside = (row >= 0.0) & (row <= rows - 1) & (column >= 0.0) & (column <= columns - 1)
        i = np.minimum(np.where(inside, row, 0.0), rows - 1.000001).astype(np.intp)
        j = np.minimum(np.where(inside, column, 0.0), columns - 1.000001).astype(np.intp)
        u, v = row - i, column - j
        flat, corner = self.height.ravel(), i * columns + j
        upper = flat[corner] * (1.0 - v) + flat[corner + 1] * v
        lower = flat[corner + columns] * (1.0 - v) + flat[corner + columns + 1] * v
        return np.where(inside, upper * (1.0 - u) + lower * u, np.nan)


def locate_rows(
    campaign: Campaign, C_EK: Array, image: int, row_px: Array, column_px: Array, height: float = 0.0
) -> Array:
    """Ground points p_J (r, c, 3) of all columns (c,) in rows (r,) of an image, at a height above the ellipsoid (m).

    NaN where a line of sight misses the Earth.  Raises EpochError for a row outside the orbit or attitude.
    """

    def exact(station: Stations, e_J: Array) -> Array:
        return ground_points(e_J, station.r_J[:, None], station.v_J[:, None], campaign.corrections, height)

    return _interpolated(campaign, C_EK, image, row_px, column_px, exact)


def geodetic_rows(
    campaign: Campaign, C_EK: Array, image: int, row_px: Array, column_px: Array, height: float = 0.0
) -> Array:
    """Geodetic latitude and longitude (r, c, 2) rad of the same; longitudes jump by a full turn neither along a row nor
    from one height to another."""

    def exact(station: Stations, e_J: Array) -> Array:
        p_J = ground_points(e_J, station.r_J[:, None], station.v_J[:, None], campaign.corrections, height)
        latitude, longitude, _ = itrf_to_geodetic(p_J)
        if not np.isnan(longitude).any():
            longitude = np.unwrap(longitude, axis=1)
        below = np.arctan2(station.r_J[:, 1], station.r_J[:, 0])[:, None]
        first = longitude if np.isnan(longitude).any() else longitude[:, :1]
        longitude -= 2.0 * np.pi * np.round((first - below) / (2.0 * np.pi))
        return np.stack([latitude, longitude], axis=-1)

    return _interpolated(campaign, C_EK, image, row_px, column_px, exact, 1.0 / 6.4e6)


def locate_on_terrain(
    campaign: Campaign, C_EK: Array, image: int, row_px: Array, column_px: Array, terrain: Terrain
) -> tuple[Array, Array]:
    """Latitude and longitude (r, c, 2) rad and height (r, c) m where the lines of sight meet a terrain; NaN beside it.

    The line of sight is a parabola in height through the places at the terrain's lowest, middle and highest level (its
    departure from it is micrometres); ``h <- terrain(place(h))`` converges where slope times tan of the zenith angle is
    below one, and finds the meeting next to the middle level where there are several.
    """
    low, high = float(np.nanmin(terrain.height)), float(np.nanmax(terrain.height)) + 1.0
    levels = (low, 0.5 * (low + high), high)
    at_low, middle, at_high = (
        geodetic_rows(campaign, C_EK, image, row_px, column_px, level) for level in levels
    )
    slope, bend = 0.5 * (at_high - at_low), 0.5 * (at_high + at_low) - middle
    half = 0.5 * (high - low)
    place, found = middle, np.zeros(middle.shape[:-1])
    for _ in range(LOOKUPS):
        met = (terrain.at(place[..., 0], place[..., 1]) - levels[1]) / half
        change = np.abs(met - found)
        found = met
        place = middle + found[..., None] * (slope + found[..., None] * bend)
        if not np.nanmax(change, initial=0.0) * half > 0.01:
            break
    return place, levels[1] + half * found


def _interpolated(
    campaign: Campaign,
    C_EK: Array,
    image: int,
    row_px: Array,
    column_px: Array,
    exact: Callable[[Stations, Array], Array],
    unit: float = 1.0,
) -> Array:
    """Values (r, c, q) of a smooth function of the line of sight, exact at the nodes; ``unit`` is a metre in them."""
    row_px, column_px = np.asarray(row_px, dtype=np.float64), np.asarray(column_px, dtype=np.float64)
    probes = row_px[np.unique(np.linspace(0, row_px.size - 1, 3).astype(np.int64))]
    between = column_px[np.unique(np.linspace(0, column_px.size - 1, 13).astype(np.int64))]
    count = 6
    while count <= MOST_NODES:
        nodes = _Nodes.over(campaign, column_px, count)
        trial = nodes.values(campaign, C_EK, image, probes, exact)
        truth = _exactly(campaign, C_EK, image, probes, between, exact)
        off = np.abs(nodes.weights(campaign, between) @ trial - truth)
        if not np.all(np.isfinite(trial)):
            break
        if np.nanmax(off, initial=0.0) < TOLERANCE_M * unit:
            values = nodes.values(campaign, C_EK, image, row_px, exact)
            r, n, q = values.shape
            product = np.moveaxis(values, 1, 2).reshape(r * q, n) @ nodes.weights(campaign, column_px).mT
            return np.moveaxis(product.reshape(r, q, column_px.size), 1, 2)
        count *= 2
    # where some lines of sight miss the Earth nothing is smooth
    return _exactly(campaign, C_EK, image, row_px, column_px, exact)


def _exactly(
    campaign: Campaign,
    C_EK: Array,
    image: int,
    row_px: Array,
    column_px: Array,
    exact: Callable[[Stations, Array], Array],
) -> Array:
    """The function itself (r, c, q), pixel by pixel."""
    xy_K, _ = campaign.camera.tan_from_px(column_px[None, :], row_px[:, None])
    return _along(campaign, C_EK, image, row_px, xy_K, exact)


def _along(
    campaign: Campaign,
    C_EK: Array,
    image: int,
    row_px: Array,
    xy_K: Array,
    exact: Callable[[Stations, Array], Array],
) -> Array:
    """The function in the directions of tangents xy_K (r or 1, n, 2) seen in rows (r,)."""
    station = stations(campaign, np.full(row_px.size, image), row_px)
    s_K = np.concatenate([xy_K, np.ones((*xy_K.shape[:-1], 1))], axis=-1)
    e_J = s_K @ (station.C_EJ.mT @ C_EK).mT
    return exact(station, e_J / np.linalg.norm(e_J, axis=-1, keepdims=True))


@dataclass(frozen=True)
class _Nodes:
    """Chebyshev nodes: of the column for a frame, whose optics are smooth; of the tangents for a line of detectors."""

    axes: tuple[Array, ...]

    @classmethod
    def over(cls, campaign: Campaign, column_px: Array, count: int) -> _Nodes:
        if not campaign.camera.scans:
            return cls((_chebyshev(column_px, count),))
        xy_K, _ = campaign.camera.tan_from_px(column_px, 0.0)
        extent = np.ptp(xy_K, axis=0)
        few = np.where(extent > 1e-9, max(3, count // 4), 1)
        x, y = np.where(extent > OBLIQUE * np.max(extent), count, few).tolist()
        return cls((_chebyshev(xy_K[:, 0], x), _chebyshev(xy_K[:, 1], y)))

    def values(
        self,
        campaign: Campaign,
        C_EK: Array,
        image: int,
        row_px: Array,
        exact: Callable[[Stations, Array], Array],
    ) -> Array:
        """The function at the nodes of rows (r,), (r, nodes, q)."""
        if not campaign.camera.scans:
            return _exactly(campaign, C_EK, image, row_px, self.axes[0], exact)
        xy_K = np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1).reshape(1, -1, 2)
        return _along(campaign, C_EK, image, row_px, xy_K, exact)

    def weights(self, campaign: Campaign, column_px: Array) -> Array:
        """Weights (c, nodes) of the nodes at columns (c,)."""
        if not campaign.camera.scans:
            return _barycentric(self.axes[0], column_px)
        xy_K, _ = campaign.camera.tan_from_px(column_px, 0.0)
        x, y = (_barycentric(axis, xy_K[:, i]) for i, axis in enumerate(self.axes))
        return np.asarray((x[:, :, None] * y[:, None, :]).reshape(column_px.size, -1))


def _chebyshev(values: Array, count: int) -> Array:
    """Nodes (count,) of the second kind over the range of values; one node in its middle."""
    low, high = float(np.min(values)), float(np.max(values))
    if count == 1 or high == low:
        return np.array([0.5 * (low + high)])
    return np.asarray(
        0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * np.arange(count) / (count - 1))
    )


def _barycentric(nodes: Array, at: Array) -> Array:
    """Lagrange polynomials of Chebyshev nodes (k,) at places (c,), (c, k)."""
    if nodes.size == 1:
        return np.ones((at.size, 1))
    sign = (-1.0) ** np.arange(nodes.size)
    sign[[0, -1]] *= 0.5
    distance = at[:, None] - nodes
    hit = distance == 0.0
    terms = sign / np.where(hit, 1.0, distance)
    weights = terms / np.sum(terms, axis=1, keepdims=True)
    return np.asarray(np.where(np.any(hit, axis=1, keepdims=True), hit.astype(np.float64), weights))
