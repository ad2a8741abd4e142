"""The commands by name.  Each stands in a module of its own, which imports what it needs only when it runs."""

from __future__ import annotations

from typing import Annotated

import typer

from .. import __version__
from .archive.verbs import archive
from .budget import budget
from .calibrate import calibrate
from .channels import Commands
from .compare import compare
from .diagnose import diagnose
from .files.check import check
from .files.import_ import import_
from .files.init import init
from .files.points import points
from .files.schema import schema
from .locate import locate
from .measure import measure
from .predict import predict
from .project import project
from .reproduce import reproduce
from .simulate import simulate
from .usage import Verbs, WithNumbers
from .versions import lines

app = typer.Typer(
    cls=Commands,
    help="In-flight alignment of an Earth-observation camera with its star tracker.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: importing rich for it would take longer than all the rest
    epilog="Exit status: 0 done, 2 unusable input (one line says why), 3 done but the answer must not be used, 128 and "
    "the signal's number when interrupted.",
)


@app.callback(invoke_without_command=True)
def _options(
    ctx: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="With --version: what a report of a fault should name.")
    ] = False,
) -> None:
    if version:
        typer.echo("\n".join(lines() if verbose else [f"starplumb {__version__}"]))
    elif ctx.invoked_subcommand is None:
        ctx.fail("Missing command")
    elif verbose:
        ctx.fail("--verbose before a command goes with --version; each command has its own")


for command in (
    *(init, import_, check, measure, calibrate, compare, diagnose, locate, project, predict, points),
    *(simulate, budget, reproduce, schema),
):
    app.command(command.__name__.rstrip("_"), cls=WithNumbers)(command)
app.add_typer(archive, name="archive", cls=Verbs)
