"""Finding images at all: how far the mounting is off, over the whole of what was known of it before.

Each image, coarse and whole, is laid on the reference by orientation correlation at every shift that the prior allows.
The mounting's error moves all images by the same number of camera pixels (the rows of a scanner that flies backwards by
as many the other way), so that their surfaces are added: where one
image alone is ambiguous, because of cloud or of fields all alike, together they are not.  The errors of each image's
own attitude must be small beside a cell of that search; then each is taken from its own peak nearby.  A turn about the
boresight shears the agreement, so it is tried in steps where it may be large.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..table.geometry import locate, project
from .coarse import Coarse, coarse_images
from .library.expected import most_binned, summed_surface
from .matching.orientation import correlation, orientation
from .scene import Scene, geodetic

Array = NDArray[np.float64]

REACH = 3.5
"""The search goes this many sigmas to each side."""
MOST_CELLS = 700
"""Cells along each side of the reference that an image is looked for in: what sets how coarse the search is."""
LEAST_CELLS = 90
"""Cells along a side that an image is told by."""
CLEAR = 6.0
"""A peak this many robust standard deviations above the surface is a place."""
_PROBE_PX = 20.0
_APART = 4
"""Cells around a peak that belong to it."""
_HEIGHTS = 7
"""Places along each side of an image at which the ground's height is asked for."""


@dataclass(frozen=True)
class Peak:
    """The highest place of a surface: ``shift`` (2,) in its cells from the middle, x and y; how many robust standard
    deviations it and the ``second`` highest stand above the rest."""

    shift: Array
    height: float
    second: float


@dataclass(frozen=True)
class Acquisition:
    """Where the images were found: ``C_EK`` (m, 3, 3) that puts each there, to a few of ``cell_px``; ``together`` is
    the peak of all surfaces, ``alone`` that of each image within reach of it; ``unfit`` says of each image why it could
    not be looked for, or is empty."""

    C_EK: Array
    cell_px: int
    together: Peak
    alone: tuple[Peak, ...]
    unfit: tuple[str, ...]

    @property
    def clear(self) -> bool:
        return self.together.height > CLEAR and self.together.height > 1.25 * self.together.second


def search_factor(scene: Scene, sigma_K: Array, own_K: Array) -> int:
    """How many pixels are binned for the search."""
    own_px = float(max(own_K[0], own_K[1])) / _pixel_rad(scene)
    factor = _factor(max(max(raw.size_px) for raw in scene.raws), _reach_px(scene, sigma_K), own_px)
    return factor if scene.chip_half_m is None else min(factor, most_binned(scene))


def acquire(
    scene: Scene, sigma_K: Array, own_K: Array, coarse: Sequence[Coarse] | None = None
) -> Acquisition:
    """Find the images of a scene whose mounting is known to ``sigma_K`` (3,) rad about K's axes, and the attitude and
    position of each image to ``own_K`` (3,); ``coarse`` are its images binned by :func:`search_factor`."""
    campaign = scene.campaign
    pixel_rad = _pixel_rad(scene)
    reach_px = _reach_px(scene, sigma_K)
    factor = search_factor(scene, sigma_K, own_K)
    if coarse is None:
        coarse = coarse_images(scene, factor)
    fit = max(sum(not each.unfit for each in coarse), 1)
    best: Acquisition | None = None
    for twist in _twists(sigma_K[2], 0.5 * max(max(c.orientation.shape) for c in coarse)):
        C_EK = campaign.C_EK @ so3.exp(np.array([0.0, 0.0, twist]))
        ways = [_way(scene, C_EK, image, pixel_rad) for image in range(len(coarse))]
        seen = _surfaces(scene, C_EK, coarse, factor, reach_px)
        surfaces = [_laid(surface, way) for surface, way in zip(seen, ways, strict=True)]
        together = peak(sum(surfaces) / np.sqrt(fit))
        if best is not None and together.height <= best.together.height:
            continue
        alone = tuple(_near(surface, together) for surface in surfaces)
        shifts = [each.shift if each.height > CLEAR else together.shift for each in alone]
        turns = [
            _turn(_direction(scene, image), shift * factor * pixel_rad) for image, shift in enumerate(shifts)
        ]
        unfit = tuple(each.unfit for each in coarse)
        best = Acquisition(C_EK @ np.array(turns), factor, together, alone, unfit)
    if best is None:
        raise ValueError("there is at least one turn")
    return best


