"""What ``--drift`` asks for: ``none``, ``auto``, or models of a motion by name, all of them at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...physics.errors import ArgumentError, EpochError, did_you_mean
from ...physics.timescales import format_iso, moment
from .averaging import Structure, structures
from .regressors import LINEAR, MEAN, ORBIT, STEP, TEMPERATURE, Scales, When, harmonics, told_apart

NONE, AUTO = "none", "auto"
MOST_HARMONICS = 8
WANTED = f"none, auto or some of orbit:K (K up to {MOST_HARMONICS}), linear, step:TIME, temperature:NAME"


def columns_asked(drift: str) -> tuple[str, ...]:
    """Columns of the models in a text with commas between them; nothing for none and auto.

    Raises ArgumentError for one that there is not.
    """
    if drift in (NONE, AUTO):
        return ()
    names = [part.strip() for part in drift.split(",")]
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise ArgumentError("drift", f"found {twice!r} twice, wanted each model once")
    return tuple(dict.fromkeys(column for name in names for column in _columns(name)))


def _columns(name: str) -> tuple[str, ...]:
    kind, _, which = name.partition(":")
    if kind == LINEAR and not which:
        return (LINEAR,)
    if kind == ORBIT and which in map(str, range(1, MOST_HARMONICS + 1)):
        return harmonics(int(which))
    if kind == TEMPERATURE and which:
        return (name,)
    if kind == STEP and which:
        try:
            at = moment(which, "UTC")
        except EpochError as error:
            raise ArgumentError("drift", f"step: {error}") from None
        return (name if "T" in which or " " in which.strip() else f"{STEP}:{format_iso([at], 'UTC', 0)[0]}",)
    hint = did_you_mean(kind, (NONE, AUTO, ORBIT, LINEAR, STEP, TEMPERATURE))
    raise ArgumentError("drift", f"found {name!r}, wanted {WANTED}{hint}")


def kinds_asked(
    drift: str, tried: Mapping[str, Sequence[Structure]], when: When, scales: Scales
) -> dict[str, tuple[Structure, ...]]:
    """Models to average: all that images can tell for auto, else the one that is asked for.

    Raises ArgumentError where the images do not tell it.
    """
    if drift == AUTO:
        return structures(tried)
    columns = columns_asked(drift)
    for name in columns:
        kind, _, which = name.partition(":")
        if kind == ORBIT and scales.orbit is None:
            raise ArgumentError("drift", f"found {drift!r}, but the images follow no even orbit")
        if kind == TEMPERATURE and not scales.temperatures.get(which, (0.0, 0.0))[1]:
            raise ArgumentError(
                "drift", f"found {name!r}, wanted a column temperature_{which}_c of the images that varies"
            )
    if not np.all(told_apart(scales.columns((MEAN, *columns), when))):
        raise ArgumentError(
            "drift",
            f"found {drift!r}, but {when.t_ns.size} images at these times do not tell that from a mounting at rest: "
            "wanted more of them, or others; auto takes what they tell",
        )
    return {drift: (columns,)}
