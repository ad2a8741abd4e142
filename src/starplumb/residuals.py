"""What is left over: residuals in the image and on the ground, by sighting, image and landmark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .adjustment import solve
from .earth import C_JT, itrf_to_geodetic
from .geometry import ground_points
from .model import linearise, residual_px
from .observations import Observations

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


def ground_error(o: Observations, C_EK: Array) -> Array:
    """East and north error (n, 2) m of every sighting, located at its landmark's own height; NaN where it misses."""
    latitude, longitude, height = itrf_to_geodetic(o.p_J)
    e_J = (o.C_EJ.mT @ C_EK @ o.e_K[..., None])[..., 0]
    found_J = ground_points(e_J, o.r_J, o.v_J, o.corrections, height)
    error_T = (C_JT(latitude, longitude).mT @ (found_J - o.p_J)[..., None])[..., 0]
    return np.asarray(error_T[:, :2])


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


def residuals(
    before: Observations, C_EK_model: Array, after: Observations, C_EK: Array, used: Mask
) -> Residuals:
    """Residuals of the table as measured at the model mounting, and of it with the estimated parameters applied at the
    estimate; the shared errors are estimated from the sightings ``used`` (n,)."""
    o = after
    model = linearise(o, C_EK)
    chosen = o.select(used)
    at_chosen = linearise(chosen, C_EK)
    shared = solve(chosen, at_chosen, at_chosen.H[..., :0])
    turned = model.H @ shared.alpha_E[o.image, :, None]
    moved = model.R @ (shared.rho_J[o.image] - shared.pi_J[o.landmark])[..., None]
    fit = model.z_px - (moved - turned)[..., 0]
    return Residuals(
        used=used,
        before_px=residual_px(before, C_EK_model),
        after_px=model.z_px,
        fit_px=fit,
        normalised=np.linalg.norm(fit, axis=-1) / o.sigma_px,
        before_m=ground_error(before, C_EK_model),
        after_m=ground_error(after, C_EK),
        alpha_E=shared.alpha_E,
        rho_J=shared.rho_J,
        pi_J=shared.pi_J,
    )


def rms(values: Array) -> float:
    """Root mean square of all entries; 0 of none."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