def _reach_px(scene: Scene, sigma_K: Array) -> float:
    return REACH * float(max(sigma_K[0], sigma_K[1])) / _pixel_rad(scene) + 8.0


def _middle(scene: Scene, image: int) -> Array:
    """The middle pixel (2,) of an image."""
    return 0.5 * (np.array(scene.raws[image].size_px, dtype=np.float64) - 1.0)


def _direction(scene: Scene, image: int) -> Array:
    """Tangents and 1, (3,), of the look direction of the middle of an image."""
    column, row = _middle(scene, image)
    xy_K, _ = scene.campaign.camera.tan_from_px(column, row)
    return np.concatenate([xy_K, [1.0]])


def _pixel_rad(scene: Scene) -> float:
    column, row = _middle(scene, 0)
    _, slope = scene.campaign.camera.tan_from_px(column, row)
    return float(np.linalg.norm(slope[:, 0]))


def _way(scene: Scene, C_EK: Array, image: int, pixel_rad: float) -> Array:
    """How many pixels (2, 2) of an image the ground moves by for a pixel's angle by which the camera turns: one for one
    in a frame, in the rows of a scanner as the track goes by."""
    index, middle = np.array([image]), _middle(scene, image)
    column, row = middle[:1], middle[1:]
    height = float(scene.height_at(*geodetic(locate(scene.campaign, C_EK, index, column, row, 0.0)))[0])
    height = height if np.isfinite(height) else 0.0
    moved = []
    for step in _PROBE_PX * np.eye(2):
        turned = C_EK @ _turn(_direction(scene, image), step * pixel_rad)
        p_J = locate(scene.campaign, turned, index, column, row, height)
        moved.append(project(scene.campaign, C_EK, index, p_J, middle[None])[0] - middle)
    return np.array(moved).T / _PROBE_PX


def _laid(surface: Array, way: Array) -> Array:
    """A surface over shifts of an image as one over the angles of the camera, in pixels."""
    from scipy.ndimage import affine_transform

    half = 0.5 * (surface.shape[0] - 1.0)
    if np.abs(way - np.eye(2)).max() * half < 0.5:
        return surface
    by_rows = way[::-1, ::-1]
    middle = np.full(2, half)
    return np.asarray(affine_transform(surface, by_rows, middle - by_rows @ middle, order=1, mode="nearest"))


def _factor(size_px: int, reach_px: float, own_px: float) -> int:
    """How many pixels are binned: so that the search is not too large, and images do not part by more than a cell; but
    an image keeps cells enough to be told by."""
    factor = 1
    while (size_px + 2.0 * reach_px) / factor > MOST_CELLS or (
        factor < own_px and size_px / factor > 2.0 * LEAST_CELLS
    ):
        factor *= 2
    return factor


def _twists(sigma: float, half_cells: float) -> Array:
    """Turns about the boresight, rad, so close that between two of them the border of an image moves by two cells."""
    steps = int(np.ceil(REACH * sigma * half_cells / 2.0 - 0.5))
    return np.asarray(np.arange(-steps, steps + 1) * 2.0 / half_cells)


def _turn(direction: Array, shift_rad: Array) -> Array:
    """The rotation that carries a direction in K to one so far beside it, by its tangents."""
    a = direction / np.linalg.norm(direction)
    b = direction + np.array([*shift_rad, 0.0])
    b = b / np.linalg.norm(b)
    axis = np.cross(a, b)
    length = float(np.linalg.norm(axis))
    return so3.exp(axis / max(length, 1e-30) * np.arctan2(length, float(a @ b)))


