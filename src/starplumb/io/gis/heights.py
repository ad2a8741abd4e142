"""Heights above the ellipsoid from a DEM, which may itself give heights above a geoid; nothing is guessed.

A raster's heights are ellipsoidal or above a geoid, and hardly any file says which; a library that is asked to turn one
into the other without its grid may return them unchanged.  So the user says what they are, names the geoid's grid if
there is one, and a file that does say what it holds must agree.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ...physics.units import DEG
from ..text.files import show

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

    from .reference_system import Grid

Array = NDArray[np.float64]

Heights = Literal["ellipsoidal", "geoid"]

_ON_A_GEOID = re.compile(r"\b(VERT_CS|VERTCRS|VERTICALCRS|COMPD_CS|COMPOUNDCRS)\b")
_THREE_AXES = re.compile(r'AXIS\["[Ee]llipsoidal height')
_IN_FEET = re.compile(r'\bVERT(?:_CS|CRS)\b.*?UNIT\["([^"]*(?:foot|feet)[^"]*)"', re.DOTALL | re.IGNORECASE)
_FEET = re.compile(r"ft|.*(foot|feet).*|us-ft|ft-us|ftus", re.IGNORECASE)
MOST_CELLS = 1 << 22
"""Cells of a raster that are read at a time (32 MB)."""
HEIGHTS_M = (-1000.0, 9500.0)
"""Of ground above the ellipsoid."""
_GEOID_M = (-150.0, 150.0)
_ANY = (-np.inf, np.inf)
_EDGE = 1e-6
"""Rounding, in cells, by which a point may seem to lie beyond the last cell's centre."""


_LARGEST, _SMALLEST_CELL = 1e9, 1e-20
"""Metres or degrees of a georeference, and the area of a cell in their squares: no raster is near them."""


