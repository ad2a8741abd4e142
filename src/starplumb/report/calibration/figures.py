"""The figures of a calibration's report: what is also returned to a session."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...judge.calibrate import Calibration
from ...judge.residuals import rms
from ...physics.earth import itrf_to_geodetic
from ...physics.timescales import format_iso
from ...physics.units import ARCSEC, DEG
from ..amounts import bars
from ..page import Figure
from ..plots import Ellipse, Points, Vectors, scatter, vectors
from ..text import coefficient, length, number

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

AXES = ("x", "y", "z")
NAMED_IMAGES = 24
"""Up to this many images are named below an axis; of more their number is given."""


def roles(c: Calibration) -> Iterator[tuple[str, Mask]]:
    """Names of the sightings' roles and which sightings have them: those in the solution first."""
    used, check = c.residuals.used, c.campaign.sightings.check
    for name, chosen in (("control", used), ("check", check), ("rejected", ~used & ~check)):
        if np.any(chosen):
            yield name, chosen


def tips(c: Calibration, chosen: Mask, values: Array, unit: str) -> list[str]:
    """What is read of a sighting: image, marker, and the size (n,) or (n, 2) of what is drawn."""
    s, size = c.campaign.sightings, np.hypot(*values.mT) if values.ndim == 2 else values
    images, landmarks = c.campaign.images.ids, c.campaign.landmarks.ids
    return [
        f"{images[s.image[i]]}, {landmarks[s.landmark[i]]}: {number(float(size[i]))} {unit}"
        for i in np.flatnonzero(chosen)
    ]


def residual_vectors(
    c: Calibration,
    where: Literal["image", "ground"],
    when: Literal["before", "after"],
) -> Figure:
    """Residuals as arrows over the field of view or over the ground."""
    r = c.residuals
    px, metres = (r.after_px, r.after_m) if when == "after" else (r.before_px, r.before_m)
    if where == "image":
        words = f"Residuals over the field of view {when} the calibration"
        return over_the_field(c, f"field-{when}", px, words)
    return _over_the_ground(c, when, metres)


def all_residual_vectors(c: Calibration) -> tuple[Figure, ...]:
    """Over the field of view and over the ground, before and after."""
    times: tuple[Literal["before", "after"], ...] = ("before", "after") if c.status.usable else ("before",)
    return tuple(residual_vectors(c, where, when) for when in times for where in ("image", "ground"))


def over_the_field(c: Calibration, name: str, px: Array, words: str) -> Figure:
    """Residuals (n, 2) px of all sightings over the field of view."""
    s = c.campaign.sightings
    places = np.stack([s.column_px, s.row_px], axis=-1)
    groups = [_arrows(c, role, chosen, places, px, "px") for role, chosen in roles(c)]
    text = f"{words}: {_size(c, px)}."
    return vectors(name, groups, ("column, px", "row, px"), "px", text, text, downwards=True)


def _size(c: Calibration, px: Array) -> str:
    """The rms of the sightings that it speaks of, and how many these are."""
    used = c.residuals.used
    if not np.any(used):
        return "no sighting in the solution"
    return f"{number(rms(px[used]))} px rms per axis of the {int(np.sum(used))} in the solution"


def _arrows(c: Calibration, role: str, chosen: Mask, places: Array, values: Array, unit: str) -> Vectors:
    read = tips(c, chosen, values, unit)
    return Vectors(role, places[chosen], values[chosen], read, apart=role != "control")


def _over_the_ground(c: Calibration, when: str, metres: Array) -> Figure:
    latitude, longitude, _ = itrf_to_geodetic(c.campaign.landmarks.r_J[c.campaign.sightings.landmark])
    places = np.stack([longitude, latitude], axis=-1) / DEG
    known = c.residuals.used & np.all(np.isfinite(metres), axis=-1)
    text = (
        f"Residuals on the ground {when} the calibration: {length(rms(metres[known]))} rms per axis "
        f"of the {int(np.sum(known))} in the solution."
    )
    groups = [_arrows(c, role, chosen, places, metres, "m") for role, chosen in roles(c)]
    return vectors(f"ground-{when}", groups, ("longitude, deg", "latitude, deg"), "m", text, text)


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
        ticks = ids if few else ()
    kind, px, words = (
        ("all", c.residuals.after_px, "All residuals")
        if shared_errors
        else ("own", c.residuals.fit_px, "Without the errors that images and markers share")
    )
    text = f"{words} against {against}: {_size(c, px)}."
    groups = [
        Points(
            _named(part, role), x[chosen], px[chosen, k], tips(c, chosen, px[:, k], "px"), role != "control"
        )
        for role, chosen in (("control", c.residuals.used), *_apart(c))
        for k, part in ((0, "column"), (1, "row"))
        if np.any(chosen)
    ]
    return scatter(f"trend-{against}-{kind}", groups, (label, "residual, px"), text, text, ticks=ticks)


def _apart(c: Calibration) -> list[tuple[str, Mask]]:
    """Those that were rejected; sightings kept for checking are left to the figures that show places."""
    return [(role, chosen) for role, chosen in roles(c) if role == "rejected"]


def _named(part: str, role: str) -> str:
    return part if role == "control" else f"{part}, {role}"


def _time(c: Calibration) -> tuple[Array, str]:
    """Seconds of each exposure after the first image, and the first image's epoch."""
    images = c.campaign.images
    first = int(np.min(images.t_ns))
    exposed = images.exposed(c.campaign.sightings.image, c.campaign.sightings.row_px)
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
    errors = c.residuals.after_m
    groups = [
        Points(name, errors[chosen, 0], errors[chosen, 1], tips(c, chosen, errors, "m"), name != "control")
        for name, chosen in roles(c)
    ]
    control = errors[c.residuals.used & np.all(np.isfinite(errors), axis=-1)]
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