def _surfaces(
    scene: Scene, C_EK: Array, coarse: Sequence[Coarse], factor: int, reach_px: float
) -> Iterator[Array]:
    """The surface of each image (2 k + 1, 2 k + 1), its middle at no shift, in robust standard deviations."""
    k = int(np.ceil(reach_px / factor))
    for image, each in enumerate(coarse):
        if each.unfit:
            yield np.zeros((2 * k + 1, 2 * k + 1))
            continue
        chip = each.orientation
        if scene.chip_half_m is not None:
            yield standing(summed_surface(scene, C_EK, image, chip, factor, k))
            continue
        rows, columns = chip.shape
        column = (np.arange(-k, columns + k) + 0.5) * factor - 0.5
        row = (np.arange(-k, rows + k) + 0.5) * factor - 0.5
        yield standing(correlation(orientation(_ground(scene, C_EK, image, column, row, factor)), chip))


def _ground(scene: Scene, C_EK: Array, image: int, column: Array, row: Array, factor: int) -> Array:
    """The reference (r, c) under columns and rows of an image and beyond, on one height.

    Between a few lines of sight, and beyond the image, places follow a parabola in column and row: an image has no
    attitude beyond its rows.
    """
    columns, rows = scene.raws[image].size_px
    x, y = (
        grid.ravel() for grid in np.meshgrid(*(np.linspace(0.0, n - 1.0, _HEIGHTS) for n in (columns, rows)))
    )
    index = np.full(x.size, image)
    level = locate(scene.campaign, C_EK, index, x, y, 0.0)
    height = scene.height_at(*geodetic(level))
    middle = float(np.nanmedian(height)) if np.isfinite(height).any() else 0.0
    latitude, longitude = geodetic(locate(scene.campaign, C_EK, index, x, y, middle))
    scale = np.array([columns, rows], dtype=np.float64)

    def terms(u: Array, v: Array) -> Array:
        return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)

    base = longitude[0]
    around = np.remainder(longitude - base + np.pi, 2.0 * np.pi) - np.pi
    fitted, *_ = np.linalg.lstsq(
        terms(x / scale[0], y / scale[1]), np.stack([latitude, around], axis=-1), rcond=None
    )
    u, v = np.meshgrid(column / scale[0], row / scale[1])
    place = terms(u, v) @ fitted
    centre = 0.5 * (scale - 1.0)
    return scene.reference.sample(
        place[..., 0], place[..., 1] + base, factor * scene.pixel_m(C_EK, image, centre)
    )


def standing(surface: Array) -> Array:
    """A surface in robust standard deviations above its median; where it has no scatter, 0."""
    off = surface - np.median(surface)
    scatter = 1.4826 * float(np.median(np.abs(off)))
    return off / scatter if scatter > 1e-9 else np.zeros_like(off)


def peak(surface: Array) -> Peak:
    """The highest place of a surface in standard deviations; its shift by a parabola along each axis."""
    i, j = (int(n) for n in np.unravel_index(int(np.argmax(surface)), surface.shape))
    far = surface.copy()
    far[max(i - _APART, 0) : i + _APART + 1, max(j - _APART, 0) : j + _APART + 1] = -np.inf
    at = np.array([j + _vertex(surface[i], j), i + _vertex(surface[:, j], i)])
    middle = 0.5 * np.array([surface.shape[1] - 1.0, surface.shape[0] - 1.0])
    return Peak(at - middle, float(surface[i, j]), float(far.max()))


def _vertex(values: Array, k: int) -> float:
    if not 0 < k < values.size - 1:
        return 0.0
    before, at, after = values[k - 1 : k + 2].tolist()
    bend = before - 2.0 * at + after
    return 0.5 * (before - after) / bend if bend < 0.0 else 0.0


def _near(surface: Array, where: Peak) -> Peak:
    """The peak of one image's surface within a few cells of that of all."""
    middle = 0.5 * np.array([surface.shape[1] - 1.0, surface.shape[0] - 1.0])
    j, i = np.rint(where.shift + middle).astype(int)
    part = np.full_like(surface, -np.inf)
    near = slice(max(i - _APART, 0), i + _APART + 1), slice(max(j - _APART, 0), j + _APART + 1)
    part[near] = surface[near]
    k, m = np.unravel_index(int(np.argmax(part)), part.shape)
    return Peak(np.array([m, k]) - middle, float(part[k, m]), float(surface.max()))
