"""Rotations: exact maps between SO(3), its tangent space and unit quaternions, over any leading batch axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def skew(v: ArrayLike) -> Array:
    """Cross-product matrix: ``skew(v) @ w = v x w``.  (..., 3) -> (..., 3, 3)."""
    v = np.asarray(v, dtype=np.float64)
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -v[..., 2], v[..., 1]
    matrix[..., 1, 0], matrix[..., 1, 2] = v[..., 2], -v[..., 0]
    matrix[..., 2, 0], matrix[..., 2, 1] = -v[..., 1], v[..., 0]
    return matrix


def _angle_functions(v: Array) -> tuple[Array, Array, Array]:
    """Angle, sin(a)/a and (1 - cos a)/a^2; numpy's sinc keeps both quotients exact down to a = 0."""
    angle = np.linalg.norm(v, axis=-1)
    return angle, np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi) ** 2


def exp(v: ArrayLike) -> Array:
    """Rotation by its length a about v: ``I + sin(a)/a [v] + (1 - cos a)/a^2 [v]^2``.  (..., 3) rad -> (..., 3, 3)."""
    v = np.asarray(v, dtype=np.float64)
    _, s, c = _angle_functions(v)
    V = skew(v)
    return np.asarray(np.eye(3) + s[..., None, None] * V + c[..., None, None] * (V @ V))


def log(C: ArrayLike) -> Array:
    """Rotation vector of C, at most pi long: inverse of :func:`exp`.  (..., 3, 3) -> (..., 3) rad.

    Taken through the quaternion, so it is exact near the identity and near half a turn alike.
    """
    q = to_quaternion(C)
    sine = np.linalg.norm(q[..., :3], axis=-1)
    angle = 2.0 * np.arctan2(sine, q[..., 3])
    # as the angle vanishes, angle / sine -> 2
    factor = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)
    return np.asarray(factor[..., None] * q[..., :3])


def left_jacobian(v: ArrayLike) -> Array:
    """J with ``exp(v + dv) = exp(J dv) exp(v)`` to first order.  (..., 3) -> (..., 3, 3).

    ``J = I + (1 - cos a)/a^2 [v] + (a - sin a)/a^3 [v]^2``; below 0.1 rad the last quotient cancels, so its
    series to a^6 is used there (remainder below 1e-15).
    """
    v = np.asarray(v, dtype=np.float64)
    angle, s, c = _angle_functions(v)
    a2 = angle * angle
    series = (1.0 - a2 / 20.0 * (1.0 - a2 / 42.0 * (1.0 - a2 / 72.0))) / 6.0
    small = angle < 0.1
    d = np.where(small, series, (1.0 - s) / np.where(small, 1.0, a2))
    V = skew(v)
    return np.asarray(np.eye(3) + c[..., None, None] * V + d[..., None, None] * (V @ V))


def from_quaternion(q_xyzw: ArrayLike) -> Array:
    """Matrix of the Hamilton quaternion (x, y, z, w), normalised first.  (..., 4) -> (..., 3, 3)."""
    q = np.asarray(q_xyzw, dtype=np.float64)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    x, y, z, w = (q[..., i] for i in range(4))
    matrix = np.empty((*q.shape[:-1], 3, 3))
    matrix[..., 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrix[..., 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrix[..., 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    matrix[..., 0, 1], matrix[..., 1, 0] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
    matrix[..., 0, 2], matrix[..., 2, 0] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    matrix[..., 1, 2], matrix[..., 2, 1] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)
    return matrix


def to_quaternion(C: ArrayLike) -> Array:
    """Unit quaternion (x, y, z, w) of C with w >= 0.  (..., 3, 3) -> (..., 4).

    The sixteen products ``4 q_i q_j`` are linear in C; the row with the largest diagonal is free of cancellation.
    """
    C = np.asarray(C, dtype=np.float64)
    m = {(i, j): C[..., i, j] for i in range(3) for j in range(3)}
    products = np.empty((*C.shape[:-2], 4, 4))
    for i, signs in enumerate(((1, -1, -1), (-1, 1, -1), (-1, -1, 1))):
        products[..., i, i] = 1.0 + signs[0] * m[0, 0] + signs[1] * m[1, 1] + signs[2] * m[2, 2]
    products[..., 3, 3] = 1.0 + m[0, 0] + m[1, 1] + m[2, 2]
    for i, j in ((0, 1), (0, 2), (1, 2)):
        products[..., i, j] = products[..., j, i] = m[i, j] + m[j, i]
    for k, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        products[..., k, 3] = products[..., 3, k] = m[i, j] - m[j, i]
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    q = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., 3:] < 0.0, -q, q))


def nearest(M: ArrayLike) -> Array:
    """Rotation nearest to M in the Frobenius norm (SVD, determinant +1).  (..., 3, 3) -> (..., 3, 3)."""
    U, _, Vt = np.linalg.svd(np.asarray(M, dtype=np.float64))
    U = U.copy()
    U[..., :, 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    return np.asarray(U @ Vt)
