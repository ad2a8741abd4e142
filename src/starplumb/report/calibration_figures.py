"""The figures of a calibration's report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

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
"""Up to this many images are named below an axis; of more their number is given."""


def residual_vectors(
    c: Calibration, where: Literal["image", "ground"], when: Literal["before", "after"]
) -> Figure:
    """Residuals as arrows over the field of view or over the ground."""
    r = c.residuals
    return (_over_the_field if where == "image" else _over_the_ground)(
        c, when, *((r.after_px, r.after_m) if when == "after" else (r.before_px, r.before_m))
    )


def all_residual_vectors(c: Calibration) -> tuple[Figure, ...]:
    """Over the field of view and over the ground, before and after."""
    times: tuple[Literal["before", "after"], ...] = ("before", "after") if c.status.usable else ("before",)
    return tuple(residual_vectors(c, where, when) for when in times for where in ("image", "ground"))


def _over_the_field(c: Calibration, when: str, px: Array, _metres: Array) -> Figure:
    s = c.campaign.sightings
    return vectors(
        f"field-{when}",
        np.stack([s.column_px, s.row_px], axis=-1),
        px,
        ~c.residuals.used,
        ("column, px", "row, px"),
        "px",
        f"Residual vectors over the field of view {when} the calibration: {number(rms(px))} px rms per axis.",
        f"Field of view, {when}: {number(rms(px))} px rms per axis. Orange: not used in the solution.",
        downwards=True,
    )


def _over_the_ground(c: Calibration, when: str, _px: Array, metres: Array) -> Figure:
    latitude, longitude, _ = itrf_to_geodetic(c.campaign.landmarks.r_J[c.campaign.sightings.landmark])
    ground = rms(metres[np.all(np.isfinite(metres), axis=-1)])
    return vectors(
        f"ground-{when}",
        np.stack([longitude, latitude], axis=-1) / DEG,
        metres,
        ~c.residuals.used,
        ("longitude, deg", "latitude, deg"),
        "m",
        f"Residual vectors on the ground {when} the calibration: {length(ground)} rms per axis.",
        f"Ground, {when}: {length(ground)} rms per axis. Orange: not used in the solution.",
    )


def trends(c: Calibration) -> tuple[Figure, ...]:
    """Residuals after the calibration against time, latitude and image, with and without the images' own errors."""
    return tuple(
        trend(c, against, shared_errors)
        for against in ("time", "latitude", "image")
        for shared_errors in (True, False)
    )


def trend(
    c: Calibration, against: Literal["time", "latitude", "image"], shared_errors: bool = True
) -> Figure:
    """Residuals after the calibration against one of the three; ``shared_errors`` says whether the errors that the
    markers of an image share are still in them."""
    ids = c.campaign.images.ids
    ticks: Sequence[str] = ()
    if against == "time":
        x, start = _time(c)
        label = f"seconds after {start} UTC"
    elif against == "latitude":
        x = itrf_to_geodetic(c.campaign.landmarks.r_J[c.campaign.sightings.landmark])[0] / DEG
        label = "latitude, deg"
    else:
        few = len(ids) <= NAMED_IMAGES
        x, label = c.campaign.sightings.image.astype(np.float64), "image" if few else "image, counted from 0"
        ticks = tuple(_short(name) for name in ids) if few else ()
    kind, px, words = (
        ("all", c.residuals.after_px, "All residuals")
        if shared_errors
        else ("own", c.residuals.fit_px, "Without the errors that images and markers share")
    )
    return _trend(f"{against}-{kind}", x, px, label, ticks, f"{words} against {against}")


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
    images = c.campaign.images
    first = int(np.min(images.t_ns))
    exposed = images.exposed(c.observations.image, c.campaign.sightings.row_px)
    return np.asarray(1e-9 * (exposed - first), dtype=np.float64), format_iso(np.array([first]), "UTC", 3)[0]


def alignment_ellipses(c: Calibration) -> tuple[Figure, ...]:
    """The estimate's error about each pair of the tracker's axes."""
    return tuple(alignment_ellipse(c, pair) for pair in ("xy", "xz", "yz"))


def alignment_ellipse(c: Calibration, pair: Literal["xy", "xz", "yz"]) -> Figure:
    """The estimate's error about two of the tracker's axes."""
    assert c.estimate.covariance_E is not None
    i, j = (AXES.index(axis) for axis in pair)
    part = c.estimate.covariance_E[np.ix_((i, j), (i, j))] / ARCSEC**2
    at = c.correction_E[[i, j]] / ARCSEC
    sigma = np.sqrt(np.diagonal(part))
    words = (
        f"about {AXES[i]} {number(sigma[0])}, about {AXES[j]} {number(sigma[1])} arcsec, "
        f"correlation {coefficient(part[0, 1] / (sigma[0] * sigma[1]))}"
    )
    return scatter(
        f"ellipse-{pair}",
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


def ground_scatter(c: Calibration) -> Figure:
    """East and north errors after the calibration with the ellipse of their scatter."""
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
    return scatter(
        "scatter",
        groups,
        ("east, m", "north, m"),
        f"Geolocation errors east and north after the calibration, {ce90}.",
        f"Geolocation error of each sighting after the calibration; {ce90} of the control points.",
        ellipses,
        equal=True,
    )


def by_ellipse(c: Calibration) -> tuple[Figure, ...]:
    """Residuals of marks whose noise is an ellipse, along its axes in units of these; nothing where it is a circle."""
    marks, used = c.campaign.sightings, c.residuals.used
    if marks.ellipse is None or not np.any(used):
        return ()
    values, axes = np.linalg.eigh(marks.ellipse[used])
    along = np.vecdot(axes.mT, c.residuals.fit_px[used][:, None, :])
    across, lengthways = (along / (marks.sigma_px[used, None] * np.sqrt(values))).mT
    circle = Ellipse("95 % where the sigmas are right", np.zeros(2), np.eye(2), 0.95)
    return (
        scatter(
            "by-ellipse",
            [Points("control", lengthways, across)],
            ("along the long axis, sigmas", "along the short axis, sigmas"),
            "Residuals of the marks along the axes of their ellipses, in units of their sigmas.",
            "Residuals, without the errors that images and markers share, along the axes of each mark's own ellipse.",
            [circle],
            equal=True,
        ),
    )


def budget(document: Mapping[str, Any]) -> Figure:
    """Share of each source in the sigma about each axis, of a ``result.json`` that has a budget."""
    sources = document["budget"]
    shares = np.array([row["sigma_arcsec"] for row in sources], dtype=np.float64)
    return bars(
        "budget",
        [row["source"] for row in sources],
        [(f"about {axis}", shares[:, i]) for i, axis in enumerate(AXES)],
        "sigma by this source alone, arcsec",
        "Standard deviation of the alignment about x, y, z by each error source alone.",
        "What each error source alone contributes to the alignment's sigma.",
    )
