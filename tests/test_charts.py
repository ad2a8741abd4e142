"""Charts: where axes are ticked, that nothing written lies over another, and that rejected points do not scale them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from datetime import UTC, datetime
from itertools import combinations

import numpy as np
import pytest

from starplumb.report.amounts import Histogram, Interval, bars, histogram, histograms, intervals, lines
from starplumb.report.charts.chart import Arrows, Axis, Chart, Dots, span
from starplumb.report.charts.library import figure_of
from starplumb.report.charts.ticks import ticks
from starplumb.report.charts.vector import FONT, svg_text
from starplumb.report.plots import Ellipse, Points, Vectors, scatter, vectors

QUARTERS = ("01", "04", "07", "10")
LETTER = 0.55
"""Width of a letter in heights of the font, on average over a text in DejaVu Sans, a wide font."""


def days(*date):
    return (datetime(*date, tzinfo=UTC) - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() / 86400.0


@pytest.mark.parametrize(
    ("axis", "most", "names"),
    [
        (Axis("", -1.2, 1.2), 5, ["−1.0", "−0.5", "0.0", "0.5", "1.0"]),
        (Axis("", 0.0, 1.0), 4, ["0.00", "0.25", "0.50", "0.75", "1.00"]),
        (Axis("", 12000.0, 0.0 + 12010.0), 5, ["12000", "12002", "12004", "12006", "12008", "12010"]),
        (Axis("", 47.66341, 47.663415), 3, ["47.66341", "47.663412", "47.663414"]),
        (Axis("", 0.5, 2000.0, log=True), 9, ["1", "10", "100", "1000"]),
        (Axis("", 44.0, 170.0, log=True), 9, ["50", "100"]),
        (Axis("", 54.0, 160.0, log=True), 9, ["60", "70", "80", "90", "100"]),
        (Axis("", 0.8, 30.0, log=True), 9, ["1", "2", "5", "10", "20"]),
        (Axis("", -0.5, 3.5, names=("a", "b", "c", "d")), 2, ["a", "c"]),
        (Axis("", days(2024, 11, 20), days(2026, 2, 3), dates=True), 6, [*(f"2025-{m}" for m in QUARTERS), "2026-01"]),
        (Axis("", days(2026, 3, 1), days(2026, 3, 4), dates=True), 5, [f"2026-03-0{d}" for d in range(1, 5)]),
        (Axis("", days(1999, 5, 1), days(2031, 1, 1), dates=True), 8, [f"{y}" for y in range(2000, 2031, 5)]),
    ],
)  # fmt: skip
def test_an_axis_is_ticked_at_round_places(axis, most, names):
    at, found = ticks(axis, most)
    assert list(found) == names
    assert np.all((at >= axis.low - 1e-9) & (at <= axis.high + 1e-9))


def drawn(figure):
    return ET.fromstring(figure.svg)


def turned(element):
    found = re.match(r"rotate\((-?[\d.]+)", element.get("transform", ""))
    return float(found[1]) if found else 0.0


def boxes(svg, letter):
    """Rectangles (x, y, x, y) of the upright texts of a drawing, for letters of a width."""
    for text in svg.iter("{http://www.w3.org/2000/svg}text"):
        if turned(text):
            continue
        x, y, wide = float(text.get("x")), float(text.get("y")), letter * FONT * len(text.text)
        left = x - {"start": 0.0, "middle": 0.5, "end": 1.0}[text.get("text-anchor")] * wide
        yield text.text, (left, y - 0.75 * FONT, left + wide, y + 0.2 * FONT)


def overlap(a, b):
    return min(a[2], b[2]) > max(a[0], b[0]) and min(a[3], b[3]) > max(a[1], b[1])


def every_kind(rng):
    x, y = rng.normal(0.0, 1.0, (2, 40))
    places, errors = rng.uniform(0.0, 12000.0, (40, 2)), rng.normal(0.0, 2.0, (40, 2))
    edges, circle = np.linspace(-4.0, 4.0, 21), Ellipse("39 % (1 sigma)", np.zeros(2), np.eye(2), 0.39)
    names = [f"a source of error {i}" for i in range(9)]
    h = Histogram("h", "error about x, arcsec", edges, np.exp(-0.5 * edges[:-1] ** 2), 1.0)
    groups = [
        Points("column", x, y),
        Points("row", x, -y),
        Points("column, rejected", x, 3.0 * y, apart=True),
    ]
    images = [f"SAT1_20260321T1030{i:02d}" for i in range(12)]
    yield scatter("s", groups, ("east, m", "north, m"), "alt", "caption", [circle], equal=True)
    yield scatter("t", groups, ("image", "residual, px"), "alt", "caption", ticks=images)
    yield vectors(
        "v", [Vectors("control", places, errors)], ("column, px", "row, px"), "px", "alt", "c", True
    )
    yield bars("b", names, [(f"about {k}", np.arange(9.0)) for k in "xyz"], "sigma, arcsec", "alt", "caption")
    yield histogram(h, "alt", "caption")
    yield histograms("hs", [h, h, h], "alt", "caption")
    yield lines(
        "l", [Points("about x", 10.0 ** np.arange(1, 5), np.ones(4))], ("trials", "sigma"), "alt", "c"
    )
    yield intervals("i", [Interval(n, 1.0, 0.9, 1.1) for n in names], (0.95, 1.05), "ratio", "alt", "caption")


@pytest.mark.parametrize("kind", range(8))
def test_what_is_written_in_a_drawing_lies_apart_and_inside(rng, kind):
    figure = list(every_kind(rng))[kind]
    svg = drawn(figure)
    wide, high = map(float, svg.get("viewBox").split()[2:])
    single = len(figure.charts) == 1
    found = list(boxes(svg, LETTER))
    assert len(found) > 6
    if single:
        for (one, a), (other, b) in combinations(found, 2):
            assert not overlap(a, b), f"{one!r} lies over {other!r}"
        for text, (x1, y1, x2, y2) in found:
            assert min(x1, y1, wide - x2, high - y2) >= 0.0, text
    assert [c.tag.rpartition("}")[2] for c in svg][:1] == ["g"]


def test_every_mark_has_its_place():
    """By hand: a chart of 460 x 340 units; the corners of the axes are where the frame's are."""
    corners = Dots(np.array([0.0, 10.0]), np.array([0.0, 5.0]), tips=("low", "high"))
    chart = Chart(Axis("x", 0.0, 10.0), Axis("y", 0.0, 5.0), (corners,))
    svg = ET.fromstring(svg_text((chart,), "c"))
    clip = svg.find(".//{*}clipPath/{*}rect")
    x, y, w, h = (float(clip.get(k)) for k in ("x", "y", "width", "height"))
    titled = {
        p.find("{*}title").text: p.get("d") for p in svg.iter("{http://www.w3.org/2000/svg}path") if len(p)
    }
    at = {name: [float(v) for v in re.match(r"M([\d.]+) ([\d.]+)", d).groups()] for name, d in titled.items()}
    np.testing.assert_allclose(at["low"], [x, y + h], atol=0.1)
    np.testing.assert_allclose(at["high"], [x + w, y], atol=0.1)


