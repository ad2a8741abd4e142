"""The whitened design of large tables on component rows.

A work buffer ``W`` (rows, sightings) holds what was measured, and receives each sighting's residual and its derivatives
in units of its own noise, which is the pixel's and that of its landmark's place::

    (z, H, R, E) <- L^-1 (z, H, R, E),     L L^T = cov_pixel + R cov_landmark R^T

with H by the mounting, R by the position in J and E by the eight numbers of a lens.  The formulas of the equation are
those of :mod:`starplumb.table.equation`, those of the lens of :mod:`starplumb.physics.lens`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..physics.components import (
    Array,
    Row,
    Six,
    Triple,
    dot,
    four,
    put_four,
    put_three,
    root,
    rotate,
    six,
    three,
    turn,
    unit,
)
from ..physics.covariance import pixel_entries
from ..physics.lens import LENS_ROWS, Eight, LensNumbers, effects, look_at
from ..table.equation import (
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
from ..table.seen import ImageErrors
from .whitening import inverse_root, least

XY, SLOPE, E_E, ROW_RATE, C_EJ, RANGE, NOISE, WEIGHT, COVARIANCE = 2, 6, LENS_ROWS, 13, 16, 25, 26, 30, 31
"""First rows of what was measured: tangents (2), slope (4), direction (3), its rate (3), attitude (9), range, the
covariance of column and row (3) with what it leaves of the row where the column is known, weight, and the landmark's
covariance xx, xy, xz, yy, yz, zz in J."""
OWN = 37
"""First row of the errors of the sighting's image about which it is linearised: attitude (3) and position (3)."""
WHITENING, PER_RAD, COLUMN, ROW = 43, 46, 50, 65
"""First rows of what is made of them: L^-1 (3, lower), L^-1 B^-1 (4), and z, H, R, E (15) of the column, of the row."""
ROWS = 80
LENS = 7
"""Where E begins behind z, H and R."""

UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))

NO_LENS: LensNumbers = (1.0, 0.0, 0.0, 0.0, 0.0, (0.0,) * 5, (0.0,) * 5, 0.0)
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


def whitened_design(W: Array, C_EK: Nine) -> None:
    """Residual, H and R in units of the sighting's own noise, with what else takes to it (L^-1, L^-1 B^-1)."""
    e, slope, S = three(W, E_E), four(W, SLOPE), six(W, COVARIANCE)
    C = (*three(W, C_EJ), *three(W, C_EJ + 3), *three(W, C_EJ + 6))
    h, _, P_x, P_y = project(C_EK, e)
    T = inverse(per_pixel(slope, three(W, ROW_RATE), P_x, P_y))
    closeness = 1.0 / W[RANGE]
    R_x = by_position(gradient(T[0], T[1], P_x, P_y), C, closeness)
    R_y = by_position(gradient(T[2], T[3], P_x, P_y), C, closeness)
    a, b, c, smallest = four(W, NOISE)
    L = inverse_root(
        quadratic(R_x, S, R_x) + a, quadratic(R_x, S, R_y) + b, quadratic(R_y, S, R_y) + c, smallest
    )
    strength = root(W[WEIGHT])
    p, q, r = strength * L[0], strength * L[1], strength * L[2]
    put_three(W, WHITENING, (p, q, r))
    V = (p * T[0], p * T[1], q * T[0] + r * T[2], q * T[1] + r * T[3])
    put_four(W, PER_RAD, V)
    z = through(V, h[0] - W[XY], h[1] - W[XY + 1])
    W[COLUMN], W[ROW] = z
    put_three(W, COLUMN + 1, by_attitude(gradient(V[0], V[1], P_x, P_y), e))
    put_three(W, ROW + 1, by_attitude(gradient(V[2], V[3], P_x, P_y), e))
    put_three(W, COLUMN + 4, (p * R_x[0], p * R_x[1], p * R_x[2]))
    put_three(W, ROW + 4, (q * R_x[0] + r * R_y[0], q * R_x[1] + r * R_y[1], q * R_x[2] + r * R_y[2]))