@dataclass(frozen=True)
class Raster:
    """The first band of a raster, sampled at geographic places by bilinear interpolation between cell centres.

    Cells beyond ``limits`` are refused: they are marks of no data that the file does not declare."""

    path: Path
    dataset: DatasetReader = field(repr=False)
    limits: tuple[float, float] = _ANY
    _last: list[tuple[tuple[int, int], Array]] = field(default_factory=list, repr=False, compare=False)

    @classmethod
    def open(cls, path: Path, limits: tuple[float, float] = _ANY) -> Raster:
        """Raises InputError where the file is no raster, has no reference system, or rasterio is not installed."""
        from .drivers import open_raster

        dataset = open_raster(path)
        turn = dataset.transform
        if dataset.crs is None or turn.is_identity:
            raise InputError(f"{path}: found no reference system, wanted a georeferenced raster")
        if not is_of_this_earth(np.array(turn[:6])):
            raise InputError(
                f"{path}: found a georeference that is none ({show(list(turn[:6]))}), wanted one"
            )
        return cls(path, dataset, limits)

    @property
    def stated(self) -> Heights | None:
        """What the file itself says its heights are."""
        wkt = self.dataset.crs.to_wkt()
        if _ON_A_GEOID.search(wkt):
            return "geoid"
        return "ellipsoidal" if _THREE_AXES.search(wkt) or self.dataset.crs.to_epsg() == 4979 else None

    @property
    def step_m(self) -> float:
        """Size of a cell on the ground, m."""
        a, b = abs(self.dataset.transform.a), abs(self.dataset.transform.e)
        return float(min(a, b)) * (111_000.0 if self.dataset.crs.is_geographic else 1.0)

    @cached_property
    def _grid(self) -> Grid:
        """Where places stand in a projected raster."""
        from .reference_system import Grid

        middle = self.dataset.transform @ (0.5 * self.dataset.width, 0.5 * self.dataset.height)
        return Grid(self.path, self.dataset.crs.to_wkt(), middle)

    @property
    def _goes_round(self) -> bool:
        """Whether the last column is followed by the first, all around the Earth."""
        d = self.dataset
        return bool(d.crs.is_geographic) and abs(d.width * d.transform.a - 360.0) < 0.5 * d.transform.a

    def at(self, latitude: Array, longitude: Array) -> Array:
        """Values (n,) at places (n,) rad; NaN beyond the raster or where a cell around the place has no data."""
        column, row = self._cells(latitude, longitude)
        return self._values(column, row)

    def _values(self, column: Array, row: Array) -> Array:
        """Values at fractional columns and rows (n,), of places far apart a part at a time."""
        size = np.array([[self.dataset.width], [self.dataset.height]])
        within = np.clip(np.nan_to_num(np.stack([column, row])), 0.0, size)
        spans = np.ptp(within, axis=1) if column.size else np.zeros(2)
        if np.prod(spans + 2.0) > MOST_CELLS:
            axis = within[int(np.argmax(spans))]
            first = axis <= 0.5 * (axis.min() + axis.max())
            values = np.empty(column.shape)
            for part in (first, ~first):
                values[part] = self._values(column[part], row[part])
            return values
        last = np.array([self.dataset.width - 1, self.dataset.height - 1])
        inside = (row >= -_EDGE) & (row <= last[1] + _EDGE)
        if not self._goes_round:
            inside &= (column >= -_EDGE) & (column <= last[0] + _EDGE)
        values = np.full(column.shape, np.nan)
        if not inside.any():
            return values
        row = np.clip(row[inside], 0, last[1])
        column = column[inside] if self._goes_round else np.clip(column[inside], 0, last[0])
        left, top = np.floor(column).astype(int), np.floor(row).astype(int)
        x, y = column - left, row - top
        if self._goes_round:
            first, right = 0, np.mod(left + 1, last[0] + 1)
            left = np.mod(left, last[0] + 1)
            cells = self._window(0, top.min(), last[0], top.max())
        else:
            first, right = int(left.min()), np.minimum(left + 1, last[0])
            cells = self._window(first, top.min(), left.max(), top.max())
        i, below = top - top.min(), np.minimum(top + 1, last[1]) - top.min()
        corners = (
            (i, left, (1 - x) * (1 - y)),
            (i, right, x * (1 - y)),
            (below, left, (1 - x) * y),
            (below, right, x * y),
        )
        # a cell of no weight may be empty
        values[inside] = sum(
            np.where(weight > 0.0, weight * self._possible(cells[a, b - first], weight), 0.0)
            for a, b, weight in corners
        )
        return values

    def _possible(self, cells: Array, weight: Array) -> Array:
        """The cells (n,).  Raises InputError where one that has a weight is beyond the limits."""
        low, high = self.limits
        beyond = (weight > 0.0) & ((cells < low) | (cells > high))
        if beyond.any():
            found = f"found a cell of {cells[np.argmax(beyond)]:.9g}"
            raise InputError(
                f"{self.path}: {found}, wanted {low:g} to {high:g} m, or a mark of no data that the file declares"
            )
        return np.where(weight > 0.0, cells, 0.0)

    def _window(self, left: int, top: int, right: int, bottom: int) -> Array:
        """Cells from (left, top) to one beyond (right, bottom), where there is one; NaN for no data.

        What was read last is kept: who looks for where a ray meets the ground looks there again.
        """
        width = min(right + 2, self.dataset.width) - left
        height = min(bottom + 2, self.dataset.height) - top
        for (x, y), cells in self._last:
            if (
                x <= left
                and y <= top
                and left + width <= x + cells.shape[1]
                and top + height <= y + cells.shape[0]
            ):
                return cells[top - y : top - y + height, left - x : left - x + width]
        from .drivers import cells_of

        cells = cells_of(self.path, self.dataset, 1, (left, top, width, height))
        self._last[:] = [((left, top), cells)]
        return cells

    def _cells(self, latitude: Array, longitude: Array) -> tuple[Array, Array]:
        """Fractional column and row (n,), 0 at the centre of the first cell."""
        x, y = longitude / DEG, latitude / DEG
        crs, left = self.dataset.crs, self.dataset.transform.c
        if not crs.is_geographic:
            x, y = self._grid.of(x, y)
        else:
            # grids may run from 0 to 360 or from -180 to 180
            x = left + np.mod(x - left, 360.0)
        t = ~self.dataset.transform
        return t.a * x + t.b * y + t.c - 0.5, t.d * x + t.e * y + t.f - 0.5


def is_of_this_earth(turn: Array) -> bool:
    """Whether a, b, c, d, e, f of a georeference, in metres or degrees, are of cells that a raster can have."""
    if not np.all(np.abs(turn) < _LARGEST):
        return False
    return bool(abs(turn[0] * turn[4] - turn[1] * turn[3]) > _SMALLEST_CELL)


