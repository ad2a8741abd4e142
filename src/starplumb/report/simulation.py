"""The report of a simulation, from its ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .page import Figure, Page, Section, Table, Tone, render
from .plots import Interval, Points, histogram, intervals, lines
from .text import interval, length, number, triple

Document = Mapping[str, Any]

AXES = ("x", "y", "z")


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
                _ratios(methods),
                _side(document),
            ),
            *(_method(name, method) for name, method in methods.items()),
            Section("sources", "Error sources", tables=(_sources(document),)),
            Section("provenance", "Provenance", tables=(_provenance(document),)),
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
        f"With {document['sightings']} sightings in {document['images']} images the method {name} gives the alignment "
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
                *(interval(axis["rms_arcsec"]) for axis in axes),
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


def _ratios(methods: Mapping[str, Document]) -> tuple[Figure, ...]:
    """Error over stated sigma of each method and axis, with the band in which it should lie."""
    rows, band = [], (1.0, 1.0)
    for name, method in methods.items():
        for axis in AXES:
            found = method["axes"][axis]["error_over_stated"]
            if found is not None:
                rows.append(Interval(f"{name}, {axis}", found["value"], found["low"], found["high"]))
                band = (found["band_low"], found["band_high"])
    if not rows:
        return ()
    worst = max(rows, key=lambda row: abs(np.log(max(row.value, 1e-12))))
    words = f"the farthest from 1 is {number(worst.value)} ({worst.name})"
    return (
        intervals(
            "ratios",
            rows,
            band,
            "error over stated sigma",
            f"Ratio of the actual error to the stated sigma by method and axis: {words}.",
            f"Actual error over stated sigma, with 95 % intervals; it should be 1 ({words}). "
            "Shaded: 95 % of studies of this size.",
        ),
    )


def _method(name: str, method: Document) -> Section:
    axes: Mapping[str, Document] = method["axes"]
    rows = [
        ("mean, arcsec", *(interval(axis["mean_arcsec"]) for axis in axes.values())),
        ("sigma, arcsec", *(interval(axis["sigma_arcsec"]) for axis in axes.values())),
        ("rms, arcsec", *(interval(axis["rms_arcsec"]) for axis in axes.values())),
        ("largest, arcsec", *(number(axis["max_arcsec"]) for axis in axes.values())),
        ("stated sigma, arcsec", *(number(axis["stated_sigma_arcsec"]) for axis in axes.values())),
        ("error / stated sigma", *(interval(axis["error_over_stated"]) for axis in axes.values())),
        ("rms / bound", *(interval(axis["rmse_over_bound"]) for axis in axes.values())),
        ("kurtosis", *(number(axis["kurtosis"]) for axis in axes.values())),
    ]
    for q in next(iter(axes.values()))["quantiles_arcsec"]:
        rows.append(
            (
                f"{100.0 * float(q):g} % quantile, arcsec",
                *(interval(a["quantiles_arcsec"][q]) for a in axes.values()),
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
        f"method-{_slug(name)}",
        f"Method {name}",
        tuple(sentences),
        (*_histograms(name, axes), *_convergence(name, method["convergence"])),
        (Table(f"Errors of {name} about the tracker's axes", ("", *AXES), rows),),
        tuple(str(sentence) for sentence in method["verdict"]),
    )


def _slug(name: str) -> str:
    return "".join(c if c.isalnum() else "-" for c in name)


def _histograms(name: str, axes: Mapping[str, Document]) -> tuple[Figure, ...]:
    drawn = []
    for axis, found in axes.items():
        if found["histogram"] is None:
            continue
        words = f"errors of {name} about {axis}: rms {number(found['rms_arcsec']['value'])} arcsec"
        drawn.append(
            histogram(
                f"histogram-{_slug(name)}-{axis}",
                np.array(found["histogram"]["edges_arcsec"], dtype=np.float64),
                np.array(found["histogram"]["counts"], dtype=np.float64),
                f"error about {axis}, arcsec",
                f"Histogram of the {words}.",
                f"The {words}.",
                found["stated_sigma_arcsec"],
            )
        )
    return tuple(drawn)


def _convergence(name: str, curve: Document) -> tuple[Figure, ...]:
    """Sigma over its last value as the trials accumulate; nothing to draw of a single chunk."""
    trials = np.array(curve["trials"], dtype=np.float64)
    if trials.size < 2:
        return ()
    groups = []
    for axis in AXES:
        sigma = np.array(curve[f"sigma_{axis}_arcsec"], dtype=np.float64)
        groups.append(Points(f"about {axis}", trials, sigma / sigma[-1]))
    words = f"Sigma of {name} over its final value as the trials accumulate"
    return (
        lines(
            f"convergence-{_slug(name)}", groups, ("trials", "sigma / final sigma"), f"{words}.", f"{words}."
        ),
    )


def _sources(document: Document) -> Table:
    rows = []
    for source in document["sources"]:
        key = next(key for key in source if key.startswith("sigma_"))
        sigma = ", ".join(number(value) for value in source[key])
        rows.append((str(source["name"]), str(source["words"]), f"{sigma} {key.removeprefix('sigma_')}"))
    return Table("What is off, and how far", ("source", "what", "sigma"), rows, text_columns=3)


def _provenance(document: Document) -> Table:
    rows = [
        ("trials", str(document["trials"])),
        ("seed", str(document["seed"])),
        ("chunk", str(document["chunk"])),
    ]
    rows += [(str(key), str(value)) for key, value in document["fingerprint"].items()]
    return Table("Made with", ("what", "value"), rows, text_columns=2)
