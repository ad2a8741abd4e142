"""``starplumb archive rerun``: the past with today's program."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from ..output import Json, Output, Quiet, Verbose
from .options import File


def rerun(
    file: File,
    campaign: Annotated[
        str | None,
        typer.Option("--campaign", metavar="ID", help="Only this one: its id's first characters, or name."),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Calibrate the campaigns again from the files kept beside the archive, and say what changes.

    Nothing is written: add the new result where it is the better one, and withdraw the old.

    Example:

      starplumb archive rerun mission.db
    """
    from ...report.page import Table
    from ...session.mission.archive import open_archive

    done = open_archive(file).rerun(campaign)
    speak = Output(json, quiet, verbose)
    speak.document(done)
    head = ("id", "campaign", "then", "now", "x, sigmas", "y", "z", "sigma z / then")
    rows = [_row(one) for one in done["campaigns"]]
    changed = [one["name"] for one in done["campaigns"] if one["changed"]]
    told = f"changed: {', '.join(changed)}" if changed else "nothing changes"
    lost = [f"not run: {one['name']}, {one['reason']}" for one in done["not_run"]]
    speak.show(
        speak.table(Table(f"{file} with starplumb {done['software']}", head, rows, text_columns=4)),
        told,
        *lost,
    )


def _row(one: dict[str, Any]) -> tuple[str, ...]:
    sigmas = one["change_sigmas"] or (None,) * 3
    ratio = None if one["sigma_ratio"] is None else one["sigma_ratio"][2]
    numbers = ("" if value is None else f"{value:+.4f}" for value in (*sigmas, ratio))
    return (one["id"][:12], one["name"], one["status_then"], one["status_now"], *numbers)
