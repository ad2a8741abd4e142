"""What else than the alignment a campaign may be asked to estimate: optics, look directions, clocks, trackers.

Each kind of parameter says how its value changes the observation table, and what it moves there: the measured tangents,
the attitude, the position.  The measurement equation does the rest.  Units are SI and radians; values are corrections:
the truth is what the campaign states plus the value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.camera import FrameCamera, LineScanCamera
from ..physics.components import Row
from ..physics.lens import (
    LENS_ROWS,
    Lens,
    LensNumbers,
    distort,
    effects,
    look_at,
    rephotograph,
)
from ..physics.units import DEG
from .equation import Linearised, by_tangents
from .observations import Observations

Array = NDArray[np.float64]


class Parameter(Protocol):
    """One or several numbers of one kind.

    ``names`` (s,) with ``sigma`` (s,) what is known of them beforehand, infinite for a free one; ``range`` (s,) is the
    largest error that makes sense, by which a free one is held (it is reported as unknown where the data do no better).
    """

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def sigma(self) -> tuple[float, ...]: ...

    @property
    def range(self) -> tuple[float, ...]: ...

    def apply(self, observations: Observations, value: Array) -> Observations:
        """The table with the correction ``value`` (..., s) applied."""
        ...

    def moves(self, observations: Observations, value: Array) -> Moves:
        """What a unit of each value moves, ``observations`` being those at ``value``, with each mark where the model
        predicts it: a derivative taken where it was measured would carry the noise that the residual carries too."""
        ...


@dataclass(frozen=True)
class Moves:
    """What a unit of each of s values moves: the tangents by ``xy_K`` (..., n, 2, s) rad, the attitude by a turn
    ``turn_E`` (..., n, 3, s) rad, the position by ``shift_J`` (..., n, 3, s) m; None for what stands still."""

    xy_K: Array | None = None
    turn_E: Array | None = None
    shift_J: Array | None = None

    def design(self, model: Linearised) -> Array:
        """d z / d value (..., n, 2, s) px per unit: ``-B^-1 xy_K - H turn_E + R shift_J``."""
        parts = []
        if self.xy_K is not None:
            parts.append(by_tangents(model, self.xy_K))
        if self.turn_E is not None:
            parts.append(-model.H @ self.turn_E)
        if self.shift_J is not None:
            parts.append(model.R @ self.shift_J)
        return np.asarray(sum(parts))


def split(parameters: Sequence[Parameter], values: Array) -> list[tuple[Parameter, Array]]:
    """Each parameter with its own of the values (..., p) of all."""
    ends = np.cumsum([len(parameter.names) for parameter in parameters]).tolist()
    return [
        (parameter, values[..., end - len(parameter.names) : end])
        for parameter, end in zip(parameters, ends, strict=True)
    ]


REACH = 0.1
"""Part of the field by which a mark may be predicted off and yet be differentiated there."""

OPTICS = ("focal_length", "principal_column", "principal_row", "k1", "k2", "k3", "p1", "p2")


@dataclass(frozen=True)
class Optics:
    """Interior orientation of a frame camera: focal length (m), principal point (px), Brown-Conrady coefficients.

    ``names`` are any of :data:`OPTICS`.  With ``xy_d = (pitch / f) (pixel - principal point)`` and ``xy_d = D(xy)``::

        d xy = D'^-1 (-xy_d df / f - (pitch / f) d_pp - dD/dk dk)
    """

    camera: FrameCamera
    names: tuple[str, ...]
    sigma: tuple[float, ...]

    @property
    def edge(self) -> float:
        """Tangent of the field angle in a corner, the axis in the middle."""
        return 0.5 * self.camera.pitch / self.camera.focal_length * float(np.hypot(*self.camera.size_px))

    @property
    def reach(self) -> float:
        """How far from a mark (rad) the lens is looked at."""
        return REACH * self.edge

    @property
    def range(self) -> tuple[float, ...]:
        """A tenth of the focal length, the size of the image, a distortion of a tenth at the edge."""
        c, edge = self.camera, self.edge
        size = max(c.size_px)
        distortion = (0.1 / edge**2, 0.1 / edge**4, 0.1 / edge**6, 0.1 / edge, 0.1 / edge)
        every = dict(zip(OPTICS, (0.1 * c.focal_length, size, size, *distortion), strict=True))
        return tuple(every[name] for name in self.names)

    @property
    def places(self) -> list[int]:
        """Places of the names in :data:`OPTICS`."""
        return [OPTICS.index(name) for name in self.names]

    def at(self, value: Array) -> tuple[Row, Row, Row, Row, Lens]:
        """Focal length, pitch / focal length, principal point and lens with a correction (..., s) applied."""
        c = self.camera
        numbers = [c.focal_length, *c.principal_point_px, *c.distortion.lens]
        for i, place in enumerate(self.places):
            numbers[place] = numbers[place] + value[..., i]
        f, column_px, row_px, k1, k2, k3, p1, p2 = numbers
        return f, c.pitch / f, column_px, row_px, (k1, k2, k3, p1, p2)

    def through(self, value: Array) -> LensNumbers:
        """What takes tangents of the stated camera to those at ``value``."""
        f, scale, column_px, row_px, lens = self.at(value)
        c = self.camera
        x, y = scale * (c.principal_point_px[0] - column_px), scale * (c.principal_point_px[1] - row_px)
        return c.focal_length / f, x, y, f, scale, lens, c.distortion.lens, self.reach

    def apply(self, observations: Observations, value: Array) -> Observations:
        xy = observations.xy_K
        W = np.empty((LENS_ROWS, *np.broadcast_shapes((*value.shape[:-1], 1), xy.shape[:-1])))
        W[2], W[3] = xy[..., 0], xy[..., 1]
        rephotograph(W, self.through(value[..., None, :]))
        xy_K, slope_K = _photographed(W)
        return replace(observations, xy_K=xy_K, slope_K=slope_K)

    def look_at(self, stated: Array, value: Array, h: Array) -> tuple[Array, Array, Array]:
        """At ``value``: tangents (..., n, 2) that differ from those predicted, ``h`` (..., n, 2), by the pixels between
        the predicted and the measured mark, whose tangents by the stated optics are ``stated``; their slope by the
        pixel there (..., n, 2, 2), and where that is (:func:`starplumb.physics.lens.look_at`)."""
        W = np.empty(
            (LENS_ROWS, *np.broadcast_shapes((*value.shape[:-1], 1), stated.shape[:-1], h.shape[:-1]))
        )
        W[2], W[3] = stated[..., 0], stated[..., 1]
        look_at(W, (h[..., 0], h[..., 1]), self.through(value[..., None, :]))
        return (*_photographed(W), np.moveaxis(W[4:6], 0, -1))

    def moves(self, observations: Observations, value: Array) -> Moves:
        focal_length, scale, _, _, lens = self.at(value[..., None, :])
        x, y = observations.xy_K[..., 0], observations.xy_K[..., 1]
        u, v, a, b, c = distort(x, y, lens)
        across, down = effects(x, y, (u, v), focal_length, scale)
        i = 1.0 / (a * c - b * b)
        d_xy = np.empty((*x.shape, 2, len(self.names)))
        for at, place in enumerate(self.places):
            d_xy[..., 0, at] = i * (b * down[place] - c * across[place])
            d_xy[..., 1, at] = i * (b * across[place] - a * down[place])
        return Moves(xy_K=d_xy)


def _photographed(W: Array) -> tuple[Array, Array]:
    """Tangents (..., 2) and slopes (..., 2, 2) of a work buffer of the lens."""
    return np.moveaxis(W[2:4], 0, -1), np.moveaxis(W[6:10], 0, -1).reshape(*W.shape[1:], 2, 2)


ALONG_Y = 1e-9
"""Part of a line's length along x from which on it counts as along y."""


