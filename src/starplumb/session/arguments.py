"""The arguments of the door, checked against their annotations: a wrong one is a sentence, not a traceback."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, wraps
from inspect import Parameter, Signature, signature
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, SimpleNamespace, UnionType
from typing import Annotated, Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

import starplumb

from ..physics.errors import ArgumentError
from .show import Shown

P = ParamSpec("P")
R = TypeVar("R")
Hint = Any
"""An evaluated annotation."""


@dataclass(frozen=True)
class Wanted:
    """What an argument must be beyond its type: in words, which replace those of the type, and as a test."""

    words: str
    holds: Callable[[Any], bool] = lambda value: True


Positive = Annotated[float, Wanted("a positive number", lambda value: value > 0.0)]
NotNegative = Annotated[float, Wanted("a number that is not negative", lambda value: value >= 0.0)]
Count = Annotated[int, Wanted("a whole number of at least 1", lambda value: value >= 1)]
Folder = Annotated[str | Path, Wanted("the path of a folder", lambda value: "\0" not in str(value))]
Seed = Annotated[int, Wanted("a whole number below 2^64, not negative", lambda value: 0 <= value < 2**64)]


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function with every argument checked against its annotation before it runs.

    Numbers must be finite; those of NumPy become Python's.  Raises ArgumentError, which names the argument, what was
    found and what is wanted.
    """

    @wraps(function)
    def with_checks(*args: P.args, **kwargs: P.kwargs) -> R:
        form, hints = _form(function)
        try:
            given = form.bind(*args, **kwargs)
        except TypeError as error:
            raise TypeError(f"{function.__qualname__}: {error}") from None
        for name in given.arguments.keys() & hints.keys():
            given.arguments[name] = _taken(name, given.arguments[name], hints[name])
        return function(*given.args, **given.kwargs)

    return with_checks


@cache
def _form(function: Callable[..., Any]) -> tuple[Signature, dict[str, Hint]]:
    """The signature of a function and the evaluated annotations of its single parameters (not of what it returns)."""
    form = signature(function)
    single = {
        name: p.annotation
        for name, p in form.parameters.items()
        if p.annotation is not Parameter.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    }
    space = getattr(function, "__globals__", {})
    named = set(re.findall(r"\w+", " ".join(map(str, single.values()))))
    # an annotation may name a class of the door whose module is not loaded yet
    unloaded = {name: getattr(starplumb, name) for name in named & (set(dir(starplumb)) - space.keys())}
    return form, get_type_hints(SimpleNamespace(__annotations__=single), space, unloaded, include_extras=True)


def _taken(name: str, value: object, hint: Hint) -> object:
    fits, taken = _fit(value, hint)
    if not fits:
        raise ArgumentError(name, f"found {_shown(value)}, wanted {_wanted(value, hint)}")
    return taken


def _wanted(value: object, hint: Hint) -> str:
    """What an annotation asks for: the first of several conditions that a value of its type does not meet."""
    kind, parts = _parts(hint)
    if kind is Annotated:
        fits, taken = _fit(value, parts[0])
        if fits:
            failed: Wanted = next(wanted for wanted in parts[1:] if not wanted.holds(taken))
            return failed.words
    return _listed(_words(hint))


def _parts(hint: Hint) -> tuple[Any, tuple[Any, ...]]:
    return get_origin(hint), get_args(hint)


def _fit(value: Any, hint: Hint) -> tuple[bool, Any]:
    """Whether a value is what an annotation says, and the value to go on with."""
    kind, parts = _parts(hint)
    if kind is Annotated:
        fits, taken = _fit(value, parts[0])
        return fits and all(wanted.holds(taken) for wanted in parts[1:]), taken
    if kind in (Union, UnionType):
        return next((found for found in (_fit(value, part) for part in parts) if found[0]), (False, value))
    if kind is Literal:
        return isinstance(value, str) and value in parts, value
    if kind is Sequence:
        each = isinstance(value, Sequence) and not isinstance(value, str | bytes)
        return each and all(_fit(item, parts[0])[0] for item in value), value
    return _fit_class(value, kind or hint)


def _fit_class(value: Any, kind: type) -> tuple[bool, Any]:
    if kind is bool:
        return isinstance(value, bool | np.bool), value
    if kind in (int, float) and isinstance(value, bool | np.bool):
        return False, value
    if kind is int:
        return isinstance(value, Integral), int(value) if isinstance(value, Integral) else value
    if kind is float:
        return _fit_number(value)
    return isinstance(value, kind), value


def _fit_number(value: Any) -> tuple[bool, Any]:
    try:
        number = float(value) if isinstance(value, Real) else math.nan
    except OverflowError:
        number = math.inf
    return math.isfinite(number), number


_NAMES: dict[Hint, str] = {
    bool: "True or False",
    int: "a whole number",
    float: "a finite number",
    str: "a string",
    Path: "a path",
    Mapping: "a dictionary",
    Sequence: "a list of strings",
    Callable: "a function",
}


def _words(hint: Hint) -> list[str]:
    """What an annotation asks for, its alternatives one by one."""
    kind, parts = _parts(hint)
    if kind is Annotated:
        return [parts[-1].words]
    if kind in (Union, UnionType):
        return [word for part in parts if part is not NoneType for word in _words(part)]
    if kind is Literal:
        return [repr(part) for part in parts]
    if isinstance(hint, type) and issubclass(hint, Shown):
        return [f"a {hint.__name__}, as {hint.made_by} gives it"]
    return [_NAMES.get(kind or hint) or f"a {hint.__name__}"]


def _listed(words: Sequence[str]) -> str:
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _shown(value: object) -> str:
    """A value in a few words: what it is where it is short, else of which class."""
    if isinstance(value, np.generic):
        return str(value)
    plain = value is None or isinstance(value, bool | int | float | str | list | tuple | Path)
    text = repr(value) if plain else ""
    if text and len(text) <= 60:
        return text
    return f"the class {value.__name__}" if isinstance(value, type) else f"a {type(value).__name__}"
