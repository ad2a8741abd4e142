"""Values of a TOML document: annotated types whose validators say what was found and what is wanted."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import isfinite, sqrt
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from .files import show
from .numbers import LEAST, MOST, SIGMA_WORDS, finite_float, is_sigma
from .sections import wrong

UNIT_TOLERANCE = 1e-3
"""How far a quaternion's norm may be from 1 and a matrix from orthonormal; both are then made exact."""
_LONGEST = 400
"""Of names, of which messages repeat those of files whole."""
_ROUNDED = 1e-6
"""Part of its largest entry by which a covariance written with few digits may miss being symmetric and positive."""


def number(wanted: str, good: Callable[[float], bool] = isfinite) -> Callable[[object], float]:
    """Validator of one finite number for which ``good`` holds; text and truth values do not pass."""

    def check(value: object) -> float:
        x = finite_float(value)
        if x is None or not good(x):
            raise wrong(value, wanted)
        return x

    return check


def vector(
    n: int, wanted: str, good: Callable[[float], bool] = isfinite
) -> Callable[[object], tuple[float, ...]]:
    """Validator of a list of ``n`` finite numbers for each of which ``good`` holds."""

    def check(value: object) -> tuple[float, ...]:
        items = [finite_float(item) for item in value] if isinstance(value, list | tuple) else []
        numbers = tuple(x for x in items if x is not None and good(x))
        if len(items) != n or len(numbers) != n:
            raise wrong(value, wanted)
        return numbers

    return check


def one_or_three(wanted: str, good: Callable[[float], bool]) -> Callable[[object], tuple[float, ...]]:
    """Validator of one number, which then stands for three equal ones, or of a list of three."""
    one, three = number(wanted, good), vector(3, wanted, good)

    def check(value: object) -> tuple[float, ...]:
        return three(value) if isinstance(value, list | tuple) else (one(value),) * 3

    return check


def _positive(x: float) -> bool:
    return LEAST <= x <= MOST


def sigma_or_zero(x: float) -> bool:
    """Whether a number can be a sigma; 0 claims an exact value."""
    return bool(is_sigma(x))


def _sigma(x: float) -> bool:
    return bool(is_sigma(x, exact=False))


def printable(value: object) -> object:
    """A name with something in it and nothing that would break a line."""
    if isinstance(value, str) and (not value.strip() or not value.isprintable() or len(value) > _LONGEST):
        raise wrong(value, f"a name of printable letters, at most {_LONGEST}")
    return value


class InMemory(str):
    """The name of a data frame, where a document would have that of a file."""


def file_name(*endings: str) -> Callable[[object], object]:
    """Validator of a file name whose ending tells one of the formats that a section reads."""

    def check(value: object) -> object:
        if isinstance(value, InMemory):
            return value
        if isinstance(value, str) and not value.lower().endswith(endings):
            raise wrong(value, f"a file name ending in {', '.join(endings)}")
        return printable(value)

    return check


GCRF = ("GCRF", "J2000", "EME2000", "ICRF")
"""Names of one frame: the bias between them is 0.02 arcsec."""


def frame_name(value: object) -> object:
    """J2000, EME2000 and ICRF are read as synonyms of GCRF."""
    return "GCRF" if value in GCRF else value


def choice(*words: str) -> BeforeValidator:
    """One of a few words, written exactly so."""
    quoted = [show(word) for word in words]
    listed = " or ".join([", ".join(quoted[:-1]), quoted[-1]]) if len(words) > 1 else quoted[0]

    def check(value: object) -> object:
        if value in words:
            return value
        raise wrong(value, listed)

    return BeforeValidator(check)


def _unit_quaternion(value: object) -> tuple[float, ...]:
    q = vector(4, "four finite numbers, a quaternion of norm 1")(value)
    norm = sqrt(sum(x * x for x in q))
    if abs(norm - 1.0) > UNIT_TOLERANCE:
        raise wrong(value, f"a quaternion of norm 1 (its norm is {norm:.6g})")
    return q


def _rotation_matrix(value: object) -> tuple[tuple[float, ...], ...]:
    wanted = "three rows of three numbers, a rotation matrix"
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise wrong(value, wanted)
    rows = tuple(vector(3, wanted)(row) for row in value)
    C = np.array(rows)
    off = float(np.abs(C @ C.mT - np.eye(3)).max())
    if off > UNIT_TOLERANCE:
        raise wrong(value, f"a rotation matrix (C times its transpose is off the identity by {off:.3g})")
    if np.linalg.det(C) < 0.0:
        raise wrong(value, "a rotation matrix of determinant +1 (this one mirrors: its determinant is -1)")
    return rows


