"""What else than the alignment a campaign may be asked to estimate: optics, look directions, clocks, trackers.

Each kind of parameter says how its value changes the observation table and how it then changes the residual, its
design, in pixels per unit; the adjustment takes it from there.  Units are SI and radians; values are corrections: the
truth is what the campaign states plus the value.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from . import so3
from .camera import Distortion, FrameCamera, LineScanCamera
from .model import Linearised
from .observations import Observations
from .small import solve2
from .units import DEG

Array = NDArray[np.float64]


class Parameter(Protocol):
    """One or several numbers of one kind.

    ``names`` (s,) with ``sigma`` (s,) what is known of them beforehand, infinite for a free one; ``range`` (s,) is the
    largest error that makes sense, by which a free one is held (it is told as unknown where the data do no better).
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

    def design(self, observations: Observations, model: Linearised, value: Array) -> Array:
        """d z / d value (..., n, 2, s) px per unit, ``observations`` and ``model`` being those at ``value``."""
        ...


def _through_tangents(model: Linearised, d_xy: Array) -> Array:
    """dz (..., n, 2, s) from changes of the measured tangents (..., n, 2, s): ``z = B^-1 (h - xy)``."""
    return -solve2(model.B, d_xy)


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
    def range(self) -> tuple[float, ...]:
        """A tenth of the focal length, the size of the image, a distortion of a tenth at the edge."""
        c = self.camera
        edge = 0.5 * c.pitch / c.focal_length * float(np.hypot(*c.size_px))
        size = max(c.size_px)
        distortion = (0.1 / edge**2, 0.1 / edge**4, 0.1 / edge**6, 0.1 / edge, 0.1 / edge)
        every = dict(zip(OPTICS, (0.1 * c.focal_length, size, size, *distortion), strict=True))
        return tuple(every[name] for name in self.names)

    def at(self, value: Array) -> FrameCamera:
        """The camera with a correction (s,) applied."""
        d = dict.fromkeys(OPTICS, 0.0) | dict(zip(self.names, np.asarray(value).tolist(), strict=True))
        c = self.camera
        (k1, k2, k3), (p1, p2) = c.distortion.k, c.distortion.p
        column, row = c.principal_point_px
        return replace(
            c,
            focal_length=c.focal_length + d["focal_length"],
            principal_point_px=(column + d["principal_column"], row + d["principal_row"]),
            distortion=Distortion((k1 + d["k1"], k2 + d["k2"], k3 + d["k3"]), (p1 + d["p1"], p2 + d["p2"])),
        )

    def apply(self, observations: Observations, value: Array) -> Observations:
        pixel = self.camera.px_from_tan(observations.xy_K)
        batch = np.broadcast_shapes(value.shape[:-1], pixel.shape[:-2])
        pixel = np.broadcast_to(pixel, (*batch, *pixel.shape[-2:]))
        values = np.broadcast_to(value, (*batch, value.shape[-1]))
        xy, slope = np.empty(pixel.shape), np.empty((*pixel.shape, 2))
        for run in np.ndindex(*batch):
            xy[run], slope[run] = self.at(values[run]).tan_from_px(*pixel[run].T)
        return replace(observations, xy_K=xy, slope_K=slope)

    def design(self, observations: Observations, model: Linearised, value: Array) -> Array:
        o = observations
        batch = o.xy_K.shape[:-2]
        values = np.broadcast_to(value, (*batch, value.shape[-1]))
        d_xy = np.empty((*o.xy_K.shape, len(self.names)))
        for run in np.ndindex(*batch):
            d_xy[run] = self._slopes(self.at(values[run]), o.xy_K[run], o.slope_K[run])
        return _through_tangents(model, d_xy)

    def _slopes(self, camera: FrameCamera, xy: Array, slope: Array) -> Array:
        """d xy / d value (n, 2, s) of one run."""
        x, y = xy[:, 0], xy[:, 1]
        r2 = x * x + y * y
        xy_d, _ = camera.distortion.apply(xy)
        scale = camera.pitch / camera.focal_length
        inverse = slope / scale  # D'^-1
        distorted = {
            "focal_length": xy_d / camera.focal_length,
            "k1": xy * r2[:, None],
            "k2": xy * r2[:, None] ** 2,
            "k3": xy * r2[:, None] ** 3,
            "p1": np.stack([2.0 * x * y, r2 + 2.0 * y * y], axis=-1),
            "p2": np.stack([r2 + 2.0 * x * x, 2.0 * x * y], axis=-1),
            "principal_column": np.broadcast_to([scale, 0.0], xy.shape),
            "principal_row": np.broadcast_to([0.0, scale], xy.shape),
        }
        return np.asarray(-inverse @ np.stack([distorted[name] for name in self.names], axis=-1))


