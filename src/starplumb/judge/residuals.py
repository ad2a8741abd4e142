"""What is left over: residuals in the image and on the ground, by sighting, image and landmark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import Fit
from ..physics.covariance import pixel_distance
from ..physics.earth import C_JT, itrf_to_geodetic
from ..solve.chunks import part
from ..table.equation import residual_px
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


def residuals(fit: Fit, used: Mask, known: Residuals | None = None) -> Residuals:
    """Residuals of the table of a fit as measured at its model mounting, and with its parameters applied at its state;
    the shared errors are estimated from the sightings ``used`` (n,).  Those at the model mounting are the ``known``
    ones of another answer to the same table."""
    o = fit.table
    shared = fit.problem(o if np.all(used) else o.select(used)).shared_errors()
    px, m = [np.empty((o.n, 2)) for _ in range(3)], [np.empty((o.n, 2)) for _ in range(2)]
    for rows, (applied, model, _) in fit.whole.pieces():
        measured = part(o, rows)
        ground, image = _Ground.of(measured.p_J), measured.image
        shift_J = shared.rho_J[image] - shared.pi_J[measured.landmark]
        turned, moved = model.H @ shared.alpha_E[image, :, None], model.R @ shift_J[..., None]
        if known is None:
            px[0][rows] = residual_px(measured, fit.C_EK_model)
            m[0][rows] = ground.error(measured, fit.C_EK_model)
        px[1][rows] = model.z_px
        px[2][rows] = model.z_px - (moved - turned)[..., 0]
        m[1][rows] = ground.error(applied, fit.state.C_EK)
    normalised = pixel_distance(px[2], o.sigma_px, o.ellipse)
    errors = shared.alpha_E, shared.rho_J, shared.pi_J
    before = (px[0], m[0]) if known is None else (known.before_px, known.before_m)
    return Residuals(used, before[0], px[1], px[2], normalised, before[1], m[1], *errors)


def rms(values: Array) -> float:
    """Root mean square of all entries; 0 of none."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
