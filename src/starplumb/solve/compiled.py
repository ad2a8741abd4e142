"""Formulas on component rows compiled by numba (the extra ``fast``), from the very source that NumPy runs.

Compiled code may call a plain Python function once that is registered with numba: a formula as it stands, or, for the
few functions of :mod:`starplumb.physics.components` that depend on NumPy, with the form that stands here.  So that the
compiler vectorises, it knows the width of a block, everything is inlined, and a loop over ``lanes()`` touches only rows
of fixed number; hence ``read_block`` and ``write_block``, which here copy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from ..physics import components
from ..physics.components import Array
from ..physics.errors import InputError

WIDTH = 64
"""Lanes of a block: two dozen rows of 512 bytes stay in the first-level cache."""

Function = Callable[..., Any]
_known: set[Function] = set()
"""The functions registered with numba."""


def kept(function: Function) -> Function | None:
    """:func:`compiled`, and kept beside the source of the function for later processes; None without numba or where
    nothing can be kept."""
    try:
        return compiled(_by_source(function), cache=True)
    except (InputError, RuntimeError):  # no numba, or no folder that numba may write to
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


def compiled(function: Function, *, cache: bool = False) -> Function:
    """A function with all that it calls compiled, under strict floating point: nothing is reordered, so that results
    do not depend on the compiler; divisions are NumPy's, which have no branch.

    Raises InputError where numba is not installed.
    """
    try:
        import numba
        from numba.extending import overload, register_jitable
    except ImportError:
        raise InputError(
            "compiled: found no numba, wanted starplumb installed with its extra 'fast'"
        ) from None
    inline: Any = {"error_model": "numpy", "forceinline": True}
    for called in {*_called_by(function)} - _known:
        if called in _FORMS:
            overload(called, jit_options=inline, strict=False)(_always(_FORMS[called]))
        else:
            register_jitable(**inline)(called)
        _known.add(called)
    run: Function = numba.njit(error_model="numpy", nogil=True, cache=cache)(function)
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


def _width(trials: int) -> int:
    return WIDTH


def _lanes() -> range:
    return range(WIDTH)


def _spare(rows: int, width: int) -> Array:
    return np.zeros((rows, WIDTH))


def _read(W: Array, row: int, lane: int, block: Array, rows: int) -> Array:
    count = min(WIDTH, W.shape[1] - lane)
    for i in range(rows):
        for at in range(count):
            block[i, at] = W[row + i, lane + at]
    return block


def _write(W: Array, row: int, lane: int, block: Array, first: int) -> None:
    count = min(WIDTH, W.shape[1] - lane)
    for i in range(first, len(block)):
        for at in range(count):
            W[row + i, lane + at] = block[i, at]


def _larger(a: float, b: float) -> float:
    return a if a > b else b


def _root(a: float) -> float:
    return math.sqrt(a)


def _extreme(number: float) -> float:
    return abs(number)


_FORMS: dict[Function, Function] = {
    components.block_width: _width,
    components.lanes: _lanes,
    components.spare_block: _spare,
    components.read_block: _read,
    components.write_block: _write,
    components.larger: _larger,
    components.root: _root,
    components.extreme: _extreme,
}
"""What is compiled in place of the functions that depend on NumPy."""
