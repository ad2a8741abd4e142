"""Vectors and rotations on component rows: formulas written once, for NumPy and for compiled code.

A vector is a tuple of its components; a component is a row over the trials (NumPy) or one trial's number (compiled).
The same source serves both: where it works on a buffer ``W`` (rows, width), ``at`` is ``slice(None)`` in one and an
index in the other.  Rows keep the trials contiguous, so that NumPy streams through them and the compiler vectorises
across them.

``specialise`` gives a module's functions another namespace: with some of them replaced, and compiled with numba if
wanted.  For the compiler to vectorise, a buffer is made inside the compiled function with a width that it knows, every
helper is inlined, and a loop over ``lanes()`` touches rows of fixed number only; hence ``rows_at`` and ``put_back``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError

Array = NDArray[np.float64]
Row = Any
"""A row over the trials (Array) in NumPy, a float in compiled code."""
Triple = tuple[Row, Row, Row]
Quaternion = tuple[Row, Row, Row, Row]

NUMPY_WIDTH = 4096
"""Trials in a block of NumPy rows: a few dozen rows of 32 KiB stay in the second-level cache."""
COMPILED_WIDTH = 128
"""Trials in a block of compiled code: two dozen rows of 1 KiB stay in the first-level cache."""

larger = np.maximum
root = np.sqrt


def extreme(row: Row) -> float:
    """Largest magnitude of a row."""
    return float(np.max(np.abs(row)))


def block_width(trials: int) -> int:
    """Width of the buffers for a number of trials."""
    return min(trials, NUMPY_WIDTH)


def lanes() -> Iterable[Any]:
    """What ``at`` runs over in a block."""
    return (slice(None),)


def rows_at(W: Array, first: int, spare: Array) -> Array:
    """Rows ``first``, ... of W, as many as ``spare`` has: a view (compiled: copied into ``spare``)."""
    return W[first : first + len(spare)]


def put_back(W: Array, first: int, part: Array) -> None:
    """Bring what was written to ``rows_at`` back into W: nothing to do for a view."""


def spare_window(buffer: Array) -> Array:
    """Room for a window on ``buffer`` (compiled: of fixed width)."""
    return buffer


def window(buffer: Array, start: int, spare: Array, rows: int) -> Array:
    """Trials ``start``, ... of a buffer: itself (compiled: the first rows of as many as ``spare`` has room for)."""
    return buffer


def put_window(buffer: Array, start: int, part: Array, rows: int) -> None:
    """Bring what was written to a ``window`` behind its first rows back: nothing to do for the buffer itself."""


def dot(a: Triple, b: Triple) -> Row:
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Triple, b: Triple) -> Triple:
    """a x b"""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def rotate(q: Quaternion, v: Triple) -> Triple:
    """``C v`` for the unit quaternion q (x, y, z, w) of C: ``v + w t + q x t`` with ``t = 2 q x v``."""
    u = (q[0] + q[0], q[1] + q[1], q[2] + q[2])
    t = cross(u, v)
    c = cross((q[0], q[1], q[2]), t)
    return v[0] + q[3] * t[0] + c[0], v[1] + q[3] * t[1] + c[1], v[2] + q[3] * t[2] + c[2]


def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """Hamilton product p q: the rotation q, then p."""
    return (
        p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] - p[0] * q[2] + p[1] * q[3] + p[2] * q[0],
        p[3] * q[2] + p[0] * q[1] - p[1] * q[0] + p[2] * q[3],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    )


# coefficients of the series of sin b/b and cos b in b^2, each the quotient of neighbours: dividing by constants would
# cost as much as dividing by rows
S1, S2, S3, S4, S5 = 1.0 / 6.0, 1.0 / 20.0, 1.0 / 42.0, 1.0 / 72.0, 1.0 / 110.0
C1, C2, C3, C4, C5 = 1.0 / 2.0, 1.0 / 12.0, 1.0 / 30.0, 1.0 / 56.0, 1.0 / 90.0


def turn(v: Triple) -> Quaternion:
    """Quaternion of the rotation about v by its length, exact to rounding up to half a turn (to 1e-12 up to a whole).

    sin b / b and cos b of the half angle b from their series at b/8, then doubled three times
    (``sin 2b/2b = sin b/b cos b``, ``cos 2b = 1 - 2 sin^2 b``): no trigonometric call, which would not vectorise.
    """
    x = dot(v, v) * (1.0 / 256.0)
    s = 1.0 - S1 * x * (1.0 - S2 * x * (1.0 - S3 * x * (1.0 - S4 * x * (1.0 - S5 * x))))
    c = 1.0 - C1 * x * (1.0 - C2 * x * (1.0 - C3 * x * (1.0 - C4 * x * (1.0 - C5 * x))))
    s, c = s * c, 1.0 - 2.0 * x * s * s
    s, c = s * c, 1.0 - 8.0 * x * s * s
    s, c = s * c, 1.0 - 32.0 * x * s * s
    h = 0.5 * s
    return h * v[0], h * v[1], h * v[2], c


def unit(v: Triple) -> Triple:
    """v over its length."""
    scale = 1.0 / root(dot(v, v))
    return scale * v[0], scale * v[1], scale * v[2]


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse rotation."""
    return -q[0], -q[1], -q[2], q[3]