@dataclass(frozen=True)
class LookAngles:
    """Look directions of a line of detectors: Legendre polynomials of the column, added to the tangents (rad).

    ``names`` are ``look_x_j`` and ``look_y_j``: ``tan_x += a_j P_j(u)``, ``tan_y += b_j P_j(u)`` with u = -1 .. 1 over
    the columns of the camera's table.  Degree 0 of both and degree 1 of y are rotations of the camera.
    """

    camera: LineScanCamera
    names: tuple[str, ...]
    sigma: tuple[float, ...]

    @property
    def range(self) -> tuple[float, ...]:
        """A tenth of the line's length."""
        return (0.1 * float(np.ptp(self.camera.tan_x)),) * len(self.names)

    def _basis(self, xy_K: Array) -> tuple[Array, Array]:
        """Changes of (tan_x, tan_y) by unit values (..., n, 2, s), and their slope by the column."""
        c = self.camera
        column = c.px_from_tan(xy_K)[..., 0]
        half = 0.5 * (c.column_px[-1] - c.column_px[0])
        u = (column - 0.5 * (c.column_px[-1] + c.column_px[0])) / half
        basis = np.zeros((*xy_K.shape, len(self.names)))
        slope = np.zeros_like(basis)
        for i, name in enumerate(self.names):
            axis, degree = "xy".index(name[5]), int(name[7:])
            series = np.eye(degree + 1)[degree]
            basis[..., axis, i] = legendre.legval(u, series)
            slope[..., axis, i] = legendre.legval(u, legendre.legder(series)) / half
        return basis, slope

    def apply(self, observations: Observations, value: Array) -> Observations:
        o = observations
        basis, slope = self._basis(o.xy_K)
        xy = o.xy_K + (basis @ value[..., None, :, None])[..., 0]
        bent = (slope @ value[..., None, :, None])[..., 0]
        slopes = np.array(np.broadcast_to(o.slope_K, (*bent.shape, 2)))
        slopes[..., :, 0] += bent
        return replace(o, xy_K=xy, slope_K=slopes)

    def design(self, observations: Observations, model: Linearised, value: Array) -> Array:
        stated = observations.xy_K  # the columns are those of the stated look directions
        for _ in range(2):
            stated = observations.xy_K - (self._basis(stated)[0] @ value[..., None, :, None])[..., 0]
        return _through_tangents(model, self._basis(stated)[0])


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

    def design(self, observations: Observations, model: Linearised, value: Array) -> Array:
        o, rate = observations, np.zeros((*model.z_px.shape, 1))
        if self._turns:
            rate = rate - model.H @ o.omega_E[..., None]
        if self._moves:
            rate = rate + model.R @ o.v_J[..., None]
        return rate


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

    def design(self, observations: Observations, model: Linearised, value: Array) -> Array:
        # exp(-delta - d) = exp(-J(-delta) d) exp(-delta)
        J = so3.left_jacobian(-value)[..., None, :, :]
        return np.where(self.images[observations.image][:, None, None], model.H @ J, 0.0)