@dataclass(frozen=True)
class LookAngles:
    """Look directions of a line of detectors: Legendre polynomials of the column, added to the tangents (rad).

    ``names`` are ``look_x_j`` along the line and ``look_y_j`` across it: ``xy_K += (a_j d + b_j n) P_j(u)`` with
    u = -1 .. 1 over the columns of the camera's table, d the direction from one end of the line to the other, towards
    growing tan_x, and n a quarter turn from it.  Degree 0 of both and degree 1 of y are rotations of the camera.
    """

    camera: LineScanCamera
    names: tuple[str, ...]
    sigma: tuple[float, ...]

    @property
    def length(self) -> float:
        """Length of the line, rad."""
        return max(float(np.ptp(self.camera.tan_x)), float(np.ptp(self.camera.tan_y)))

    @property
    def axes(self) -> Array:
        """Directions (2, 2), rows, along the line and across it."""
        c = self.camera
        x, y = (float(tangent[-1] - tangent[0]) for tangent in (c.tan_x, c.tan_y))
        size = float(np.hypot(x, y))
        x, y = x / size, y / size
        sign = 1.0 if (y > 0.0 if abs(x) < ALONG_Y else x > 0.0) else -1.0
        return sign * np.array([[x, y], [-y, x]])

    @property
    def reach(self) -> float:
        """How far from a mark (rad) the look directions are looked at."""
        return 0.5 * REACH * self.length

    @property
    def range(self) -> tuple[float, ...]:
        """A tenth of the line's length."""
        return (0.1 * self.length,) * len(self.names)

    def _basis(self, xy_K: Array) -> tuple[Array, Array]:
        """Changes of (tan_x, tan_y) by unit values (..., n, 2, s), and their slope by the column."""
        from numpy.polynomial import legendre

        c = self.camera
        column = c.px_from_tan(xy_K)[..., 0]
        half = 0.5 * (c.column_px[-1] - c.column_px[0])
        u = (column - 0.5 * (c.column_px[-1] + c.column_px[0])) / half
        basis = np.zeros((*xy_K.shape, len(self.names)))
        slope = np.zeros_like(basis)
        for i, name in enumerate(self.names):
            direction, degree = self.axes["xy".index(name[5])], int(name[7:])
            series = np.eye(degree + 1)[degree]
            basis[..., i] = legendre.legval(u, series)[..., None] * direction
            slope[..., i] = legendre.legval(u, legendre.legder(series))[..., None] / half * direction
        return basis, slope

    def apply(self, observations: Observations, value: Array) -> Observations:
        o = observations
        basis, slope = self._basis(o.xy_K)
        xy = o.xy_K + (basis @ value[..., None, :, None])[..., 0]
        bent = (slope @ value[..., None, :, None])[..., 0]
        slopes = np.array(np.broadcast_to(o.slope_K, (*bent.shape, 2)))
        slopes[..., :, 0] += bent
        return replace(o, xy_K=xy, slope_K=slopes)

    def moves(self, observations: Observations, value: Array) -> Moves:
        stated = observations.xy_K  # the columns are those of the stated look directions
        for _ in range(2):
            stated = observations.xy_K - (self._basis(stated)[0] @ value[..., None, :, None])[..., 0]
        return Moves(xy_K=self._basis(stated)[0])


