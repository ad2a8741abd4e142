"""``summary.json``: what a Monte Carlo study found."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from .document import Document, Files, Number, Numbers3, Part


class Interval(Part):
    """A value with its 95 % confidence interval."""

    value: Number
    low: Number
    high: Number


class Ratio(Interval):
    """A ratio that should be 1; all is well between ``band_low`` and ``band_high``."""

    band_low: Number
    band_high: Number
    within: bool
    wrong: bool


class Histogram(Part):
    """Errors counted between edges."""

    edges_arcsec: list[float]
    counts: list[int]


class AxisErrors(Part):
    """Errors about one axis of the star tracker."""

    mean_arcsec: Interval
    sigma_arcsec: Interval
    rms_arcsec: Interval
    max_arcsec: Number
    kurtosis: Number
    quantiles_arcsec: dict[str, Interval | None]
    stated_sigma_arcsec: Number
    error_over_stated: Ratio | None
    histogram: Histogram | None
    rmse_over_bound: Interval | None


class Ground(Part):
    """Errors on the ground by the alignment alone."""

    rmse_m: Interval
    ce90_m: Interval | None
    points: str


class MethodErrors(Part):
    """What one method did; ``verdict`` says in sentences what to think of it."""

    status: dict[str, int]
    failed: int
    without_estimate: int
    axes: dict[str, AxisErrors]
    nees: Ratio | None
    chi2_per_degree_of_freedom: Ratio | None
    ground: Ground
    trials_for_1_percent: int
    verdict: list[str]
    convergence: dict[str, list[int] | list[Number]]


class SimulationDocument(Document):
    """``summary.json``."""

    schema_: Literal["starplumb-simulation/1"] = Field(alias="schema")
    scenario: str
    description: str
    fingerprint: dict[str, Any]
    trials: int
    seed: int
    chunk: int
    images: int
    sightings: int
    stated_model_is_true: bool
    sources: list[dict[str, str | list[float]]]
    cramer_rao_arcsec: Numbers3 | None
    methods: dict[str, MethodErrors]
    files: Files = None
