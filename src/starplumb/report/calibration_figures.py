"""The figures of a calibration's report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..judge.calibrate import Calibration
from ..judge.residuals import rms
from ..physics.earth import itrf_to_geodetic
from ..physics.timescales import format_iso
from ..physics.units import ARCSEC, DEG
from .page import Figure
from .plots import Ellipse, Points, bars, scatter, vectors
from .text import coefficient, length, number

Array = NDArray[np.float64]

AXES = ("x", "y", "z")
NAMED_IMAGES = 24
"""So many images are named below an axis; more are counted."""


def residual_vectors(c: Calibration) -> tuple[Figure, ...]:
    """Over the field of view and over the ground, before and after."""
    r, s = c.residuals, c.campaign.sightings
    pixel = np.stack([s.column_px, s.row_px], axis=-1)
    latitude, longitude, _ = itrf_to_geodetic(c.campaign.landmarks.r_J[s.landmark])
    place = np.stack([longitude, latitude], axis=-1) / DEG
    shown = [("before", r.before_px, r.before_m)]
    if c.status.usable:
        shown.append(("after", r.after_px, r.after_m))
    figures = []
    for when, px, metres in shown:
        figures.append(
            vectors(
                f"field-{when}",
                pixel,
                px,
                ~r.used,
                ("column, px", "row, px"),
                "px",
                f"Residual vectors over the field of view {when} the calibration: {number(rms(px))} px rms per axis.",
                f"Field of view, {when}: {number(rms(px))} px rms per axis. Orange: not used in the solution.",
                downwards=True,
            )
        )
        ground = rms(metres[np.all(np.isfinite(metres), axis=-1)])
        figures.append(
            vectors(
                f"ground-{when}",
                place,
                metres,
                ~r.used,
                ("longitude, deg", "latitude, deg"),
                "m",
                f"Residual vectors on the ground {when} the calibration: {length(ground)} rms per axis.",
                f"Ground, {when}: {length(ground)} rms per axis. Orange: not used in the solution.",
            )
        )
    return tuple(figures)


def trends(c: Calibration) -> tuple[Figure, ...]:
    """Residuals after the calibration against time, latitude and image, with and without the images' own errors."""
    time, start = _time(c)
    latitude = itrf_to_geodetic(c.campaign.landmarks.r_J[c.campaign.sightings.landmark])[0] / DEG
    ids = c.campaign.images.ids
    few = len(ids) <= NAMED_IMAGES
    axes: list[tuple[str, Array, str, Sequence[str]]] = [
        ("time", time, f"seconds after {start} UTC", ()),
        ("latitude", latitude, "latitude, deg", ()),
        (
            "image",
            c.observations.image.astype(np.float64),
            "image" if few else "image, counted from 0",
            [_short(name) for name in ids] if few else (),
        ),
    ]
    return tuple(
        _trend(f"{name}-{kind}", x, px, label, ticks, f"{words} against {name}")
        for name, x, label, ticks in axes
        for kind, px, words in (
            ("all", c.residuals.after_px, "All that is left"),
            ("own", c.residuals.fit_px, "Less the errors that images and markers share"),
        )
    )


def _short(name: str) -> str:
    return name if len(name) <= 16 else f"{name[:15]}…"


def _trend(name: str, x: Array, px: Array, label: str, ticks: Sequence[str], words: str) -> Figure:
    groups = (Points("column", x, px[:, 0]), Points("row", x, px[:, 1]))
    size = f"{number(rms(px))} px rms per axis"
    return scatter(
        f"trend-{name}",
        groups,
        (label, "residual, px"),
        f"{words}: residuals of column and row after the calibration, {size}.",
        f"{words}: {size}.",
        ticks=ticks,
    )


def _time(c: Calibration) -> tuple[Array, str]:
    """Seconds of each exposure after the first image, and the first image's epoch."""
    t_ns = c.campaign.images.t_ns
    first = int(np.min(t_ns))
    time = (t_ns[c.observations.image] - first) * 1e-9
    row = np.where(c.observations.line_period_s > 0.0, c.campaign.sightings.row_px, 0.0)
    return time + row * c.observations.line_period_s, format_iso(np.array([first]), "UTC", 3)[0]


def alignment_ellipses(c: Calibration) -> tuple[Figure, ...]:
    """The estimate's error about pairs of the tracker's axes."""
    assert c.estimate.covariance_E is not None
    covariance = c.estimate.covariance_E / ARCSEC**2
    centre = c.correction_E / ARCSEC
    sigma = np.sqrt(np.diagonal(covariance))
    figures = []
    for i, j in ((0, 1), (0, 2), (1, 2)):
        part = covariance[np.ix_((i, j), (i, j))]
        at = centre[[i, j]]
        correlation = part[0, 1] / np.sqrt(part[0, 0] * part[1, 1])
        words = (
            f"about {AXES[i]} {number(sigma[i])}, about {AXES[j]} {number(sigma[j])} arcsec, "
            f"correlation {coefficient(correlation)}"
        )
        figures.append(
            scatter(
                f"ellipse-{AXES[i]}{AXES[j]}",
                (Points("estimate", at[:1], at[1:]),),
                (f"correction about {AXES[i]}, arcsec", f"correction about {AXES[j]}, arcsec"),
                f"Error ellipse of the correction about {AXES[i]} and {AXES[j]}: {words}.",
                f"Error ellipse about {AXES[i]} and {AXES[j]}: {words}.",
                (
                    Ellipse("39 % (1 sigma)", at, part, 1.0 - np.exp(-0.5)),
                    Ellipse("95 %", at, part, 0.95),
                ),
                equal=True,
            )
        )
    return tuple(figures)


def ground_scatter(c: Calibration) -> tuple[Figure, ...]:
    """East and north errors after the calibration with the ellipse of their scatter."""
    if not c.status.usable:
        return ()
    used, check = c.residuals.used, c.campaign.sightings.check
    groups = [
        Points(name, *c.residuals.after_m[chosen].mT)
        for name, chosen in (("control", used), ("check", check), ("rejected", ~used & ~check))
        if np.any(chosen)
    ]
    control = c.residuals.after_m[used & np.all(np.isfinite(c.residuals.after_m), axis=-1)]
    ellipses = []
    if len(control) > 2:
        spread = np.cov(control.mT)
        ellipses = [Ellipse("90 % of the control points", np.mean(control, axis=0), spread, 0.9)]
    accuracy = c.accuracy(after=True)
    ce90 = "CE90 not known" if accuracy is None else f"CE90 {length(accuracy.ce90)}"
    return (
        scatter(
            "scatter",
            groups,
            ("east, m", "north, m"),
            f"Geolocation errors east and north after the calibration, {ce90}.",
            f"Geolocation error of each sighting after the calibration; {ce90} of the control points.",
            ellipses,
            equal=True,
        ),
    )


def budget(names: Sequence[str], sigma_arcsec: Array) -> tuple[Figure, ...]:
    """Share of each source in the sigma about each axis, (sources, 3) arcsec."""
    return (
        bars(
            "budget",
            names,
            [(f"about {axis}", sigma_arcsec[:, i]) for i, axis in enumerate(AXES)],
            "sigma by this source alone, arcsec",
            "Standard deviation of the alignment about x, y, z by each error source alone.",
            "What each error source alone contributes to the alignment's sigma.",
        ),
    )
