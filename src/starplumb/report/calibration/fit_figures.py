"""Figures of how well the residuals are those that the stated sigmas promise, and what the optics leave in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...judge.calibrate import Calibration
from ...judge.residuals import rms
from ..amounts import histogram, normalised
from ..charts.chart import Area, Line, span
from ..page import Figure
from ..plots import Points, Vectors, scatter, thinned, vectors
from ..text import number
from .figures import over_the_field, roles, tips

Array = NDArray[np.float64]

PANELS = 12
"""Images that have a panel of their own; of more those whose own residuals are largest."""
CELLS, FEWEST = 6, 5
"""Cells across the field of view over which residuals are averaged, and sightings that such a mean needs."""
WIDEST = 5.0
FAR = 3.2905
"""A normal residual is farther than so many sigmas once in a thousand."""


def own_over_the_field(c: Calibration) -> tuple[Figure, ...]:
    """Residuals without what images and markers share: what is left of the optics; and their means over cells."""
    words = "Own residuals over the field of view, without the errors that images and markers share"
    return (over_the_field(c, "field-own", c.residuals.fit_px, words), *_means(c))


def _means(c: Calibration) -> tuple[Figure, ...]:
    """Means over the cells of the field of view, with their standard errors in the tips; nothing of few sightings."""
    s, used, px = c.campaign.sightings, c.residuals.used, c.residuals.fit_px
    if np.sum(used) < FEWEST * CELLS:
        return ()
    across, down = _cell(s.column_px[used]), _cell(s.row_px[used])
    cell, counts = np.unique(across * CELLS + down, return_counts=True)
    rows = [np.flatnonzero(across * CELLS + down == k) for k in cell[counts >= FEWEST]]
    if len(rows) < 2:
        return ()
    places = np.stack([s.column_px[used], s.row_px[used]], axis=-1)
    at, mean = (np.array([values[r].mean(axis=0) for r in rows]) for values in (places, px[used]))
    error = np.array([px[used][r].std(axis=0, ddof=1) / np.sqrt(r.size) for r in rows])
    read = [
        f"column {number(m[0])} ± {number(e[0], 2)} px, row {number(m[1])} ± {number(e[1], 2)} px of {r.size}"
        for m, e, r in zip(mean, error, rows, strict=True)
    ]
    size = np.sqrt(np.mean((mean / np.maximum(error, 1e-12)) ** 2))
    text = (
        f"Means of the own residuals in {len(rows)} parts of the field of view: {number(rms(mean))} px rms, "
        f"{number(float(size), 2)} times their standard errors (about 1 where the optics are known)."
    )
    labels = ("column, px", "row, px")
    return (
        vectors("field-means", [Vectors("mean", at, mean, read)], labels, "px", text, text, downwards=True),
    )


def _cell(place: Array) -> NDArray[np.int64]:
    low, high = float(place.min()), float(place.max())
    return np.minimum((CELLS * (place - low) / ((high - low) or 1.0)).astype(np.int64), CELLS - 1)


def standardised(c: Calibration) -> Array:
    """Residuals (k,) of columns and rows in the solution over the sigma of each: with what the solution took of it
    where the method says that, else over the pixel's."""
    used = c.residuals.used
    if c.snooping is not None:
        z = c.snooping.w[used]
    else:
        z = c.residuals.fit_px[used] / c.campaign.sightings.sigma_px[used, None]
    return np.asarray(z[np.isfinite(z)])


def normality(c: Calibration) -> tuple[Figure, ...]:
    """Standardised residuals beside the normal law: their histogram and their quantiles."""
    z = standardised(c)
    if z.size < 8:
        return ()
    far, expected = int(np.sum(np.abs(z) > FAR)), 1e-3 * z.size
    words = (
        f"{z.size} standardised residuals of columns and rows in the solution: standard deviation "
        f"{number(float(np.sqrt(np.mean(z**2))))} (1 where the stated sigmas are right); beyond {FAR:.1f} sigmas "
        f"{far}, where {number(expected, 2)} are expected"
    )
    h = normalised("standardised", "standardised residual", z, WIDEST)
    bars = histogram(h, f"Histogram of {words}.", f"{words}.")
    return (bars, _quantiles(z))


def _quantiles(z: Array) -> Figure:
    """The quantiles against those of the normal law, with the band of 95 % of samples of so many independent ones."""
    from ...solve.probability import betaincinv, ndtri

    z = np.sort(z)
    rank = np.arange(1.0, z.size + 1.0)
    x = ndtri((rank - 0.375) / (z.size + 0.25))
    low, high = (ndtri(betaincinv(rank, z.size + 1.0 - rank, p)) for p in (0.025, 0.975))
    outside = float(np.mean((z < low) | (z > high)))
    ends = np.array(span([x]))
    band = (Area(x, low, high, "muted", "95 % of normal samples", 0.2), Line(ends, ends, "muted", width=1.0))
    text = (
        f"Quantiles of the standardised residuals against those of the normal law: {100.0 * outside:.0f} % of them lie "
        "outside the band, which is drawn for residuals that know nothing of each other."
    )
    chosen, _ = thinned(np.abs(z))
    dots = Points("residuals", x[chosen], z[chosen])
    return scatter("quantiles", [dots], ("normal quantile", "residual"), text, text, curves=band)


def image_panels(c: Calibration) -> tuple[Figure, ...]:
    """The own residuals of each image over the field of view, all to one scale."""
    image, used, px = c.campaign.sightings.image, c.residuals.used, c.residuals.fit_px
    images = np.unique(image[used])
    if images.size < 2:
        return ()
    size = np.array([rms(px[used & (image == i)]) for i in images])
    shown = np.sort(images[np.argsort(-size, kind="stable")[:PANELS]])
    long = float(np.quantile(np.hypot(*px[used].mT), 0.9))
    return tuple(_panel(c, int(i), long) for i in shown)


def _panel(c: Calibration, image: int, long: float) -> Figure:
    s, px = c.campaign.sightings, c.residuals.fit_px
    name = c.campaign.images.ids[image]
    places = np.stack([s.column_px, s.row_px], axis=-1)
    groups = []
    for role, chosen in roles(
        c
    ):  # also those that this image has none of: colours are those of the figure above
        mine = chosen & (s.image == image)
        groups.append(Vectors(role, places[mine], px[mine], tips(c, mine, px, "px"), role != "control"))
    mine = c.residuals.used & (s.image == image)
    text = f"{name}: {number(rms(px[mine]))} px rms per axis of {int(np.sum(mine))}."
    figure = vectors(f"image-{image}", groups, ("", ""), "px", text, text, downwards=True, long=long)
    (chart,) = figure.charts
    bare = replace(
        chart,
        x=replace(chart.x, ticks=False),
        y=replace(chart.y, ticks=False),
        marks=tuple(replace(mark, name="") for mark in chart.marks),
        width=230.0,
        height=190.0,
    )
    return replace(figure, chart=bare)
