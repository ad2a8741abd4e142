"""Drawings of places: arrows, points, ellipses.  Those of amounts are in :mod:`.amounts`.

Each takes plain arrays in the units of its axes and returns a :class:`~starplumb.report.page.Figure`.  What is not
finite is left out; of very many points only some are drawn, and the caption says so.  Axes are those of what is
accepted: what stands apart (rejected, or kept for checking) and lies beyond is shown at the rim and counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .charts.chart import (
    SERIES,
    SHAPES,
    Arrows,
    Axis,
    Chart,
    Dash,
    Dots,
    Key,
    Line,
    Mark,
    span,
)
from .page import Figure
from .text import counted, number

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DRAWN_AT_MOST = 600
"""Points or arrows in one drawing: more could not be told apart and would load slowly."""
WORST = 20
"""So many of them are the largest; more would show another distribution than there is."""
LONG_ARROW = 0.09
"""Length of the 90 % longest arrow, as a share of the width of the drawing."""
CUT = 3.0
"""Arrows apart that are so many times longer are cut to this."""
AROUND = 1.5
"""What stands apart and lies within so many times the extent of the others has its true place."""
DASHES: tuple[Dash, ...] = ("-", "--", ":", "-.")
SQUARE = 3.0
"""Ratio of sides up to which a field of view is drawn in its own form."""


@dataclass(frozen=True)
class Points:
    """A named group of points: ``x``, ``y`` (n,), with ``tips`` (n) to read; ``apart`` ones do not scale the axes."""

    name: str
    x: Array
    y: Array
    tips: Sequence[str] = ()
    apart: bool = False


@dataclass(frozen=True)
class Vectors:
    """A named group of arrows (n, 2) from places (n, 2); likewise."""

    name: str
    start: Array
    vector: Array
    tips: Sequence[str] = ()
    apart: bool = False


@dataclass(frozen=True)
class Ellipse:
    """A named ellipse about ``centre`` (2,) that holds ``probability`` of a normal error of covariance (2, 2)."""

    name: str
    centre: Array
    covariance: Array
    probability: float


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


def _some(tips: Sequence[str], rows: NDArray[np.int64]) -> Sequence[str]:
    return [tips[i] for i in rows.tolist()] if len(tips) else ()


def limits(
    accepted: Sequence[Array], apart: Sequence[Array], margin: float = 0.08, least: float = 0.0
) -> tuple[float, float]:
    """Ends of an axis for what is accepted, and for what is apart and lies near it; for all where none is accepted."""
    if not any(np.any(np.isfinite(values)) for values in accepted):
        return span(apart, margin, least)
    low, high = span(accepted, 0.5 * (AROUND - 1.0), least)
    near = [values[(values >= low) & (values <= high)] for values in apart]
    return span([*accepted, *near], margin, least)


def _rim(groups: Sequence[Points | Vectors], x: Axis, y: Axis) -> tuple[list[Mark], str]:
    """Marks at the rim, in the colour of their group, for what is apart and beyond the axes; and how many are."""
    marks: list[Mark] = []
    words = []
    for group, role in zip(groups, SERIES, strict=False):
        if not group.apart:
            continue
        across, up = group.start.mT if isinstance(group, Vectors) else (group.x, group.y)
        beyond = (across < x.low) | (across > x.high) | (up < y.low) | (up > y.high)
        if np.any(beyond):
            at = np.clip(across[beyond], x.low, x.high), np.clip(up[beyond], y.low, y.high)
            marks.append(Dots(*at, role, "x"))
            words.append(f"{int(np.sum(beyond))} {group.name}".strip())
    return marks, f" Crosses at the rim: {', '.join(words)} beyond it." if words else ""


def vectors(
    name: str,
    groups: Sequence[Vectors],
    labels: tuple[str, str],
    unit: str,
    alt: str,
    caption: str,
    downwards: bool = False,
    ground: Sequence[Mark] = (),
    long: float | None = None,
) -> Figure:
    """Groups of arrows over what lies under them; a key tells their scale, which is that of the accepted ones, or that
    of another drawing whose ``long`` arrow is given."""
    groups = [_known(group) for group in groups]
    core = [g for g in groups if not g.apart] or groups
    length = np.concatenate([np.hypot(*g.vector.mT) for g in core] or [np.empty(0)])
    if long is None:
        long = float(np.quantile(length, 0.9)) if length.size else 1.0
    scale = LONG_ARROW / (long or 1.0)
    x, y = (Axis(labels[k], *_ends(groups, k), reverse=downwards and k == 1) for k in (0, 1))
    marks, remark = [*ground], ""
    for group, role in zip(groups, SERIES, strict=False):
        chosen, left = thinned(np.hypot(*group.vector.mT))
        drawn, cut = _shortened(group, chosen, long)
        remark += left + cut
        x0, y0, right, up = *group.start[chosen].mT, *(scale * drawn.mT)
        marks.append(
            Arrows(
                x0,
                y0,
                right,
                -up if downwards else up,
                role,
                group.name,
                _some(group.tips, chosen),
            )
        )
    rim, beyond = _rim(groups, x, y)
    key = _round_down(long)
    square = 1.0 / SQUARE < (y.high - y.low) / (x.high - x.low) < SQUARE
    chart = Chart(
        x,
        y,
        (*_inside(marks, x, y), *rim),
        equal=downwards and square,
        key=Key(scale * key, f"{number(key, 1)} {unit}"),
    )
    return Figure(chart, name, alt, caption + remark + beyond)


def _known(group: Vectors) -> Vectors:
    finite = np.all(np.isfinite(group.start) & np.isfinite(group.vector), axis=-1)
    rows = np.flatnonzero(finite)
    return replace(group, start=group.start[rows], vector=group.vector[rows], tips=_some(group.tips, rows))


def _ends(groups: Sequence[Vectors], k: int) -> tuple[float, float]:
    return limits(
        [g.start[:, k] for g in groups if not g.apart], [g.start[:, k] for g in groups if g.apart], 0.12
    )


def _shortened(group: Vectors, chosen: NDArray[np.int64], long: float) -> tuple[Array, str]:
    """The chosen arrows of a group; those apart that are very long keep their direction only."""
    vector = group.vector[chosen]
    if not group.apart or not long > 0.0:
        return vector, ""
    ratio = np.hypot(*vector.mT) / (CUT * long)
    cut = int(np.sum(ratio > 1.0))
    whose = f" ({group.name})" if group.name else ""
    words = f" {counted(cut, 'arrow')}{whose} cut short." if cut else ""
    return vector / np.maximum(ratio, 1.0)[:, None], words


def _inside(marks: Sequence[Mark], x: Axis, y: Axis) -> list[Mark]:
    """Arrows that begin beyond the axes are left to the marks at the rim."""
    return [_kept(mark, x, y) if isinstance(mark, (Arrows, Dots)) else mark for mark in marks]


def _kept(mark: Arrows | Dots, x: Axis, y: Axis) -> Mark:
    rows = np.flatnonzero((mark.x >= x.low) & (mark.x <= x.high) & (mark.y >= y.low) & (mark.y <= y.high))
    tips = _some(mark.tips, rows)
    if isinstance(mark, Dots):
        return replace(mark, x=mark.x[rows], y=mark.y[rows], tips=tips)
    return replace(mark, x=mark.x[rows], y=mark.y[rows], right=mark.right[rows], up=mark.up[rows], tips=tips)


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
    curves: Sequence[Mark] = (),
) -> Figure:
    """Groups of points, each in its colour and marker, with ellipses and curves; ``ticks`` name whole numbers of x."""
    outlines = [outline(e) for e in ellipses]
    lines = [
        Line(edge[:, 0], edge[:, 1], "ink", dash, e.name)
        for e, edge, dash in zip(ellipses, outlines, DASHES, strict=False)
    ]
    x, y = (Axis(labels[k], *_extent(groups, outlines, k)) for k in (0, 1))
    if ticks:
        x = replace(x, low=-0.5, high=len(ticks) - 0.5, names=tuple(ticks))
    marks, remark = [*curves], ""
    for group, role, shape in zip(groups, SERIES, SHAPES, strict=False):
        rows = np.flatnonzero(np.isfinite(group.x) & np.isfinite(group.y))
        chosen, left = thinned(np.abs(group.y[rows]))
        remark, rows = remark or left, rows[chosen]
        marks.append(Dots(group.x[rows], group.y[rows], role, shape, group.name, _some(group.tips, rows)))
    rim, beyond = _rim(groups, x, y)
    if len(groups) + len(ellipses) + sum(bool(mark.name) for mark in curves) < 2:
        marks = [replace(mark, name="") for mark in marks]
    chart = Chart(x, y, (*_inside(marks, x, y), *lines, *rim), equal=equal)
    return Figure(chart, name, alt, caption + remark + beyond)


def _extent(groups: Sequence[Points], outlines: Sequence[Array], k: int) -> tuple[float, float]:
    """Ends of the axis x (0) or y (1)."""
    pick = [(g.apart, (g.x, g.y)[k]) for g in groups]
    edges = [edge[:, k] for edge in outlines]
    return limits([*(v for apart, v in pick if not apart), *edges], [v for apart, v in pick if apart])


def outline(ellipse: Ellipse) -> Array:
    """Points (k, 2) of an ellipse: ``centre + sqrt(q) S (cos, sin)``, S S = covariance, q = -2 ln(1 - probability)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    values, axes = np.linalg.eigh(ellipse.covariance)
    root = (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.mT
    return np.asarray(ellipse.centre + np.sqrt(-2.0 * np.log1p(-ellipse.probability)) * circle @ root)
