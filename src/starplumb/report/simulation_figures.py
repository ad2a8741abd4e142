"""The figures of a simulation, from its ``summary.json`` alone: in the report, as files, and for a session."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..study.statistics import Z95
from .amounts import Histogram, Interval, histogram, histograms, intervals, lines
from .page import Figure
from .plots import Points
from .text import number

Document = Mapping[str, Any]

AXES = ("x", "y", "z")


def simulation_files(document: Document) -> dict[str, str]:
    """Figures as SVG files by their names."""
    files = {}
    for name, method in document["methods"].items():
        files[f"histogram-{name}.svg"] = all_histograms(name, method).file
        files[f"convergence-{name}.svg"] = convergence(name, method["convergence"]).file
    for figure in ratios(document["methods"]):
        files["error-over-stated.svg"] = figure.file
    return files


def slug(name: str) -> str:
    """A name of letters, digits and dashes."""
    return "".join(c if c.isalnum() else "-" for c in name)


def ratios(methods: Mapping[str, Document]) -> tuple[Figure, ...]:
    """Error over stated sigma of each method and axis, with the band in which it should lie."""
    rows, band = [], (1.0, 1.0)
    for name, method in methods.items():
        for axis in AXES:
            found = method["axes"][axis]["error_over_stated"]
            if found is not None:
                rows.append(Interval(f"{name}, {axis}", found["value"], found["low"], found["high"]))
                band = (found["band_low"], found["band_high"])
    if not rows:
        return ()
    worst = max(rows, key=lambda row: abs(np.log(max(row.value, 1e-12))))
    words = f"the farthest from 1 is {number(worst.value)} ({worst.name})"
    return (
        intervals(
            "ratios",
            rows,
            band,
            "error over stated sigma",
            f"Ratio of the actual error to the stated sigma by method and axis: {words}.",
            f"Actual error over stated sigma, with 95 % intervals; it should be 1 ({words}). "
            "Shaded: 95 % of studies of this size.",
        ),
    )


def histograms_by_axis(name: str, axes: Mapping[str, Document]) -> tuple[Figure, ...]:
    """Errors about each axis, a figure each."""
    drawn = []
    for axis, h in _histograms(name, axes).items():
        words = f"errors of {name} about {axis}: rms {number(axes[axis]['rms_arcsec']['value'])} arcsec"
        drawn.append(histogram(h, f"Histogram of the {words}.", f"The {words}."))
    return tuple(drawn)


def all_histograms(name: str, method: Document) -> Figure:
    """Errors about all axes in one figure; an axis whose errors have no scatter is left out."""
    words = f"errors of {name} about x, y and z"
    parts = list(_histograms(name, method["axes"]).values())
    return histograms(f"histogram-{slug(name)}", parts, f"Histograms of the {words}.", f"The {words}.")


def _histograms(name: str, axes: Mapping[str, Document]) -> dict[str, Histogram]:
    """Those axes whose errors have a histogram."""
    return {
        axis: Histogram(
            f"histogram-{slug(name)}-{axis}",
            f"error about {axis}, arcsec",
            np.array(found["histogram"]["edges_arcsec"], dtype=np.float64),
            np.array(found["histogram"]["counts"], dtype=np.float64),
            found["stated_sigma_arcsec"],
        )
        for axis, found in axes.items()
        if found["histogram"] is not None
    }


def convergence(name: str, curve: Document) -> Figure:
    """Sigma over its last value as the trials accumulate, within the band of Gaussian errors."""
    trials = np.array(curve["trials"], dtype=np.float64)
    groups = []
    for axis in AXES:
        sigma = np.array(curve[f"sigma_{axis}_arcsec"], dtype=np.float64)
        groups.append(Points(f"about {axis}", trials, sigma / sigma[-1]))
    half = Z95 / np.sqrt(2.0 * np.maximum(trials, 1.0))
    words = f"Sigma of {name} over its final value as the trials accumulate"
    return lines(
        f"convergence-{slug(name)}",
        groups,
        ("trials", "sigma / final sigma"),
        f"{words}.",
        f"{words}.",
        (trials, 1.0 - half, 1.0 + half),
    )
