"""``starplumb archive``: the memory of a mission, a verb each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...physics.errors import counted
from ..output import Json, Output, Quiet, Verbose
from ..usage import WithNumbers
from . import trends
from .options import File, OfCamera, OfSatellite
from .rerun import rerun

archive = typer.Typer(
    help="The memory of a mission: campaigns, their joint solution, the mounting's trend, and what was issued.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@archive.command("init", cls=WithNumbers)
def init(
    file: File,
    satellite: Annotated[
        str, typer.Option("--satellite", metavar="NAME", help="The satellite of campaigns that say no other.")
    ] = "",
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Make an empty archive.

    Example:

      starplumb archive init mission.db --satellite SAT1
    """
    from ...io.archive.store import create

    create(file, satellite)
    speak = Output(json, quiet, verbose)
    speak.document({"schema": "starplumb-archive-init/1", "archive": str(file), "satellite": satellite})
    speak.show(f"written: {file}")


@archive.command("add", cls=WithNumbers)
def add(
    file: File,
    what: Annotated[
        list[Path],
        typer.Argument(
            help="Results (a result.json or its folder) or campaigns (a campaign.toml, calibrated by default).",
            metavar="WHAT...",
        ),
    ],
    satellite: Annotated[
        str | None,
        typer.Option("--satellite", metavar="NAME", help="Their satellite [default: the archive's]."),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Add results or campaigns, all or none; what is there already stays one entry.

    The files of a campaign are kept beside the archive, in FILE.db.files, where they still are what the result was made
    from.

    Examples:

      starplumb archive add mission.db demo/result

      starplumb archive add mission.db spring/campaign.toml autumn/campaign.toml
    """
    from ...session.mission.archive import open_archive

    done = open_archive(file).add([str(one) for one in what], satellite)
    speak = Output(json, quiet, verbose)
    speak.notices(done["notices"])
    speak.document(done)
    for one in done["campaigns"]:
        state = one["status"] if one["new"] else "there already"
        if satellite not in (None, one["satellite"]):
            state += (
                f" as one of {one['satellite']!r}, which stays so: --satellite {satellite} changes nothing"
            )
        lacking = "" if one["kept"] else "; not all of its files are kept, so that it cannot be run again"
        speak.show(f"{one['id'][:12]}  {one['name']}: {state}{lacking}")


@archive.command("list", cls=WithNumbers)
def list_(file: File, json: Json = False, quiet: Quiet = False, verbose: Verbose = False) -> None:
    """List all campaigns, withdrawn ones too; with --json a list, one entry per campaign.

    Example:

      starplumb archive list mission.db
    """
    from ...session.mission.archive import open_archive

    found = open_archive(file)
    speak = Output(json, quiet, verbose)
    speak.document(found.listed)
    speak.shown(found)


@archive.command("show", cls=WithNumbers)
def show(
    file: File,
    satellite: OfSatellite = None,
    camera: OfCamera = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """The joint solution of all campaigns that stand, as if they were one: each landmark is one unknown.

    Example:

      starplumb archive show mission.db
    """
    from ...session.mission.archive import open_archive

    found = open_archive(file).show(satellite, camera)
    speak = Output(json, quiet, verbose)
    speak.document(found.document)
    speak.show(*map(speak.table, found.tables), *found.sentences)


@archive.command("withdraw", cls=WithNumbers)
def withdraw(
    file: File,
    campaign: Annotated[
        str,
        typer.Argument(help="The first characters of its id, or a campaign's name.", metavar="CAMPAIGN"),
    ],
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why; it stays beside it.")],
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Withdraw a campaign or an event: it stays in the archive, with the reason, and counts no more.

    Example:

      starplumb archive withdraw mission.db 3f6a12 --reason "wrong clock table"
    """
    from ...session.mission.archive import open_archive

    done = open_archive(file).withdraw(campaign, reason)
    speak = Output(json, quiet, verbose)
    speak.document(done)
    speak.show(f"withdrawn: {done['id'][:12]} {done['name']}")


@archive.command("merge", cls=WithNumbers)
def merge(
    file: File,
    other: Annotated[Path, typer.Argument(help="The archive whose campaigns are added.", metavar="OTHER.db")],
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Add all that another archive has, all or nothing: campaigns, events, withdrawals and what was issued.

    Example:

      starplumb archive merge mission.db from-the-other-team.db
    """
    from ...session.mission.archive import open_archive

    done = open_archive(file).merge(other)
    speak = Output(json, quiet, verbose)
    speak.document(done)
    new = ", ".join(f"{done[key]} {key}" for key in ("campaigns", "events", "issued", "withdrawn"))
    speak.show(f"new in {file}: {new}")


@archive.command("verify", cls=WithNumbers)
def verify(file: File, json: Json = False, quiet: Quiet = False, verbose: Verbose = False) -> None:
    """Look whether the database is whole, every row as it was added and as the results say, and all files are kept.

    Exit status 3 where something is wrong.

    Example:

      starplumb archive verify mission.db
    """
    from ...physics.errors import AlignmentFailed
    from ...session.mission.archive import open_archive

    found = open_archive(file).verify()
    speak = Output(json, quiet, verbose)
    speak.document(found)
    lost = [
        f"{one[:12]} cannot be run again, for want of {', '.join(names)}"
        for one, names in found["not_kept"].items()
    ]
    if left := len(found["left_over"]):
        lost.append(
            f"{left} files in {file.name}.files are of no campaign: an addition was stopped; repeat it"
        )
    n, wrong = found["campaigns"], len(found["faults"])
    speak.show(f"{counted(n, 'campaign')}, {counted(wrong, 'fault')}", *found["faults"], *lost)
    if found["faults"]:
        more = f" and {wrong - 1} more" if wrong > 1 else ""
        raise AlignmentFailed(f"{file}: {found['faults'][0]}{more}, wanted rows as they were added")


for verb in (trends.trend, trends.event, trends.issue, rerun):
    archive.command(verb.__name__, cls=WithNumbers)(verb)
