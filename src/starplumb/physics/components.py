"""Vectors and rotations on component rows: formulas written once, for NumPy, for Python and for compiled code.

A vector is a tuple of its components; a component is a row over the trials (NumPy) or one trial's number (Python's own,
or compiled by :mod:`starplumb.solve.compiled`).  The same source serves all: it reads a block ``W`` (rows, width), or
the numbers (rows,) of one trial.  Rows keep the trials contiguous, so that NumPy streams through them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Row = Any
"""A row over the trials (Array) in NumPy; a float in compiled code, or where there is a single trial."""
Triple = tuple[Row, Row, Row]
Quaternion = tuple[Row, Row, Row, Row]
Six = tuple[Row, Row, Row, Row, Row, Row]

WIDTH = 4096
"""Trials in a block: a few dozen rows of 32 KiB stay in the second-level cache."""


def larger(a: Row, b: Row) -> Row:
    """The larger of two, trial by trial."""
    if isinstance(b, float):
        return a if a > b else b
    return np.maximum(a, b)


def root(a: Row) -> Row:
    """The square root."""
    return math.sqrt(a) if isinstance(a, float) else np.sqrt(a)


def three(W: Array, row: int) -> Triple:
    """A vector from three rows."""
    return W[row], W[row + 1], W[row + 2]


def four(W: Array, row: int) -> Quaternion:
    """A quaternion, or a 2 x 2 matrix row by row, from four rows."""
    return W[row], W[row + 1], W[row + 2], W[row + 3]


def six(W: Array, row: int) -> Six:
    """A symmetric 3 x 3 matrix, by its upper triangle, from six rows."""
    return W[row], W[row + 1], W[row + 2], W[row + 3], W[row + 4], W[row + 5]


def put_three(W: Array, row: int, v: Triple) -> None:
    """A vector into three rows."""
    W[row], W[row + 1], W[row + 2] = v


def put_four(W: Array, row: int, v: Quaternion) -> None:
    """A quaternion, or a 2 x 2 matrix row by row, into four rows."""
    W[row], W[row + 1], W[row + 2], W[row + 3] = v


def put_six(W: Array, row: int, v: Six) -> None:
    """A symmetric 3 x 3 matrix, by its upper triangle, into six rows."""
    W[row], W[row + 1], W[row + 2] = v[0], v[1], v[2]
    W[row + 3], W[row + 4], W[row + 5] = v[3], v[4], v[5]


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


def axes(q: Quaternion) -> tuple[Triple, Triple, Triple]:
    """The columns of C for its unit quaternion."""
    x, y, z = q[0] + q[0], q[1] + q[1], q[2] + q[2]
    xx, yy, zz = x * q[0], y * q[1], z * q[2]
    xy, xz, yz = x * q[1], x * q[2], y * q[2]
    wx, wy, wz = x * q[3], y * q[3], z * q[3]
    return (
        (1.0 - yy - zz, xy + wz, xz - wy),
        (xy - wz, 1.0 - xx - zz, yz + wx),
        (xz + wy, yz - wx, 1.0 - xx - yy),
    )
