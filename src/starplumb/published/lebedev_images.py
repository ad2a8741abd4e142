"""Accuracy against the number of images, Lebedev and Tkachenko 2012, as we read it: images that share an error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimators.gls import Gls
from ..estimators.protocol import AlignmentEstimate
from ..estimators.published.cross_product import CrossProduct
from ..physics import so3
from ..physics.errors import counted
from ..physics.units import ARCSEC, DEG, MM
from ..table.observations import Observations
from ..table.simulate import Errors, measure
from .comparison import Comparison, Recomputed, Row, judge
from .lebedev2012 import PIXEL
from .lebedev_scene import C_EK_TRUE, Nadir, photographs
from .tables import published, scenario, source

Array = NDArray[np.float64]

COLUMNS = ("x", "y", "z")
SHARE = 4
"""A run here has up to 60 sightings: one for every four of the runs asked for."""


def images_sigma(trials: int, rng: np.random.Generator) -> Comparison:
    """Standard deviations of the alignment against the number of images."""
    return _against_images("images-sigma", "sigma", trials, rng)


def images_max(trials: int, rng: np.random.Generator) -> Comparison:
    """Largest absolute errors of a series against the number of images."""
    return _against_images("images-max", "max", trials, rng)


def _against_images(name: str, figure: str, trials: int, rng: np.random.Generator) -> Comparison:
    document = scenario("slides2012")
    setting = document["images"]
    nadir = Nadir.over(document["orbit"], setting["height_km"] * 1e3)
    trials = max(setting["runs"], trials // SHARE)
    rows, extra = [], []
    for row in published(name):
        count, refined = int(row["images"]), bool(row["note"])
        table = _truth(setting, nadir, count, refined, rng, trials)
        measured = measure(table, C_EK_TRUE, _errors(setting, table, rng, trials))
        figures = [float(row[f"{figure}_{axis}_arcsec"]) for axis in COLUMNS]
        label = f"{counted(count, 'image')}{', refined resolution' if refined else ''}"
        ours = _series(CrossProduct(covariance="none")(measured, C_EK_TRUE).C_EK, figure, setting["runs"])
        allowance = np.array(setting["tolerance"]) * ours.value
        rows.append(judge(label, COLUMNS, figures, ours, allowance, setting["why"]))
        gls, sigma = _with_shared_error(setting, measured)
        extra.append(Row(f"gls, shared error stated, {label}", _series(gls, figure, setting["runs"])))
        if figure == "sigma":
            extra.append(Row(f"Cramer-Rao bound, {label}", Recomputed.exact(sigma / ARCSEC)))
    return Comparison(
        name=name,
        title=f"{'Standard deviation' if figure == 'sigma' else 'Largest error'} by number of images (arcsec)",
        source=source(name),
        columns=COLUMNS,
        runs=trials,
        rows=(*rows, *extra),
        notes=(
            "The slides give no inputs; independent errors cannot rise with more images.  Ours is one reading of two "
            f"that fit about equally: images after the first {setting['good_images']} share one more attitude error.",
            "gls knows of that error: it gives those images less weight, and more images never make it worse.",
        ),
    )


def _truth(
    setting: Mapping[str, Any], nadir: Nadir, count: int, refined: bool, rng: np.random.Generator, trials: int
) -> Observations:
    """True tables (trials,) of ``count`` images of the same markers, which each run draws anew over the field."""
    half = setting["height_km"] * 1e3 * np.tan(0.5 * setting["field_deg"] * DEG)
    place = rng.uniform(-half, half, (trials, setting["markers"], 3)) * [1.0, 1.0, 0.0]
    noise = setting["sigma_K_m"] * (setting["refined"] if refined else 1.0)
    return photographs(
        nadir,
        0.0,
        np.tile(place, (1, count, 1)),
        np.repeat(np.arange(count), setting["markers"]),
        PIXEL / (setting["focal_length_mm"] * MM),
        attitude_E=np.diag(np.array(setting["sigma_attitude_arcsec"]) * ARCSEC) ** 2,
        position_m=0.0,
        landmark_m=0.0,
        noise_px=noise / PIXEL,
    )


def _errors(setting: Mapping[str, Any], table: Observations, rng: np.random.Generator, trials: int) -> Errors:
    """Errors as stated, one position error for all images, and one more attitude error for all late ones."""
    errors = Errors.draw(table, rng, (trials,))
    late = np.arange(table.n_images) >= setting["good_images"]
    shared = np.array(setting["sigma_shared_arcsec"]) * ARCSEC * rng.standard_normal((trials, 1, 3))
    return replace(
        errors,
        rho_J=errors.rho_J + setting["sigma_common_m"] * rng.standard_normal((trials, 1, 3)),
        alpha_E=errors.alpha_E + late[:, None] * shared,
    )


def _with_shared_error(setting: Mapping[str, Any], measured: Observations) -> tuple[Array, Array]:
    """``gls`` of the good images and of the late ones, joined with the shared error in the weight of the latter.

    Returns the mountings (..., 3, 3) and the standard deviations (3,) rad of the bound.  The joint estimate is
    ``exp(P (P_late + Q)^-1 d) C_good`` with ``d = log(C_late C_good^T)``, the Gauss-Markov combination of the two.  The
    position error that all images share turns the whole by its share of the height; nothing can be done about it.
    """
    late = measured.image >= setting["good_images"]
    good = Gls()(_images(measured, ~late), C_EK_TRUE)
    C, P = good.C_EK, _covariance(good)
    if np.any(late):
        other = Gls()(_images(measured, late), C_EK_TRUE)
        Q = _covariance(other) + np.diag(np.array(setting["sigma_shared_arcsec"]) * ARCSEC) ** 2
        P = np.linalg.inv(np.linalg.inv(P) + np.linalg.inv(Q))
        step = (P @ np.linalg.inv(Q) @ so3.log(other.C_EK @ C.mT)[..., None])[..., 0]
        C = so3.exp(step) @ C
    common = setting["sigma_common_m"] / (setting["height_km"] * 1e3) * np.array([1.0, 1.0, 0.0])
    return C, np.sqrt(np.mean(np.diagonal(P, axis1=-2, axis2=-1), axis=0) + common**2)


def _covariance(estimate: AlignmentEstimate) -> Array:
    if estimate.covariance_E is None:
        raise ValueError("the estimate states no covariance")
    return estimate.covariance_E


def _images(table: Observations, keep: NDArray[np.bool_]) -> Observations:
    """The sightings kept, with their images and landmarks numbered anew."""
    part = table.select(keep)
    images, image = np.unique(part.image, return_inverse=True)
    landmarks, landmark = np.unique(part.landmark, return_inverse=True)
    return replace(
        part,
        image=image,
        landmark=landmark,
        cov_attitude_E=part.cov_attitude_E[..., images, :, :],
        cov_position_J=part.cov_position_J[..., images, :, :],
        cov_landmark_J=part.cov_landmark_J[..., landmarks, :, :],
    )


def _series(C_EK: Array, figure: str, size: int) -> Recomputed:
    errors = so3.log(C_EK @ C_EK_TRUE.mT) / ARCSEC
    series = errors[: len(errors) // size * size].reshape(-1, size, 3)
    statistic = series.std(axis=1, ddof=1) if figure == "sigma" else np.abs(series).max(axis=1)
    return Recomputed.of_series(statistic)
