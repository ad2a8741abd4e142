"""What is wrong with a command line, in one line; and negative numbers among the arguments."""

from __future__ import annotations

import math
import re
from typing import Any, get_args, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""Every mistake in a command line: a class that typer has but does not name; its ``ctx`` says in which command."""
MOST_DIGITS = 20
"""Of a whole number: seeds go up to 2^64."""
NUMBER = re.compile(r"-\.?\d")


def _summary(docstring: str | None) -> str:
    return " ".join((docstring or "").partition("\n\n")[0].split())


class Verbs(TyperGroup):
    """Commands under one name, whose summary is not cut."""

    def get_short_help_str(self, limit: int = 45) -> str:
        """The first paragraph of the help, however long."""
        return _summary(self.help)


class WithNumbers(TyperCommand):
    """A command among whose arguments ``-10`` is a number; what else begins with a dash is an option it must have."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take numbers as arguments.  Raises UsageError for an option that the command does not have."""
        ctx.ignore_unknown_options = True
        if not ctx.resilient_parsing:  # while a line is completed nothing is wrong with it yet
            if unknown := _unknown(args, self.get_params(ctx)):
                ctx.fail(f"No such option: {unknown}")
            self._require_numbers(ctx, args)
        rest: list[str] = super().parse_args(ctx, args)
        return rest

    def invoke(self, ctx: Any) -> Any:
        """Run it.  Raises InputError, where an argument is unusable, by the name that the command line has for it."""
        from ..physics.errors import ArgumentError, InputError

        try:
            return super().invoke(ctx)
        except ArgumentError as error:
            found = _asked_as(error.argument, self.get_params(ctx))
            if found is None:
                raise
            raise InputError(f"{found}{str(error).removeprefix(error.argument)}") from None

    def _require_numbers(self, ctx: Any, args: list[str]) -> None:
        """Raise BadParameter for a text in place of a number, and for a number out of its bounds."""
        from ..io.text.files import show

        given, _, _ = self.make_parser(ctx).parse_args(args=list(args))
        hints = get_type_hints(self.callback, include_extras=True)
        parameter: Any
        for parameter in self.get_params(ctx):
            kind, bounds = _number_asked(hints.get(parameter.name))
            text = given.get(parameter.name)
            if kind is not None and isinstance(text, str) and (wanted := _unlike(text, kind, bounds)):
                raise typer.BadParameter(f"found {show(text)}, wanted {wanted}", ctx=ctx, param=parameter)

    def get_short_help_str(self, limit: int = 45) -> str:
        """The first paragraph of the help, however long."""
        return _summary(self.help)


def _asked_as(argument: str, parameters: list[Any]) -> str | None:
    """What the command line calls an argument of a function: an option, or a word of its usage; None for another."""
    parameter = next((p for p in parameters if p.name == argument), None)
    if parameter is None:
        return None
    long = next((name for name in _names(parameter) if name.startswith("--")), None)
    return long or str(parameter.metavar or parameter.name.upper()).rstrip(".")


def _number_asked(hint: Any) -> tuple[type | None, tuple[float | None, float | None]]:
    """Whether an annotation asks for an int or a float, and its least and most."""
    asked = [getattr(hint, "__origin__", None), *get_args(getattr(hint, "__origin__", None))]
    kind = next((kind for kind in (int, float) if kind in asked), None)
    return (
        (None, (None, None)) if kind is None else (kind, (hint.__metadata__[0].min, hint.__metadata__[0].max))
    )


def _unlike(text: str, kind: type, bounds: tuple[float | None, float | None]) -> str | None:
    """What is wanted of a number, in words; None for a text that is it."""
    from ..io.text.numbers import number, whole

    value = whole(text, MOST_DIGITS) if kind is int else number(text)
    least, most = (
        (-math.inf if bounds[0] is None else bounds[0]),
        (math.inf if bounds[1] is None else bounds[1]),
    )
    if value is not None and least <= value <= most:
        return None
    words = "a whole number" if kind is int else "a finite number"
    if bounds[0] is not None:
        words += f", {least:.16g} to {most:.16g}" if bounds[1] is not None else f", {least:.16g} or more"
    return f"{words}, of at most {MOST_DIGITS} digits" if kind is int and bounds[1] is None else words


def _unknown(args: list[str], parameters: list[Any]) -> str | None:
    """The first option among the arguments that no parameter has."""
    needs_value = {name: not p.is_flag for p in parameters for name in _names(p)}
    is_value = False
    for text in args:
        if is_value:
            is_value = False
        elif text == "--":
            break
        elif (name := text.partition("=")[0]) in needs_value:
            is_value = needs_value[name] and "=" not in text
        elif text.startswith("--") or (
            text[:1] == "-" and len(text) > 1 and text[:2] not in needs_value and not NUMBER.match(text)
        ):
            return name
    return None


def _names(parameter: Any) -> list[str]:
    return [*parameter.opts, *parameter.secondary_opts] if parameter.param_type_name == "option" else []


def sentence(error: Any) -> str | None:
    """What was found and what is wanted: the option or command most likely meant; None where help is shown instead."""
    ctx: Any = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":
        error.show()
        return None
    message = " ".join(error.format_message().split()).rstrip(".")
    message = re.sub(r"'(-[^' ]*|[A-Z.a-z]+\.toml)'", r"\1", message)
    for pattern, said in (
        (r"No such (option|command):? '?([^\s']+)", _unheard_of),
        (r"Missing (?:option |argument )?'?(.*?)'?$", lambda found, _ctx: f"found no {found[1]}, wanted one"),
        # the name of an argument, which old versions of typer put into brackets, as all others
        (r"Invalid value for '\[?([A-Z_]+)\]?'(:.*)", lambda found, _ctx: found[1] + found[2]),
        (r"Invalid value for (.*)", lambda found, _ctx: found[1]),
        (
            r"Got unexpected extra argument(?:s|\(s\))? \((.*)\)",
            lambda found, _ctx: f"found {found[1]} too, wanted no more",
        ),
    ):
        if found := re.match(pattern, message):
            message = said(found, ctx)
    message = re.sub(r"(?:Value error, )?'([^']*)' is not one of ", r'found "\1", wanted one of ', message)
    if ctx is None:
        return message
    command = ctx.command_path.partition(" ")[2]
    return f"{command}: {message} ({ctx.command_path} --help says more)".removeprefix(": ")


def _unheard_of(found: re.Match[str], ctx: Any) -> str:
    from ..io.text.files import nearest

    kind, name = found[1], found[2].rstrip(".")
    options = [name for p in ctx.command.get_params(ctx) for name in _names(p) if name.startswith("--")]
    near = nearest(name, options if kind == "option" else ctx.command.commands)
    return f"found the {kind} {name}, which there is not" + (f", wanted perhaps {near}" if near else "")