def axes(q: Quaternion) -> tuple[Row, ...]:
    """Columns of C, one after the other, for its unit quaternion."""
    x, y, z = q[0] + q[0], q[1] + q[1], q[2] + q[2]
    xx, yy, zz = x * q[0], y * q[1], z * q[2]
    xy, xz, yz = x * q[1], x * q[2], y * q[2]
    wx, wy, wz = x * q[3], y * q[3], z * q[3]
    return 1.0 - yy - zz, xy + wz, xz - wy, xy - wz, 1.0 - xx - zz, yz + wx, xz + wy, yz - wx, 1.0 - xx - yy


ALGEBRA = (dot, cross, rotate, multiply, turn, unit, conjugate, axes)


def specialise(
    entry: Callable[..., Any],
    helpers: Iterable[Callable[..., Any]],
    replaced: Mapping[str, Callable[..., Any]],
    compiled: bool,
    width: int = COMPILED_WIDTH,
) -> Callable[..., Any]:
    """``entry`` in a namespace of its own: ``helpers`` likewise, and the functions ``replaced`` by name.

    ``helpers`` come in an order in which each uses only those before it.  Compiled, buffers are ``width`` trials wide,
    and numba sees strict floating point (no reordering, so that results do not depend on the compiler) and NumPy's
    division, which has no branch.
    Raises InputError where numba is not installed.
    """
    helpers = tuple(helpers)
    space: dict[str, Any] = dict(globals())
    for function in (*helpers, entry):
        space |= function.__globals__
    space |= replaced
    if not compiled:
        for function in helpers:
            space[function.__name__] = FunctionType(function.__code__, space, function.__name__)
        space |= {
            name: space[function.__name__]
            for name, function in replaced.items()
            if function.__name__ in space
        }
        return FunctionType(entry.__code__, space, entry.__name__)
    try:
        import numba
    except ImportError:
        raise InputError(
            "compiled: found no numba, wanted starplumb installed with its extra 'fast'"
        ) from None
    inline = numba.njit(error_model="numpy", forceinline=True)
    for name, primitive in _compiled_primitives(width).items():
        space[name] = inline(primitive)
    space["root"] = math.sqrt
    for helper in (*ALGEBRA, *helpers):
        space[helper.__name__] = inline(FunctionType(helper.__code__, space, helper.__name__))
    space |= {name: space[function.__name__] for name, function in replaced.items()}
    jit = numba.njit(error_model="numpy", nogil=True)
    run: Callable[..., Any] = jit(FunctionType(entry.__code__, space, entry.__name__))
    return run


def _compiled_primitives(width: int) -> dict[str, Callable[..., Any]]:
    """What takes the place of the functions above that know of NumPy."""

    def fixed(trials: int) -> int:
        return width

    def indices() -> range:
        return range(width)

    def copied(W: Array, first: int, spare: Array) -> Array:
        for i in range(len(spare)):
            for at in range(width):
                spare[i, at] = W[first + i, at]
        return spare

    def returned(W: Array, first: int, part: Array) -> None:
        for i in range(len(part)):
            for at in range(width):
                W[first + i, at] = part[i, at]

    def room(buffer: Array) -> Array:
        return np.zeros((len(buffer), width))

    def opened(buffer: Array, start: int, spare: Array, rows: int) -> Array:
        count = min(width, buffer.shape[1] - start)
        for i in range(rows):
            for at in range(count):
                spare[i, at] = buffer[i, start + at]
        return spare

    def closed(buffer: Array, start: int, part: Array, rows: int) -> None:
        count = min(width, buffer.shape[1] - start)
        for i in range(rows, len(buffer)):
            for at in range(count):
                buffer[i, start + at] = part[i, at]

    def greater(a: float, b: float) -> float:
        return a if a > b else b

    def magnitude(number: float) -> float:
        return abs(number)

    return {
        "block_width": fixed,
        "lanes": indices,
        "rows_at": copied,
        "put_back": returned,
        "spare_window": room,
        "window": opened,
        "put_window": closed,
        "larger": greater,
        "extreme": magnitude,
    }
