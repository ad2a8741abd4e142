"""The table of algorithm 1 of Lebedev and Tkachenko 2012 recomputed: attitude and position from four markers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimators.gls import Gls
from ..estimators.published.projective import Projective
from ..physics import so3
from ..physics.units import ARCSEC
from ..table.observations import Observations
from ..table.simulate import Errors, measure
from .comparison import Comparison, Recomputed, Row, judge
from .lebedev_scene import C_EK_TRUE, Nadir, photographs
from .tables import published, scenario, source

Array = NDArray[np.float64]

COLUMNS = ("mu", "dr_m")
PIXELS = {0.0: "rp0", 1.0: "rp1", 5.0: "rp5"}
"""Size of a pixel on the ground, m, and the columns of the table that belong to it."""


def algorithm1(trials: int, rng: np.random.Generator) -> Comparison:
    """Errors of attitude (mu, arcsec) and position (dr, m) at times after the nadir, for the pixel sizes r_p."""
    document = scenario("slides2012")
    setting = document["algorithm1"]
    nadir = Nadir.over(document["orbit"], setting["height_km"] * 1e3)
    rows: list[Row] = []
    extra: list[Row] = []
    for row in published("algorithm1"):
        for pixel_m, tag in PIXELS.items():
            table = _truth(setting, nadir, float(row["t_s"]), pixel_m)
            runs = _rounded(table, rng, trials) if pixel_m else table
            figures = [float(row[f"mu_{tag}_arcsec"]), float(row[f"dr_{tag}_m"])]
            label = f"t = {row['t_s']} s, r_p = {pixel_m:g} m"
            ours = _single(_errors(runs, nadir, float(row["t_s"])))
            why = setting["why"] if pixel_m else setting["why_exact"]
            rows.append(judge(label, COLUMNS, figures, ours, 0.5 * ours.value, why))
            if pixel_m:
                extra.append(Row(f"gls, {label}", _single(_gls(runs))))
    rows += [
        _average(rows[column :: len(PIXELS)], pixel_m) for column, pixel_m in enumerate(PIXELS) if pixel_m
    ]
    bounds = [_bound(_truth(setting, nadir, 25.0, pixel_m), pixel_m) for pixel_m in PIXELS if pixel_m]
    return Comparison(
        name="algorithm1",
        title="Algorithm 1, projective fit of four markers: errors of attitude (arcsec) and position (m)",
        source=source("algorithm1"),
        columns=COLUMNS,
        runs=trials,
        rows=(*rows, *extra, *bounds),
        notes=(
            "Ours is the median of single runs; a published cell looks like one run and agrees where 99 of 100 of ours "
            "lie, or within half of the median.",
            "gls is given the position, as GPS would give it without error, and estimates the attitude alone.",
        ),
    )


def _truth(setting: dict[str, Any], nadir: Nadir, time_s: float, pixel_m: float) -> Observations:
    """True table; the stated pixel noise is that of rounding, and nothing else is wrong."""
    return photographs(
        nadir,
        time_s,
        1e3 * np.array(setting["markers_km"]),
        np.zeros(len(setting["markers_km"]), dtype=np.int64),
        max(pixel_m, 1.0) / (setting["height_km"] * 1e3),
        attitude_E=np.zeros((3, 3)),
        position=0.0,
        landmark=0.0,
        pixel=1.0 / np.sqrt(12.0),
    )


def _rounded(table: Observations, rng: np.random.Generator, trials: int) -> Observations:
    """Runs in which every image coordinate is rounded to whole pixels of a grid that lies at random."""
    still = Errors.draw(table, rng, (trials,)).only("alpha_E")
    pixel = rng.uniform(-0.5, 0.5, (trials, table.n, 2))
    return measure(table, C_EK_TRUE, Errors(**{**vars(still), "pixel": pixel}))


def _errors(runs: Observations, nadir: Nadir, time_s: float) -> Array:
    """Angle of the attitude's error, arcsec, and length of the position's, m: (runs, 2)."""
    estimate = Projective(heights="removed")(runs, C_EK_TRUE)
    angle = np.linalg.norm(so3.log(estimate.C_EK @ C_EK_TRUE.mT), axis=-1) / ARCSEC
    r_J, _ = nadir.at(time_s)
    return np.stack([angle, np.linalg.norm(estimate.r_J[..., 0, :] - r_J, axis=-1)], axis=-1).reshape(-1, 2)


def _gls(runs: Observations) -> Array:
    angle = np.linalg.norm(so3.log(Gls()(runs, C_EK_TRUE).C_EK @ C_EK_TRUE.mT), axis=-1) / ARCSEC
    return np.stack([angle, np.full_like(angle, np.nan)], axis=-1)


def _average(rows: Sequence[Row], pixel_m: float) -> Row:
    """A column of the table averaged over t."""
    figures = np.mean([row.published for row in rows if row.published is not None], axis=0)
    ours = Recomputed.exact(np.mean([row.ours.value for row in rows], axis=0))
    return judge(f"mean over t, r_p = {pixel_m:g} m", COLUMNS, figures, ours, 0.5 * ours.value)


def _single(errors: Array) -> Recomputed:
    return Recomputed.of_series(errors) if len(errors) > 1 else Recomputed.exact(errors[0])


def _bound(table: Observations, pixel_m: float) -> Row:
    """Root of the trace of the bound, with the position known."""
    covariance = Gls()(table, C_EK_TRUE).covariance_E
    angle = np.nan if covariance is None else np.sqrt(np.trace(covariance)) / ARCSEC
    label = f"Cramer-Rao bound (rms), t = 25 s, r_p = {pixel_m:g} m, position known"
    return Row(label, Recomputed.exact([angle, np.nan]))
