"""Many campaigns at once, as ``starplumb calibrate`` runs them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..options.places import require_place
from ..output import Output

if TYPE_CHECKING:
    from ...session.mission.fleet import Asked

FILES = ("fleet.json", "fleet.html")
MARK = ("fleet.json", "starplumb-fleet/1")


def fleet(
    speak: Output,
    campaigns: list[Path],
    asked: Asked,
    out: Path | None,
    jobs: int | None,
    scheduler: str | None,
    archive: Path | None,
) -> None:
    """Calibrate campaigns, write the page, and end with status 3 and the list where some have no usable answer."""
    from ...io.text.write import json_text, publish
    from ...report.fleet import fleet_page
    from ...report.page import Table
    from ...session.mission.fleet import complaint, flown

    folder = out or (Path() if archive is None else archive.parent)
    require_place(folder, FILES, [campaigns, archive], MARK)
    done = flown(
        campaigns,
        asked,
        out,
        jobs,
        scheduler,
        archive,
        lambda items: speak.watched(items, "calibrating", len(campaigns)),
    )
    publish(folder, {"fleet.json": json_text(done), "fleet.html": fleet_page(done)})
    speak.document(done)
    rows = [(one["campaign"], one["status"] + " (was there)" * one["resumed"]) for one in done["campaigns"]]
    speak.show(speak.table(Table("Campaigns", ("campaign", "status"), rows, text_columns=2)))
    speak.show(f"written: {folder / 'fleet.html'}")
    if (failed := complaint(done)) is not None:
        raise failed
