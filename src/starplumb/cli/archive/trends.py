"""``starplumb archive trend``, ``event`` and ``issue``: the mounting against time, and what is used of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..options.places import require_place
from ..output import Json, Output, Quiet, Verbose
from .options import File, OfCamera, OfSatellite


def trend(
    file: File,
    satellite: OfSatellite = None,
    camera: OfCamera = None,
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="TIME", help="Seen from this time on, UTC [default: last campaign]."),
    ] = None,
    horizon_days: Annotated[
        float, typer.Option("--horizon-days", metavar="DAYS", help="How far ahead a mounting is used.")
    ] = 30.0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the page trend.html.")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """The mounting against time: what changes it and how surely, what will be, and what to do.

    Each change has its significance and its size on the ground. The recommendation is by expected metres: keep the
    mounting in use, issue the foretold one, or calibrate again.

    Examples:

      starplumb archive trend mission.db

      starplumb archive trend mission.db --out trend --horizon-days 90
    """
    from ...disk.owned import require_own
    from ...report.page import is_page
    from ...session.mission.archive import open_archive

    if out is not None:
        require_own(out / "trend.html", [file], is_page)
    found = open_archive(file).trend(satellite, camera, at, horizon_days)
    speak = Output(json, quiet, verbose)
    written = []
    if out is not None:
        from ...io.text.write import publish

        publish(out, {"trend.html": found.page()})
        written = [f"written: {out / 'trend.html'}"]
    speak.document(found.document)
    speak.show(*map(speak.table, found.tables), *found.sentences, *written)


def event(
    file: File,
    time: Annotated[
        str, typer.Argument(help="When, ISO 8601 in UTC; a day alone is its midnight.", metavar="TIME")
    ],
    kind: Annotated[str, typer.Argument(help="What happened, in a word or two.", metavar="KIND")],
    note: Annotated[str, typer.Option("--note", metavar="TEXT", help="More of it.")] = "",
    satellite: OfSatellite = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Note what happened to a satellite: the trend then expects that its mounting may have jumped.

    `starplumb archive withdraw` takes an event back, by the id that is printed.

    Example:

      starplumb archive event mission.db 2026-05-04T11:20:00 "safe mode"
    """
    from ...session.mission.archive import open_archive

    done = open_archive(file).event(time, kind, note, satellite)
    speak = Output(json, quiet, verbose)
    speak.document(done)
    speak.show(f"noted: {done['time']} {done['kind']}, {done['id'][:12]}")


def issue(
    file: File,
    reason: Annotated[
        str, typer.Option("--reason", metavar="TEXT", help="Why; it stays beside what is issued.")
    ],
    start: Annotated[
        str | None,
        typer.Option("--start", metavar="TIME", help="Valid from, UTC [default: the last campaign]."),
    ] = None,
    end: Annotated[
        str | None,
        typer.Option("--end", metavar="TIME", help="Valid to, UTC [default: until further notice]."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="DIR", help="Folder for the SPICE frame kernel mounting.tf and issue.json."
        ),
    ] = None,
    satellite: OfSatellite = None,
    camera: OfCamera = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Issue the mounting that the trend foretells, as coefficients with their covariance, valid for an interval.

    `starplumb predict mission.db --at TIME` then gives it at a time. What was issued before stays in the archive.

    Example:

      starplumb archive issue mission.db --reason "after the May campaign" --out issued
    """
    from ...session.mission.archive import open_archive

    mark = ("issue.json", "starplumb-archive-issue/1")
    if out is not None:
        require_place(out, ["mounting.tf", mark[0]], [file], mark)
    done = open_archive(file).issue(reason, start, end, satellite, camera)
    if out is not None:
        from ...io.text.write import marked, publish
        from ...session.mission.kernel import kernel_of

        publish(out, {"mounting.tf": kernel_of(done)}, mark=marked(mark[0], done))
    speak = Output(json, quiet, verbose)
    speak.document(done)
    sigma = ", ".join(f"{s:.2f}" for s in done["sigma_arcsec"])
    until = "until further notice" if done["to"] is None else f"to {done['to'][:19]}"
    speak.show(
        f"issued: valid from {done['from'][:19]} {until}, sigma {sigma} arcsec at its start",
        *([] if out is None else [f"written: {out}"]),
    )
