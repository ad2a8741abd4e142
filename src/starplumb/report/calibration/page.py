"""The report of a calibration: what a calibration engineer attaches to a technical note."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...judge.calibrate import Calibration
from ...physics.units import ARCSEC
from ..cameras import cameras_section
from ..page import Page, Section, Tone, render
from ..text import counted, length, listed, measured
from . import figures, lists, tables
from .facts import facts, in_the_camera
from .fit_figures import image_panels, normality, own_over_the_field
from .sites import site_map, site_table, sites

BADGES: dict[str, tuple[str, Tone]] = {
    "ok": ("ok: the mounting may be used", "good"),
    "weak": ("weak: usable within the 95 % interval, with the reservations below", "fair"),
    "refuted": ("refuted: the data contradict the answer, and the mounting must not be used", "bad"),
    "singular": ("singular: the mounting must not be used", "bad"),
    "not_converged": ("not converged: the mounting must not be used", "bad"),
}


def calibration_page(calibration: Calibration, document: Mapping[str, Any]) -> str:
    """``report.html`` of a calibration and its ``result.json``; the same input gives the same text."""
    required = (document["requirement"]["sentence"],) if document.get("requirement") else ()
    badge, tone = BADGES[str(document["status"])]
    page = Page(
        title=f"Camera alignment: {calibration.campaign.name}",
        summary=summary(calibration, document),
        badge=badge,
        tone=tone,
        sections=_sections(calibration, document),
        kind=f"calibration, method {document['method']}",
        remarks=(*required, *calibration.sentences),
    )
    return render(page)


def summary(c: Calibration, document: Mapping[str, Any]) -> str:
    """The sentence with the correction, the larger of its sigmas, and the data it is from."""
    tracker, fit = document["mounting"]["to"], document["fit"]
    made = f"{counted(fit['observations'], 'sighting')} in {counted(fit['images'], 'image')}"
    if not c.status.usable:
        return f"No alignment can be given from {made}: {c.message}."
    sigma = c.leading_sigma_E
    turn = ", ".join(
        measured(float(value), None if sigma is None else float(sigma[i] / ARCSEC))
        for i, value in enumerate(c.correction_E / ARCSEC)
    )
    doubt = "" if sigma is not None else " (the method states no sigma)"
    before, after = c.accuracy(after=False), c.accuracy(after=True)
    ground = ""
    if after is not None:
        was = "off the Earth" if before is None else length(before.rmse)
        ground = f" The geolocation error falls from {was} to {length(after.rmse)} rms."
    return (
        f"Turn the camera's mounting by ({turn}) arcsec about x, y, z of {tracker}{doubt}, "
        f"from {made}.{ground}"
    )


def _sections(c: Calibration, document: Mapping[str, Any]) -> tuple[Section, ...]:
    """All sections; empty ones are left out of the page."""
    usable, found = c.status.usable, sites(c)
    return (
        Section(
            "flown",
            "What was flown",
            figures=site_map(c, found) if usable else (),
            tables=(facts(c, document), *tables.sources(document), *site_table(c, found)),
        ),
        Section("alignment", "Alignment", tables=(*tables.alignment(c, document), *in_the_camera(c))),
        Section("cameras", "Cameras against each other", *cameras_section(c)),
        Section(
            "mounting",
            "Mounting before and after",
            (tables.mounting_words(document),),
            tables=tables.mounting(c, document),
        ),
        _knowledge(c),
        Section(
            "residuals",
            "Residuals in the image and on the ground",
            ("An arrow leads from the measured place to the predicted one.",),
            (*figures.all_residual_vectors(c), *(figures.by_ellipse(c) if usable else ())),
        ),
        *_own(c),
        Section(
            "trends", "Residuals against time, latitude and image", (), figures.trends(c) if usable else ()
        ),
        Section(
            "geolocation",
            "Geolocation",
            tables.geolocation_words(c),
            (figures.ground_scatter(c),) if usable else (),
            tables.geolocation(c),
        ),
        Section("budget", "Error budget", *_budget(c, document)),
        Section(
            "fit",
            "Fit, images and markers",
            tables.fit_words(document),
            (),
            (
                *tables.parameters(document),
                *tables.motion(document),
                *lists.rejections(document),
                *lists.images(document),
                *lists.markers(document),
            ),
        ),
        Section("reliability", "Reliability of each sighting", *lists.reliability(c)),
        Section("provenance", "Provenance", tables=tables.provenance(document)),
    )


def _own(c: Calibration) -> tuple[Section, ...]:
    """What remains of the residuals once what images and markers share is taken out."""
    if not c.status.usable:
        return ()
    words = (
        "What remains once the errors are taken out that the markers of an image, or the images of a marker, share: "
        "the optics, the marks themselves, and whether their sigmas are right."
    )
    figures = (*own_over_the_field(c), *normality(c))
    return (Section("own", "Own residuals", (words,), figures, panels=image_panels(c)),)


def _knowledge(c: Calibration) -> Section:
    """How well each direction is known, and which is the worst."""
    covariance = c.estimate.covariance_E
    if covariance is None or not c.status.usable:
        return Section("knowledge", "What is well and what is poorly determined")
    return Section(
        "knowledge",
        "What is well and what is poorly determined",
        tables.knowledge(c.estimate.C_EK, covariance),
        figures.alignment_ellipses(c),
    )


def _budget(c: Calibration, document: Mapping[str, Any]) -> tuple[Any, ...]:
    """Sentences, figures and tables of the budget by source, where the result has one."""
    budget = document.get("budget")
    if not budget:
        return ()
    names = [row["source"] for row in budget]
    shares = np.array([row["sigma_arcsec"] for row in budget], dtype=np.float64)
    worst = [names[int(np.argmax(shares[:, i]))] for i in range(3)]
    limits = {
        name: listed(axis for axis, most in zip("xyz", worst, strict=True) if most == name) for name in worst
    }
    sentence = (
        f"What limits the alignment most: {listed(f'{name} about {axes}' for name, axes in limits.items())}."
    )
    return (sentence,), (figures.budget(document),), tables.budget(names, shares)