def _covariance_matrix(value: object) -> tuple[tuple[float, ...], ...]:
    wanted = "three rows of three numbers, a covariance matrix"
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise wrong(value, wanted)
    rows = tuple(vector(3, wanted)(row) for row in value)
    P = np.array(rows)
    size = float(np.max(np.abs(P)))
    if np.max(np.abs(P - P.mT)) > _ROUNDED * size:
        raise wrong(value, f"{wanted} (this one is not symmetric)")
    least = float(np.min(np.linalg.eigvalsh(0.5 * (P + P.mT))))
    if least < -_ROUNDED * size:
        raise wrong(value, f"{wanted} (along one direction the variance of this one is {least:.3g})")
    return rows


def axis_order(value: object) -> object:
    """Three axes, no two neighbours alike: capitals about the axes as turned so far, small ones about the
    fixed."""
    order = value if isinstance(value, str) else ""
    one_case = order in (order.lower(), order.upper())
    if (
        len(order) != 3
        or set(order.lower()) - set("xyz")
        or not one_case
        or any(a == b for a, b in pairwise(order))
    ):
        raise wrong(
            value,
            'three axes such as "ZYX" (about the turned axes) or "xyz" (about the fixed axes)',
        )
    return value


def _whole_pair(value: object) -> tuple[int, ...]:
    items = value if isinstance(value, list | tuple) else ()
    whole = tuple(n for n in items if isinstance(n, int) and not isinstance(n, bool) and 1 <= n <= 10_000_000)
    if len(items) != 2 or len(whole) != 2:
        raise wrong(value, "two positive whole numbers, columns and rows")
    return whole


def _window(value: object) -> tuple[int, ...]:
    items = value if isinstance(value, list | tuple) else ()
    whole = tuple(n for n in items if isinstance(n, int) and not isinstance(n, bool) and 0 <= n <= 10_000_000)
    if len(items) != 4 or len(whole) != 4 or min(whole[2:]) < 1:
        raise wrong(value, "four whole numbers: first column, first row, columns, rows")
    return whole


Text = Annotated[str, BeforeValidator(printable)]
Positive = Annotated[
    float,
    BeforeValidator(
        number(f"a positive finite number, {LEAST:g} to {MOST:g}", _positive),
        json_schema_input_type=Annotated[float, Field(gt=0)],
    ),
]
Quaternion = Annotated[tuple[float, float, float, float], BeforeValidator(_unit_quaternion)]
Matrix = Annotated[tuple[tuple[float, float, float], ...], BeforeValidator(_rotation_matrix)]
Covariance = Annotated[tuple[tuple[float, float, float], ...], BeforeValidator(_covariance_matrix)]
Triple = Annotated[tuple[float, float, float], BeforeValidator(vector(3, "three finite numbers"))]
Pair = Annotated[tuple[float, float], BeforeValidator(vector(2, "two finite numbers"))]
Window = Annotated[tuple[int, int, int, int], BeforeValidator(_window)]
WholePair = Annotated[tuple[int, int], BeforeValidator(_whole_pair)]
OneOrThree = float | tuple[float, float, float]
Sigma = Annotated[
    tuple[float, float, float],
    BeforeValidator(
        one_or_three(
            f"one finite number or three, none negative (0 claims an exact value, else {SIGMA_WORDS})",
            sigma_or_zero,
        ),
        json_schema_input_type=OneOrThree,
    ),
]
Prior = Annotated[
    tuple[float, float, float],
    BeforeValidator(
        one_or_three(f"one positive finite number or three, {SIGMA_WORDS}", _sigma),
        json_schema_input_type=OneOrThree,
    ),
]
_FrameNames = Literal["ITRF", "GCRF", "J2000", "EME2000", "ICRF", "TEME", "TOD", "MOD"]
_FRAMES = ("ITRF", "GCRF", "TEME", "TOD", "MOD")
Frame = Annotated[
    Literal["ITRF", "GCRF", "TEME", "TOD", "MOD"],
    choice(*_FRAMES),
    BeforeValidator(frame_name, json_schema_input_type=_FrameNames),
]
