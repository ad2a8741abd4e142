"""The page of a mission's trend, from what ``starplumb archive trend --json`` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .charts.chart import Area, Axis, Chart, Dots, Line, Mark, Role, span
from .page import Figure, Page, Section, Table, Tone, render
from .plots import Points, scatter
from .text import counted

Array = NDArray[np.float64]
Document = Mapping[str, Any]

AXES = ("x", "y", "z")
HALF_68 = 0.9944578832
"""Half-width of the 68 % interval of a normal distribution, in sigmas."""
HALF_95 = 1.959963985
CLOSE = 100
"""Campaigns from which on their dots and bars are drawn smaller."""
LISTED = 60
"""Campaigns in the table: of more the last."""
TONES: Mapping[str, Tone] = {"keep": "good", "issue": "fair", "calibrate": "bad"}
BADGES = {
    "keep": "keep the mounting in use",
    "issue": "issue the foretold mounting",
    "calibrate": "calibrate again",
}


def trend_page(document: Document) -> str:
    """``trend.html``; the same document gives the same text."""
    d = document
    advice, of = d["recommendation"], d["satellite"] or d["from"]
    page = Page(
        title=f"Mounting of {of} against time",
        summary=_summary(d),
        badge=BADGES[advice["action"]],
        tone=TONES[advice["action"]],
        sections=(
            Section(
                "time",
                "Against time",
                (
                    "Dots are campaigns with their sigmas, the line is what was known after each, with its 68 and 95 % "
                    "bands, and what is foretold after the last (dashed).",
                ),
                tuple(_figure(d, k) for k in range(3)),
            ),
            Section("changes", "What changes it", (_evidence(d),), (), _changes(d)),
            Section("advice", "What to do", (_sentence(advice["sentence"]),), (), (_advice(advice),)),
            Section("temperature", "Temperature and place on the orbit", (), _against(d)),
            Section("events", "Events and what was issued", (), (), _happened(d)),
            Section("campaigns", "Campaigns", (), (), (_campaigns(d),)),
        ),
        kind="trend",
        remarks=tuple(f"{c['words']}: {_ground(c)}" for c in d["changes"] if c["significant"]),
    )
    return render(page)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _summary(d: Document) -> str:
    n, first, last = len(d["points"]), d["points"][0]["time"][:10], d["points"][-1]["time"][:10]
    span = f"from {first} to {last}" if first != last else f"of {first}"
    return f"{counted(n, 'campaign')} {span}. {_sentence(d['recommendation']['sentence'])}"


def _ground(change: Document) -> str:
    size = ", ".join(f"{v:+.2f}" for v in change["size_arcsec"])
    ground = "" if change["ground_m"] is None else f", {change['ground_m']:.2f} m on the ground"
    return f"{size} arcsec about x, y, z{ground} (p = {change['p']:.2g})"


def _evidence(d: Document) -> str:
    kinds = ", ".join(
        f"{m['name']} {100.0 * m['weight']:.0f} %" for m in d["models"][:5] if m["weight"] > 0.005
    )
    return f"Models of the motion between jumps, by how well each foretold the next campaign: {kinds}."


def _dates(times: Sequence[str]) -> Array:
    """Times as days, the way that the axis of dates counts them, a leap second being the next one."""
    minutes = np.array([time[:16] for time in times], dtype="datetime64[m]").astype(np.float64)
    return minutes / 1440.0 + np.array([float(time[17:]) for time in times]) / 86_400.0


def _figure(d: Document, k: int) -> Figure:
    """One axis against time."""
    points, ahead, axis = d["points"], d["forecast"], AXES[k]
    t = _dates([p["time"] for p in points])
    value, sigma, line, band = (
        np.array([p[name][k] for p in points])
        for name in ("value_arcsec", "sigma_arcsec", "trend_arcsec", "trend_sigma_arcsec")
    )
    later = _dates([f["time"] for f in ahead])
    told, spread = (np.array([f[name][k] for f in ahead]) for name in ("value_arcsec", "sigma_arcsec"))
    events, issued = (
        _dates([one[key] for one in d[name]]) for name, key in (("events", "time"), ("issued", "from"))
    )
    whole = [value - sigma, value + sigma, line - HALF_95 * band, line + HALF_95 * band]
    y = Axis(f"about {axis}, arcsec", *span([*whole, told - HALF_95 * spread, told + HALF_95 * spread]))
    thin = min(1.0, CLOSE / t.size)
    tips = [f"{p['time'][:10]} {p['name']}" for p in points]
    marks = (
        *_bands(t, line, band, "-"),
        *_bands(later, told, spread, "--"),
        *(_upright(at, y, "muted", ":") for at in events),
        *(_upright(at, y, "three", "-.") for at in issued),
        Line(np.repeat(t, 3), _bars(value, sigma), "two", width=0.9 * thin),
        Dots(t, value, "two", tips=tips, filled=True, size=0.3 + 0.7 * thin),
    )
    chart = Chart(Axis("date (UTC)", *span([t, later, events, issued]), dates=True), y, marks)
    ends = f"{value.min():.2f} to {value.max():.2f} arcsec in {counted(value.size, 'campaign')}"
    alt = f"The mounting about {axis} against time: {ends}."
    words = (
        "; dotted: events; dash-dotted: from when a mounting was issued" if d["events"] or d["issued"] else ""
    )
    return Figure(chart, f"trend-{axis}", alt, f"About {axis} of the star tracker, from the mean{words}.")


def _bars(value: Array, sigma: Array) -> Array:
    """Ends of upright bars, each with a gap behind."""
    return np.stack([value - sigma, value + sigma, np.full_like(value, np.nan)], axis=-1).ravel()


def _upright(at: float, y: Axis, role: Role, dash: Literal[":", "-."]) -> Line:
    return Line(np.array([at, at]), np.array([y.low, y.high]), role, dash, width=0.9)


def _bands(t: Array, line: Array, sigma: Array, style: Literal["-", "--"]) -> tuple[Mark, ...]:
    areas = (
        Area(t, line - half * sigma, line + half * sigma, "one", opacity=opacity)
        for half, opacity in ((HALF_95, 0.15), (HALF_68, 0.25))
    )
    return (*areas, Line(t, line, "one", style)) if t.size else ()


def _against(d: Document) -> tuple[Figure, ...]:
    """The mounting against what it may move with, where campaigns say so."""
    points = d["points"]
    names = dict.fromkeys(name for p in points for name in p["temperatures_c"])
    found = [
        (f"temperature {name}, °C", f"temperature-{i}", 0.1, [p["temperatures_c"].get(name) for p in points])
        for i, name in enumerate(names)
    ]
    found.append(("argument of latitude, deg", "phase", 1.0, [p["argument_of_latitude_deg"] for p in points]))
    return tuple(_scatter(d, label, name, x) for label, name, least, x in found if _differ(x, least))


def _differ(given: Sequence[float | None], least: float) -> bool:
    """Whether campaigns differ by enough for a figure that says something."""
    told = [value for value in given if value is not None]
    return len(told) > 1 and max(told) - min(told) >= least


def _scatter(d: Document, label: str, name: str, given: Sequence[float | None]) -> Figure:
    x = np.array([np.nan if value is None else value for value in given])
    groups = [
        Points(f"about {axis}", x, np.array([p["value_arcsec"][k] for p in d["points"]]))
        for k, axis in enumerate(AXES)
    ]
    alt = f"The mounting against {label}."
    return scatter(
        name, groups, (label, "arcsec from the mean"), alt, f"Against {label}, each campaign's mean."
    )


def _changes(d: Document) -> tuple[Table, ...]:
    if not d["changes"]:
        return ()
    rows = [
        (
            c["words"],
            *(f"{v:+.2f} ± {s:.2f}" for v, s in zip(c["size_arcsec"], c["sigma_arcsec"], strict=True)),
            f"{c['p']:.2g}",
            "–" if c["ground_m"] is None else f"{c['ground_m']:.2f} m",
        )
        for c in d["changes"]
    ]
    head = ("change", "x, arcsec", "y, arcsec", "z, arcsec", "p by chance", "on the ground")
    marked = frozenset(i for i, c in enumerate(d["changes"]) if c["significant"])
    note = (
        "All of them are estimated side by side; the walk and what campaigns' errors have in common are in the sigmas. "
        "On the ground: at the nadir, without the part about the line of sight. Set apart: less than 1 % by chance."
    )
    return (Table("Changes, the most significant first", head, rows, marked=marked, note=note),)


def _advice(a: Document) -> Table:
    keys = (
        ("in_use", "the mounting in use"),
        ("if_issued", "the foretold one, if issued now"),
        ("if_calibrated", "right after a campaign like the latest"),
    )
    rows = [
        (words, _number(a[f"rms_{key}_arcsec"], "arcsec"), _number(a[f"rms_{key}_m"], "m"))
        for key, words in keys
    ]
    days = a["horizon_days"]
    caption = f"Expected error across the line of sight over {days:g} day{'s' * (days != 1)} (rms)"
    return Table(caption, ("with", "angle", "on the ground"), rows)


def _number(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{value:.2f} {unit}"


def _happened(d: Document) -> tuple[Table, ...]:
    rows = [(e["time"][:16], e["kind"], e["note"]) for e in d["events"]]
    rows += [(one["from"][:16], "issued from then on", one["reason"]) for one in d["issued"]]
    return (Table("Events", ("time (UTC)", "what", "note"), sorted(rows), text_columns=3),) if rows else ()


def _campaigns(d: Document) -> Table:
    points = d["points"][-LISTED:]
    rows = [
        (
            p["time"][:10],
            p["name"],
            *(f"{v:+.2f} ± {s:.2f}" for v, s in zip(p["value_arcsec"], p["sigma_arcsec"], strict=True)),
            "jump" if p["jumped"] > 0.5 else "",
        )
        for p in points
    ]
    left = len(d["points"]) - len(points)
    note = f"The last {LISTED}; {left} earlier ones are in the archive." if left else ""
    return Table(
        "Campaigns, arcsec from the mean", ("date", "campaign", *AXES, "before it"), rows, 2, note=note
    )
