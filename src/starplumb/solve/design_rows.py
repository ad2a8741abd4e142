"""The whitened design of large tables on component rows: one source for NumPy and for compiled code.

A work buffer ``W`` (rows, sightings) holds what was measured, and receives each sighting's residual and its derivatives
in units of its own noise, which is the pixel's and that of its landmark's place::

    (z, H, R, E) <- L^-1 (z, H, R, E),     L L^T = sigma^2 I + R cov_landmark R^T

with H by the mounting, R by the position in J and E by the eight numbers of a lens.  The formulas of the equation are
those of :mod:`starplumb.table.equation`, those of the lens of :mod:`starplumb.physics.lens`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..physics.components import (
    Array,
    Row,
    Triple,
    dot,
    lanes,
    put_window,
    root,
    spare_window,
    specialise,
    window,
)
from ..physics.lens import LENS as LENS_HELPERS
from ..physics.lens import LENS_ROWS, Eight, LensNumbers, effects, rephotograph
from ..table.equation import (
    EQUATION,
    Nine,
    by_attitude,
    by_position,
    gradient,
    inverse,
    per_pixel,
    project,
    through,
)
from ..table.observations import Observations
from .whitening import inverse_root

XY, SLOPE, E_E, ROW_RATE, C_EJ, RANGE, SIGMA, WEIGHT, COVARIANCE = 2, 6, LENS_ROWS, 13, 16, 25, 26, 27, 28
"""First rows of what was measured: tangents (2), slope (4), direction (3), its rate (3), attitude (9), range, sigma of
a pixel, weight, and the landmark's covariance xx, xy, xz, yy, yz, zz in J."""
WHITENING, PER_RAD, COLUMN, ROW = 34, 37, 41, 56
"""First rows of what is made of them: L^-1 (3, lower), L^-1 B^-1 (4), and z, H, R, E (15) of the column, of the row."""
ROWS = 71
LENS = 7
"""Where E begins behind z, H and R."""

UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))

Six = tuple[Row, Row, Row, Row, Row, Row]
NO_LENS: LensNumbers = (1.0, 0.0, 0.0, 0.0, 0.0, (0.0,) * 5, (0.0,) * 5)
"""No lens is estimated."""


def quadratic(a: Triple, S: Six, b: Triple) -> Row:
    """``a^T S b`` for a symmetric S."""
    return dot(
        a,
        (
            S[0] * b[0] + S[1] * b[1] + S[2] * b[2],
            S[1] * b[0] + S[3] * b[1] + S[4] * b[2],
            S[2] * b[0] + S[4] * b[1] + S[5] * b[2],
        ),
    )


def whitened_design(W: Array, at: Any, C_EK: Nine) -> None:
    """Residual, H and R in units of the sighting's own noise, with what else takes to it (L^-1, L^-1 B^-1)."""
    e = (W[E_E, at], W[E_E + 1, at], W[E_E + 2, at])
    rate = (W[ROW_RATE, at], W[ROW_RATE + 1, at], W[ROW_RATE + 2, at])
    C = (
        W[C_EJ, at],
        W[C_EJ + 1, at],
        W[C_EJ + 2, at],
        W[C_EJ + 3, at],
        W[C_EJ + 4, at],
        W[C_EJ + 5, at],
        W[C_EJ + 6, at],
        W[C_EJ + 7, at],
        W[C_EJ + 8, at],
    )
    S = (
        W[COVARIANCE, at],
        W[COVARIANCE + 1, at],
        W[COVARIANCE + 2, at],
        W[COVARIANCE + 3, at],
        W[COVARIANCE + 4, at],
        W[COVARIANCE + 5, at],
    )
    slope = (W[SLOPE, at], W[SLOPE + 1, at], W[SLOPE + 2, at], W[SLOPE + 3, at])
    h, _, P_x, P_y = project(C_EK, e)
    T = inverse(per_pixel(slope, rate, P_x, P_y))
    closeness = 1.0 / W[RANGE, at]
    R_x = by_position(gradient(T[0], T[1], P_x, P_y), C, closeness)
    R_y = by_position(gradient(T[2], T[3], P_x, P_y), C, closeness)
    noise = W[SIGMA, at] * W[SIGMA, at]
    L = inverse_root(
        quadratic(R_x, S, R_x) + noise, quadratic(R_x, S, R_y), quadratic(R_y, S, R_y) + noise, noise
    )
    strength = root(W[WEIGHT, at])
    p, q, r = strength * L[0], strength * L[1], strength * L[2]
    W[WHITENING, at], W[WHITENING + 1, at], W[WHITENING + 2, at] = p, q, r
    V = (p * T[0], p * T[1], q * T[0] + r * T[2], q * T[1] + r * T[3])
    W[PER_RAD, at], W[PER_RAD + 1, at], W[PER_RAD + 2, at], W[PER_RAD + 3, at] = V
    z = through(V, h[0] - W[XY, at], h[1] - W[XY + 1, at])
    W[COLUMN, at], W[ROW, at] = z
    H_x = by_attitude(gradient(V[0], V[1], P_x, P_y), e)
    H_y = by_attitude(gradient(V[2], V[3], P_x, P_y), e)
    W[COLUMN + 1, at], W[COLUMN + 2, at], W[COLUMN + 3, at] = H_x
    W[ROW + 1, at], W[ROW + 2, at], W[ROW + 3, at] = H_y
    W[COLUMN + 4, at], W[COLUMN + 5, at], W[COLUMN + 6, at] = p * R_x[0], p * R_x[1], p * R_x[2]
    W[ROW + 4, at] = q * R_x[0] + r * R_y[0]
    W[ROW + 5, at] = q * R_x[1] + r * R_y[1]
    W[ROW + 6, at] = q * R_x[2] + r * R_y[2]


