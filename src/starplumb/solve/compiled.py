"""Formulas on component rows compiled by numba (the extra ``fast``), from the very source that NumPy and Python run.

Compiled code may call a plain Python function once that is registered with numba: a formula as it stands, or, for the
two functions of :mod:`starplumb.physics.components` that depend on NumPy, with the form that stands here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from types import FunctionType
from typing import Any

from ..physics import components

Function = Callable[..., Any]
_known: set[Function] = set()
"""The functions registered with numba."""


def kept(function: Function) -> Function | None:
    """A function with all that it calls compiled, and kept beside its source for later processes; None without numba or
    where nothing can be kept.

    Floating point is strict: nothing is reordered, so that results do not depend on the compiler; divisions are
    NumPy's, which have no branch.
    """
    try:
        return _compiled(_by_source(function))
    except (ImportError, RuntimeError):  # no numba, or no folder that numba may write to
        return None


def is_kept(function: Function) -> bool:
    """Whether an earlier process has left what :func:`kept` makes of a function."""
    file = Path(function.__code__.co_filename)
    named = f"{file.stem}.{_by_source(function).__qualname__}-*.nbi"
    return any(file.parent.joinpath("__pycache__").glob(named))


def _by_source(function: Function) -> Function:
    """The function under a name that changes with any source that it is made of: numba asks for its own file only."""
    files = {f.__code__.co_filename for f in (function, *_called_by(function))}
    digest = sha256(b"".join(Path(name).read_bytes() for name in sorted(files))).hexdigest()
    named = FunctionType(function.__code__, function.__globals__, function.__name__)
    named.__qualname__, named.__module__ = f"{function.__name__}_{digest[:16]}", function.__module__
    return named


def _compiled(function: Function) -> Function:
    import numba
    from numba.extending import overload, register_jitable

    inline: Any = {"error_model": "numpy", "forceinline": True}
    for called in {*_called_by(function)} - _known:
        if called in _FORMS:
            overload(called, jit_options=inline, strict=False)(_always(_FORMS[called]))
        else:
            register_jitable(**inline)(called)
        _known.add(called)
    run: Function = numba.njit(error_model="numpy", nogil=True, cache=True)(function)
    return run


def _always(form: Function) -> Function:
    def chosen(*_types: Any) -> Function:
        return form

    return chosen


def _called_by(function: Function) -> Iterator[Function]:
    """The plain functions that a function names, and those that they name."""
    seen: set[Function] = set()
    waiting = [function]
    while waiting:
        at: Any = waiting.pop()
        named = {at.__globals__.get(name) for name in at.__code__.co_names}
        new = {f for f in named if isinstance(f, FunctionType)} - seen
        seen |= new
        yield from new
        waiting += new - _FORMS.keys()


def _larger(a: float, b: float) -> float:
    return a if a > b else b


def _root(a: float) -> float:
    return math.sqrt(a)


_FORMS: dict[Function, Function] = {
    components.larger: _larger,
    components.root: _root,
}
"""What is compiled in place of the functions that depend on NumPy."""
