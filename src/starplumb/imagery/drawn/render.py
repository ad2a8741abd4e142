"""Raw images and orthoimages of drawn ground, as a camera of known mounting would take them.

A pixel is the ground's brightness blurred by the optics and gathered over the pixel's square; both are summed over
finer pixels, whose lines of sight are followed to the terrain by the package's own camera model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...ground.grid import Terrain, locate_on_terrain
from ...table.campaign import Campaign
from .ground import NOW, Look
from .noise import in_blocks
from .plane import Plane
from .sky import Sky

Array = NDArray[np.float64]
Dn = NDArray[np.uint16]
Places = Callable[[Array, Array], tuple[Array, Array]]
"""x and y (r, c) m in the plane of the columns (c,) and rows (r,) of a picture, which may lie between its pixels."""

FINER = 2
"""Finer pixels along each side of a pixel."""
BLOCK = 320
"""Rows and columns of pixels that are drawn at a time."""
NODES_PX = 4.0
"""Pixels between the lines of sight that are followed to the terrain; between them the ground is smooth."""
_MEAN = np.array([1.0, 22.0, 1.0]) / 24.0
"""Mean over a step of samples about its middle, to the fourth order: ``f + h^2 f'' / 24``."""
SPACING = 0.75
"""Spacing of the samples of the ground, in its finest details: half a pixel's detail then errs by 0.0004 px."""


class Surface(Protocol):
    """What can be drawn on a plane: brightness (r, c) at columns and rows, m, with nothing finer than ``detail`` m."""

    @property
    def detail(self) -> float: ...

    def draw(self, x: Array, y: Array, look: Look = NOW) -> Array: ...


@dataclass(frozen=True)
class Sensor:
    """How brightness becomes numbers: ``psf_px`` is the sigma of the optics' blur beside the pixel's own square.

    ``dn = mean_dn + gain_dn brightness``, with the noise ``read_noise_dn^2 + dn_per_electron (dn - dark_dn)``, in whole
    numbers of so many ``bits``.
    """

    psf_px: float = 0.45
    mean_dn: float = 900.0
    gain_dn: float = 160.0
    dark_dn: float = 100.0
    read_noise_dn: float = 4.0
    dn_per_electron: float = 0.1
    bits: int = 12

    @property
    def most_dn(self) -> int:
        """The number of a saturated pixel."""
        return (1 << self.bits) - 1

    def expose(self, brightness: Array, rng: np.random.Generator) -> Dn:
        """Numbers (...) of one exposure of a brightness (...)."""
        dn = self.mean_dn + self.gain_dn * brightness
        light = np.maximum(dn - self.dark_dn, 0.0)
        dn += rng.standard_normal(dn.shape) * np.sqrt(self.read_noise_dn**2 + self.dn_per_electron * light)
        return np.asarray(np.clip(np.rint(dn), 0, self.most_dn), dtype=np.uint16)


@dataclass(frozen=True)
class View:
    """What the images of a campaign see: drawn ``ground`` on a ``plane``, its heights a ``terrain``, through the
    mounting ``C_EK`` (3, 3)."""

    campaign: Campaign
    C_EK: Array
    terrain: Terrain
    plane: Plane
    ground: Surface
    spacing: float = SPACING

    def places(self, image: int) -> Places:
        """Where pixels of an image look; raises InputError as ``locate_on_terrain``, ValueError beside the terrain."""

        def of(column: Array, row: Array) -> tuple[Array, Array]:
            nodes = _nodes(column), _nodes(row)
            place, _ = locate_on_terrain(self.campaign, self.C_EK, image, nodes[1], nodes[0], self.terrain)
            if not np.all(np.isfinite(place)):
                raise ValueError(f"the terrain does not cover image {self.campaign.images.ids[image]!r}")
            x, y = self.plane.metres(place[..., 0], place[..., 1])
            return _between(nodes, x, column, row), _between(nodes, y, column, row)

        return of

    def brightness(
        self, image: int, size_px: tuple[int, int], psf_px: float, look: Look = NOW, sky: Sky | None = None
    ) -> Array:
        """What an image of so many columns and rows sees, without noise (r, c)."""
        seen = picture(self.ground, self.places(image), size_px, psf_px, look, self.spacing)
        if sky is None:
            return seen
        return sky.over(size_px).veil(seen, *(np.arange(float(n)) for n in size_px))


def picture(
    ground: Surface,
    places: Places,
    size_px: tuple[int, int],
    psf_px: float = 0.0,
    look: Look = NOW,
    spacing: float = SPACING,
) -> Array:
    """Brightness (r, c) of pixels that look at ``places``, blurred by a Gaussian of ``psf_px`` and by the pixel."""
    drawn = np.empty(size_px[::-1])
    rim = int(np.ceil(4.0 * psf_px)) + 1
    for row in in_blocks(size_px[1], BLOCK):
        for column in in_blocks(size_px[0], BLOCK):
            x, y = places(_finer(column, rim), _finer(row, rim))
            fine = _blurred(sampled(ground, x, y, look, spacing), psf_px)
            fine = fine[FINER * rim : -FINER * rim, FINER * rim : -FINER * rim]
            means = fine.reshape(row.size, FINER, column.size, FINER).mean(axis=(1, 3))
            drawn[row[0] : row[-1] + 1, column[0] : column[-1] + 1] = means
    return drawn


def _blurred(fine: Array, psf_px: float) -> Array:
    """Means over the squares of finer pixels, of what the optics blur."""
    from scipy.ndimage import correlate1d, gaussian_filter

    fine = gaussian_filter(fine, FINER * psf_px) if psf_px > 0.0 else fine
    for axis in (0, 1):
        fine = correlate1d(fine, _MEAN, axis)
    return np.asarray(fine)


def _finer(pixels: NDArray[np.int64], rim: int) -> Array:
    """Centres of the finer pixels of pixels that follow one another, with so many more on either side."""
    first, count = pixels[0] - rim, pixels.size + 2 * rim
    return np.asarray(first - 0.5 + (np.arange(FINER * count) + 0.5) / FINER)


def sampled(ground: Surface, x: Array, y: Array, look: Look = NOW, spacing: float = SPACING) -> Array:
    """Brightness at places (r, c): drawn on a grid around them and taken between its samples by cubic splines."""
    from scipy.ndimage import map_coordinates

    step = spacing * ground.detail
    columns, rows = (_axis(values, step) for values in (x, y))
    at = [(y - rows[0]) / step, (x - columns[0]) / step]
    return np.asarray(map_coordinates(ground.draw(columns, rows, look), at, order=3, mode="nearest"))


def _axis(values: Array, step: float) -> Array:
    """Samples on a lattice that all pictures share, with some more on either side for the spline."""
    return np.asarray(
        step * np.arange(np.floor(values.min() / step) - 12.0, np.ceil(values.max() / step) + 13.0)
    )


def _nodes(pixels: Array) -> Array:
    """Places about NODES_PX apart that reach from the first to the last pixel."""
    count = max(int(np.ceil((pixels[-1] - pixels[0]) / NODES_PX)) + 1, 4)
    return np.linspace(pixels[0], pixels[-1], count)


def _between(nodes: tuple[Array, Array], values: Array, column: Array, row: Array) -> Array:
    """Values (r, c) between those (j, i) at nodes of columns (i,) and rows (j,), by cubic splines."""
    from scipy.interpolate import RectBivariateSpline

    return np.asarray(RectBivariateSpline(nodes[1], nodes[0], values)(row, column))
