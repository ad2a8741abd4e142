"""The commands by name.  Each stands in a module of its own, which imports what it needs only when it runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib import import_module
from keyword import iskeyword
from typing import Annotated, Any

import typer

from .. import __version__
from .channels import Commands
from .usage import Verbs, WithNumbers

COMMANDS = {
    "init": "files.init",
    "import": "files.import_",
    "check": "files.check",
    "measure": "measure",
    "calibrate": "calibrate",
    "compare": "compare",
    "diagnose": "diagnose",
    "locate": "locate",
    "project": "project",
    "predict": "predict",
    "points": "files.points",
    "simulate": "simulate",
    "budget": "budget",
    "plan": "planning.plan",
    "reproduce": "reproduce",
    "schema": "files.schema",
    "archive": "archive.verbs",
}
"""Commands in the order of the help, and the module of each."""


def __getattr__(name: str) -> typer.Typer:
    """``app``, the program with all its commands."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found: typer.Typer = globals().setdefault(name, program())
    return found


def program(names: Iterable[str] = COMMANDS) -> typer.Typer:
    """The program with some of its commands: loading and describing all takes a tenth of a small campaign."""
    found = typer.Typer(
        cls=Commands,
        help="In-flight alignment of an Earth-observation camera with its star tracker.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,  # plain help: importing rich for it would take longer than all the rest
        epilog="Exit status: 0 done, 2 unusable input (one line says why), 3 done but the answer must not be used, "
        "128 and the signal's number when interrupted.",
    )
    found.callback(invoke_without_command=True)(_options)
    for name in names:
        command = _command(name)
        if isinstance(command, typer.Typer):
            found.add_typer(command, name=name, cls=Verbs)
        else:
            found.command(name, cls=WithNumbers)(command)
    return found


def _command(name: str) -> Any:
    """The function of a command, or the group of its verbs: the object of the same name."""
    module = import_module(f".{COMMANDS[name]}", __package__)
    return getattr(module, f"{name}_" if iskeyword(name) else name)


def asked(arguments: Sequence[str]) -> Iterable[str]:
    """The commands that a command line needs: the one that it begins with, else all."""
    return arguments[:1] if arguments and arguments[0] in COMMANDS else COMMANDS


def _options(
    ctx: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="With --version: what a report of a fault should name.")
    ] = False,
) -> None:
    if version:
        from .versions import lines

        typer.echo("\n".join(lines() if verbose else [f"starplumb {__version__}"]))
    elif ctx.invoked_subcommand is None:
        ctx.fail("Missing command")
    elif verbose:
        ctx.fail("--verbose before a command goes with --version; each command has its own")
