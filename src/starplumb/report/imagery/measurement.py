"""The page of what was measured in raw images, for the eye: where chips were looked for, and what each looks like."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ...imagery.pictures import Picture
from ...imagery.verdicts import Verdict
from ..cards import Card, Ellipse, Panel, shades, signed
from ..page import Page, Section, Table, Tone, render
from ..text import counted, listed, number
from .figures import histogram, image_map

Document = Mapping[str, Any]
Part = Mapping[str, Any]

MOST_CARDS = 400
"""Chips that are shown; of more the refused ones and the largest residuals first."""
MOST_MAPS = 24
MOST_SENTENCES = 10
"""Chips of a kind without a picture that are named."""
REFUSED = (
    *(Verdict.OUTLIER, Verdict.CHANGED, Verdict.NO_MATCH, Verdict.CLOUD, Verdict.WATER, Verdict.NO_TEXTURE),
    *(Verdict.SATURATED, Verdict.EDGE, Verdict.NO_REFERENCE),
)
"""In the order in which they are shown: those first that say most about what is wrong."""


def measurement_page(document: Document, pictures: Sequence[Picture]) -> str:
    """``measure.html`` of a ``measure.json`` and the pictures of its chips; the same input gives the same text."""
    badge, tone = _verdict(document)
    shown = list(_shown(document, {(p.image_id, p.landmark_id): p for p in pictures}))
    page = Page(
        title=f"Chips measured: {document['campaign']}",
        summary=_summary(document),
        badge=badge,
        tone=tone,
        sections=(
            Section("images", "Images", (), (), (_images(document), _counts(document))),
            _maps(document),
            Section("residuals", "Residuals", _fit(document), tuple(histogram(document))),
            *_cards(document, shown),
        ),
        kind="measurement",
        remarks=tuple(
            f"{i['image_id']} is left out: {i['reason']}" for i in document["images"] if i["reason"]
        ),
    )
    return render(page)


def _verdict(document: Document) -> tuple[str, Tone]:
    if document["status"] != "ok":
        return "failed: too few images could be measured", "bad"
    out = sum(image["status"] != "measured" for image in document["images"])
    return (
        ("ok: every image was measured", "good")
        if not out
        else (f"{out} left out, the others measured", "fair")
    )


def _summary(document: Document) -> str:
    used = [c for c in document["candidates"] if c["role"] is not None]
    sigma = [np.hypot(c["sigma_column_px"], c["sigma_row_px"]) / np.sqrt(2.0) for c in used]
    known = f", known to {number(float(np.median(sigma)), 2)} px each way (median)" if used else ""
    sought = (
        f"{len(used)} of {counted(len(document['candidates']), 'chip')} in "
        f"{counted(len(document['images']), 'image')} were found"
    )
    return f"{sought}{known}. {document['message']}".rstrip(". ") + "."


def _images(document: Document) -> Table:
    rows = [
        (
            *(
                i["image_id"],
                i["status"],
                i["reason"] or "–",
                f"{i['used']} of {i['candidates']}",
                str(i["check"]),
            ),
            *(
                ("–", "–")
                if i["offset_px"] is None
                else tuple(f"{round(v, 1) + 0.0:.1f}" for v in i["offset_px"])
            ),
        )
        for i in document["images"]
    ]
    head = ("Image", "Status", "Why", "Chips used", "of these checks", "Off, columns (px)", "rows (px)")
    marked = frozenset(k for k, i in enumerate(document["images"]) if i["status"] != "measured")
    note = "Off: how far the image was found from where the model mounting puts it (median)."
    return Table("Images", head, rows, 3, marked, note)


def _counts(document: Document) -> Table:
    count = Counter((c["image_id"], c["verdict"]) for c in document["candidates"])
    words = [v for v in (Verdict.USED, *REFUSED) if any(verdict == v for _, verdict in count)]
    ids = [i["image_id"] for i in document["images"]]
    rows = [(name, *(str(count[name, word]) for word in words)) for name in ids]
    total = ("all", *(str(sum(count[name, word] for name in ids)) for word in words))
    return Table("Chips by verdict", ("Image", *words), [*rows, total], 1, totals=1)


def _maps(document: Document) -> Section:
    """Where the chips lie in each image."""
    tried = [image for image in document["images"] if image["candidates"]]
    images = tried[:MOST_MAPS]
    more = len(tried) - len(images)
    said = "Each mark is a place at which a chip was looked for; lines are residuals, enlarged."
    left = (f"The first {len(images)} images are drawn, {more} more are in measure.json.",) if more else ()
    return Section(
        "maps", "Where", (said, *left) if images else (), tuple(image_map(document, i) for i in images)
    )


def _fit(document: Document) -> tuple[str, ...]:
    z = [
        v
        for c in document["candidates"]
        if c["role"] is not None and c["normalised"]
        for v in c["normalised"]
    ]
    if not z:
        return ()
    rms = 1.4826 * float(np.median(np.abs(z)))
    floor = float(document["floor_px"])
    told = (
        f"Residuals over their sigmas scatter by {number(rms, 2)}, where 1 is wanted: those of the places "
        "and of what the reference's own errors, which stand with the landmarks, add. "
    )
    if not floor:
        return (told + "Nothing else had to be added.",)
    return (told + f"{number(floor, 2)} px were added to all for what neither of these explains.",)


def _shown(document: Document, pictures: Mapping[tuple[str, str], Picture]) -> Iterator[tuple[Part, Picture]]:
    """Chips that have a picture, in the order of importance."""
    order = {verdict: k for k, verdict in enumerate((*REFUSED, Verdict.USED))}

    def weight(c: Part) -> tuple[int, float]:
        off = 0.0 if c["normalised"] is None else float(np.hypot(*c["normalised"]))
        return order.get(c["verdict"], -1), -off

    for c in sorted(document["candidates"], key=weight):
        if (key := (c["image_id"], c["landmark_id"])) in pictures:
            yield c, pictures[key]


def _cards(document: Document, shown: list[tuple[Part, Picture]]) -> Iterator[Section]:
    """A section for each reason, refused ones first."""
    kept = shown[:MOST_CARDS]
    for word in (*REFUSED, Verdict.USED):
        mine = [(c, picture) for c, picture in kept if c["verdict"] == word]
        total = sum(c["verdict"] == word for c in document["candidates"])
        if total:
            title = f"{word.capitalize()} ({total})"
            seen = {(picture.image_id, picture.landmark_id) for _, picture in mine}
            left = (
                ()
                if len(mine) == total
                else (f"{len(mine)} of {total} are shown.", *_unseen(document, word, seen))
            )
            cards = tuple(_card(c, picture) for c, picture in mine)
            yield Section(
                f"chips-{word.replace(' ', '-')}", title, (*_MEANS.get(word, ()), *left), cards=cards
            )


def _unseen(document: Document, word: str, seen: set[tuple[str, str]]) -> Iterator[str]:
    """The first chips without a picture in words."""
    mine = [c for c in document["candidates"] if c["verdict"] == word]
    for c in [c for c in mine if (c["image_id"], c["landmark_id"]) not in seen][:MOST_SENTENCES]:
        yield f"{_title(c)}: {_told(c)}"


def _title(c: Part) -> str:
    name, image = str(c["landmark_id"]), str(c["image_id"])
    return name if name.startswith(image) else f"{name} in {image}"


_MEANS: Mapping[str, tuple[str, ...]] = {
    Verdict.USED: (
        "The largest residuals first. An ellipse has the form and direction of the error, and is enlarged.",
    ),
    Verdict.OUTLIER: ("They match, but lie elsewhere than the other chips of their image say.",),
    Verdict.CHANGED: ("Window and reference show different ground.",),
    Verdict.NO_REFERENCE: ("Reference or heights do not cover their ground: there is nothing to show.",),
}


def _card(c: Part, picture: Picture) -> Card:
    at = f"Column {c['column_px']:.1f}, row {c['row_px']:.1f}"
    return Card(
        title=_title(c),
        word=c["role"] or c["verdict"],
        sentence=f"{at}. {_told(c)}",
        panels=tuple(_panels(picture)),
        bad=c["verdict"] != Verdict.USED,
    )


def _told(c: Part) -> str:
    if c["reason"]:
        return f"{c['reason'][:1].upper()}{c['reason'][1:]}."
    if c["role"] is None:
        return "Its image is left out."
    left = "" if c["residual_column_px"] is None else _residual(c)
    sigmas = f"sigma {number(c['sigma_column_px'], 2)}, {number(c['sigma_row_px'], 2)} px"
    said = [f"{sigmas}, correlation {c['correlation']:.2f}"]
    said += [f"{word} {number(c[key], 2)}{unit}" for word, key, unit in _FIGURES if c[key] is not None]
    return f"{left}{listed(said)}."


_FIGURES = (
    ("agreement", "agreement", ""),
    ("part of the pixels kept", "kept", ""),
    ("blur", "blur_px", " px"),
)


def _residual(c: Part) -> str:
    return f"Residual {number(c['residual_column_px'], 2)}, {number(c['residual_row_px'], 2)} px; "


def _panels(picture: Picture) -> Iterator[Panel]:
    name = picture.landmark_id
    window = shades(picture.window)
    if picture.reference is None:
        yield Panel("raw", f"{name}: the raw window", (window,))
    else:
        reference = shades(picture.reference)
        yield Panel("reference", f"{name}: the reference as it was predicted", (reference,))
        yield Panel("raw", f"{name}: the raw window", (window,))
        yield Panel("blink", f"{name}: reference and raw window in turn", (reference, window))
    if picture.residual is not None:
        left = signed(picture.residual, picture.weight)
        yield Panel("residual", f"{name}: what the match leaves, clear where it has no weight", (left,))
    if picture.surface is not None:
        yield _surface(picture)


def _surface(picture: Picture) -> Panel:
    """The correlation around the predicted place, with its peak and the form of the error's ellipse."""
    surface = picture.surface
    assert surface is not None
    mark, ellipse = None, None
    if picture.peak is not None:
        rows, columns = surface.shape
        mark = (0.5 + picture.peak[0] / columns, 0.5 + picture.peak[1] / rows)
        if picture.covariance_px2 is not None:
            ellipse = Ellipse.enlarged(*mark, np.array(picture.covariance_px2))
    alt = f"{picture.landmark_id}: correlation around the predicted place"
    return Panel("correlation", alt, (shades(surface),), mark, ellipse)
