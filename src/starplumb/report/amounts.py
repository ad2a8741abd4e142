"""Drawings of amounts: bars, histograms, curves over a logarithmic axis, intervals.  Plain arrays in the units of the
axes go in, a :class:`~starplumb.report.page.Figure` comes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .charts.chart import HEIGHT, SERIES, SHAPES, Area, Axis, Boxes, Chart, Dots, Line, Mark, span
from .page import Figure
from .plots import Points
from .text import number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Interval:
    """A named value with the ends of its confidence interval."""

    name: str
    value: float
    low: float
    high: float


def bars(
    name: str, rows: Sequence[str], groups: Sequence[tuple[str, Array]], label: str, alt: str, caption: str
) -> Figure:
    """Horizontal bars: one row for each name, in it one bar for each group."""
    thickness = 0.8 / max(len(groups), 1)
    place = np.arange(len(rows), dtype=np.float64)
    marks = []
    for i, (group, values) in enumerate(groups):
        low = place + i * thickness - 0.4
        tips = [f"{row}, {group}: {number(value)}" for row, value in zip(rows, values.tolist(), strict=True)]
        known = np.where(np.isfinite(values), values, 0.0)
        marks.append(
            Boxes(np.zeros_like(known), known, low, low + 0.9 * thickness, SERIES[i], group, tips=tips)
        )
    most = max((float(np.max(mark.right, initial=0.0)) for mark in marks), default=0.0)
    x = Axis(label, 0.0, 1.05 * most or 1.0)
    y = Axis("", -0.5, len(rows) - 0.5, tuple(rows), reverse=True)
    height = max(HEIGHT, 90.0 + 15.0 * len(rows) * max(len(groups), 1))
    return Figure(Chart(x, y, tuple(marks), height=height), name, alt, caption)


@dataclass(frozen=True)
class Histogram:
    """Counts (n,) between ``edges`` (n + 1,), and the standard deviation that is stated for them, None for none."""

    name: str
    label: str
    edges: Array
    counts: Array
    sigma: float | None = None


def normalised(name: str, label: str, z: Array, widest: float = 5.0, bins: int = 41) -> Histogram:
    """Values (n,) that should be normal with unit sigma; those beyond the widest are counted at the ends."""
    counts, edges = np.histogram(np.clip(z, -widest, widest), np.linspace(-widest, widest, bins))
    return Histogram(name, label, edges, counts.astype(np.float64), 1.0)


def histogram(h: Histogram, alt: str, caption: str) -> Figure:
    """Density of counts, with that of a centred normal of the stated standard deviation."""
    return Figure(_density(h, "density"), h.name, alt, caption)


def histograms(name: str, parts: Sequence[Histogram], alt: str, caption: str) -> Figure:
    """The same side by side."""
    charts = [_density(h, "") for h in parts]
    plain = [replace(chart, y=replace(chart.y, ticks=False), width=300.0, height=300.0) for chart in charts]
    return Figure(tuple(plain), name, alt, caption)


def _density(h: Histogram, label: str) -> Chart:
    density = h.counts / np.maximum(np.sum(h.counts) * np.diff(h.edges), 1e-300)
    marks: list[Mark] = [
        Boxes(h.edges[:-1], h.edges[1:], np.zeros_like(density), density, "one", opacity=0.6)
    ]
    most = float(np.max(density, initial=0.0))
    if h.sigma:
        x = np.linspace(h.edges[0], h.edges[-1], 201)
        normal = np.exp(-0.5 * (x / h.sigma) ** 2) / (h.sigma * np.sqrt(2.0 * np.pi))
        marks.append(Line(x, normal, "ink", name="as the stated sigma says"))
        most = max(most, float(np.max(normal)))
    across = Axis(h.label, float(h.edges[0]), float(h.edges[-1]))
    return Chart(across, Axis(label, 0.0, 1.08 * most or 1.0), tuple(marks))


def lines(
    name: str,
    groups: Sequence[Points],
    labels: tuple[str, str],
    alt: str,
    caption: str,
    band: tuple[Array, Array, Array] | None = None,
) -> Figure:
    """Curves over a logarithmic axis; ``band`` (x, low, high) is where they should lie."""
    marks: list[Mark] = [Area(*band, "muted", "95 % of Gaussian samples", 0.25)] if band else []
    for group, role, shape in zip(groups, SERIES, SHAPES, strict=False):
        marks += [Line(group.x, group.y, role), Dots(group.x, group.y, role, shape, group.name, group.tips)]
    right = [group.x[group.x > 0.0] for group in groups]
    low, high = span([np.log10(x) for x in right], 0.03, 0.3)
    x = Axis(labels[0], 10.0**low, 10.0**high, log=True)
    y = Axis(labels[1], *span([*(group.y for group in groups), *(band[1:] if band else ())]))
    return Figure(Chart(x, y, tuple(marks)), name, alt, caption)


def intervals(
    name: str, rows: Sequence[Interval], band: tuple[float, float], label: str, alt: str, caption: str
) -> Figure:
    """Values with their intervals, one row each, over the band in which they should lie."""
    place, value = np.arange(len(rows), dtype=np.float64), np.array([row.value for row in rows])
    ends = np.array([(row.low, row.high, np.nan) for row in rows])
    x = Axis(label, *span([ends.ravel(), value, np.array([1.0, *band])]))
    y = Axis("", -0.5, len(rows) - 0.5, tuple(row.name for row in rows), reverse=True)
    over = np.array([y.low, y.high])
    left, right, low, high = np.array([[*band, y.low, y.high]]).T
    tips = [f"{row.name}: {number(row.value)}, {number(row.low)} to {number(row.high)}" for row in rows]
    marks = (
        Boxes(left, right, low, high, "three", opacity=0.2),
        Line(np.ones(2), over, "muted", width=0.9),
        Line(ends.ravel(), np.repeat(place, 3), "one"),
        Dots(value, place, "one", tips=tips, filled=True),
    )
    return Figure(Chart(x, y, marks, height=max(HEIGHT, 90.0 + 24.0 * len(rows))), name, alt, caption)
