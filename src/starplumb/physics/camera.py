"""Cameras: the map between pixels and tangents ``(x/z, y/z)`` of the look direction in K, for frame and line scanners.

K looks along +z with x towards growing columns and y towards growing rows; vendors' axes are turned when read.
Pixel (0, 0) is the centre of the first pixel; another origin is shifted when read.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .lens import LENS_ROWS, Lens, distort, straighten

Array = NDArray[np.float64]


class Camera(Protocol):
    """What the geometry needs of a camera.

    ``scans`` says that a row is an epoch (line scanner), so that its look direction depends on the column alone.
    """

    @property
    def scans(self) -> bool: ...

    @property
    def size_px(self) -> tuple[float, float]:
        """Columns, rows; rows are infinite where the image has no stated end."""
        ...

    def tan_from_px(self, column_px: ArrayLike, row_px: ArrayLike) -> tuple[Array, Array]:
        """Tangents xy_K (..., 2) and their slope d xy_K / d (column, row) (..., 2, 2), rad per pixel."""
        ...

    def px_from_tan(self, xy_K: ArrayLike) -> Array:
        """Pixel (..., 2) of a look direction; a line scanner's row is then the offset from its own line, in pixels."""
        ...


@dataclass(frozen=True)
class Distortion:
    """Brown-Conrady: ideal tangents to those the optics give (the OpenCV convention).

    The formulas stand in :mod:`starplumb.physics.lens`.
    """

    k: tuple[float, float, float] = (0.0, 0.0, 0.0)
    p: tuple[float, float] = (0.0, 0.0)

    @property
    def is_zero(self) -> bool:
        return not any(self.k) and not any(self.p)

    @property
    def lens(self) -> Lens:
        """The numbers in the order of :mod:`starplumb.physics.lens`."""
        return (*self.k, *self.p)

    def apply(self, xy: Array) -> tuple[Array, Array]:
        """Distorted tangents (..., 2) and their Jacobian (..., 2, 2)."""
        x, y, xx, mixed, yy = distort(xy[..., 0], xy[..., 1], self.lens)
        return np.stack([x, y], axis=-1), np.stack([xx, mixed, mixed, yy], axis=-1).reshape(*xy.shape, 2)

    def remove(self, xy_d: Array) -> tuple[Array, Array]:
        """Ideal tangents and d ideal / d distorted, by Newton's method (exact where the lens does not fold)."""
        W = np.empty((LENS_ROWS, xy_d.size // 2))
        W[:2] = xy_d.reshape(-1, 2).mT
        if xy_d.size:
            straighten(W, self.lens)
        return W[2:4].mT.reshape(xy_d.shape), W[6:10].mT.reshape(*xy_d.shape, 2)


@dataclass(frozen=True)
class FrameCamera:
    """Central projection onto a matrix of pixels.

    ``(column, row) = principal point + (f / pitch) distorted(x/z, y/z)``; f and pitch in metres.
    """

    focal_length: float
    pitch: float
    principal_point_px: tuple[float, float]
    size_px: tuple[float, float]
    distortion: Distortion = field(default_factory=Distortion)
    scans: bool = field(default=False, init=False)

    def tan_from_px(self, column_px: ArrayLike, row_px: ArrayLike) -> tuple[Array, Array]:
        scale = self.pitch / self.focal_length
        column, row = np.broadcast_arrays(np.asarray(column_px, float), np.asarray(row_px, float))
        xy = scale * np.stack(
            [column - self.principal_point_px[0], row - self.principal_point_px[1]], axis=-1
        )
        slope = np.broadcast_to(scale * np.eye(2), (*column.shape, 2, 2))
        if self.distortion.is_zero:
            return xy, slope
        xy, inverse = self.distortion.remove(xy)
        return xy, scale * inverse

    def px_from_tan(self, xy_K: ArrayLike) -> Array:
        xy = np.asarray(xy_K, dtype=np.float64)
        if not self.distortion.is_zero:
            xy, _ = self.distortion.apply(xy)
        return np.asarray(self.principal_point_px + (self.focal_length / self.pitch) * xy)


ALONG_X = 0.1
"""Slope of a line of detectors below which its columns are counted along x."""


@dataclass(frozen=True)
class LineScanCamera:
    """One line of detectors, given by its look directions ``(tan_x, tan_y, 1)`` in K at the columns of a table.

    Linear between the table's columns and beyond its ends with the last slope (a column outside the image is refused
    where observations are read).  The directions must go on and on along the line's own, from its first to its last, so
    that a direction has one column; whether that is along x, along y or between them, and which way, is all one.
    Shapes: ``column_px, tan_x, tan_y`` (d,), d >= 2.
    """

    column_px: Array
    tan_x: Array
    tan_y: Array
    size_px: tuple[float, float]
    scans: bool = field(default=True, init=False)

    @classmethod
    def from_optics(
        cls,
        focal_length: float,
        pitch: float,
        principal_point_px: tuple[float, float],
        columns: int,
        distortion: Distortion | None = None,
        rows: float = np.inf,
    ) -> LineScanCamera:
        """Detectors of a straight line behind a lens; its offset from the optical axis is the principal point's row.

        Without distortion two directions say all; with it every detector is tabulated (between two of them the line
        is straight to 1e-5 px even behind a lens that moves its ends by hundreds of pixels).
        """
        last = max(columns - 1.0, 1.0)
        bent = distortion is not None and not distortion.is_zero
        column = np.arange(last + 1.0) if bent else np.array([0.0, last])
        scale = pitch / focal_length
        offset = np.full_like(column, principal_point_px[1])
        xy = scale * np.stack([column - principal_point_px[0], offset], axis=-1)
        if bent and distortion is not None:
            xy, _ = distortion.remove(xy)
        return cls(column, xy[:, 0], xy[:, 1], (float(columns), rows))

    def _slope(self, values: Array, segment: NDArray[np.int64]) -> Array:
        return np.asarray(
            (values[segment + 1] - values[segment]) / (self.column_px[segment + 1] - self.column_px[segment])
        )

    def tan_from_px(self, column_px: ArrayLike, row_px: ArrayLike) -> tuple[Array, Array]:
        column, _ = np.broadcast_arrays(np.asarray(column_px, float), np.asarray(row_px, float))
        segment = np.clip(
            np.searchsorted(self.column_px, column, side="right") - 1, 0, self.column_px.size - 2
        )
        slope = np.zeros((*column.shape, 2, 2))
        slope[..., 0, 0] = self._slope(self.tan_x, segment)
        slope[..., 1, 0] = self._slope(self.tan_y, segment)
        start = np.stack([self.tan_x[segment], self.tan_y[segment]], axis=-1)
        return start + slope[..., 0] * (column - self.column_px[segment])[..., None], slope

    def px_from_tan(self, xy_K: ArrayLike) -> Array:
        xy = np.asarray(xy_K, dtype=np.float64)
        a, n = self.axes
        along, at = self.tan_x * a[0] + self.tan_y * a[1], xy @ a
        segment = np.clip(np.searchsorted(along, at, side="right") - 1, 0, along.size - 2)
        column = self.column_px[segment] + (at - along[segment]) / self._slope(along, segment)
        line, slope = self.tan_from_px(column, 0.0)
        pixel = np.hypot(slope[..., 0, 0], slope[..., 1, 0])
        return np.stack([column, (xy - line) @ n / pixel], axis=-1)

    @property
    def pixel_rad(self) -> float:
        """Width of a pixel, rad, on average over the line."""
        ends = np.hypot(self.tan_x[-1] - self.tan_x[0], self.tan_y[-1] - self.tan_y[0])
        return float(ends / abs(self.column_px[-1] - self.column_px[0]))

    @property
    def axes(self) -> tuple[Array, Array]:
        """Unit directions of (tan_x, tan_y) along the line and across it, by which a place beside it is said.

        They are x, either way, and y for a line that is nearly along x.
        """
        along = np.array([self.tan_x[-1] - self.tan_x[0], self.tan_y[-1] - self.tan_y[0]])
        if abs(along[1]) <= ALONG_X * abs(along[0]):
            return np.array([np.sign(along[0]), 0.0]), np.array([0.0, 1.0])
        a = along / np.linalg.norm(along)
        return a, np.array([-a[1], a[0]])
