"""What came of many campaigns, and how the mounting of each satellite is: ``fleet.json``, and the page's rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...physics.errors import InputError
from ...physics.timescales import parse
from .archive import Archive
from .fleet_rows import satellite_row

USABLE = ("ok", "weak")


def fleet_document(found: Sequence[dict[str, Any]], store: Archive | None) -> dict[str, Any]:
    """Of the outcomes of campaigns, and of all satellites of the archive, the largest expected loss first."""
    campaigns = [one | {"failed": one["status"] not in USABLE or one["archived"] is False} for one in found]
    return {
        "schema": "starplumb-fleet/1",
        "archive": None if store is None else str(store.path),
        "campaigns": campaigns,
        "satellites": [] if store is None else satellites(store),
    }


def satellites(store: Archive) -> list[dict[str, Any]]:
    """A row for each mounting of an archive that has a campaign in use."""
    instruments = dict.fromkeys(entry.instrument for entry in store.entries if entry.stands)
    trends = []
    for one in instruments:
        try:
            trends.append(store.trend(one.satellite, one.frame_from).document)
        except InputError:  # none of its campaigns has normal equations
            continue
    latest = max((int(parse([d["at"]], "UTC")[0]) for d in trends), default=0)
    rows = [satellite_row(d, latest) for d in trends]
    return sorted(rows, key=lambda row: -(row["loss_m"] or row["loss_arcsec"]))
