"""What came of many campaigns, and how the mounting of each satellite is: ``fleet.json``, and the page's rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...io.archive import store
from ...io.archive.rows import entries
from ...physics.errors import InputError
from .archive import Archive
from .fleet_rows import satellite_row
from .known import known
from .trend_document import trend_document

USABLE = ("ok", "weak")
HORIZON_DAYS = 30.0
"""Over which the mountings of a fleet are used."""


def fleet_document(found: Sequence[dict[str, Any]], archive: Archive | None) -> dict[str, Any]:
    """Of the outcomes of campaigns, and of all satellites of the archive, the largest expected loss first."""
    campaigns = [one | {"failed": one["status"] not in USABLE or one["archived"] is False} for one in found]
    return {
        "schema": "starplumb-fleet/1",
        "archive": None if archive is None else str(archive.path),
        "campaigns": campaigns,
        "satellites": [] if archive is None else satellites(archive),
    }


def satellites(archive: Archive) -> list[dict[str, Any]]:
    """A row for each mounting of an archive that has a campaign in use, all as seen from its last campaign."""
    name, found = str(archive.path), []
    with store.opened(archive.path) as database:
        for one in dict.fromkeys(entry.instrument for entry in entries(database) if entry.stands):
            try:
                found.append(known(name, database, one))
            except InputError:  # none of its campaigns has normal equations
                continue
    latest = max((int(of.trend.t_ns[-1]) for of in found), default=0)
    rows = [satellite_row(trend_document(of, latest, HORIZON_DAYS)) for of in found]
    return sorted(rows, key=lambda row: -(row["loss_m"] or row["loss_arcsec"]))