def put_eight(W: Array, first: int, at: Any, a: Row, u: Eight, b: Row, v: Eight) -> None:
    """Rows ``first``, ...: ``a u + b v``."""
    W[first, at], W[first + 1, at] = a * u[0] + b * v[0], a * u[1] + b * v[1]
    W[first + 2, at], W[first + 3, at] = a * u[2] + b * v[2], a * u[3] + b * v[3]
    W[first + 4, at], W[first + 5, at] = a * u[4] + b * v[4], a * u[5] + b * v[5]
    W[first + 6, at], W[first + 7, at] = a * u[6] + b * v[6], a * u[7] + b * v[7]


def whitened_lens(W: Array, at: Any, numbers: LensNumbers) -> None:
    """E in units of the sighting's own noise: ``L^-1 B^-1 (d ideal / d distorted)`` times the effects of the lens."""
    i = 1.0 / numbers[4]
    V = (W[PER_RAD, at], W[PER_RAD + 1, at], W[PER_RAD + 2, at], W[PER_RAD + 3, at])
    a, c = through(V, W[SLOPE, at] * i, W[SLOPE + 2, at] * i)
    b, d = through(V, W[SLOPE + 1, at] * i, W[SLOPE + 3, at] * i)
    u, v = effects(W[XY, at], W[XY + 1, at], (W[0, at], W[1, at]), numbers[3], numbers[4])
    put_eight(W, COLUMN + LENS, at, a, u, b, v)
    put_eight(W, ROW + LENS, at, c, u, d, v)


def fill(buffer: Array, C_EK: Nine, numbers: LensNumbers) -> None:
    """Make everything behind what was measured; with a lens to estimate, tangents and slopes are by the present one."""
    spare = spare_window(buffer)
    estimated = numbers[3] != 0.0
    for start in range(0, buffer.shape[1], spare.shape[1]):
        W = window(buffer, start, spare, WHITENING)
        if estimated:
            rephotograph(W, numbers)
        for at in lanes():
            whitened_design(W, at, C_EK)
        if estimated:
            for at in lanes():
                whitened_lens(W, at, numbers)
        put_window(buffer, start, W, WHITENING)


HELPERS = (*LENS_HELPERS, *EQUATION, quadratic, inverse_root, whitened_design, put_eight, whitened_lens)


@cache
def filler(compiled: bool) -> Callable[[Array, Nine, LensNumbers], None]:
    """:func:`fill` in NumPy, or compiled with numba.  Raises InputError where numba is not installed."""
    return specialise(
        fill, HELPERS, {}, compiled, width=64
    )  # as many sightings as the first-level cache holds


def load(W: Array, o: Observations, rows: slice | NDArray[np.int64]) -> None:
    """What was measured in some sightings of landmarks of their own (no batch axes) into the rows of a buffer."""
    W[XY : XY + 2] = o.xy_K[rows].mT
    W[SLOPE : SLOPE + 4].reshape(2, 2, -1)[...] = o.slope_K[rows].transpose(1, 2, 0)
    W[E_E : E_E + 3] = o.e_E[rows].mT
    W[ROW_RATE : ROW_RATE + 3] = o.row_rate_E[rows].mT
    W[C_EJ : C_EJ + 9].reshape(3, 3, -1)[...] = o.C_EJ[rows].transpose(1, 2, 0)
    W[RANGE], W[SIGMA], W[WEIGHT] = o.range_m[rows], o.sigma_px[rows], o.weight[rows]
    covariance = o.cov_landmark_J[o.landmark[rows]]
    for place, (i, j) in enumerate(UPPER):
        W[COVARIANCE + place] = covariance[:, i, j]
