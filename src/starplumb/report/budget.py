"""The report of a scenario's error budget, from its ``budget.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .amounts import bars
from .page import Figure, Page, Section, Table, made_with, render, seen
from .text import number, triple

Array = NDArray[np.float64]
Document = Mapping[str, Any]

AXES = ("x", "y", "z")
SMALL = 1e-3
"""Less than this part of what it adds to is shown as 0."""
NOTE = (
    "0 stands for a contribution below a thousandth of the largest, and for a derivative where twice the source would "
    "not change the sigma by a thousandth."
)


def budget_page(document: Document) -> str:
    """``report.html`` of an error budget; the same budget gives the same text."""
    methods: Mapping[str, Document] = document["methods"]
    true = bool(document["stated_model_is_true"])
    page = Page(
        title=f"Error budget: {document['scenario']}",
        summary=_summary(document),
        badge="the stated error model is the true one"
        if true
        else "the stated error model is not the true one",
        tone="good" if true else "fair",
        sections=(
            *(_method(name, method) for name, method in methods.items()),
            _target(document["target"]),
            *_provenance(document),
        ),
        kind="error budget",
        remarks=tuple(
            filter(None, (document["description"], *(f"left out: {name}" for name in document["left_out"])))
        ),
    )
    return render(page)


def _summary(document: Document) -> str:
    name, method = next(iter(document["methods"].items()))
    return (
        f"With {seen(document)} the method {name} gives the alignment "
        f"to {triple(method['sigma_arcsec'])} arcsec (1 sigma) about x, y, z."
    )


def _label(share: Document) -> str:
    return f"{share['source']} {share['component']}".strip()


def _unit(share: Document) -> str:
    return next(key for key in share if key.startswith("sigma_")).removeprefix("sigma_")


def _method(name: str, method: Document) -> Section:
    shares = method["sources"]
    rows = []
    for before, share in zip([None, *shares], shares, strict=False):
        unit = _unit(share)
        rows.append(
            (
                _label(share),
                # said once for all components of a source
                "" if before is not None and before["source"] == share["source"] else str(share["words"]),
                f"{number(share[f'sigma_{unit}'])} {unit}",
                *contributed(share, shares),
                *slopes(share, method["sigma_arcsec"]),
            )
        )
    stated = method["stated_sigma_arcsec"]
    rows.append(("sigma it has", "", "", *(number(x) for x in method["sigma_arcsec"]), "", "", ""))
    rows.append(("sigma it states", "", "", *(number(x) for x in stated or [None] * 3), "", "", ""))
    head = (
        "source",
        "what",
        "sigma",
        *(f"contributes about {axis}, arcsec" for axis in AXES),
        *(f"d sigma / d source, {axis}" for axis in AXES),
    )
    return Section(
        f"method-{name}",
        f"Method {name}",
        figures=contributions(name, shares),
        tables=(Table(f"Budget of {name}", head, rows, text_columns=2, note=NOTE),),
        bullets=tuple(str(sentence) for sentence in method["in_words"]),
    )


def contributed(share: Document, shares: Sequence[Document]) -> tuple[str, ...]:
    """What a source contributes about x, y, z; 0 for less than a thousandth of the largest of all about that axis."""
    values = share["contribution_arcsec"]
    largest = np.max(np.array([s["contribution_arcsec"] for s in shares], dtype=np.float64), axis=0)
    return tuple(
        number(x) if x >= SMALL * most else "0" for x, most in zip(values, largest.tolist(), strict=True)
    )


def slopes(share: Document, sigma_arcsec: list[float]) -> tuple[str, ...]:
    """How the sigma depends on a source's; 0 where twice the source would not change it by a thousandth."""
    unit = _unit(share)
    values = share[f"sensitivity_arcsec_per_{unit}"]
    return tuple(
        "0" if abs(slope) * share[f"sigma_{unit}"] < SMALL * sigma else number(slope)
        for slope, sigma in zip(values, sigma_arcsec, strict=True)
    )


def _provenance(document: Document) -> tuple[Section, ...]:
    """Version, scenario and methods; budgets written before these were kept have none."""
    fingerprint = document.get("fingerprint")
    if not fingerprint:
        return ()
    return (Section("provenance", "Provenance", tables=(made_with(fingerprint, document["methods"]),)),)


def contributions(name: str, shares: list[Document]) -> tuple[Figure, ...]:
    """Contributions of those sources that matter, a figure for each axis with a scale of its own."""
    values = np.array([share["contribution_arcsec"] for share in shares], dtype=np.float64)
    parts = values / np.maximum(np.max(values, axis=0), 1e-300)
    chosen = np.flatnonzero(np.max(parts, axis=1) > 0.02)
    names = [_label(shares[i]) for i in chosen]
    return tuple(
        _about(name, axis, names, np.where(parts < SMALL, 0.0, values)[chosen, i])
        for i, axis in enumerate(AXES)
    )


def _about(name: str, axis: str, names: list[str], values: Array) -> Figure:
    """What the named sources contribute about an axis."""
    most = int(np.argmax(values))
    worst = f"the largest is {names[most]} with {number(float(values[most]))} arcsec"
    return bars(
        f"shares-{name}-{axis}",
        names,
        [("", values)],
        f"sigma about {axis} by this source alone, arcsec",
        f"Contributions of the error sources to the error of {name} about {axis}: {worst}.",
        f"What each source alone contributes to the error of {name} about {axis}; {worst}.",
    )


def _target(target: Document | None) -> Section:
    """What each source must shrink to."""
    title = "What the required accuracy asks of each error"
    if target is None:
        return Section("target", title)
    rows = []
    for source in target["sources"]:
        unit = _unit(source)
        wanted = source[f"wanted_sigma_{unit}"]
        rows.append(
            (
                str(source["source"]),
                f"{', '.join(number(x) for x in source[f'sigma_{unit}'])} {unit}",
                "cannot reach it" if wanted is None else f"{', '.join(number(x) for x in wanted)} {unit}",
                *(number(x) for x in source["without_it_arcsec"]),
            )
        )
    head = ("source", "is", "must be", *(f"sigma without it, {axis}, arcsec" for axis in AXES))
    caption = f"Each source alone, for {number(target['target_arcsec'])} arcsec about each axis"
    return Section(
        "target",
        title,
        tables=(Table(caption, head, rows, text_columns=3),),
        bullets=tuple(str(sentence) for sentence in target["in_words"]),
    )
