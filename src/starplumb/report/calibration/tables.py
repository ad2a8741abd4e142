"""The tables and sentences of a calibration's report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...ground.intersection import Intersections, intersect
from ...judge.calibrate import Calibration
from ...judge.residuals import Accuracy
from ...physics.units import ARCSEC, DEG
from ..page import UNDATED, Table
from ..text import NOT_STATED, coefficient, length, listed, number, rotation_forms

Array = NDArray[np.float64]
Document = Mapping[str, Any]


def alignment(c: Calibration, document: Document) -> tuple[Table, ...]:
    """Correction, sigma and correlations; the truth beside them where it is known."""
    tracker = document["mounting"]["to"]
    if document["correction_arcsec"] is None:
        return ()
    rows = [("correction", *(number(x, 6) for x in document["correction_arcsec"]))]
    sigma, covariance = document["sigma_arcsec"], c.covariance_E
    of_sigma = [("sigma", *((NOT_STATED,) * 3 if sigma is None else (number(x, 3) for x in sigma)))]
    data = document.get("sigma_from_data_arcsec")
    if data is not None and sigma is not None:
        first = any(own > stated for own, stated in zip(data, sigma, strict=True))  # the larger leads
        of_sigma.insert(0 if first else 1, ("sigma from the data", *(number(x, 3) for x in data)))
        rough = document["jackknife_sigma_arcsec"]
        of_sigma.append((f"the same by leaving out one {_left(c)} each", *(number(x, 2) for x in rough)))
    rows += of_sigma
    if document["interval_95_arcsec"] is not None:
        rows.append(("95 % interval, ±", *(number(x, 3) for x in document["interval_95_arcsec"])))
    further = document.get("next_session")
    if further:
        half = (number(x, 3) for x in further["interval_95_arcsec"])
        rows.append((f"95 % interval at the next {further['of']}, ±", *half))
    truth = document.get("truth")
    if truth:
        rows.append(("true correction", *(number(x, 6) for x in truth["correction_arcsec"])))
        rows.append(("error", *(number(x, 3) for x in truth["error_arcsec"])))
        if truth["error_over_sigma"]:
            rows.append(("error / sigma", *(number(x, 2) for x in truth["error_over_sigma"])))
    head = ("arcsec", "about x", "about y", "about z")
    found = [Table(f"Correction of the mounting about the axes of {tracker}", head, rows)]
    if covariance is not None and c.status.usable:
        s = np.sqrt(np.diagonal(covariance))
        correlation = covariance / np.outer(s, s)
        names = ("x", "y", "z")
        cells = [(names[i], *map(coefficient, correlation[i])) for i in range(3)]
        found.append(Table("Correlation of the three angles", ("", *names), cells))
    return tuple(found)


def _left(c: Calibration) -> str:
    return "image" if c.from_data is None else c.from_data.left


def sources(document: Document) -> tuple[Table, ...]:
    """What the data say of each source of error."""
    rows = [
        (
            str(s["name"]),
            f"{number(s['stated'])} {s['unit']}" if s["stated"] else NOT_STATED,
            f"{number(s['found'])} {s['unit']}",
            number(s["ratio"], 2),
            "–"
            if s["ratio_interval_95"] is None
            else " to ".join(number(x, 2) for x in s["ratio_interval_95"]),
            number(s["p"], 2),
        )
        for s in document["sources"]
    ]
    head = ("source of error", "stated", "from the data", "ratio", "95 % interval", "p")
    note = (
        "From the scatter of the images and of the sightings within them; p is the probability of at least such a "
        "scatter if the source is as stated."
    )
    return (Table("Errors as stated and as the data show them", head, rows, note=note),) if rows else ()


def motion(document: Document) -> tuple[Table, ...]:
    """Tests of a mounting that moves."""
    found = document.get("motion")
    if not found:
        return ()
    rows = [
        (", ".join(test["columns"]), number(test["p"], 2), number(test["detectable_arcsec"], 3))
        for test in found["tests"]
    ]
    note = (
        "p is the probability of any such finding, over all that is tried, where the mounting rests; the amplitude, "
        "about each axis, is that which the test finds with 90 % probability: of a sine, of the whole change over the "
        "span, of a step in the middle, of half the change over the range of a temperature."
    )
    return (Table("Does the mounting move?", ("with", "p", "found from, arcsec"), rows, note=note),)


def mounting_words(document: Document) -> str:
    camera, tracker = document["mounting"]["from"], document["mounting"]["to"]
    return (
        f"The rotation C takes coordinates in the frame {camera} to those in {tracker}: v_tracker = C v_camera. "
        "The camera's x is to the right (growing column), y down (growing row), z along the boresight to the scene. "
        "Quaternions are Hamilton's, q v q* = C v; Euler angles give C = Rz Ry Rx. The correction d is applied as "
        f"C_after = exp(d) C_before, with d along the axes of {tracker}."
    )


def mounting(c: Calibration, document: Document) -> tuple[Table, ...]:
    """The model mounting and the estimate in each convention."""
    found = [("before", rotation_forms(c.campaign.C_EK))]
    if c.status.usable:
        found.append(("after", rotation_forms(c.estimate.C_EK)))
    rows = [(name, when, *forms[name]) for name in found[0][1] for when, forms in found]
    camera, tracker = document["mounting"]["from"], document["mounting"]["to"]
    head = ("convention", "when", "1", "2", "3", "4")
    return (Table(f"Mounting from {camera} to {tracker}", head, rows, text_columns=2),)


def knowledge(C_EK: Array, covariance_E: Array) -> tuple[str, ...]:
    """The best and the worst known directions, in the axes of the camera."""
    values, vectors = np.linalg.eigh(C_EK.mT @ covariance_E @ C_EK)
    sigma = np.sqrt(np.maximum(values, 0.0)) / ARCSEC
    best, worst = (_direction(vectors[:, i]) for i in (0, 2))
    return (
        f"In the axes of the camera the rotation about {best} is known best, to {number(sigma[0])} arcsec, and about "
        f"{worst} worst, to {number(sigma[2])} arcsec: {number(sigma[2] / max(sigma[0], 1e-300), 2)} times less well.",
    )


def _direction(axis_K: Array) -> str:
    """An axis of the camera in words: the nearest of x, y and the boresight, and how far off it is."""
    names = ("its x (along a row)", "its y (down a column)", "its boresight z")
    k = int(np.argmax(np.abs(axis_K)))
    off = float(np.arccos(min(abs(float(axis_K[k])), 1.0)) / DEG)
    return names[k] if off < 1.0 else f"an axis {number(off, 2)} deg from {names[k]}"


def geolocation(c: Calibration) -> tuple[Table, ...]:
    """Horizontal errors of single sightings and errors of intersected lines, before and after."""
    rows = []
    for name, check in (("control points", False), ("check points", True)):
        for when, after in (("before", False), ("after", True)):
            rows += _accuracy_row(
                name, when, c.accuracy(after, check) if c.status.usable or not after else None
            )
    control = c.residuals.used
    for name, chosen in (
        ("control points, several images", control),
        ("check points, several images", c.check),
    ):
        for when, C_EK in (("before", c.campaign.C_EK), ("after", c.estimate.C_EK)):
            if c.status.usable or when == "before":
                rows += _intersection_row(name, when, intersect(c.campaign, C_EK, chosen))
    head = ("points", "when", "number", "rms", "CE90", "LE90")
    return (Table("Geolocation error at the markers", head, rows, text_columns=2),)


def _accuracy_row(name: str, when: str, accuracy: Accuracy | None) -> list[tuple[str, ...]]:
    if accuracy is None:
        return []
    return [(name, when, str(accuracy.n), length(accuracy.rmse), length(accuracy.ce90), "–")]


def _intersection_row(name: str, when: str, found: Intersections) -> list[tuple[str, ...]]:
    if found.landmark.size == 0:
        return []
    horizontal = float(np.sqrt(np.mean(np.sum(found.error_T[:, :2] ** 2, axis=-1))))
    return [
        (name, when, str(found.landmark.size), length(horizontal), length(found.ce90), length(found.le90))
    ]


def geolocation_words(c: Calibration) -> tuple[str, ...]:
    """What CE90 and LE90 are of, and why LE90 is missing where it is."""
    words = (
        "Each sighting is taken down to the ground at its marker's own height; CE90 is the radius that holds 90 % of "
        "the horizontal errors."
    )
    if intersect(c.campaign, c.campaign.C_EK, c.residuals.used).landmark.size:
        return (f"{words} LE90 is that of heights where the lines of sight of several images meet.",)
    return (
        f"{words} There is no LE90: no marker is seen from directions 5 deg or more apart, "
        "and one line of sight has no height of its own.",
    )


def fit_words(document: Document) -> tuple[str, ...]:
    """Chi-square, residuals and iterations in a sentence."""
    fit = document["fit"]
    if fit["chi2"] is None:
        chi2 = "The method has no chi-square."
    else:
        chi2 = (
            f"Chi-square is {number(fit['chi2'], 4)} for {fit['degrees_of_freedom']} degrees of freedom; a value at "
            f"least this large has probability {number(fit['chi2_p'], 2)} when the stated sigmas are right."
        )
    return (
        f"{chi2} Residuals are {number(fit['rms_px'])} px rms per axis, and {number(fit['rms_own_px'])} px once the "
        "errors are taken out that the markers of an image, or the images of a marker, share.",
    )


def parameters(document: Document) -> tuple[Table, ...]:
    """What was estimated beside the alignment."""
    found: Sequence[Document] = document.get("parameters", ())
    if not found:
        return ()
    rows = [
        (
            str(p["name"]),
            str(p["unit"]),
            number(p["correction"], 5) if p["known"] else "not determined by the data",
            number(p["sigma"]),
            number(p["prior_sigma"]),
        )
        for p in found
    ]
    head = ("parameter", "unit", "correction", "sigma", "sigma before")
    return (Table("Estimated beside the alignment", head, rows, text_columns=2),)


def budget(names: Sequence[str], sigma_arcsec: Array) -> tuple[Table, ...]:
    """Sigma of each source (sources, 3) arcsec, and of all together."""
    rows = [(name, *(number(x) for x in sigma)) for name, sigma in zip(names, sigma_arcsec, strict=True)]
    total = np.sqrt(np.sum(sigma_arcsec**2, axis=0))
    rows.append(("all together", *(number(x) for x in total)))
    head = ("source", "about x", "about y", "about z")
    return (Table("Sigma of the alignment by source, arcsec", head, rows),)


def provenance(document: Document) -> tuple[Table, ...]:
    """Inputs with their hashes, versions, the Earth's orientation, corrections, notices."""
    facts = [(name, version) for name, version in document["software"].items()]
    orientation = document.get("earth_orientation")
    if orientation:
        kind = "predicted values" if orientation["predicted"] else "measured values"
        facts.append(("Earth orientation", f"{orientation['source']}, {kind}"))
    else:
        facts.append(("Earth orientation", "not needed: all frames are Earth-fixed"))
    switches = document.get("corrections", {})
    if switches:
        words = (f"{name.replace('_', ' ')} {'on' if on else 'off'}" for name, on in switches.items())
        facts.append(("corrections", listed(words)))
    facts += [("notice", str(notice)) for notice in document.get("notices", ())]
    inputs = [(name, digest) for name, digest in document["inputs"].items()]
    return (
        Table("Inputs", ("file", "digest"), inputs, text_columns=2),
        Table("Made with", ("what", "value"), facts, text_columns=2, note=UNDATED),
    )