def take_out(W: Array) -> None:
    """The direction by an attitude and a position without the errors of the image."""
    e, r = three(W, E_E), three(W, OWN + 3)
    i = 1.0 / W[RANGE]
    x = e[0] + i * dot(three(W, C_EJ), r)
    y = e[1] + i * dot(three(W, C_EJ + 3), r)
    z = e[2] + i * dot(three(W, C_EJ + 6), r)
    q = turn(three(W, OWN))
    put_three(W, E_E, unit(rotate((-q[0], -q[1], -q[2], q[3]), (x, y, z))))


def put_back(W: Array) -> None:
    """The errors of the image into the residual again, about which it is linear: ``z - H alpha + R rho``."""
    a, r = three(W, OWN), three(W, OWN + 3)
    W[COLUMN] += dot(three(W, COLUMN + 4), r) - dot(three(W, COLUMN + 1), a)
    W[ROW] += dot(three(W, ROW + 4), r) - dot(three(W, ROW + 1), a)


def put_eight(W: Array, first: int, a: Row, u: Eight, b: Row, v: Eight) -> None:
    """Rows ``first``, ...: ``a u + b v``."""
    W[first], W[first + 1] = a * u[0] + b * v[0], a * u[1] + b * v[1]
    W[first + 2], W[first + 3] = a * u[2] + b * v[2], a * u[3] + b * v[3]
    W[first + 4], W[first + 5] = a * u[4] + b * v[4], a * u[5] + b * v[5]
    W[first + 6], W[first + 7] = a * u[6] + b * v[6], a * u[7] + b * v[7]


def whitened_lens(W: Array, numbers: LensNumbers) -> None:
    """E in units of the sighting's own noise: ``L^-1 B^-1 (d ideal / d distorted)`` times the effects of the lens."""
    i = 1.0 / numbers[4]
    V = four(W, PER_RAD)
    a, c = through(V, W[SLOPE] * i, W[SLOPE + 2] * i)
    b, d = through(V, W[SLOPE + 1] * i, W[SLOPE + 3] * i)
    u, v = effects(W[4], W[5], (W[0], W[1]), numbers[3], numbers[4])
    put_eight(W, COLUMN + LENS, a, u, b, v)
    put_eight(W, ROW + LENS, c, u, d, v)


def fill(W: Array, C_EK: Nine, numbers: LensNumbers, about: bool = False) -> None:
    """Make everything behind what was measured; with a lens to estimate, tangents and slopes are by the present one;
    ``about`` the errors of the images, where they are among the rows."""
    estimated = numbers[3] != 0.0
    if about:
        take_out(W)
    if estimated:
        look_at(W, project(C_EK, three(W, E_E))[0], numbers)
    whitened_design(W, C_EK)
    if about:
        put_back(W)
    if estimated:
        whitened_lens(W, numbers)


def load(
    W: Array, o: Observations, rows: slice | NDArray[np.int64], errors: ImageErrors | None = None
) -> None:
    """What was measured in some sightings of landmarks of their own (no batch axes) into the rows of a buffer, and the
    errors of their images about which to linearise."""
    if errors is not None:
        image = o.image[rows]
        W[OWN : OWN + 3], W[OWN + 3 : OWN + 6] = errors.alpha_E[image].mT, errors.rho_J[image].mT
    W[XY : XY + 2] = o.xy_K[rows].mT
    W[SLOPE : SLOPE + 4].reshape(2, 2, -1)[...] = o.slope_K[rows].transpose(1, 2, 0)
    W[E_E : E_E + 3] = o.e_E[rows].mT
    W[ROW_RATE : ROW_RATE + 3] = o.row_rate_E[rows].mT
    W[C_EJ : C_EJ + 9].reshape(3, 3, -1)[...] = o.C_EJ[rows].transpose(1, 2, 0)
    W[RANGE], W[WEIGHT] = o.range_m[rows], o.weight[rows]
    if o.ellipse is None:
        W[NOISE] = W[NOISE + 2] = W[NOISE + 3] = o.sigma_px[rows] ** 2
        W[NOISE + 1] = 0.0
    else:
        entries = pixel_entries(o.sigma_px[rows], o.ellipse[rows])
        W[NOISE : NOISE + 4] = (*entries, least(*entries))
    covariance = o.cov_landmark_J[o.landmark[rows]]
    for place, (i, j) in enumerate(UPPER):
        W[COVARIANCE + place] = covariance[:, i, j]
