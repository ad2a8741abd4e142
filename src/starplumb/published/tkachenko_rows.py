"""The scene of Tkachenko 2019 on component rows: from unit normal draws to what camera, trackers and GPS would report.

Written like :mod:`starplumb.estimators.observer_rows`, whose rotations it uses and whose work rows it fills: ``at`` is
a slice over the runs in NumPy and the index of one run in compiled code.

Draws (rows of ``Z``): initial error 3, relative focal error 1, then per image: aim 2, attitude 3, position 3, and per
marker of it column and row 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimators.observer_rows import (
    SIGHTING_ROWS,
    STATE_ROWS,
    Quaternion,
    Row,
    Triple,
    dot,
    multiply,
    rotate,
    turn,
)

Array = NDArray[np.float64]

RUN_DRAWS = 4
IMAGE_DRAWS = 8
MARKER_DRAWS = 2


def unit(v: Triple) -> Triple:
    scale = 1.0 / np.sqrt(dot(v, v))
    return scale * v[0], scale * v[1], scale * v[2]


def axes(q: Quaternion) -> tuple[Row, ...]:
    """Columns of C, one after the other, for its unit quaternion."""
    x, y, z = q[0] + q[0], q[1] + q[1], q[2] + q[2]
    xx, yy, zz = x * q[0], y * q[1], z * q[2]
    xy, xz, yz = x * q[1], x * q[2], y * q[2]
    wx, wy, wz = x * q[3], y * q[3], z * q[3]
    return 1.0 - yy - zz, xy + wz, xz - wy, xy - wz, 1.0 - xx - zz, yz + wx, xz + wy, yz - wx, 1.0 - xx - yy


def station(
    Z: Array, at: Any, first: int, image: Array, L: Array, q_EK: Quaternion, aim: float
) -> tuple[Quaternion, Quaternion]:
    """True C_KJ of an image that was aimed amiss, and measured ``C_EJ = exp(alpha_E) C_EK C_KJ``.

    ``image``: r_J (3), quaternion of the wanted C_KJ (4), range (1); L (3, 3) root of the fused trackers' covariance;
    ``q_EK`` the true mounting; ``aim`` the sigma on the ground, m.
    """
    tilt = aim / image[7]
    shift = tilt * Z[first, at]
    q_KJ = multiply(
        turn((shift, tilt * Z[first + 1, at], 0.0 * shift)), (image[3], image[4], image[5], image[6])
    )
    u = (Z[first + 2, at], Z[first + 3, at], Z[first + 4, at])
    alpha = (
        L[0, 0] * u[0] + L[0, 1] * u[1] + L[0, 2] * u[2],
        L[1, 0] * u[0] + L[1, 1] * u[1] + L[1, 2] * u[2],
        L[2, 0] * u[0] + L[2, 1] * u[1] + L[2, 2] * u[2],
    )
    return q_KJ, multiply(turn(alpha), multiply(q_EK, q_KJ))


def look(q_KJ: Quaternion, u_J: Triple, column: Row, row: Row, scale: Row) -> Triple:
    """Measured e_K: tangents with their noise, read with a focal length that is off by 1/scale."""
    s = rotate(q_KJ, u_J)
    depth = 1.0 / s[2]
    x, y = scale * (s[0] * depth + column), scale * (s[1] * depth + row)
    size = 1.0 / np.sqrt(1.0 + x * x + y * y)
    return size * x, size * y, size


def simulate(
    Z: Array, W: Array, at: Any, images: Array, p_J: Array, L: Array, q_model: Array, sigma: Array
) -> None:
    """Fill W: the true mounting ``exp(-theta_E) C_EK_model``, and for each sighting e_K, e_E and the axes of J in E.

    ``images`` (m, 8) as in ``station``; ``p_J`` (n, 3) markers; ``sigma`` (5): initial error rad, focal length, aim m,
    GPS m, marker in tangents; ``q_model`` (4) quaternion of the model mounting.  J's axes come in ITRF's order.
    """
    minus_theta_E = (-sigma[0] * Z[0, at], -sigma[0] * Z[1, at], -sigma[0] * Z[2, at])
    q_EK = multiply(turn(minus_theta_E), (q_model[0], q_model[1], q_model[2], q_model[3]))
    W[0, at], W[1, at], W[2, at], W[3, at] = q_EK
    scale = 1.0 / (1.0 + sigma[1] * Z[3, at])
    base = STATE_ROWS
    first = RUN_DRAWS
    for i in range(len(images)):
        q_KJ, q_EJ = station(Z, at, first, images[i], L, q_EK, sigma[2])
        c = axes(q_EJ)
        rho = (sigma[3] * Z[first + 5, at], sigma[3] * Z[first + 6, at], sigma[3] * Z[first + 7, at])
        first += IMAGE_DRAWS
        for k in range(len(p_J)):
            d = (p_J[k, 0] - images[i, 0], p_J[k, 1] - images[i, 1], p_J[k, 2] - images[i, 2])
            e_K = look(q_KJ, d, sigma[4] * Z[first, at], sigma[4] * Z[first + 1, at], scale)
            e_E = rotate(q_EJ, unit((d[0] - rho[0], d[1] - rho[1], d[2] - rho[2])))
            W[base, at], W[base + 1, at], W[base + 2, at] = e_K
            W[base + 3, at], W[base + 4, at], W[base + 5, at] = e_E
            W[base + 6, at], W[base + 7, at], W[base + 8, at] = c[0], c[1], c[2]
            W[base + 9, at], W[base + 10, at], W[base + 11, at] = c[3], c[4], c[5]
            W[base + 12, at], W[base + 13, at], W[base + 14, at] = c[6], c[7], c[8]
            first += MARKER_DRAWS
            base += SIGHTING_ROWS
