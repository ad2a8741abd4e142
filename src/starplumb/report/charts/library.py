"""A chart as a matplotlib figure, for who wants to go on drawing; it touches no state of ``matplotlib.pyplot``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

from ...io.text.libraries import keep_quiet
from .chart import COLOURS, Area, Arrows, Axis, Boxes, Chart, Dots, Line, Mark
from .ticks import ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UNITS_PER_INCH = 100.0
STYLE = {
    "font.family": "sans-serif",
    "font.size": 9.0,
    "text.color": COLOURS["ink"],
    "text.parse_math": False,  # an identifier may hold a dollar sign
    "axes.edgecolor": COLOURS["muted"],
    "axes.labelcolor": COLOURS["ink"],
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.0,
    "axes.unicode_minus": True,
    "figure.facecolor": "none",
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.6,
    "xtick.color": COLOURS["muted"],
    "ytick.color": COLOURS["muted"],
    "xtick.labelcolor": COLOURS["ink"],
    "ytick.labelcolor": COLOURS["ink"],
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.2,
    "svg.fonttype": "none",
    "svg.hashsalt": "starplumb",
}


def figure_of(charts: Sequence[Chart]) -> Figure:
    """Charts side by side as a figure of as many axes."""
    keep_quiet("matplotlib")  # advice about caches, and about fonts
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(cast("Any", STYLE)):
        wide, high = sum(chart.width for chart in charts), max(chart.height for chart in charts)
        figure = Figure(figsize=(wide / UNITS_PER_INCH, high / UNITS_PER_INCH), layout="constrained")
        all_axes = figure.subplots(1, len(charts), squeeze=False)[0]
        for axes, chart in zip(all_axes, charts, strict=True):
            for mark in chart.marks:
                _draw(axes, mark)
            _fit(axes, chart)
        if any(mark.name for mark in charts[0].marks):
            figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
        return figure


def _fit(axes: Axes, chart: Chart) -> None:
    from matplotlib.quiver import Quiver

    for name, axis in (("x", chart.x), ("y", chart.y)):
        ends = (axis.high, axis.low) if axis.reverse else (axis.low, axis.high)
        axes.set(**{f"{name}scale": "log" if axis.log else "linear"})
        axes.set(**{f"{name}lim": ends, f"{name}label": axis.label})
        _tick(axes, name, axis)
    if chart.title:
        axes.set_title(chart.title)
    if chart.key is not None and (arrows := [c for c in axes.collections if isinstance(c, Quiver)]):
        axes.set_title(" ")  # room for the key
        axes.quiverkey(arrows[0], 0.72, 1.04, chart.key.share, chart.key.text, labelpos="E")
    if chart.equal:
        axes.set_aspect("equal", adjustable="datalim")


def _tick(axes: Axes, name: str, axis: Axis) -> None:
    which = axes.xaxis if name == "x" else axes.yaxis
    if not axis.ticks:
        which.set_ticks([])
    elif axis.dates:
        which.axis_date()
    elif axis.names:
        at, names = ticks(axis, len(axis.names))
        turned = 60 if name == "x" and max(map(len, names)) > 2 else 0
        which.set_ticks(at.tolist(), list(names), rotation=turned)


def _draw(axes: Axes, mark: Mark) -> None:
    colour, name = COLOURS[mark.role], mark.name or None
    match mark:
        case Dots():
            fill = "full" if mark.filled or mark.shape == "." else "none"
            axes.plot(
                mark.x,
                mark.y,
                mark.shape,
                color=colour,
                markersize=3.5 * mark.size,
                label=name,
                fillstyle=fill,
            )
        case Line():
            axes.plot(mark.x, mark.y, mark.dash, color=colour, linewidth=mark.width, label=name)
        case Arrows():
            where = (mark.x, mark.y, mark.right, mark.up)
            axes.quiver(*where, color=colour, scale=1.0, scale_units="width", width=0.004, label=name)
        case Area():
            axes.fill_between(mark.x, mark.low, mark.high, color=colour, alpha=mark.opacity, lw=0, label=name)
        case Boxes():
            wide, high = mark.right - mark.left, mark.high - mark.low
            axes.bar(
                mark.left, high, wide, mark.low, align="edge", color=colour, alpha=mark.opacity, label=name
            )
