"""Numbers and rotations in words: rounding that keeps what is known, and a rotation in every convention people use."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.errors import counted as counted
from ..physics.units import DEG

Array = NDArray[np.float64]

ROUNDING = 1e-9
"""Less than this part of what stands beside it is what rounding leaves of nothing."""
NOT_STATED = "not stated"


def number(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits, in plain notation where it fits; a dash for none."""
    if value is None or not np.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    exponent = int(np.floor(np.log10(abs(value))))
    if -5 < exponent < 7:
        return f"{value:.{max(digits - 1 - exponent, 0)}f}".replace("-", "−")
    return f"{value:.{digits - 1}e}".replace("-", "−")


def beside(value: float | None, scale: float, digits: int = 3) -> str:
    """A number as :func:`number` has it; one that rounding explains, against a ``scale`` of its unit, is 0."""
    return "0" if value is not None and abs(value) <= ROUNDING * scale else number(value, digits)


def measured(value: float, sigma: float | None) -> str:
    """``value ± sigma``, the sigma to two significant digits and the value to the same place."""
    if sigma is None or not np.isfinite(sigma) or sigma <= 0.0:
        return number(value, 4)
    places = max(1 - int(np.floor(np.log10(sigma))), 0)
    return f"{value:.{places}f} ± {sigma:.{places}f}".replace("-", "−")


def interval(found: Mapping[str, float] | None, scale: float = 0.0) -> str:
    """A value with half its confidence interval; a dash for none, 0 where rounding explains it against a ``scale``."""
    if found is None or found["value"] is None:
        return "–"
    if max(abs(found["low"]), abs(found["high"])) <= ROUNDING * scale:
        return "0"
    return measured(found["value"], 0.5 * (found["high"] - found["low"]))


def triple(values: Iterable[float]) -> str:
    """Three figures, one for each axis."""
    return ", ".join(number(value) for value in values)


def length(metres: float | None) -> str:
    """A length in metres or, from 10 km on, in kilometres."""
    if metres is None or not np.isfinite(metres):
        return "not known"
    return f"{number(metres / 1e3)} km" if abs(metres) >= 1e4 else f"{number(metres)} m"


def amount_of_bytes(n: float) -> str:
    """``216 bytes``, ``3.46 GB``."""
    for size, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if n >= size:
            return f"{n / size:.3g} {unit}"
    return f"{n:.0f} bytes"


def listed(words: Iterable[str]) -> str:
    """``a, b and c``."""
    *rest, last = words
    return f"{', '.join(rest)} and {last}" if rest else last


def rotation_forms(C_BA: Array) -> dict[str, tuple[str, ...]]:
    """The numbers of a rotation (3, 3) from A to B in each usual convention, by the convention's name."""
    x, y, z, w = so3.to_quaternion(C_BA)
    return {
        "quaternion x, y, z, w (scalar last)": _fixed((x, y, z, w), 12),
        "quaternion w, x, y, z (scalar first)": _fixed((w, x, y, z), 12),
        "inverse quaternion x, y, z, w": _fixed(so3.to_quaternion(C_BA.mT), 12),
        "matrix, row 1": _fixed(C_BA[0], 12),
        "matrix, row 2": _fixed(C_BA[1], 12),
        "matrix, row 3": _fixed(C_BA[2], 12),
        "rotation vector x, y, z, deg": _fixed(so3.log(C_BA) / DEG, 9),
        "Euler angles z, y′, x″, deg": _fixed(euler_zyx(C_BA) / DEG, 9),
    }


def euler_zyx(C: Array) -> Array:
    """Angles (a, b, c), rad, of ``C = R_z(a) R_y(b) R_x(c)``: turns about z, the turned y and the twice turned x.

    At b = +-90 deg only a -+ c is determined; c is then 0.
    """
    b = -np.arcsin(np.clip(C[2, 0], -1.0, 1.0))
    if abs(C[2, 0]) > 1.0 - 1e-12:
        return np.array([np.arctan2(-C[0, 1], C[1, 1]), b, 0.0])
    return np.array([np.arctan2(C[1, 0], C[0, 0]), b, np.arctan2(C[2, 1], C[2, 2])])


def _fixed(values: Iterable[float], places: int) -> tuple[str, ...]:
    return tuple(f"{value:.{places}f}" for value in values)  # an ASCII minus: these are copied into files


def coefficient(value: float) -> str:
    """A correlation coefficient to two places."""
    return f"{value + 0.0:.2f}".replace("-0.00", "0.00").replace("-", "−")
