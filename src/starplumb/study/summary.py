"""What a study found: ``summary.json``."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimators.protocol import Status
from ..physics.units import ARCSEC
from ..plan.bound import bound_E
from .cameras import OfCamera
from .monte_carlo import Study, Tally, on_ground
from .statistics import Z95, chi2_band, quantile, trials_for
from .store import Store
from .verdict import TOLERANCE, verdict

Array = NDArray[np.float64]

SCHEMA = "starplumb-simulation/1"
AXES = ("x", "y", "z")
QUANTILES = (0.025, 0.16, 0.5, 0.84, 0.975)
CHECKPOINTS = 60
"""Most points of the curve of sigma against the number of trials."""
SURE = 0.999
"""A figure outside the band of this probability may be called wrong..."""
SURELY = 3.29
"""...if it is off by as many of its own standard errors (99.9 % of a normal)."""


@dataclass
class Progress:
    """Sigma of one estimator as trials accumulate."""

    trials: list[int] = field(default_factory=list)
    sigma: list[Array] = field(default_factory=list)
    error: list[Array] = field(default_factory=list)

    def note(self, tally: Tally) -> None:
        self.trials.append(int(tally.theta.n))
        self.sigma.append(tally.theta.sigma)
        self.error.append(tally.theta.sigma_error)

    def document(self) -> dict[str, Any]:
        """A curve of at most CHECKPOINTS points, the last one always among them."""
        chosen = np.unique(np.linspace(0, len(self.trials) - 1, CHECKPOINTS).round().astype(int))
        return {
            "trials": [self.trials[i] for i in chosen],
            **{
                f"sigma_{axis}_arcsec": [float(self.sigma[i][k] / ARCSEC) for i in chosen]
                for k, axis in enumerate(AXES)
            },
        }


@dataclass
class Found:
    """What one estimator made of a study: statistics, their course, and its finite errors (n, 3) rad in order."""

    tally: Tally
    progress: Progress
    theta_E: Array


def found_of(store: Store) -> dict[str, Found]:
    """Statistics of all chunks of a finished study, by method, merged in the order of the chunks."""
    merged: dict[str, Tally] = {}
    progress: dict[str, Progress] = {name: Progress() for name in store.study.methods}
    theta_E: dict[str, list[Array]] = {name: [] for name in store.study.methods}
    for arrays in store.load():
        for name in store.study.methods:
            part = Tally.from_arrays(arrays, f"{name}/tally/")
            merged[name] = merged[name].merge(part) if name in merged else part
            progress[name].note(merged[name])
            errors = arrays[f"{name}/theta_E"]
            theta_E[name].append(errors[np.all(np.isfinite(errors), axis=-1)])
    return {name: Found(merged[name], progress[name], np.concatenate(theta_E[name])) for name in merged}


def summarise(store: Store) -> dict[str, Any]:
    """The document of a finished study; the same for the same scenario, seed, trials and chunk size."""
    study, bounds = store.study, bound_E(store.study.scenario)
    scenario = study.scenario
    methods = {}
    for name, found in found_of(store).items():
        asked = study.methods[name]
        bound = asked.of(asked.of(bounds).T) if isinstance(asked, OfCamera) else bounds
        methods[name] = _method(study, found, bound) | {"convergence": found.progress.document()}
    document: dict[str, Any] = _finite(
        {
            "schema": SCHEMA,
            "scenario": scenario.name,
            "description": scenario.description,
            "fingerprint": study.fingerprint,
            "trials": study.trials,
            "seed": study.seed,
            "chunk": study.chunk,
            "images": scenario.truth.n_images,
            "sightings": scenario.truth.n,
            "stated_model_is_true": scenario.model_is_true,
            "sources": [
                {
                    "name": s.name,
                    "words": s.words,
                    f"sigma_{s.unit.name}": [float(x / s.unit.size) for x in s.sigma],
                }
                for s in scenario.sources
            ],
            "cramer_rao_arcsec": _arcsec(np.sqrt(np.diagonal(bounds)[:3])),
            "methods": methods,
        }
    )
    return document


def _finite(part: Any) -> Any:
    """The document with None for what is not a number, which JSON has not."""
    if isinstance(part, dict):
        return {key: _finite(value) for key, value in part.items()}
    if isinstance(part, list):
        return [_finite(value) for value in part]
    return None if isinstance(part, float) and not isfinite(part) else part


def _arcsec(values: Array) -> list[float]:
    return [float(value / ARCSEC) for value in values]


def _interval(value: float, error: float, scale: float = 1.0) -> dict[str, float]:
    """A value with its 95 % confidence interval."""
    return {
        "value": value / scale,
        "low": (value - Z95 * error) / scale,
        "high": (value + Z95 * error) / scale,
    }


def _quantile(values: Array, q: float, scale: float = 1.0) -> dict[str, float] | None:
    if values.size == 0:
        return None
    value, low, high = quantile(values, q)
    return {"value": value / scale, "low": low / scale, "high": high / scale}


def _method(study: Study, made: Found, bound: Array | None) -> dict[str, Any]:
    found = made.tally
    counts = {status.name.lower(): int(found.status[status]) for status in Status}
    failed = sum(int(found.status[status]) for status in Status if not status.usable)
    document = {
        "status": counts,
        "failed": failed,
        "without_estimate": int(found.unusable),
        "axes": {axis: _axis(found, made.theta_E[:, k], k, bound) for k, axis in enumerate(AXES)},
        "nees": _consistency(found.nees.mean[0], found.nees.mean_error[0], 3.0 * float(found.nees.n)),
        "chi2_per_degree_of_freedom": _fit(study, found),
        "ground": {
            "rmse_m": _interval(float(found.ground_m.rms[0]), float(found.ground_m.rms_error[0])),
            "ce90_m": _quantile(on_ground(made.theta_E, study.scenario.ground_m), 0.9),
            "points": "centres of the images, alignment error alone",
        },
        "trials_for_1_percent": trials_for(0.01, kurtosis=float(np.max(found.theta.kurtosis))),
    }
    document["verdict"] = list(verdict(study.trials, document))
    return document


def _axis(found: Tally, errors: Array, k: int, bound: Array | None) -> dict[str, Any]:
    theta = found.theta
    rms, rms_error = float(theta.rms[k]), float(theta.rms_error[k])
    limit = None if bound is None else float(np.sqrt(bound[k, k]))
    return {
        "mean_arcsec": _interval(float(theta.mean[k]), float(theta.mean_error[k]), ARCSEC),
        "sigma_arcsec": _interval(float(theta.sigma[k]), float(theta.sigma_error[k]), ARCSEC),
        "rms_arcsec": _interval(rms, rms_error, ARCSEC),
        "max_arcsec": float(theta.largest[k] / ARCSEC) if theta.n else None,
        "kurtosis": float(theta.kurtosis[k]),
        "quantiles_arcsec": {f"{q:g}": _quantile(errors, q, ARCSEC) for q in QUANTILES},
        "stated_sigma_arcsec": float(found.sigma.mean[k] / ARCSEC) if found.sigma.n else None,
        "error_over_stated": _ratio(found, k),
        "histogram": _histogram(errors, float(theta.mean[k]), float(theta.sigma[k])),
        "rmse_over_bound": None if limit is None else _interval(rms, rms_error, limit),
    }


def _histogram(errors: Array, mean: float, sigma: float) -> dict[str, Any] | None:
    """Counts in bins of a fifth of sigma out to five sigma, for the figures; the outer two hold what lies beyond."""
    if errors.size == 0 or not sigma > 0.0:
        return None
    edges = mean + sigma * np.linspace(-5.0, 5.0, 51)
    counts, _ = np.histogram(np.clip(errors, edges[0], edges[-1]), edges)
    return {"edges_arcsec": [float(edge / ARCSEC) for edge in edges], "counts": [int(n) for n in counts]}


def _consistency(
    value: float, error: float, degrees_of_freedom: float, root: bool = False
) -> dict[str, Any] | None:
    """A mean square (or its root) that should be 1, its 95 % interval, and its band if the sigmas are true."""
    if degrees_of_freedom == 0.0:
        return None
    bands = [chi2_band(degrees_of_freedom, level) for level in (0.95, SURE)]
    (low, high), sure = (tuple(np.sqrt(band)) if root else band for band in bands)
    # beyond the band of Gaussian errors, beyond its own uncertainty (tails may be heavy), and large enough to matter
    least = max(SURELY * error, TOLERANCE if root else 2.0 * TOLERANCE)
    off = not (sure[0] <= value <= sure[1]) and abs(value - 1.0) > least
    return _interval(float(value), float(error)) | {
        "band_low": float(low),
        "band_high": float(high),
        "within": bool(low <= value <= high),
        "wrong": bool(off),
    }


def _ratio(found: Tally, k: int) -> dict[str, Any] | None:
    """Rms of error over stated sigma; each trial is one degree of freedom."""
    ratio = found.ratio
    return _consistency(float(ratio.rms[k]), float(ratio.rms_error[k]), float(ratio.n), root=True)


def _fit(study: Study, found: Tally) -> dict[str, Any] | None:
    o = study.scenario.truth
    per_trial = 2 * o.n - 3 * len(study.scenario.C_EC_true)
    per_trial += 3 * (study.scenario.prior_E is not None)
    return _consistency(found.fit.mean[0], found.fit.mean_error[0], float(found.fit.n) * per_trial)
