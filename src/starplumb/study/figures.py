"""Figures of ``summary.json`` (matplotlib): errors, stated sigmas, convergence with the trials.

Each figure is drawn from the document alone, so that it can be drawn again without the samples.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .statistics import Z95

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXES = ("x", "y", "z")
COLOURS = ("#3465a4", "#c4570b", "#4e7d0f")


def figures(summary: dict[str, Any]) -> dict[str, str]:
    """SVG texts by file name."""
    drawn: dict[str, str] = {}
    for name, method in summary["methods"].items():
        drawn[f"histogram-{name}.svg"] = _svg(partial(_histograms, method=method, name=name), 9.0, 3.0)
        drawn[f"convergence-{name}.svg"] = _svg(partial(_convergence, method=method, name=name), 5.5, 3.6)
    drawn["error-over-stated.svg"] = _svg(partial(_ratios, methods=summary["methods"]), 5.5, 3.6)
    return drawn


def _svg(draw: Callable[[Figure], None], width: float, height: float) -> str:
    """A drawing as SVG text that depends on nothing but its data."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"svg.hashsalt": "starplumb", "svg.fonttype": "none", "font.size": 9.0}):
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def _histograms(figure: Figure, method: dict[str, Any], name: str) -> None:
    """Errors about each axis as a density, and the normal of the stated sigma."""
    for axes, axis, colour in zip(figure.subplots(1, 3), AXES, COLOURS, strict=True):
        found = method["axes"][axis]
        axes.set(title=f"{name}: error about {axis}", xlabel="arcsec", yticks=[])
        if found["histogram"] is None:
            continue
        edges, counts = np.array(found["histogram"]["edges_arcsec"]), np.array(found["histogram"]["counts"])
        axes.stairs(counts / (counts.sum() * np.diff(edges)), edges, fill=True, color=colour, alpha=0.5)
        sigma = found["stated_sigma_arcsec"]
        if sigma is not None:
            x = np.linspace(edges[0], edges[-1], 201)
            axes.plot(
                x,
                np.exp(-0.5 * (x / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi)),
                "k-",
                lw=1.0,
                label="stated",
            )
            axes.legend(frameon=False)


def _convergence(figure: Figure, method: dict[str, Any], name: str) -> None:
    """Sigma over its final value against the number of trials, within the band of a Gaussian."""
    axes, curve = figure.subplots(), method["convergence"]
    trials = np.array(curve["trials"])
    for axis, colour in zip(AXES, COLOURS, strict=True):
        sigma = np.array(curve[f"sigma_{axis}_arcsec"], dtype=np.float64)
        axes.plot(trials, sigma / sigma[-1], ".-", color=colour, label=axis)
    band = Z95 / np.sqrt(2.0 * trials)
    axes.fill_between(trials, 1.0 - band, 1.0 + band, color="0.85", label="95 % of Gaussian samples")
    axes.set(
        title=f"{name}: convergence of sigma", xlabel="trials", ylabel="sigma / final sigma", xscale="log"
    )
    axes.legend(frameon=False)


def _ratios(figure: Figure, methods: dict[str, Any]) -> None:
    """Error over stated sigma of each method and axis, with its interval and the band."""
    axes = figure.subplots()
    stated = [
        name for name, method in methods.items() if method["axes"]["x"]["error_over_stated"] is not None
    ]
    for k, (axis, colour) in enumerate(zip(AXES, COLOURS, strict=True)):
        for row, name in enumerate(stated):
            ratio = methods[name]["axes"][axis]["error_over_stated"]
            place = row + 0.2 * (k - 1)
            interval = [[ratio["value"] - ratio["low"]], [ratio["high"] - ratio["value"]]]
            axes.errorbar(
                ratio["value"], place, xerr=interval, fmt="o", color=colour, label=axis if row == 0 else None
            )
            axes.plot([ratio["band_low"], ratio["band_high"]], [place, place], color="0.8", lw=8.0, zorder=0)
    axes.set(
        title="error over stated sigma, with its 95 % band", xlabel="1 wanted", yticks=range(len(stated))
    )
    axes.set_yticklabels(stated)
    if stated:
        axes.legend(frameon=False)