@dataclass(frozen=True)
class TimeOffset:
    """The camera's clock against those of the attitude and the orbit, s: it exposes so much later than it says.

    ``names`` is one of ``time_offset`` (both), ``time_offset_attitude`` and ``time_offset_orbit``::

        C_EJ <- exp(omega_E dt) C_EJ,   r_J <- r_J + v_J dt,   dz/dt = -H omega_E + R v_J

    Straight motion during the offset: 0.4 m of curvature for 0.3 s.
    """

    names: tuple[str]
    sigma: tuple[float]
    range: tuple[float] = (10.0,)

    @property
    def _turns(self) -> bool:
        return self.names[0] != "time_offset_orbit"

    @property
    def _moves(self) -> bool:
        return self.names[0] != "time_offset_attitude"

    def apply(self, observations: Observations, value: Array) -> Observations:
        o, dt = observations, value[..., None, :]
        C_EJ = so3.exp(dt * o.omega_E) @ o.C_EJ if self._turns else o.C_EJ
        r_J = o.r_J + dt * o.v_J if self._moves else o.r_J
        return o.with_geometry(C_EJ=C_EJ, r_J=r_J)

    def moves(self, observations: Observations, value: Array) -> Moves:
        o = observations
        return Moves(
            turn_E=o.omega_E[..., None] if self._turns else None,
            shift_J=o.v_J[..., None] if self._moves else None,
        )


@dataclass(frozen=True)
class TrackerMounting:
    """A star tracker's own mounting against that of the first one, rad about E: a constant error of its attitudes.

    ``C_EJ = exp(delta_E) C_EJ_true`` for the images it measured, so ``C_EJ <- exp(-delta_E) C_EJ``, ``dz/d delta = H``.
    ``images`` (m,) says which those are.
    """

    tracker: str
    images: NDArray[np.bool_]
    sigma: tuple[float, float, float] = (np.inf, np.inf, np.inf)
    range: tuple[float, float, float] = field(default=(10.0 * DEG,) * 3)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"tracker_{self.tracker}_{axis}" for axis in "xyz")

    def apply(self, observations: Observations, value: Array) -> Observations:
        o = observations
        turned = self.images[o.image][:, None, None]
        C_EJ = np.where(turned, so3.exp(-value)[..., None, :, :] @ o.C_EJ, o.C_EJ)
        return o.with_geometry(C_EJ=C_EJ)

    def moves(self, observations: Observations, value: Array) -> Moves:
        # exp(-delta - d) = exp(-J(-delta) d) exp(-delta)
        J = so3.left_jacobian(-value)[..., None, :, :]
        return Moves(turn_E=np.where(self.images[observations.image][:, None, None], -J, 0.0))
