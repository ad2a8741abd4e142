"""The fuzzy observer on component rows (:mod:`starplumb.physics.components`): one source for NumPy, for Python and for
compiled code.

A work buffer ``W`` (rows, width) holds a block of trials: the quaternion of C_EK (4), the state of P (6), and for each
sighting e_K (3), e_E (3), the axes of J in E in the order of the equations (9) and the floor of gamma (1).

Rounding differs between processors and gamma^2 ~ z^2 amplifies it: one unit in the last place of the input moves the
20th cycle by 2e-10 arcsec in the median and by arcseconds in one trial of 10^5.  They agree in statistics.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...physics.components import (
    WIDTH,
    Array,
    Quaternion,
    Row,
    Six,
    Triple,
    cross,
    dot,
    four,
    larger,
    multiply,
    put_four,
    put_six,
    root,
    rotate,
    six,
    three,
    turn,
)

Parameters = tuple[float, float, float, float, float]
"""alpha, beta and the square roots of w_1, w_2, w_3."""

STATE, STATE_ROWS = 4, 10
"""First row of the state of P, behind the quaternion of C_EK; and all rows before those of the sightings."""
E_E, AXES, FLOOR, SIGHTING_ROWS = 3, 6, 15, 16
"""Rows of a sighting behind e_K: e_E, the axes of J in E, the floor of gamma; and how many they are."""

Sighting = tuple[Triple, Triple, Triple, Triple, Triple, Row]
"""e_K, e_E, the axes of J in E in the order of the equations, the floor of gamma."""
Update = Callable[[Six, Triple, Row, Row, Parameters], tuple[Six, Triple]]
"""A form of (3): P, g, z, the floor of gamma and the parameters give P+ and the correction ``K z``."""


def growth(z: Row, weight: Row, floor: Row, v: Triple) -> Triple:
    """gamma_i = max(floor, v_i |z| sqrt(weight)): roots of the gamma^2 of (3), with ``v_i = sqrt(w_i)``."""
    innovation = root(z * z * weight)
    return (
        larger(floor, v[0] * innovation),
        larger(floor, v[1] * innovation),
        larger(floor, v[2] * innovation),
    )


def update_plain(P: Six, g: Triple, z: Row, floor: Row, parameters: Parameters) -> tuple[Six, Triple]:
    """Formula (3) on the upper triangle P = (P11, P12, P13, P22, P23, P33), which keeps it symmetric.

    Returns P+ and the correction ``K z``.
    """
    alpha, beta, v1, v2, v3 = parameters
    a1 = P[0] * g[0] + P[1] * g[1] + P[2] * g[2]
    a2 = P[1] * g[0] + P[3] * g[1] + P[4] * g[2]
    a3 = P[2] * g[0] + P[4] * g[1] + P[5] * g[2]
    s = dot(g, (a1, a2, a3))
    # two quotients by one division, the dearest operation here
    both = 1.0 / ((alpha + s) * (beta + s))
    gain = both * (beta + s)
    k1, k2, k3 = gain * a1, gain * a2, gain * a3
    c1, c2, c3 = growth(z, both * (alpha + s), floor, (v1, v2, v3))
    P_plus = (
        (P[0] - k1 * a1) * (c1 * c1),
        (P[1] - k1 * a2) * (c1 * c2),
        (P[2] - k1 * a3) * (c1 * c3),
        (P[3] - k2 * a2) * (c2 * c2),
        (P[4] - k2 * a3) * (c2 * c3),
        (P[5] - k3 * a3) * (c3 * c3),
    )
    return P_plus, (k1 * z, k2 * z, k3 * z)


def update_factorised(UD: Six, g: Triple, z: Row, floor: Row, parameters: Parameters) -> tuple[Six, Triple]:
    """Formula (3) on ``P = U D U^T``, UD = (D1, U12, U13, D2, U23, D3): Bierman's update, then Gamma.

    ``U_ij *= gamma_i / gamma_j``, ``D_j *= gamma_j^2``.  Returns the factors of P+ and the correction ``K z``.
    Source: G. J. Bierman, Factorization Methods for Discrete Sequential Estimation (1977), chapter V.
    """
    alpha, beta, v1, v2, v3 = parameters
    d1, u12, u13, d2, u23, d3 = UD
    f2 = u12 * g[0] + g[1]
    f3 = u13 * g[0] + u23 * g[1] + g[2]
    b1, b2, b3 = d1 * g[0], d2 * f2, d3 * f3
    a1 = alpha + b1 * g[0]
    a2 = a1 + b2 * f2
    s = (a2 - alpha) + b3 * f3
    # two quotients by one division, the dearest operation here
    first, last = 1.0 / (a1 * a2), 1.0 / ((alpha + s) * (beta + s))
    i1, i2, i3 = first * a2, first * a1, last * (beta + s)
    l2, l3 = f2 * i1, f3 * i2
    m1 = b1 + b2 * u12
    k1, k2, k3 = (m1 + b3 * u13) * i3, (b2 + b3 * u23) * i3, b3 * i3
    c1, c2, c3 = growth(z, last * (alpha + s), floor, (v1, v2, v3))
    c23 = 1.0 / (c2 * c3)
    UD_plus = (
        d1 * (alpha * i1) * (c1 * c1),
        (u12 - b1 * l2) * (c1 * c3 * c23),
        (u13 - m1 * l3) * (c1 * c2 * c23),
        d2 * (a1 * i2) * (c2 * c2),
        (u23 - b2 * l3) * (c2 * c2 * c23),
        d3 * (a2 * i3) * (c3 * c3),
    )
    return UD_plus, (k1 * z, k2 * z, k3 * z)


def corrected(
    q: Quaternion, P: Six, sighting: Sighting, parameters: Parameters, update: Update
) -> tuple[Quaternion, Six]:
    """One equation (2), ``e_J* - e_J = G theta_E`` with ``G = -C_JE [e_E*]``, row by row of J, then the exact turn.

    With c_j the j-th axis of J in E the row is ``g = e_E* x c_j`` and its left side ``c_j . (e_E* - e_E)``, less what
    the rows before have corrected already.  A marker not seen has e_K = e_E = 0: g = 0 and z = 0, nothing happens.
    """
    e_K, e_E, c1, c2, c3, floor = sighting
    e = rotate(q, e_K)
    d = (e[0] - e_E[0], e[1] - e_E[1], e[2] - e_E[2])
    P, theta = update(P, cross(e, c1), dot(c1, d), floor, parameters)
    g = cross(e, c2)
    P, step = update(P, g, dot(c2, d) - dot(g, theta), floor, parameters)
    theta = (theta[0] + step[0], theta[1] + step[1], theta[2] + step[2])
    g = cross(e, c3)
    P, step = update(P, g, dot(c3, d) - dot(g, theta), floor, parameters)
    return multiply(turn((-theta[0] - step[0], -theta[1] - step[1], -theta[2] - step[2])), q), P


def vector_equation(W: Array, S: Array, parameters: Parameters, update: Update) -> None:
    """:func:`corrected` on a block of trials W and the rows S of a sighting."""
    axes = three(S, AXES), three(S, AXES + 3), three(S, AXES + 6)
    sighting = three(S, 0), three(S, E_E), axes[0], axes[1], axes[2], S[FLOOR]
    q, P = corrected(four(W, 0), six(W, STATE), sighting, parameters, update)
    put_four(W, 0, q)
    put_six(W, STATE, P)


def one_cycle(W: Array, parameters: Parameters, update: Update) -> None:
    """Every sighting once, in order."""
    for base in range(STATE_ROWS, len(W), SIGHTING_ROWS):
        vector_equation(W, W[base : base + SIGHTING_ROWS], parameters, update)


def run_blocks(rows: Array, cycles: int, parameters: Parameters, trace: Array, update: Update) -> None:
    """Run all trials, a block at a time.

    ``rows`` (10 + 16 n, trials) initial work rows; ``trace`` (cycles, 4, trials) receives the quaternion of C_EK after
    each cycle; ``update`` is the form of (3).
    """
    trials = rows.shape[1]
    memory = np.empty((len(rows), min(trials, WIDTH)))
    for start in range(0, trials, WIDTH):
        W = memory[:, : trials - start]
        W[...] = rows[:, start : start + WIDTH]
        for cycle in range(cycles):
            one_cycle(W, parameters, update)
            trace[cycle, :, start : start + WIDTH] = W[:4]


def form(factorised: bool) -> Update:
    """The form of (3): on U D U^T, or on the upper triangle of P."""
    return update_factorised if factorised else update_plain
