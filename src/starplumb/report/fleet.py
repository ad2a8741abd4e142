"""The page of a fleet: a row a satellite, and what came of each campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..physics.errors import counted
from .page import Page, Section, Table, render

Document = Mapping[str, Any]

BARS = "▁▂▃▄▅▆▇█"
ACTIONS = ("keep", "issue", "calibrate")
SURE = 0.01
"""Probability by chance below which a change is one."""


def fleet_page(document: Document) -> str:
    """``fleet.html``; the same document gives the same text."""
    d = document
    failed = [one for one in d["campaigns"] if one["failed"]]
    page = Page(
        title="Fleet",
        summary=_summary(d, len(failed)),
        badge=f"{len(failed)} without a usable answer" if failed else "every campaign has a usable answer",
        tone="bad" if failed else "good",
        sections=(
            Section("satellites", "Satellites, the largest expected loss first", (), (), _satellites(d)),
            Section("failed", "Campaigns without a usable answer", (), (), _campaigns("Failed", failed)),
            Section("campaigns", "All campaigns", (), (), _campaigns("Campaigns", d["campaigns"])),
        ),
        kind="fleet",
    )
    return render(page)


def _summary(d: Document, failed: int) -> str:
    n, s = len(d["campaigns"]), d["satellites"]
    kinds = [row["action"] for row in s]
    todo = ", ".join(f"{kinds.count(kind)} to {kind}" for kind in ACTIONS if kind in kinds)
    satellites = f" {counted(len(s), 'satellite')} in the archive: {todo}." if s else ""
    return f"{counted(n, 'campaign')}, {failed} of them without a usable answer.{satellites}"


def _satellites(d: Document) -> tuple[Table, ...]:
    rows = [
        (
            row["satellite"] or row["from"],
            _loss(row),
            row["action"],
            _spark(row["recent_arcsec"]),
            f"{row['age_days']:.0f}",
            f"{max(row['sigma_arcsec'][:2]):.2f}",
            "–" if row["calibrate_by"] is None else row["calibrate_by"][:10],
            _change(row),
            str(row["campaigns"]),
        )
        for row in d["satellites"]
    ]
    head = (
        *("satellite", "loss", "what to do", "last campaigns", "age, days", "sigma x, y"),
        *("calibrate by", "change", "campaigns"),
    )
    marked = frozenset(i for i, row in enumerate(d["satellites"]) if row["action"] == "calibrate")
    note = (
        "Loss: expected error on the ground (rms, at the nadir, across the line of sight) over 30 days with "
        "the mounting that was issued, or (in brackets) with the foretold one where none was. "
        "All of it is as seen from the latest campaign of the archive. Age: from its own last one. "
        "Sigma in arcsec, the larger of x and y. "
        "Change: the surest one and its probability by chance."
    )
    return (Table("Satellites", head, rows, 1, marked, note),) if rows else ()


def _loss(row: Document) -> str:
    size = f"{row['loss_arcsec']:.2f} arcsec" if row["loss_m"] is None else f"{row['loss_m']:.2f} m"
    return size if row["issued"] else f"({size})"


def _change(row: Document) -> str:
    if row["change_p"] is None:
        return "–"
    return f"{row['change']} (p = {row['change_p']:.1g})" if row["change_p"] < SURE else "none"


def _spark(values: Sequence[float]) -> str:
    """The values as bars of a line of text."""
    low, high = min(values), max(values)
    span = (high - low) or 1.0
    return "".join(BARS[round((value - low) / span * (len(BARS) - 1))] for value in values)


def _campaigns(caption: str, found: Sequence[Document]) -> tuple[Table, ...]:
    rows = [
        (one["campaign"], one["status"] + (" (was there)" if one["resumed"] else ""), one["message"])
        for one in found
    ]
    return (Table(caption, ("campaign", "status", "message"), rows, 3),) if rows else ()
