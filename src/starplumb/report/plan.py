"""The page of a plan of images, from its ``plan.json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .charts.chart import Axis, Chart, Dots, Line, Mark
from .land import coast, region
from .page import Figure, Page, Section, Table, render
from .text import counted, number, triple

Document = Mapping[str, Any]

LISTED = 200
"""Images in the table; ``plan.csv`` has all."""


def plan_page(document: Document) -> str:
    """``plan.html``; the same plan gives the same text."""
    d = document
    target = d["target"]
    badge = f"within {number(d['bound']['within_percent'])} % of the best there can be"
    if target is not None:
        badge = "the target is reached" if target["reached"] else "the target is not reached"
    page = Page(
        title=f"What to take next: {d['scenario']}",
        summary=_summary(d),
        badge=badge,
        tone="good" if target is None or target["reached"] else "bad",
        sections=(
            Section("words", "What is badly determined, and what cures it", _sentences(d), (), (_kinds(d),)),
            Section("accuracy", "How well the mounting is known after each image", (), _accuracy(d)),
            Section("map", "Where", (), (_map(d),)),
            Section("images", "The images", (_order(d),), (), (_images(d),)),
            Section("limits", "What limits", (), (), _shared(d)),
            Section("how", "How far this can be trusted", _trust(d)),
        ),
        kind="plan",
        remarks=tuple(d["notices"]),
    )
    return render(page)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _sentences(d: Document) -> tuple[str, ...]:
    said = [_sentence(text) for text in (*d["in_words"], *of_cameras(d))]
    return (*said, *([] if d["target"] is None else [_sentence(d["target"]["in_words"])]))


def of_cameras(d: Document) -> tuple[str, ...]:
    """How each further camera is known against the first, by whose mounting images are chosen."""
    return tuple(map(_of_camera, d["cameras"]))


def _of_camera(c: Document) -> str:
    pair = f"{c['camera']} against {c['against']}, by whose mounting the images are chosen, is"
    sigma = f"known to {triple(c['sigma_arcsec'])} arcsec about x, y, z"
    if c.get("left_out") is None:
        return f"{pair} then {sigma}"
    return f"{pair} {sigma} by the planned images and what is given of {c['against']}; {c['left_out']} is left out"


def _summary(d: Document) -> str:
    last = d["images"][-1]
    return (
        f"{counted(len(d['images']), 'image')} from {d['start'][:10]} to {d['end'][:10]} "
        f"give{'s' * (len(d['images']) == 1)} the mounting to "
        f"{triple(last['sigma_arcsec'])} arcsec about x, y, z, {number(last['rms_m'])} m on the ground."
    )


def _kinds(d: Document) -> Table:
    before = d["before"]
    have = before["given"] or f"{counted(before['images'], 'image')} of the usual kind"
    rows = [(k["kind"], str(k["images"]), number(k["rms_m"])) for k in d["kinds"]]
    caption = f"What some more images of a kind leave, after {have} ({number(before['rms_m'])} m)"
    return Table(caption, ("kind of view", "images", "on the ground, m"), rows)


def _accuracy(d: Document) -> tuple[Figure, ...]:
    images, bound, usual = d["images"], float(d["bound"]["rms_m"]), d["usual"]
    count = np.array([i["order"] for i in images], dtype=np.float64)
    rms = np.array([i["rms_m"] for i in images])
    ends = np.array([0.5, count[-1] + 0.5])
    tips = [f"{i['order']}: {i['time'][:16]} {i['site']}, {number(i['rms_m'])} m" for i in images]
    marks: list[Mark] = [
        Line(ends, np.full(2, bound), "three", "--", "no choice of all images can be better"),
        Line(count, rms, "one"),
        Dots(count, rms, "one", name="this plan", tips=tips, filled=True, size=0.7),
    ]
    shown = [rms, np.array([bound])]
    if usual["rms_m"] is not None:
        at, value = np.array([float(usual["images"])]), np.array([usual["rms_m"]])
        marks.append(Dots(at, value, "two", "s", "as many usual views as there are", filled=True))
        shown.append(value)
    low, high = np.min(np.concatenate(shown)), np.max(np.concatenate(shown))
    chart = Chart(
        Axis("images", *ends.tolist()),
        Axis("on the ground, m", float(low / 1.2), float(high * 1.2), log=True),
        tuple(marks),
    )
    over = counted(rms.size, "image")
    alt = f"The error on the ground falls from {number(rms[0])} to {number(rms[-1])} m over {over}."
    return (Figure(chart, "accuracy", alt, "The error on the ground (rms over the field) after each image."),)


def _map(d: Document) -> Figure:
    places: dict[str, list[Document]] = {}
    for image in d["images"]:
        places.setdefault(image["site"], []).append(image)
    x = np.array([mine[0]["longitude_deg"] for mine in places.values()])
    y = np.array([mine[0]["latitude_deg"] for mine in places.values()])
    x = np.unwrap(x, period=360.0)
    times = [len(mine) for mine in places.values()]
    marks = tuple(
        Dots(x[[k]], y[[k]], "one", tips=[f"{site}: {n}"], filled=True, size=float(0.6 + 0.2 * np.sqrt(n)))
        for k, (site, n) in enumerate(zip(places, times, strict=True))
    )
    west, east, south, north = region(np.stack([x, y], axis=-1))
    axes = Axis("longitude, deg", west, east), Axis("latitude, deg", south, north)
    listed = ", ".join(f"{site} {n}" for site, n in zip(places, times, strict=True))
    chart = Chart(*axes, (*coast(west, east, south, north), *marks))
    text = f"Sites, and how many images look at each: {listed}. Coastlines: Natural Earth."
    return Figure(chart, "map", f"Images by site: {listed}.", text)


def _order(d: Document) -> str:
    left = len(d["images"]) - LISTED
    more = f" {left} more are in plan.csv." if left > 0 else ""
    return (
        "The one that is worth most first: take them in the order of time, and leave out the last ones first. Motion: "
        f"the smallest motion of the mounting that would be found after them with 90 % probability.{more}"
    )


def _images(d: Document) -> Table:
    rows = [
        (
            str(i["order"]),
            i["time"][:19],
            i["site"],
            *(f"{i[key]:.1f}" for key in ("pitch_deg", "roll_deg", "yaw_deg", "sun_deg")),
            *(number(s) for s in i["sigma_arcsec"]),
            number(i["rms_m"]),
            "–" if i["gain_m"] is None else number(i["gain_m"]),
            "–" if i["detectable_arcsec"] is None else number(i["detectable_arcsec"]),
        )
        for i in d["images"][:LISTED]
    ]
    head = (
        *("", "time (UTC)", "site", "pitch", "roll", "yaw", "Sun"),
        *("sigma x", "sigma y", "sigma z", "ground, m", "gain, m", "motion, arcsec"),
    )
    return Table("Images to take; angles in degrees, sigma in arcsec", head, rows, text_columns=3)


def _shared(d: Document) -> tuple[Table, ...]:
    rows = [(name, f"{100.0 * part:.0f} %") for name, part in d["shared_errors"].items() if part > 0.005]
    caption = "By how much the variance that is left would fall were an error known that images share"
    return (Table(caption, ("error", "by"), rows),) if rows else ()


def _trust(d: Document) -> tuple[str, ...]:
    c, b = d["checked"], d["bound"]
    return (
        f"Criterion: {d['criterion']}.",
        f"Chosen from {counted(d['candidates']['views'], 'view')} in "
        f"{counted(d['candidates']['passes'], 'pass', 'passes')} over "
        f"{counted(len(d['candidates']['sites']), 'site')}. No choice of as many can leave less than "
        f"{number(b['rms_m'])} m "
        "(a bound by the convex problem in which images may be taken in part).",
        f"By the whole noise model, every image being clear, the chosen ones leave {number(c['rms_m'])} m "
        f"({triple(c['sigma_arcsec'])} arcsec); by the sums that they were chosen by {number(c['chosen_by_rms_m'])} m.",
    )
