"""A lens on component rows (:mod:`starplumb.physics.components`): distortion, its inverse, and what each of its
numbers does.

``x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)``,
``y_d = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y`` (Brown-Conrady, as in OpenCV).
Source: D. C. Brown, Decentering distortion of lenses, Photogrammetric Engineering 32 (1966).

A work buffer ``W`` begins with distorted tangents (rows 0, 1), ideal tangents (2, 3), the last step of their search
or the tangents at which the lens is looked at (4, 5), and ``d ideal / d distorted`` row by row (6 .. 9).
"""

from __future__ import annotations

import numpy as np

from .components import Array, Row, four, larger, put_four

Lens = tuple[Row, Row, Row, Row, Row]
"""k1, k2, k3, p1, p2."""
Eight = tuple[Row, Row, Row, Row, Row, Row, Row, Row]
LensNumbers = tuple[Row, Row, Row, Row, Row, Lens, Lens, Row]
"""A camera at other values of its optics: distorted tangents of a pixel, ``ratio xy_d + (x, y)``, as ratio, x, y; focal
length; pitch / focal length; its lens; the stated lens; and how far from a mark it is looked at (see :func:`near`)."""

LENS_ROWS = 10
SETTLED = 1e-7
"""Step of Newton's method, rad, after which the next one, of the order of its square, would be below rounding."""


def distort(x: Row, y: Row, lens: Lens) -> tuple[Row, Row, Row, Row, Row]:
    """Distorted tangents, and the entries xx, xy, yy of their Jacobian, which is symmetric."""
    k1, k2, k3, p1, p2 = lens
    xx, yy, xy2 = x * x, y * y, 2.0 * x * y
    r2 = xx + yy
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3))  # d radial / d r2
    return (
        x * radial + p1 * xy2 + p2 * (r2 + 2.0 * xx),
        y * radial + p1 * (r2 + 2.0 * yy) + p2 * xy2,
        radial + 2.0 * xx * slope + 2.0 * p1 * y + 6.0 * p2 * x,
        xy2 * slope + 2.0 * (p1 * x + p2 * y),
        radial + 2.0 * yy * slope + 6.0 * p1 * y + 2.0 * p2 * x,
    )


def start_search(W: Array) -> None:
    """The search for the ideal tangents begins at the distorted ones."""
    W[2], W[3] = W[0], W[1]


def search_step(W: Array, lens: Lens) -> None:
    """One step of Newton's method for the ideal tangents."""
    u, v, a, b, c = distort(W[2], W[3], lens)
    du, dv = W[0] - u, W[1] - v
    scale = 1.0 / (a * c - b * b)
    W[4] = scale * (c * du - b * dv)
    W[5] = scale * (a * dv - b * du)
    W[2] += W[4]
    W[3] += W[5]


def bend(W: Array, lens: Lens) -> None:
    """d ideal / d distorted at the tangents found."""
    _, _, a, b, c = distort(W[2], W[3], lens)
    scale = 1.0 / (a * c - b * b)
    put_four(W, 6, (scale * c, -scale * b, -scale * b, scale * a))


def straighten(W: Array, lens: Lens) -> None:
    """Rows 2 .. 9 from rows 0 and 1 (exact where the lens does not fold)."""
    start_search(W)
    for _ in range(20):
        search_step(W, lens)
        if np.max(np.abs(W[4:6])) < SETTLED:
            break
    bend(W, lens)


def seen_again(W: Array, numbers: LensNumbers) -> None:
    """Distorted tangents, by the optics at other values, of the pixel that the stated ones see at the tangents."""
    ratio, x, y, _, _, _, stated, _ = numbers
    u, v, _, _, _ = distort(W[2], W[3], stated)
    W[0], W[1] = ratio * u + x, ratio * v + y


def magnify(W: Array, scale: Row) -> None:
    """Slope by the pixel from the slope by the distorted tangents."""
    a, b, c, d = four(W, 6)
    put_four(W, 6, (scale * a, scale * b, scale * c, scale * d))


def rephotograph(W: Array, numbers: LensNumbers) -> None:
    """Rows 2, 3 from tangents by the stated optics to those at other values, and the slope per pixel in rows 6 .. 9."""
    seen_again(W, numbers)
    straighten(W, numbers[5])
    magnify(W, numbers[4])


def near(predicted: Row, measured: Row, reach: Row) -> Row:
    """Where a mark is predicted, but no farther than ``reach`` from where it was measured: a lens is not to be looked
    at where a blunder of the model would have it."""
    return measured + larger(-reach, -larger(-reach, measured - predicted))


def look_at(W: Array, h: tuple[Row, Row], numbers: LensNumbers) -> None:
    """Rows 2, 3 from tangents by the stated optics to those at other values, and the slope per pixel in rows 6 .. 9,
    the lens being taken as straight as it is at q, where a mark is predicted (``h``)::

        xy = q - D'(q)^-1 (D(q) - xy_d)

    so that the mark is off by exactly the pixels between the predicted and the measured one.  Rows 4, 5 are then q, and
    0, 1 what the lens makes of it.
    """
    x, y = W[2], W[3]
    seen_again(W, numbers)
    u, v, a, b, c = distort(x, y, numbers[5])
    du, dv, i = W[0] - u, W[1] - v, 1.0 / (a * c - b * b)
    x, y = x + i * (c * du - b * dv), y + i * (a * dv - b * du)  # measured, to a step of Newton's method
    x, y = near(h[0], x, numbers[7]), near(h[1], y, numbers[7])
    u, v, a, b, c = distort(x, y, numbers[5])
    du, dv, i = W[0] - u, W[1] - v, 1.0 / (a * c - b * b)
    W[0], W[1], W[4], W[5] = u, v, x, y
    W[2], W[3] = x + i * (c * du - b * dv), y + i * (a * dv - b * du)
    put_four(W, 6, (i * c, -i * b, -i * b, i * a))
    magnify(W, numbers[4])


def effects(x: Row, y: Row, distorted: tuple[Row, Row], focal_length: Row, scale: Row) -> tuple[Eight, Eight]:
    """Change of the two distorted tangents at fixed ideal ones by each number of the optics, less that of the measured
    ones: ``dD/dp - d xy_d/dp``.

    In the order focal length, principal column and row, k1, k2, k3, p1, p2; ``scale`` is pitch / focal length.
    """
    xy2, r2 = 2.0 * x * y, x * x + y * y
    r4 = r2 * r2
    r6 = r4 * r2
    by_length = 1.0 / focal_length
    return (
        (distorted[0] * by_length, scale, 0.0, x * r2, x * r4, x * r6, xy2, r2 + 2.0 * x * x),
        (distorted[1] * by_length, 0.0, scale, y * r2, y * r4, y * r6, r2 + 2.0 * y * y, xy2),
    )
