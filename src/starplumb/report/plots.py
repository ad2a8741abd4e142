"""The few kinds of drawing that reports are made of: arrows, points, ellipses, bars, histograms, curves, intervals.

Each takes plain arrays in the units of its axes and returns a :class:`~starplumb.report.page.Figure`.  What is not
finite is left out; of very many points only some are drawn, and the caption says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .page import Figure
from .svg import GRID, HEIGHT, INK, MUTED, SERIES, drawing
from .text import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DRAWN_AT_MOST = 600
"""Points or arrows in one drawing: more could not be told apart and would load slowly."""
WORST = 20
"""So many of them are the largest; more would show another distribution than there is."""
LONG_ARROW = 0.09
"""Length of the 90 % longest arrow, as a share of the width of the drawing."""
MARKERS = ("o", "^", "s", "D")


@dataclass(frozen=True)
class Points:
    """A named group of points: ``x``, ``y`` (n,)."""

    name: str
    x: Array
    y: Array


@dataclass(frozen=True)
class Ellipse:
    """A named ellipse about ``centre`` (2,) that holds ``probability`` of a normal error of covariance (2, 2)."""

    name: str
    centre: Array
    covariance: Array
    probability: float


@dataclass(frozen=True)
class Interval:
    """A named value with the ends of its confidence interval."""

    name: str
    value: float
    low: float
    high: float


def thinned(size: Array) -> tuple[NDArray[np.int64], str]:
    """Which of n items to draw, in order: the largest by ``size`` (n,) and an even choice of the rest; and a remark."""
    n = size.size
    if n <= DRAWN_AT_MOST:
        return np.arange(n), ""
    large = np.flatnonzero(size >= np.partition(size, n - WORST)[n - WORST])
    worst = large[np.argsort(-size[large], kind="stable")[:WORST]]
    even = np.linspace(0, n - 1, DRAWN_AT_MOST - worst.size).astype(np.int64)
    chosen = np.union1d(worst, even)
    return chosen, f" {chosen.size} of {n} are drawn, the largest among them."


def vectors(
    name: str,
    start: Array,
    vector: Array,
    marked: Mask,
    labels: tuple[str, str],
    unit: str,
    alt: str,
    caption: str,
    downwards: bool = False,
) -> Figure:
    """Arrows (n, 2) from places (n, 2), the ``marked`` ones in another colour; a key tells their scale."""
    finite = np.all(np.isfinite(start) & np.isfinite(vector), axis=-1)
    start, vector, marked = start[finite], vector[finite], marked[finite]
    length = np.hypot(vector[:, 0], vector[:, 1])
    chosen, remark = thinned(length)
    start, vector, marked = start[chosen], vector[chosen], marked[chosen]
    long = float(np.quantile(length, 0.9)) if length.size else 1.0
    key = _round_down(long)
    with drawing(4.3) as (figure, (axes,)):
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        axes.plot(start[:, 0], start[:, 1], ".", color=MUTED, markersize=2.5)
        arrows = None
        for group, colour in ((~marked, SERIES[0]), (marked, SERIES[1])):
            drawn = axes.quiver(
                *start[group].mT,
                *(vector[group] / key).mT,
                color=colour,
                angles="uv" if not downwards else "xy",
                scale=long / key / LONG_ARROW if long > 0.0 else 1.0,
                scale_units="width",
                width=0.004,
            )
            arrows = drawn if arrows is None else arrows
        axes.margins(0.12)
        if downwards:
            axes.invert_yaxis()
        if arrows is not None:
            axes.set_title(" ")  # room for the key
            axes.quiverkey(arrows, 0.72, 1.04, 1.0, f"{number(key, 1)} {unit}", labelpos="E")
        return Figure(figure, name, alt, caption + remark)


def _round_down(x: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above x; 1 for nothing."""
    if not x > 0.0 or not np.isfinite(x):
        return 1.0
    power = 10.0 ** np.floor(np.log10(x))
    return float(max(step for step in (1.0, 2.0, 5.0) if step * power <= x * (1 + 1e-9)) * power)


def scatter(
    name: str,
    groups: Sequence[Points],
    labels: tuple[str, str],
    alt: str,
    caption: str,
    ellipses: Sequence[Ellipse] = (),
    ticks: Sequence[str] = (),
    equal: bool = False,
) -> Figure:
    """Groups of points, each in its colour and marker, with ellipses; ``ticks`` name the whole numbers of x."""
    remark = ""
    with drawing(4.1 if equal else HEIGHT) as (figure, (axes,)):
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        for group, colour, marker in zip(groups, SERIES, MARKERS, strict=False):
            finite = np.isfinite(group.x) & np.isfinite(group.y)
            x, y = group.x[finite], group.y[finite]
            chosen, remark = thinned(np.abs(y))
            axes.plot(
                x[chosen], y[chosen], marker, color=colour, markersize=3.5, label=group.name, fillstyle="none"
            )
        for ellipse, style in zip(ellipses, ("-", "--", ":", "-."), strict=False):
            axes.plot(*outline(ellipse).mT, style, color=INK, label=ellipse.name)
        if ticks:
            axes.set_xticks(range(len(ticks)), list(ticks), rotation=60 if max(map(len, ticks)) > 2 else 0)
        if equal:
            axes.set_aspect("equal", adjustable="datalim")
        if len(groups) + len(ellipses) > 1:
            figure.legend(loc="outside upper center", ncols=2)
        return Figure(figure, name, alt, caption + remark)


