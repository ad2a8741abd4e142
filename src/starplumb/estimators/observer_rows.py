"""The fuzzy observer on component rows: formulas written once, for NumPy and for compiled code.

A vector is a tuple of its components; a component is a row over the trials (NumPy) or one trial's number (compiled).
The same source serves both: ``at`` is ``slice(None)`` in one and an index in the other.  Rows keep the trials
contiguous, so that NumPy streams through them and the compiler vectorises across them.

A work buffer ``W`` (rows, width) holds a block of trials: the quaternion of C_EK (4), the state of P (6), and for each
sighting e_K (3), e_E (3), the axes of J in E in the order of the equations (9) and the floor of gamma^2 (1).

Rounding differs between back ends and gamma^2 ~ z^2 amplifies it: one unit in the last place of the input moves the
20th cycle by 2e-10 arcsec in the median and by arcseconds in one trial of 10^5.  Back ends agree in statistics.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Row = Any
"""A row over the trials (Array) in NumPy, a float in compiled code."""
Triple = tuple[Row, Row, Row]
Quaternion = tuple[Row, Row, Row, Row]
Six = tuple[Row, Row, Row, Row, Row, Row]
Parameters = tuple[float, float, float, float, float]
"""alpha, beta, w_1, w_2, w_3."""

STATE_ROWS = 10
SIGHTING_ROWS = 16
NUMPY_WIDTH = 4096
"""Trials in a block of NumPy rows: a few dozen rows of 32 KiB stay in the second-level cache."""
COMPILED_WIDTH = 64
"""Trials in a block of compiled code; a constant, so that the compiler knows the distance between rows."""


def dot(a: Triple, b: Triple) -> Row:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Triple, b: Triple) -> Triple:
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


def turn(v: Triple) -> Quaternion:
    """Quaternion of the rotation by |v| about v, exact for any |v| up to a turn.

    sin b / b and cos b of the half angle b from their series at b/8, then doubled three times
    (``sin 2b/2b = sin b/b cos b``, ``cos 2b = 1 - 2 sin^2 b``): no trigonometric call, which would not vectorise.
    """
    x = dot(v, v) * (1.0 / 256.0)
    s = 1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0 * (1.0 - x / 110.0))))
    c = 1.0 - x / 2.0 * (1.0 - x / 12.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0 * (1.0 - x / 90.0))))
    for factor in (2.0, 8.0, 32.0):
        s, c = s * c, 1.0 - factor * x * s * s
    h = 0.5 * s
    return h * v[0], h * v[1], h * v[2], c


def update_plain(P: Six, g: Triple, z: Row, floor: Row, parameters: Parameters) -> tuple[Six, Triple]:
    """Formula (3) on the upper triangle P = (P11, P12, P13, P22, P23, P33), which keeps it symmetric.

    Returns P+ and the correction ``K z``.
    """
    alpha, beta, w1, w2, w3 = parameters
    a1 = P[0] * g[0] + P[1] * g[1] + P[2] * g[2]
    a2 = P[1] * g[0] + P[3] * g[1] + P[4] * g[2]
    a3 = P[2] * g[0] + P[4] * g[1] + P[5] * g[2]
    s = dot(g, (a1, a2, a3))
    gain = 1.0 / (alpha + s)
    k1, k2, k3 = gain * a1, gain * a2, gain * a3
    q = z * z / (beta + s)
    G1, G2, G3 = np.maximum(floor, w1 * q), np.maximum(floor, w2 * q), np.maximum(floor, w3 * q)
    gamma1, gamma2, gamma3 = np.sqrt(G1), np.sqrt(G2), np.sqrt(G3)
    P_plus = (
        (P[0] - k1 * a1) * G1,
        (P[1] - k1 * a2) * gamma1 * gamma2,
        (P[2] - k1 * a3) * gamma1 * gamma3,
        (P[3] - k2 * a2) * G2,
        (P[4] - k2 * a3) * gamma2 * gamma3,
        (P[5] - k3 * a3) * G3,
    )
    return P_plus, (k1 * z, k2 * z, k3 * z)


def update_factorised(UD: Six, g: Triple, z: Row, floor: Row, parameters: Parameters) -> tuple[Six, Triple]:
    """Formula (3) on ``P = U D U^T``, UD = (D1, U12, U13, D2, U23, D3): Bierman's update, then Gamma.

    ``U_ij *= gamma_i / gamma_j``, ``D_j *= gamma_j^2``.  Returns the factors of P+ and the correction ``K z``.
    Source: G. J. Bierman, Factorization Methods for Discrete Sequential Estimation (1977), chapter V.
    """
    alpha, beta, w1, w2, w3 = parameters
    d1, u12, u13, d2, u23, d3 = UD
    f1 = g[0]
    f2 = u12 * g[0] + g[1]
    f3 = u13 * g[0] + u23 * g[1] + g[2]
    v1, v2, v3 = d1 * f1, d2 * f2, d3 * f3
    a1 = alpha + v1 * f1
    a2 = a1 + v2 * f2
    a3 = a2 + v3 * f3
    i1, i2, i3 = 1.0 / a1, 1.0 / a2, 1.0 / a3
    l2, l3 = f2 * i1, f3 * i2
    b1 = v1 + v2 * u12
    k1, k2, k3 = (b1 + v3 * u13) * i3, (v2 + v3 * u23) * i3, v3 * i3
    q = z * z / (beta + (a3 - alpha))
    G1, G2, G3 = np.maximum(floor, w1 * q), np.maximum(floor, w2 * q), np.maximum(floor, w3 * q)
    gamma1, gamma2, gamma3 = np.sqrt(G1), np.sqrt(G2), np.sqrt(G3)
    r2, r3 = 1.0 / gamma2, 1.0 / gamma3
    UD_plus = (
        d1 * alpha * i1 * G1,
        (u12 - v1 * l2) * gamma1 * r2,
        (u13 - b1 * l3) * gamma1 * r3,
        d2 * a1 * i2 * G2,
        (u23 - v2 * l3) * gamma2 * r3,
        d3 * a2 * i3 * G3,
    )
    return UD_plus, (k1 * z, k2 * z, k3 * z)


update = update_factorised
"""The form of (3) that ``vector_equation`` calls; compiled and plain copies of this module's code have their own."""


