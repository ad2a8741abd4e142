"""A chart as SVG: margins that follow from what is written in them, so that no text lies over another.

Colours are CSS variables in a page, and plain in a file.  Text stays text (selected, searched, printed sharp); nothing
depends on the day, the machine or the process.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from html import escape
from typing import cast

import numpy as np

from ...io.text.visible import visible
from .chart import COLOURS, Arrows, Axis, Chart, Dots, Line, Mark, Role
from .marks import Frame, arrow, drawn, shapes, stroke
from .ticks import ticks

FONT = 12.0
LETTER = 0.56
"""Width of a letter on average, in heights of the font, and a little more."""
GAP, LINE = 6.0, 16.0
EDGE = 12.0
LONGEST_NAME = 24
SLANT = 45.0
"""Degrees by which names of places are turned where they do not fit beside one another."""


def svg_text(charts: Sequence[Chart], name: str) -> str:
    """Charts side by side as an ``<svg>`` element of a page; ``name`` keeps its ids apart from those of others."""
    return visible("".join(_beside(charts, name, "")))


def standalone(charts: Sequence[Chart], name: str) -> str:
    """The same as the text of an SVG file on white ground."""
    text = "".join(_beside(charts, name, '<rect width="100%" height="100%" fill="#ffffff"/>'))
    text = re.sub(r"var\(--(\w+)\)", lambda found: COLOURS[cast("Role", found[1])], text)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{visible(text)}\n'


def _beside(charts: Sequence[Chart], name: str, ground: str) -> Iterator[str]:
    size = sum(chart.width for chart in charts), max((chart.height for chart in charts), default=0.0)
    yield f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]:g} {size[1]:g}" aria-hidden="true" '
    yield f'focusable="false" font-family="system-ui, Liberation Sans, Arial, sans-serif" font-size="{FONT:g}">'
    yield ground
    left = 0.0
    for k, chart in enumerate(charts):
        yield f'<g transform="translate({left:g} 0)">' if left else "<g>"
        yield from _pieces(chart, f"{name}-{k}" if k else name)
        yield "</g>"
        left += chart.width
    yield "</svg>"


def width_of(text: str, size: float = FONT) -> float:
    """About how wide a text is."""
    return LETTER * size * len(text)


def _pieces(chart: Chart, name: str) -> Iterator[str]:
    frame, legend = _framed(chart)
    chart = frame.chart
    yield (
        f'<clipPath id="{name}-inside"><rect x="{frame.left:.1f}" y="{frame.top:.1f}" '
        f'width="{frame.right - frame.left:.1f}" height="{frame.bottom - frame.top:.1f}"/></clipPath>'
    )
    yield from _axes(frame)
    yield f'<g clip-path="url(#{name}-inside)">'
    yield from (drawn(frame, mark) for mark in chart.marks if not isinstance(mark, (Dots, Arrows)))
    yield "</g>"
    for mark in chart.marks:
        if isinstance(mark, Arrows):
            yield f'<g clip-path="url(#{name}-inside)">{drawn(frame, mark)}</g>'
        elif isinstance(mark, Dots):  # whole at the rim
            yield drawn(frame, mark)
    yield from legend


def _framed(chart: Chart) -> tuple[Frame, list[str]]:
    """The frame that leaves room for what is written around it, and the legend above."""
    names = ticks(chart.y, 8)[1] if chart.y.ticks else ()
    left = EDGE + (LINE + GAP if chart.y.label else 0.0) + max(map(width_of, _cut(names)), default=0.0) + GAP
    right = chart.width - EDGE - _overhang(chart.x)
    legend, lines = _legend(chart, right - left)
    top = EDGE + LINE * lines + 0.5 * GAP
    bottom = chart.height - EDGE - (LINE if chart.x.label else 0.0) - _below(chart, right - left)
    frame = Frame(chart, left, right, top, bottom)
    return (replace(frame, chart=_equal(frame)) if chart.equal else frame), legend


def _overhang(axis: Axis) -> float:
    """How far the last name below an axis may reach beyond its end."""
    if axis.names or not axis.ticks:
        return 2.0
    return 0.5 * max(map(width_of, ticks(axis, 8)[1]), default=0.0)


def _equal(frame: Frame) -> Chart:
    """The chart with the axis that has room to spare made longer, so that units are the same length on paper."""
    chart, x, y = frame.chart, frame.chart.x, frame.chart.y
    across, down = (
        (x.high - x.low) / (frame.right - frame.left),
        (y.high - y.low) / (frame.bottom - frame.top),
    )
    unit = max(across, down)
    return replace(
        chart,
        x=_widened(x, unit * (frame.right - frame.left)),
        y=_widened(y, unit * (frame.bottom - frame.top)),
    )


def _widened(axis: Axis, width: float) -> Axis:
    middle = 0.5 * (axis.low + axis.high)
    return replace(axis, low=middle - 0.5 * width, high=middle + 0.5 * width)


def _cut(names: Sequence[str]) -> list[str]:
    return [n if len(n) <= LONGEST_NAME else f"{n[: LONGEST_NAME - 1]}…" for n in names]


def _most(axis: Axis, room: float) -> int:
    """How many ticks an axis of so much width takes."""
    if axis.names:
        return max(1, int(room // LINE))
    return max(2, int(room // (90.0 if axis.dates else 55.0)))


def _slanted(axis: Axis, room: float) -> bool:
    return bool(axis.names) and sum(map(width_of, _cut(axis.names))) + GAP * len(axis.names) > room


def _below(chart: Chart, room: float) -> float:
    """Height of what is written below the axis."""
    if not chart.x.ticks:
        return GAP
    if not _slanted(chart.x, room):
        return LINE + GAP + 2.0
    return GAP + LINE + 2.0 + float(np.sin(np.radians(SLANT))) * max(map(width_of, _cut(chart.x.names)))


def _axes(frame: Frame) -> Iterator[str]:
    """Grid, ticks, labels."""
    chart = frame.chart
    yield '<g style="fill:var(--ink)">'
    if chart.x.ticks:
        yield from _across(frame)
    if chart.y.ticks:
        yield from _upwards(frame)
    yield "</g>"
    yield f'<g style="fill:none;stroke:var(--muted)"><path d="M{frame.left:.1f} {frame.top:.1f}'
    yield f'V{frame.bottom:.1f}H{frame.right:.1f}"/></g><g style="fill:var(--ink)">'
    middle = 0.5 * (frame.left + frame.right)
    if chart.x.label:
        yield _text(chart.x.label, middle, chart.height - EDGE, "middle")
    if chart.y.label:
        at = 0.5 * (frame.top + frame.bottom)
        yield _text(chart.y.label, EDGE + 6.0, at, "middle", f"rotate(-90 {EDGE + 6.0:.1f} {at:.1f})")
    yield "</g>"


def _across(frame: Frame) -> Iterator[str]:
    axis, room = frame.chart.x, frame.right - frame.left
    at, names = ticks(axis, _most(axis, room))
    slanted = _slanted(axis, room)
    for x, name in zip(frame.x(at).tolist(), _cut(names), strict=True):
        y = frame.bottom + LINE
        if not axis.names:
            yield _rule(x, frame.top, x, frame.bottom)
        if slanted:
            yield _text(name, x + 3.0, y - 3.0, "end", f"rotate(-{SLANT:g} {x + 3.0:.1f} {y - 3.0:.1f})")
        else:
            yield _text(name, x, y, "middle")


def _upwards(frame: Frame) -> Iterator[str]:
    axis, room = frame.chart.y, frame.bottom - frame.top
    at, names = ticks(axis, 8 if not axis.names else max(1, int(room // LINE)))
    for y, name in zip(frame.y(at).tolist(), _cut(names), strict=True):
        if not axis.names:
            yield _rule(frame.left, y, frame.right, y)
        yield _text(name, frame.left - GAP, y + 4.0, "end")


def _rule(x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<path style="stroke:var(--grid);stroke-width:.8" d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}"/>'


def _text(text: str, x: float, y: float, anchor: str = "start", turn: str = "") -> str:
    turned = f' transform="{turn}"' if turn else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{turned}>{escape(text)}</text>'


def _legend(chart: Chart, inner: float) -> tuple[list[str], int]:
    """What is written above the frame, which is ``inner`` wide, and in how many lines."""
    found, x, line = ['<g style="fill:var(--ink)">'], EDGE, 1
    if chart.title:
        found.append(_text(_cut([chart.title])[0], EDGE, EDGE + 8.0))
        x += width_of(_cut([chart.title])[0]) + LINE
    for mark in chart.marks:
        if not mark.name:
            continue
        wide = 26.0 + width_of(mark.name) + GAP
        if x > EDGE and x + wide > chart.width:
            x, line = EDGE, line + 1
        y = EDGE + LINE * line - 12.0
        found += [_swatch(mark, x, y), _text(mark.name, x + 22.0, y + 4.0)]
        x += wide
    if chart.key is not None:
        right = chart.width - EDGE - width_of(chart.key.text)
        length = chart.key.share * inner
        if x > right - length - LINE:
            line += 1
        y = EDGE + LINE * line - 12.0
        found += [arrow(right - length - GAP, y, right - GAP, y, "ink")]
        found += [_text(chart.key.text, right, y + 4.0)]
    lines = line if len(found) > 1 else 0
    return [*found, "</g>"] if lines else [], lines


def _swatch(mark: Mark, x: float, y: float) -> str:
    """The mark itself, small."""
    match mark:
        case Dots():
            return shapes(replace(mark, tips=()), np.array([x + 10.0]), np.array([y]))
        case Arrows():
            return arrow(x, y, x + 16.0, y, mark.role)
        case Line():
            return stroke(mark, f"M{x:.1f} {y:.1f}h17")
        case _:
            return (
                f'<rect x="{x:.1f}" y="{y - 5.0:.1f}" width="17" height="10" '
                f'style="fill:var(--{mark.role});opacity:{mark.opacity:g}"/>'
            )