def outline(ellipse: Ellipse) -> Array:
    """Points (k, 2) of an ellipse: ``centre + sqrt(q) S (cos, sin)``, S S = covariance, q = -2 ln(1 - probability)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    values, axes = np.linalg.eigh(ellipse.covariance)
    root = (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.mT
    return np.asarray(ellipse.centre + np.sqrt(-2.0 * np.log1p(-ellipse.probability)) * circle @ root)


def bars(
    name: str, rows: Sequence[str], groups: Sequence[tuple[str, Array]], label: str, alt: str, caption: str
) -> Figure:
    """Horizontal bars: one row for each name, in it one bar for each group."""
    thickness = 0.8 / max(len(groups), 1)
    with drawing(max(2.2, 0.9 + 0.15 * len(rows) * max(len(groups), 1))) as (figure, (axes,)):
        place = np.arange(len(rows), dtype=np.float64)
        for i, (group, values) in enumerate(groups):
            axes.barh(
                place + (i + 0.5) * thickness - 0.4, values, 0.9 * thickness, color=SERIES[i], label=group
            )
        axes.set_yticks(place, list(rows))
        axes.invert_yaxis()
        axes.set_xlabel(label)
        axes.grid(visible=False, axis="y")
        if len(groups) > 1:
            figure.legend(loc="outside upper center", ncols=len(groups))
        return Figure(figure, name, alt, caption)


@dataclass(frozen=True)
class Histogram:
    """Counts (n,) between ``edges`` (n + 1,), and the standard deviation that is stated for them, None for none."""

    name: str
    label: str
    edges: Array
    counts: Array
    sigma: float | None = None


def histogram(h: Histogram, alt: str, caption: str) -> Figure:
    """Density of counts, with that of a centred normal of the stated standard deviation."""
    with drawing() as (figure, (axes,)):
        _density(axes, h)
        axes.set_ylabel("density")
        if h.sigma:
            figure.legend(loc="outside upper center")
        return Figure(figure, h.name, alt, caption)


def histograms(name: str, parts: Sequence[Histogram], alt: str, caption: str) -> Figure:
    """The same side by side."""
    with drawing(3.0, 9.0, max(len(parts), 1)) as (figure, all_axes):
        for axes, h in zip(all_axes, parts, strict=False):
            _density(axes, h)
            axes.set_yticks([])
        if any(h.sigma for h in parts):
            figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside upper center")
        return Figure(figure, name, alt, caption)


def _density(axes: Axes, h: Histogram) -> None:
    density = h.counts / np.maximum(np.sum(h.counts) * np.diff(h.edges), 1e-300)
    axes.stairs(density, h.edges, fill=True, color=SERIES[0], alpha=0.6)
    if h.sigma:
        x = np.linspace(h.edges[0], h.edges[-1], 201)
        normal = np.exp(-0.5 * (x / h.sigma) ** 2) / (h.sigma * np.sqrt(2.0 * np.pi))
        axes.plot(x, normal, color=INK, label="as the stated sigma says")
    axes.set_xlabel(h.label)


def lines(
    name: str,
    groups: Sequence[Points],
    labels: tuple[str, str],
    alt: str,
    caption: str,
    band: tuple[Array, Array, Array] | None = None,
) -> Figure:
    """Curves over a logarithmic axis; ``band`` (x, low, high) is where they should lie."""
    with drawing() as (figure, (axes,)):
        axes.set_xscale("log")
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        if band:
            axes.fill_between(*band, color=GRID, label="95 % of Gaussian samples")
        for group, colour, marker in zip(groups, SERIES, MARKERS, strict=False):
            axes.plot(group.x, group.y, f"{marker}-", color=colour, markersize=3.0, label=group.name)
        figure.legend(loc="outside upper center", ncols=2 if band else len(groups))
        return Figure(figure, name, alt, caption)


def intervals(
    name: str, rows: Sequence[Interval], band: tuple[float, float], label: str, alt: str, caption: str
) -> Figure:
    """Values with their intervals, one row each, over the band in which they should lie."""
    with drawing(max(2.0, 0.9 + 0.3 * len(rows))) as (figure, (axes,)):
        axes.axvspan(*band, color=SERIES[2], alpha=0.2)
        axes.axvline(1.0, color=MUTED, linewidth=0.8)
        for place, row in enumerate(rows):
            axes.plot((row.low, row.high), (place, place), color=SERIES[0])
            axes.plot(row.value, place, "o", color=SERIES[0], markersize=4.0)
        axes.set_yticks(range(len(rows)), [row.name for row in rows])
        axes.invert_yaxis()
        axes.set_xlabel(label)
        return Figure(figure, name, alt, caption)
