"""Cells of an archive's rows as they are read: each is what was written there, else a ValueError says what it is."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ...physics.timescales import leap_seconds, parse, utc_minus_tai
from ..text.numbers import MOST_FINITE

Array = NDArray[np.float64]

LATEST_NS = (
    int((datetime(2100, 1, 1, tzinfo=UTC) - datetime(2000, 1, 1, 12, tzinfo=UTC)).total_seconds()) * 10**9
)
"""No satellite of ours flies then."""
MODEL = {
    "coefficients_arcsec": (4, 3),
    "covariance_arcsec2": (12, 12),
    "matrix": (3, 3),
    "walk_arcsec2_per_year": (),
}
"""The numbers of an issued model."""
ROUNDED = 1e-9
"""How far a covariance may be from one, its variances being 1."""


def numbers(data: bytes) -> Array:
    """Numbers as they were kept.  Raises ValueError for what can be none."""
    if not isinstance(data, bytes):
        raise ValueError("numbers that are missing")
    values = np.frombuffer(data, dtype="<f8").astype(np.float64)
    if not (np.abs(values) < MOST_FINITE).all():
        raise ValueError("numbers that are not finite")
    return values


def rows(data: Sequence[bytes]) -> Array:
    """Numbers of several rows of one length.  Raises ValueError for what can be none."""
    if not all(isinstance(row, bytes) for row in data):
        raise ValueError("numbers that are missing")
    return numbers(b"".join(data)).reshape(len(data), -1)


def epoch(t_ns: Any) -> int:
    """An epoch of a satellite.  Raises ValueError before 1972 and from 2100 on, EpochError where the leap seconds are
    not known yet: another machine, on which the campaign was added, knew them."""
    if not isinstance(t_ns, int):
        raise ValueError("a time that is no whole number")
    if not leap_seconds().t_ns[0] <= t_ns < LATEST_NS:
        raise ValueError(f"a time {t_ns * 1e-9:.0f} s from 2000-01-01T12:00:00 TAI")
    utc_minus_tai(t_ns)
    return t_ns


def number(value: Any) -> float | None:
    """A number, where there is one.  Raises ValueError for anything else."""
    if value is not None and not (isinstance(value, int | float) and abs(value) < MOST_FINITE):
        raise ValueError("numbers that are not finite")
    return value


def mapping(text: str) -> dict[str, Any]:
    """An object in JSON.  Raises ValueError for anything else."""
    found = _json(text)
    if not isinstance(found, dict):
        raise ValueError("JSON that is no object")
    return found


def options(text: str) -> dict[str, Any]:
    """What a result was asked for, in JSON: words, and parameters as ``[name, unit, sigma or null]``.

    Raises ValueError for anything else.
    """
    found = mapping(text)
    estimated = found.get("estimate", [])
    words = [found.get(key, "") for key in ("method", "drift")]
    if not isinstance(estimated, list) or not all(map(_is_parameter, estimated)):
        raise ValueError("options that are none")
    if not all(isinstance(word, str) for word in words):
        raise ValueError("options that are none")
    return found


def _is_parameter(value: Any) -> bool:
    if not isinstance(value, list) or len(value) != 3:
        return False
    name, unit, sigma = value
    return isinstance(name, str) and isinstance(unit, str) and (sigma is None or number(sigma) is not None)


def temperatures(text: str | None) -> dict[str, float]:
    """Temperatures by name, in JSON.  Raises ValueError for anything else."""
    found = mapping(text) if text else {}
    if not all(isinstance(value, int | float) and isfinite(value) for value in found.values()):
        raise ValueError("temperatures that are no numbers")
    return found


def period_s(text: str) -> float | None:
    """The period of the orbit that a ``result.json`` states, where it states one.  Raises ValueError for what is no
    such document, or no period."""
    orbit = mapping(text).get("orbit")
    if orbit is None:
        return None
    period = number(orbit.get("period_s")) if isinstance(orbit, dict) else None
    if period is None or period <= 0.0:
        raise ValueError("an orbit without its period")
    return period


def names(text: str) -> list[str]:
    """A list of names in JSON.  Raises ValueError for anything else."""
    found = _json(text)
    if not isinstance(found, list) or not all(isinstance(name, str) for name in found):
        raise ValueError("JSON that is no list of names")
    return found


def model(text: str) -> dict[str, Any]:
    """A mounting that was issued, in JSON.  Raises ValueError for what is none."""
    found = mapping(text)
    try:
        parse([found["time"], found["year_time"]], "UTC")
        each = {key: np.asarray(found[key], dtype=np.float64) for key in MODEL}
    except (InputError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"an issued mounting that is none: {error}") from None
    for key, shape in MODEL.items():
        if each[key].shape != shape or not (np.abs(each[key]) < MOST_FINITE).all():
            raise ValueError(f"an issued mounting that is none: {key}")
    if each["walk_arcsec2_per_year"] < 0.0 or not _is_covariance(each["covariance_arcsec2"]):
        raise ValueError("an issued mounting that is none: a negative variance")
    return found


def covariance(data: bytes) -> Array:
    """A covariance (3, 3) as it was kept.  Raises ValueError for what is none."""
    P = numbers(data).reshape(3, 3)
    if not _is_covariance(P):
        raise ValueError("a covariance that is none")
    return P


def _is_covariance(P: Array) -> bool:
    """Whether a matrix (n, n) is symmetric and none of its variances negative, in any direction."""
    sigma = np.sqrt(np.maximum(np.diagonal(P), 0.0))
    scale = np.outer(*(2 * [np.where(sigma > 0.0, sigma, 1.0)]))
    R = P / scale
    return bool(
        (np.diagonal(P) >= 0.0).all()
        and (np.abs(R - R.T) < ROUNDED).all()
        and np.linalg.eigvalsh(R).min() > -ROUNDED
    )


def _json(text: str) -> Any:
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("JSON that is nested without end") from None
