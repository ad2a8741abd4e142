"""The fuzzy observer is run in rows, or few trials number by number, by Python or compiled: whichever ends sooner.

The bits are the same.  Compiling takes some seconds once; what is compiled is kept beside this file, as Python keeps
its own, and later processes load it.
"""

from __future__ import annotations

from functools import cache
from typing import Any, cast

import numpy as np

from ...physics.components import Array, four, six, three
from ...solve.compiled import Function, is_kept, kept
from .observer_rows import (
    AXES,
    E_E,
    FLOOR,
    SIGHTING_ROWS,
    STATE,
    STATE_ROWS,
    Parameters,
    Sighting,
    Update,
    corrected,
    form,
    run_blocks,
    update_factorised,
)

FEW = 8
"""Trials up to which single numbers are faster than rows (ten times for one; as fast for some fifteen)."""
TO_LOAD, TO_COMPILE = 80_000, 300_000
"""Sightings times cycles from which Python takes longer than numba and what is kept take to load, or to compile."""


def run(rows: Array, cycles: int, parameters: Parameters, trace: Array, factorised: bool) -> None:
    """:func:`~starplumb.estimators.published.observer_rows.run_blocks` with the wanted form of (3), or one by one where
    the trials are too few for rows."""
    update = form(factorised)
    if rows.shape[1] > FEW or not run_singly(rows, cycles, parameters, trace, update):
        run_blocks(rows, cycles, parameters, trace, update)


def run_singly(rows: Array, cycles: int, parameters: Parameters, trace: Array, update: Update) -> bool:
    """:func:`~starplumb.estimators.published.observer_rows.run_blocks` trial by trial; False where a row would hold an
    infinity or no number, which Python's own numbers refuse."""
    fast = _compiled() if update is update_factorised and _pays(rows, cycles) else None
    found = np.empty((cycles, STATE))
    try:
        for trial in range(rows.shape[1]):
            if fast is None:
                _by_python(rows[:, trial], cycles, parameters, found, update)
            else:
                fast(rows[:, trial].copy(), cycles, parameters, found)
            trace[:, :, trial] = found
    except (ArithmeticError, ValueError):
        return False
    return True


def _pays(rows: Array, cycles: int) -> bool:
    """Whether compiled code ends sooner, with what it takes to have it."""
    work = cycles * (len(rows) - STATE_ROWS) // SIGHTING_ROWS * rows.shape[1]
    return work > TO_COMPILE or (work > TO_LOAD and is_kept(one_run))


@cache
def _compiled() -> Function | None:
    """The compiled form, loaded; None where that cannot be had."""
    fast = kept(one_run)
    try:
        if fast is not None:
            fast(np.zeros(STATE_ROWS), 0, (1.0, 1.0, 1.0, 1.0, 1.0), np.empty((0, STATE)))
    except OSError:  # a full disk keeps nothing
        return None
    return fast


def _by_python(rows: Array, cycles: int, parameters: Parameters, trace: Array, update: Update) -> None:
    """One trial, ``rows`` (10 + 16 n,) and ``trace`` (cycles, 4), on Python's own numbers.

    Raises ArithmeticError or ValueError where a row would hold an infinity or no number.
    """
    numbers = rows.tolist()
    state: tuple[Any, Any] = tuple(numbers[:STATE]), tuple(numbers[STATE:STATE_ROWS])
    sightings = [
        _sighting(numbers[at : at + SIGHTING_ROWS]) for at in range(STATE_ROWS, len(numbers), SIGHTING_ROWS)
    ]
    for cycle in range(cycles):
        for sighting in sightings:
            state = corrected(*state, sighting, parameters, update)
        trace[cycle] = state[0]


def _sighting(numbers: list[float]) -> Sighting:
    e_K, e_E, c1, c2, c3 = (tuple(numbers[at : at + 3]) for at in range(0, FLOOR, 3))
    return cast("Sighting", (e_K, e_E, c1, c2, c3, numbers[FLOOR]))


def one_run(rows: Array, cycles: int, parameters: Parameters, trace: Array) -> None:
    """The same as it is compiled, ``rows`` (10 + 16 n,), in the form on U D U^T."""
    q, P = four(rows, 0), six(rows, STATE)
    for cycle in range(cycles):
        for at in range(STATE_ROWS, len(rows), SIGHTING_ROWS):
            axes = three(rows, at + AXES), three(rows, at + AXES + 3), three(rows, at + AXES + 6)
            seen = three(rows, at), three(rows, at + E_E), axes[0], axes[1], axes[2], rows[at + FLOOR]
            q, P = corrected(q, P, seen, parameters, update_factorised)
        trace[cycle, 0], trace[cycle, 1], trace[cycle, 2], trace[cycle, 3] = q
