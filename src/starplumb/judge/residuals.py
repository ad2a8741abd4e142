"""What is left over: residuals in the image and on the ground, by sighting, image and landmark."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import Fit
from ..physics.earth import C_JT, itrf_to_geodetic
from ..solve.adjustment import Adjustment, is_large, solve, solve_large
from ..solve.portions import Images, Linear, read, reader
from ..solve.streaming import CHUNK, Rows, part, streams
from ..table.equation import Linearised, residual_px
from ..table.geometry import ground_points
from ..table.observations import Observations

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Accuracy:
    """Horizontal geolocation error of n points: root mean square and circular 90 % (m).

    ``rmse = sqrt(mean(de^2 + dn^2))``; ``ce90`` is the radius that holds 90 % of the points (their empirical quantile).
    """

    rmse: float
    ce90: float
    n: int

    @classmethod
    def of(cls, east_north: Array) -> Accuracy | None:
        """Of errors (n, 2) m; None without points, or where a line of sight misses the ground."""
        radius = np.hypot(east_north[:, 0], east_north[:, 1])
        if radius.size == 0 or not np.all(np.isfinite(radius)):
            return None
        return cls(float(np.sqrt(np.mean(radius**2))), float(np.quantile(radius, 0.9)), radius.size)


@dataclass(frozen=True)
class _Ground:
    """Where landmarks lie: geodetic ``height`` (n,) m, and ``C_JT`` (n, 3, 3) from east, north, up."""

    height: Array
    C_JT: Array

    @classmethod
    def of(cls, p_J: Array) -> _Ground:
        latitude, longitude, height = itrf_to_geodetic(p_J)
        return cls(height, C_JT(latitude, longitude))

    def error(self, o: Observations, C_EK: Array) -> Array:
        """East and north error (n, 2) m of sightings, located at their landmarks' own heights; NaN where one misses."""
        e_J = (o.C_EJ.mT @ (o.e_K @ C_EK.mT)[..., None])[..., 0]
        found_J = ground_points(e_J, o.r_J, o.v_J, o.corrections, self.height)
        return np.asarray((self.C_JT[..., :2].mT @ (found_J - o.p_J)[..., None])[..., 0])


@dataclass(frozen=True)
class Residuals:
    """Residuals of all n sightings, those kept for checking included.

    ``before_px``, ``after_px`` (n, 2) predicted minus measured pixel at the model mounting and at the estimate;
    ``fit_px`` (n, 2) what remains once each image's and landmark's own error, as estimated from the sightings used, is
    taken out as well; ``normalised`` (n,) the length of that in units of the pixel's sigma; ``before_m``, ``after_m``
    (n, 2) east and north on the ground.  ``alpha_E`` (m, 3) rad, ``rho_J`` (m, 3) m and ``pi_J`` (L, 3) m are the
    errors of images and landmarks so estimated.
    """

    used: Mask
    before_px: Array
    after_px: Array
    fit_px: Array
    normalised: Array
    before_m: Array
    after_m: Array
    alpha_E: Array
    rho_J: Array
    pi_J: Array


@dataclass(frozen=True)
class _Part:
    """Rows of a table as measured, with the parameters applied and linearised, and how far their images' attitude
    ``turn_E`` (n, 3) and their images' position less their landmarks' place ``shift_J`` (n, 3) are off."""

    rows: Rows
    measured: Observations
    applied: Observations
    model: Linearised
    turn_E: Array
    shift_J: Array


def residuals(fit: Fit, used: Mask) -> Residuals:
    """Residuals of the table of a fit as measured at its model mounting, and with its parameters applied at its state;
    the shared errors are estimated from the sightings ``used`` (n,)."""
    o = fit.table
    px, m = [np.empty((o.n, 2)) for _ in range(3)], [np.empty((o.n, 2)) for _ in range(2)]
    alpha_E, rho_J, pi_J = (np.zeros((count, 3)) for count in (o.n_images, o.n_images, o.n_landmarks))
    found = Residuals(used, px[0], px[1], px[2], np.empty(o.n), m[0], m[1], alpha_E, rho_J, pi_J)
    for p in _in_blocks(fit, found) if streams(o) else _in_rows(fit, found):
        rows, model, ground = p.rows, p.model, _Ground.of(p.measured.p_J)
        turned = (model.H @ p.turn_E[..., None])[..., 0]
        moved = (model.R @ p.shift_J[..., None])[..., 0]
        found.before_px[rows] = residual_px(p.measured, fit.C_EK_model)
        found.after_px[rows] = model.z_px
        found.fit_px[rows] = model.z_px - (moved - turned)
        found.normalised[rows] = np.linalg.norm(found.fit_px[rows], axis=-1) / o.sigma_px[rows]
        found.before_m[rows] = ground.error(p.measured, fit.C_EK_model)
        found.after_m[rows] = ground.error(p.applied, fit.state.C_EK)
    return found


def _in_blocks(fit: Fit, found: Residuals) -> Iterator[_Part]:
    """Images whose landmarks are seen once: each says its own errors."""
    o = fit.table
    for block in read(o, _at_the_mounting(fit)):
        a, d = Images.of(block.squares, np.zeros(0)).a, block.design
        found.alpha_E[block.images] = (d.S_attitude[block.images] @ a[:, :3, None])[..., 0]
        found.rho_J[block.images] = (d.S_position[block.images] @ a[:, 3:, None])[..., 0]
        image, measured = o.image[block.rows], part(o, block.rows)
        errors = found.alpha_E[image], found.rho_J[image]
        yield _Part(block.rows, measured, block.table, block.model, *errors)


def _at_the_mounting(fit: Fit) -> Linear:
    """Linear problems of parts of a table in which the mounting and the parameters stand as they are."""

    def linear(part: Observations) -> tuple[Observations, Linearised, Array]:
        table, model, A = fit.linear(part)
        return table, model, A[..., :0]

    return linear


def _shared_errors(fit: Fit, o: Observations) -> Adjustment:
    """The errors of images and landmarks of a table, whole or in chunks."""
    linear = _at_the_mounting(fit)
    return solve_large(o, reader(o, linear)) if is_large(o) else solve(*linear(o))


def _in_rows(fit: Fit, found: Residuals) -> Iterator[_Part]:
    """Any table: the errors of images and landmarks are solved for together."""
    o = fit.table
    shared = _shared_errors(fit, o if np.all(found.used) else o.select(found.used))
    for whole, solved in zip(
        (found.alpha_E, found.rho_J, found.pi_J), (shared.alpha_E, shared.rho_J, shared.pi_J), strict=True
    ):
        whole[...] = solved
    for start in range(0, o.n, CHUNK):
        rows = slice(start, min(start + CHUNK, o.n))
        measured = part(o, rows)
        table, model, _ = fit.linear(measured)
        shift_J = shared.rho_J[o.image[rows]] - shared.pi_J[o.landmark[rows]]
        yield _Part(rows, measured, table, model, shared.alpha_E[o.image[rows]], shift_J)


def rms(values: Array) -> float:
    """Root mean square of all entries; 0 of none."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