@dataclass(frozen=True)
class Surface:
    """Ground heights above the ellipsoid: a DEM, plus the geoid it stands on, if any."""

    dem: Raster
    geoid: Raster | None

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files that are read."""
        return tuple(raster.path for raster in (self.dem, self.geoid) if raster is not None)

    def at(self, latitude: Array, longitude: Array) -> Array:
        """Heights (n,) m above the ellipsoid at places (n,) rad; NaN where DEM or geoid has none."""
        height = self.dem.at(latitude, longitude)
        return height if self.geoid is None else height + self.geoid.at(latitude, longitude)

    def heights(self, latitude: Array, longitude: Array, names: tuple[str, ...]) -> Array:
        """The same, raising InputError about the first place that has none."""
        return _complete(
            self.dem if self.geoid is None else self.geoid, self.dem, self, latitude, longitude, names
        )


def surface(dem: Path, heights: Heights | None, geoid: Path | None) -> Surface:
    """A DEM whose heights are what the user says; raises InputError where that is not said or the file disagrees."""
    raster = Raster.open(dem, HEIGHTS_M)
    _require_metres(raster)
    if heights is None:
        raise InputError(
            f'{dem}: found heights of a kind not stated, wanted heights = "ellipsoidal", or "geoid" with its grid'
        )
    if raster.stated is not None and raster.stated != heights:
        raise InputError(
            f"{dem}: found {_WORDS[raster.stated]} by its own reference system, wanted {_WORDS[heights]} as stated"
        )
    if heights == "geoid":
        if geoid is None:
            raise InputError(f"{dem}: found heights above a geoid, wanted the geoid's grid too")
        return Surface(raster, Raster.open(geoid, _GEOID_M))
    return Surface(raster, None)


def _require_metres(raster: Raster) -> None:
    """Raise InputError where a file itself says that its heights are in feet, of its band or its reference system."""
    unit = next(iter(raster.dataset.units), None) or ""
    in_feet = _IN_FEET.search(raster.dataset.crs.to_wkt())
    if in_feet is not None or _FEET.fullmatch(unit):
        found = unit or (in_feet[1] if in_feet is not None else "")
        raise InputError(
            f"{raster.path}: found heights in feet ({show(found)}), wanted metres: multiply them by 0.3048"
        )


@dataclass(frozen=True)
class Ground:
    """What the user says about heights: a DEM for points that have none, what heights are above, and the geoid's grid.

    ``words`` are the option or key of each, for messages.
    """

    dem: Path | None = None
    heights: Heights | None = None
    geoid: Path | None = None
    words: tuple[str, str, str] = ("--dem", "--heights", "--geoid")

    def ellipsoidal(
        self,
        source: object,
        height: Array | None,
        latitude: Array,
        longitude: Array,
        names: tuple[str, ...],
    ) -> Array:
        """Heights (n,) m above the ellipsoid of named points (n,) rad, ``h = H + N`` where theirs are above a geoid.

        ``height`` (n,) are those of the table ``source``, None where it has none.  Raises InputError where the heights
        are not stated, or stated twice.
        """
        dem, kind, geoid = self.words
        if height is None:
            if self.dem is None:
                raise InputError(
                    f"{source}: found points without heights, wanted a DEM ({dem}) to take them from"
                )
            return surface(self.dem, self.heights, self.geoid).heights(latitude, longitude, names)
        if self.dem is not None:
            raise InputError(f"{source}: found heights beside a DEM ({dem}), wanted only one of the two")
        if self.heights != "geoid":
            return height
        if self.geoid is None:
            raise InputError(f"{kind}: found geoid, wanted its grid ({geoid}) too")
        grid = Raster.open(self.geoid, _GEOID_M)
        return height + _complete(grid, grid, grid, latitude, longitude, names)


_WORDS: dict[Heights, str] = {"ellipsoidal": "heights above the ellipsoid", "geoid": "heights above a geoid"}


def _complete(
    outer: Raster, inner: Raster, source: Any, latitude: Array, longitude: Array, names: tuple[str, ...]
) -> Array:
    """Values of ``source`` (n,); raises InputError naming the raster and the first place that has none."""
    values = np.asarray(source.at(latitude, longitude), dtype=np.float64)
    if np.isnan(values).any():
        row = int(np.argmax(np.isnan(values)))
        place = (latitude[row : row + 1], longitude[row : row + 1])
        guilty = inner if np.isnan(inner.at(*place)).any() else outer
        where = f"latitude {latitude[row] / DEG:.6f}, longitude {longitude[row] / DEG:.6f}"
        raise InputError(
            f"{guilty.path}: found no height for {show(names[row])} at {where}, wanted a raster that covers it"
        )
    return values
