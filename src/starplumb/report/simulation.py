"""The report of a simulation, from its ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from . import simulation_figures as figures
from .page import Page, Section, Table, Tone, made_with, render, seen
from .text import beside, interval, length, number, triple

Document = Mapping[str, Any]

AXES = ("x", "y", "z")
ARCSEC_SCALE = 1.0
"""Angles are rotations of the order of 1: what is below a billionth of an arc second is rounding."""


def simulation_page(document: Document) -> str:
    """``report.html`` of a simulation; the same summary gives the same text."""
    methods: Mapping[str, Document] = document["methods"]
    badge, tone = _badge(methods)
    page = Page(
        title=f"Simulated accuracy: {document['scenario']}",
        summary=_summary(document),
        badge=badge,
        tone=tone,
        sections=(
            Section(
                "comparison",
                "Methods side by side",
                (str(document["description"]),),
                figures.ratios(methods),
                _side(document),
            ),
            *(_method(name, method) for name, method in methods.items()),
            Section("sources", "Error sources", tables=(_sources(document),)),
            Section(
                "provenance",
                "Provenance",
                tables=(made_with(document["fingerprint"], methods, trials=document["trials"]),),
            ),
        ),
        kind=f"simulation, {document['trials']} trials",
        remarks=tuple(
            f"{name}: {sentence}" for name, method in methods.items() for sentence in method["verdict"]
        ),
    )
    return render(page)


def _badge(methods: Mapping[str, Document]) -> tuple[str, Tone]:
    """Whether the methods that state a sigma state the right one."""
    wrong = [name for name, method in methods.items() if _is_wrong(method)]
    if wrong:
        return f"the stated sigma does not hold: {', '.join(wrong)}", "bad"
    if any(method["nees"] is not None for method in methods.values()):
        return "the stated sigmas hold", "good"
    return "no method states a sigma", "fair"


def _is_wrong(method: Document) -> bool:
    checks = [method["nees"], *(axis["error_over_stated"] for axis in method["axes"].values())]
    return any(check is not None and check["wrong"] for check in checks)


def _summary(document: Document) -> str:
    name, method = next(iter(document["methods"].items()))
    sigma = triple([method["axes"][axis]["sigma_arcsec"]["value"] for axis in AXES])
    bound = document["cramer_rao_arcsec"]
    least = "" if bound is None else f"; no unbiased method can do better than {triple(bound)}"
    return (
        f"With {seen(document)} the method {name} gives the alignment "
        f"to {sigma} arcsec (1 sigma) about x, y, z{least}."
    )


def _side(document: Document) -> tuple[Table, ...]:
    rows = []
    for name, method in document["methods"].items():
        axes = [method["axes"][axis] for axis in AXES]
        ground = method["ground"]["ce90_m"]
        rows.append(
            (
                name,
                *(interval(axis["rms_arcsec"], ARCSEC_SCALE) for axis in axes),
                *(interval(axis["rmse_over_bound"]) for axis in axes),
                "–" if ground is None else length(ground["value"]),
                str(method["failed"]),
            )
        )
    head = (
        "method",
        *(f"rms about {axis}, arcsec" for axis in AXES),
        *(f"rms / bound, {axis}" for axis in AXES),
        "CE90 on the ground",
        "failed",
    )
    note = "± is half the 95 % confidence interval; CE90 is that of the alignment error alone, at the images' centres."
    return (Table("Accuracy by method", head, rows, note=note),)


def _method(name: str, method: Document) -> Section:
    axes, curve = method["axes"], method["convergence"]
    rows = [
        ("mean, arcsec", *(interval(axis["mean_arcsec"], ARCSEC_SCALE) for axis in axes.values())),
        ("sigma, arcsec", *(interval(axis["sigma_arcsec"], ARCSEC_SCALE) for axis in axes.values())),
        ("rms, arcsec", *(interval(axis["rms_arcsec"], ARCSEC_SCALE) for axis in axes.values())),
        ("largest, arcsec", *(beside(axis["max_arcsec"], ARCSEC_SCALE) for axis in axes.values())),
        (
            "stated sigma, arcsec",
            *(beside(axis["stated_sigma_arcsec"], ARCSEC_SCALE) for axis in axes.values()),
        ),
        ("error / stated sigma", *(interval(axis["error_over_stated"]) for axis in axes.values())),
        ("rms / bound", *(interval(axis["rmse_over_bound"]) for axis in axes.values())),
        ("kurtosis", *(number(axis["kurtosis"]) for axis in axes.values())),
    ]
    for q in next(iter(axes.values()))["quantiles_arcsec"]:
        rows.append(
            (
                f"{100.0 * float(q):g} % quantile, arcsec",
                *(interval(a["quantiles_arcsec"][q], ARCSEC_SCALE) for a in axes.values()),
            )
        )
    counts = ", ".join(
        f"{count} {status.replace('_', ' ')}" for status, count in method["status"].items() if count
    )
    sentences = [f"Trials: {counts}."]
    if method["nees"] is not None:
        nees = method["nees"]
        sentences.append(
            f"Normalised error squared per axis (NEES): {interval(nees)}; it should lie between "
            f"{number(nees['band_low'], 4)} and {number(nees['band_high'], 4)} in 95 of 100 studies."
        )
    return Section(
        f"method-{figures.slug(name)}",
        f"Method {name}",
        tuple(sentences),
        (
            *figures.histograms_by_axis(name, axes),
            # of a single chunk there is no curve
            *((figures.convergence(name, curve),) if len(curve["trials"]) > 1 else ()),
        ),
        (Table(f"Errors of {name} about the tracker's axes", ("", *AXES), rows),),
        tuple(str(sentence) for sentence in method["verdict"]),
    )


def _sources(document: Document) -> Table:
    rows = []
    for source in document["sources"]:
        key = next(key for key in source if key.startswith("sigma_"))
        sigma = ", ".join(number(value) for value in source[key])
        rows.append((str(source["name"]), str(source["words"]), f"{sigma} {key.removeprefix('sigma_')}"))
    return Table("What is off, and how far", ("source", "what", "sigma"), rows, text_columns=3)
