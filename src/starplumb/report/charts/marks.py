"""The marks of a chart as SVG within its frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from .chart import Area, Arrows, Axis, Boxes, Chart, Dots, Line, Mark

Array = NDArray[np.float64]

DASHES = {"-": "", "--": "6 4", ":": "1.5 3", "-.": "6 3 1.5 3"}
RADIUS = 3.2
HEAD = 4.5
"""Length of the head of an arrow."""


@dataclass(frozen=True)
class Frame:
    """The inner rectangle of a chart and its axes, in the chart's units."""

    chart: Chart
    left: float
    right: float
    top: float
    bottom: float

    def x(self, values: Array) -> Array:
        return self.left + _share(self.chart.x, values) * (self.right - self.left)

    def y(self, values: Array) -> Array:
        return self.bottom - _share(self.chart.y, values) * (self.bottom - self.top)


def _share(axis: Axis, values: Array) -> Array:
    low, high, at = axis.low, axis.high, np.asarray(values, dtype=np.float64)
    if axis.log:
        low, high, at = float(np.log10(low)), float(np.log10(high)), np.log10(np.maximum(at, 1e-300))
    share = np.asarray((at - low) / ((high - low) or 1.0))
    return 1.0 - share if axis.reverse else share


def drawn(frame: Frame, mark: Mark) -> str:
    match mark:
        case Dots():
            return shapes(mark, frame.x(mark.x), frame.y(mark.y))
        case Line():
            return stroke(mark, _path(frame.x(mark.x), frame.y(mark.y)))
        case Arrows():
            return _arrows(frame, mark)
        case Boxes():
            return _boxes(frame, mark)
        case Area():
            there = _path(frame.x(mark.x), frame.y(mark.high))
            back = _path(frame.x(mark.x[::-1]), frame.y(mark.low[::-1])).replace("M", "L", 1)
            return f'<path style="fill:var(--{mark.role});opacity:{mark.opacity:g}" d="{there}{back}z"/>'


def _path(x: Array, y: Array) -> str:
    """A polyline, begun anew after what is not finite."""
    parts, pen = [], "M"
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if np.isfinite(a) and np.isfinite(b):
            parts.append(f"{pen}{a:.1f} {b:.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(parts)


def stroke(line: Line, path: str) -> str:
    dash = f";stroke-dasharray:{DASHES[line.dash]}" if DASHES[line.dash] else ""
    return f'<path style="fill:none;stroke:var(--{line.role});stroke-width:{line.width:g}{dash}" d="{path}"/>'


_OUTLINES = {
    "o": "m-{r} 0a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0 -{d} 0z",
    ".": "m-{r} 0a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0 -{d} 0z",
    "^": "m0 -{r}l{r} {d}h-{d}z",
    "v": "m0 {r}l{r} -{d}h-{d}z",
    "<": "m-{r} 0l{d} -{r}v{d}z",
    ">": "m{r} 0l-{d} -{r}v{d}z",
    "s": "m-{r} -{r}h{d}v{d}h-{d}z",
    "D": "m0 -{r}l{r} {r}l-{r} {r}l-{r} -{r}z",
    "x": "m-{r} -{r}l{d} {d}m0 -{d}l-{d} {d}",
    "+": "m-{r} 0h{d}m-{r} -{r}v{d}",
    "*": "m-{r} 0h{d}m-{r} -{r}v{d}m-{r} -{r}m-{h} -{h}l{w} {w}m0 -{w}l-{w} {w}",
}


def shapes(mark: Dots, x: Array, y: Array) -> str:
    r = mark.size * (1.6 if mark.shape == "." else RADIUS)
    outline = _OUTLINES[mark.shape].format(r=f"{r:g}", d=f"{2.0 * r:g}", h=f"{0.7 * r:g}", w=f"{1.4 * r:g}")
    fill = f"var(--{mark.role})" if mark.filled or mark.shape == "." else "transparent"
    known = np.isfinite(x) & np.isfinite(y)
    places = [f"M{a:.1f} {b:.1f}{outline}" for a, b in zip(x[known].tolist(), y[known].tolist(), strict=True)]
    tips = [tip for tip, seen in zip(mark.tips, known.tolist(), strict=False) if seen]
    return f'<g style="fill:{fill};stroke:var(--{mark.role})">{_with_tips(places, tips)}</g>'


def _with_tips(paths: Sequence[str], tips: Sequence[str]) -> str:
    """Paths, each with what is read when the pointer rests on it; one for all where there is nothing to read."""
    if not tips:
        return f'<path d="{"".join(paths)}"/>'
    return "".join(
        f'<path d="{path}"><title>{escape(tip)}</title></path>' for path, tip in zip(paths, tips, strict=True)
    )


def arrow(x1: float, y1: float, x2: float, y2: float, role: str) -> str:
    return f'<path style="fill:none;stroke:var(--{role});stroke-width:1.3" d="{_shaft(x1, y1, x2, y2)}"/>'


def _shaft(x1: float, y1: float, x2: float, y2: float) -> str:
    """A line with a head, which is smaller for a short line."""
    dx, dy = x2 - x1, y2 - y1
    length = float(np.hypot(dx, dy))
    if length < 0.3:
        return f"M{x1:.1f} {y1:.1f}h.1"
    head = min(HEAD, 0.45 * length)
    ux, uy = dx / length, dy / length
    back = (
        ((-ux - 0.5 * uy) * head, (-uy + 0.5 * ux) * head),
        ((-ux + 0.5 * uy) * head, (-uy - 0.5 * ux) * head),
    )
    (ax, ay), (bx, by) = back
    return (
        f"M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}M{x2 + ax:.1f} {y2 + ay:.1f}L{x2:.1f} {y2:.1f}"
        f"L{x2 + bx:.1f} {y2 + by:.1f}"
    )


def _arrows(frame: Frame, mark: Arrows) -> str:
    x, y, width = frame.x(mark.x), frame.y(mark.y), frame.right - frame.left
    ends = zip(*(v.tolist() for v in (x, y, x + width * mark.right, y - width * mark.up)), strict=True)
    paths = [_shaft(*end) for end in ends]
    body = _with_tips(paths, mark.tips)
    return f'<g style="fill:none;stroke:var(--{mark.role});stroke-width:1.3">{body}</g>'


def _boxes(frame: Frame, mark: Boxes) -> str:
    x, y = (frame.x(mark.left), frame.x(mark.right)), (frame.y(mark.low), frame.y(mark.high))
    sides = (np.minimum(*x), np.minimum(*y), np.abs(x[1] - x[0]), np.abs(y[1] - y[0]))
    paths = [
        f"M{a:.1f} {b:.1f}h{w:.2f}v{h:.2f}h-{w:.2f}z"
        for a, b, w, h in zip(*(s.tolist() for s in sides), strict=True)
    ]
    return f'<g style="fill:var(--{mark.role});opacity:{mark.opacity:g}">{_with_tips(paths, mark.tips)}</g>'