def test_a_rejected_point_does_not_scale_the_axes_and_is_counted_at_the_rim(rng):
    x, y = rng.normal(0.0, 1.0, (2, 50))
    wild = Points("rejected", np.array([1e4, 0.5]), np.array([-2e4, 0.1]), apart=True)
    figure = scatter("s", [Points("control", x, y), wild], ("x", "y"), "alt", "caption.")
    (chart,) = figure.charts
    assert max(abs(chart.x.low), chart.x.high) < 4.0
    assert figure.caption == "caption. Crosses at the rim: 1 rejected beyond it."
    rim = [m for m in chart.marks if isinstance(m, Dots) and m.shape == "x"]
    assert [(m.x.tolist(), m.y.tolist()) for m in rim] == [([chart.x.high], [chart.y.low])]
    (rejected,) = [m for m in chart.marks if isinstance(m, Dots) and m.name == "rejected"]
    assert rim[0].role == rejected.role
    three = scatter(
        "s", [Points("control", x, y), Points("check", x, y, (), True), wild], ("x", "y"), "a", "c"
    )
    assert [m.role for m in three.charts[0].marks if m.shape == "x"] == ["three"]
    accepted = scatter("s", [Points("control", x, y), Points("more", wild.x, wild.y)], ("x", "y"), "a", "c")
    assert accepted.charts[0].x.high > 1e4


def test_arrows_are_scaled_by_the_accepted_ones():
    start, one = np.array([[0.0, 0.0], [10.0, 10.0]]), np.array([[1.0, 0.0], [0.0, 1.0]])
    wild = Vectors("rejected", np.array([[5.0, 5.0]]), np.array([[0.0, 4000.0]]), apart=True)
    figure = vectors(
        "v", [Vectors("control", start, one), wild], ("x", "y"), "px", "alt", "caption.", downwards=True
    )
    control, rejected = figure.charts[0].marks
    np.testing.assert_allclose(control.right, [0.09, 0.0])
    np.testing.assert_allclose(control.up, [0.0, -0.09])  # rows grow downwards
    np.testing.assert_allclose(rejected.up, [-0.27])
    assert figure.caption == "caption. 1 arrow (rejected) cut short."
    assert figure.charts[0].key.share == pytest.approx(0.09)
    assert figure.charts[0].key.text == "1 px"
    nameless = vectors(
        "v", [Vectors("", start, one), replace(wild, name="")], ("x", "y"), "px", "alt", "caption."
    )
    assert nameless.caption == "caption. 1 arrow cut short."


def test_arrows_end_at_the_frame_and_crosses_at_the_rim_are_whole():
    arrows = Arrows(np.array([0.9]), np.array([0.9]), np.array([0.5]), np.array([0.5]))
    chart = Chart(Axis("x", 0, 1), Axis("y", 0, 1), (arrows, Dots(np.ones(1), np.ones(1), "two", "x")))
    svg = ET.fromstring(svg_text((chart,), "c"))
    clipped = [g for g in svg.iter("{http://www.w3.org/2000/svg}g") if g.get("clip-path") == "url(#c-inside)"]
    inside = "".join(ET.tostring(g, encoding="unicode") for g in clipped)
    assert "--one" in inside
    assert "--two" not in inside


@pytest.mark.slow
def test_the_library_draws_the_same(rng):
    for figure in every_kind(rng):
        drawing = figure_of(figure.charts)
        assert len(drawing.axes) == len(figure.charts)
        drawing.draw_without_rendering()
        for axes, chart in zip(drawing.axes, figure.charts, strict=True):
            assert axes.get_xlabel() == chart.x.label
            if not chart.equal:
                assert sorted(axes.get_xlim()) == pytest.approx([chart.x.low, chart.x.high])


@pytest.mark.parametrize(("value", "width"), [(47.66342, 4.766342), (3e-13, 1.0), (0.0, 1.0), (-2.0, 0.2)])
def test_values_that_are_alike_have_an_axis_with_ticks_that_differ(value, width):
    """As 500 campaigns at one place of the orbit have: rounding is no span."""
    low, high = span([np.full(5, value) * (1.0 + 1e-15 * np.arange(5))])
    assert high - low == pytest.approx(1.1 * width)
    _, names = ticks(Axis("", low, high), 6)
    assert len(names) == len(set(names)) > 2