def vector_equation(W: Array, at: Any, base: int, parameters: Parameters) -> None:
    """One equation (2), ``e_J* - e_J = G theta_E`` with ``G = -C_JE [e_E*]``, row by row of J, then the exact turn.

    With c_j the j-th axis of J in E the row is ``g = e_E* x c_j`` and its left side ``c_j . (e_E* - e_E)``, less what
    the rows before have corrected already.  A marker not seen has e_K = e_E = 0: g = 0 and z = 0, nothing happens.
    """
    q = (W[0, at], W[1, at], W[2, at], W[3, at])
    P = (W[4, at], W[5, at], W[6, at], W[7, at], W[8, at], W[9, at])
    e = rotate(q, (W[base, at], W[base + 1, at], W[base + 2, at]))
    d = (e[0] - W[base + 3, at], e[1] - W[base + 4, at], e[2] - W[base + 5, at])
    floor = W[base + 15, at]
    c = (W[base + 6, at], W[base + 7, at], W[base + 8, at])
    P, theta = update(P, cross(e, c), dot(c, d), floor, parameters)
    c = (W[base + 9, at], W[base + 10, at], W[base + 11, at])
    g = cross(e, c)
    P, step = update(P, g, dot(c, d) - dot(g, theta), floor, parameters)
    theta = (theta[0] + step[0], theta[1] + step[1], theta[2] + step[2])
    c = (W[base + 12, at], W[base + 13, at], W[base + 14, at])
    g = cross(e, c)
    P, step = update(P, g, dot(c, d) - dot(g, theta), floor, parameters)
    q = multiply(turn((-theta[0] - step[0], -theta[1] - step[1], -theta[2] - step[2])), q)
    W[0, at], W[1, at], W[2, at], W[3, at] = q
    W[4, at], W[5, at], W[6, at], W[7, at], W[8, at], W[9, at] = P


def block_width(trials: int) -> int:
    return min(trials, NUMPY_WIDTH)


def block_lanes() -> Iterable[Any]:
    return (slice(None),)


def run_blocks(rows: Array, cycles: int, parameters: Parameters, trace: Array) -> None:
    """Run all trials, a block at a time.

    ``rows`` (10 + 16 n, trials) initial work rows; ``trace`` (1 + cycles, 4, trials) receives the quaternion of C_EK
    after the very first equation and after each cycle.
    """
    trials = rows.shape[1]
    width = block_width(trials)
    W = np.zeros((rows.shape[0], width))
    for start in range(0, trials, width):
        count = min(width, trials - start)
        W[:, :count] = rows[:, start : start + count]
        for cycle in range(cycles):
            for base in range(STATE_ROWS, rows.shape[0], SIGHTING_ROWS):
                for at in block_lanes():
                    vector_equation(W, at, base, parameters)
                if cycle == 0 and base == STATE_ROWS:
                    trace[0, :, start : start + count] = W[:4, :count]
            trace[1 + cycle, :, start : start + count] = W[:4, :count]


Runner = Callable[[Array, int, Parameters, Array], None]


@cache
def runner(factorised: bool, compiled: bool) -> Runner:
    """``run_blocks`` with the wanted form of (3), in NumPy or compiled with numba (the optional extra ``fast``).

    The code objects of this module are given a namespace of their own, in which ``update`` is the wanted form and, when
    compiled, every helper its compiled self.
    """
    chosen = update_factorised if factorised else update_plain
    if compiled:
        return _compile(chosen)
    space = {**globals(), "update": chosen}
    space["vector_equation"] = FunctionType(vector_equation.__code__, space)
    return FunctionType(run_blocks.__code__, space)


def _compile(chosen: Callable[..., Any]) -> Runner:
    import numba

    # numpy's error model has no branch for a zero divisor; strict floating point (no fastmath): results do not depend
    # on how the compiler would reorder them
    jit = numba.njit(error_model="numpy", nogil=True)
    space: dict[str, Any] = {**globals(), "COMPILED_WIDTH": COMPILED_WIDTH}

    def width(trials: int) -> int:
        return COMPILED_WIDTH

    def lanes() -> range:
        return range(COMPILED_WIDTH)

    space["block_width"], space["block_lanes"] = jit(width), jit(lanes)
    for function in (dot, cross, rotate, multiply, turn, chosen):
        space[function.__name__] = jit(FunctionType(function.__code__, space, function.__name__))
    space["update"] = space[chosen.__name__]
    space["vector_equation"] = jit(FunctionType(vector_equation.__code__, space, "vector_equation"))
    compiled: Runner = jit(FunctionType(run_blocks.__code__, space, "run_blocks"))
    return compiled
