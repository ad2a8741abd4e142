"""Whether images that differ are wrong one by one, or all of them scatter or drift more than is stated.

The sightings of image i imply a rotation of the answer, along three axes that part the errors of sightings from those
of images: y_i with the variance ``q_i + f a_i``, a as stated.  Compared are, by minus twice the logarithm of the
likelihood and ``log m`` for each number estimated from m images (Schwarz)::

    spread    sum log(q + f a) + (y - X b)^2 / (q + f a),   X: constant, linear in time, a harmonic of the orbit,
                                                            two levels, a level for each session
    outliers  the same of the others, and k images with a variance s^2 of their own, each of which costs 2 log(1 / P)

Source: G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.earth import OMEGA_EARTH
from ..physics.orbit import argument_of_latitude
from ..table.observations import Observations, first_of_image
from ..table.sharing import chained
from .fit import Fit
from .image_sums import image_sums

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Shape = tuple[Array, float]
"""Values (k, p) at the images of what is estimated, and what that freedom costs."""

WRONG = 0.01
"""Probability of an image that is wrong by itself before anything is known."""
SESSION_S = 3000.0
"""Gap in time, s, half an orbit, that begins another session."""
STEPS = 20
"""Places in time at which a step is looked for at most."""
FACTORS = np.concatenate([[1.0], np.geomspace(1.1, 1e8, 60)])
"""Variances of images that are tried, over the stated one."""
_SUMS = ("image", "N", "b", "toward", "squares", "count")


@dataclass(frozen=True)
class Turns:
    """What images (k,) alone say: ``image`` their index, ``y = axes d_E`` (k, 3) along ``axes`` (3, 3), with the
    variances ``q`` of their sightings and ``a`` of their own stated errors."""

    image: Index
    y: Array
    q: Array
    a: Array
    axes: Array


def further_spread(fit: Fit, seen: Mask) -> Array | None:
    """Covariance (m, 3, 3) rad^2 about E beyond the stated one that explains the images, with which some of those left
    out need not be; None where all that are left out whole are wrong by themselves, or none is.

    ``fit`` is at an answer, with the weights of the sightings used; ``seen`` (n,) those that were offered.
    """
    o = fit.table
    used, offered = (np.bincount(o.image[rows], minlength=o.n_images) for rows in (o.weight > 0.0, seen))
    out = (used == 0) & (offered > 0)
    if not np.any(out):
        return None
    turns = _turns(fit, (o.weight > 0.0) | (seen & out[o.image]), used > 0)
    if turns is None:
        return None
    order = np.flatnonzero(out[turns.image])
    order = order[np.argsort(-np.sum(turns.y[order] ** 2 / (turns.q + turns.a)[order], axis=-1))]
    shapes = _shapes(o, turns.image)
    scores = [_score(turns, order[:k], shapes) for k in range(order.size + 1)]
    best = int(np.argmin(scores))
    if best == order.size:
        return None
    keep = np.setdiff1d(np.arange(turns.image.size), order[:best])
    f = _of_axes(turns, keep, shapes[0][0])[1]
    back = np.linalg.inv(turns.axes)
    extra_E = np.zeros((o.n_images, 3, 3))
    more = ((np.array(f) - 1.0) * turns.a)[:, :, None] * np.eye(3)
    extra_E[turns.image] = back @ more @ back.T
    return extra_E


def _turns(fit: Fit, rows: Mask, right: Mask) -> Turns | None:
    """Rotations of the images by the sightings chosen; ``right`` (m,) images tell what is usual, None where none of
    them fixes a rotation."""
    x, o, found = fit.step(), fit.table, []
    for part, (table, model, A) in fit.parts():
        z_px = model.z_px + A[..., 3:] @ x[3:]
        found.append(image_sums(table, model, np.flatnonzero(rows[part]), z_px))
    columns = ([getattr(one, name)[one.fixed] for one in found] for name in _SUMS)
    image, N, b, toward, squares, count = (np.concatenate(of) for of in columns)
    if not np.any(right[image]):
        return None
    Q = np.linalg.inv(N)
    d_E, gain = -(Q @ b)[..., 0], Q @ toward
    # sightings that contradict each other say less
    within = squares - np.sum(d_E * (N @ d_E[..., None])[..., 0], axis=-1)
    Q = Q * np.maximum(1.0, within / np.maximum(2 * count - 3, 1))[:, None, None]
    own = o.cov_attitude_E[image] + gain @ o.cov_position_J[image] @ gain.mT
    axes = _axes(np.mean(own, axis=0), np.mean(Q[right[image]], axis=0))
    q, a = (np.einsum("ij,kjl,il->ki", axes, S, axes) for S in (Q, own))
    return Turns(image, d_E @ axes.T, q, a, axes)


def _axes(own: Array, Q: Array) -> Array:
    """Axes (3, 3), rows, along which the first covariance is 1 and the second diagonal."""
    root = np.linalg.inv(np.linalg.cholesky(own + 1e-6 * np.trace(Q) * np.eye(3)))
    return np.asarray(np.linalg.eigh(root @ Q @ root.T)[1].T @ root)


def _score(turns: Turns, out: Index, shapes: list[Shape]) -> float:
    """Minus twice the logarithm of the likelihood with these images wrong by themselves, of the likeliest shape."""
    keep = np.setdiff1d(np.arange(turns.image.size), out)
    s2 = max(1.0, float(np.mean(turns.y[out] ** 2))) if out.size else 1.0
    alone = out.size * float(3.0 * (np.log(s2) + 1.0) - 2.0 * np.log(WRONG))
    fitting = [shape for shape in shapes if shape is shapes[0] or 2 * shape[0].shape[1] <= keep.size]
    return alone + min(cost + sum(_of_axes(turns, keep, X)[0]) for X, cost in fitting)


def _of_axes(turns: Turns, keep: Index, X: Array) -> tuple[list[float], list[float]]:
    """Score and factor of each axis, of the images kept."""
    found = [_likeliest(turns.y[keep, i], turns.q[keep, i], turns.a[keep, i], X[keep]) for i in range(3)]
    return [score for score, _ in found], [factor for _, factor in found]


def _likeliest(y: Array, q: Array, a: Array, X: Array) -> tuple[float, float]:
    """The smallest score of numbers y (k,) with the shape X (k, p) over the factors, and its factor."""
    v = q + FACTORS[:, None] * a
    weighted = X / v[..., None]
    M = weighted.mT @ X + 1e-12 * np.trace(weighted.mT @ X, axis1=-2, axis2=-1)[:, None, None] * np.eye(
        X.shape[1]
    )
    beta = np.linalg.solve(M, weighted.mT @ y[:, None])
    score = np.sum(np.log(v) + (y - (X @ beta)[..., 0]) ** 2 / v, axis=-1)
    score[1:] += np.log(y.size)
    best = int(np.argmin(score))
    return float(score[best]), float(FACTORS[best])


def _shapes(o: Observations, image: Index) -> list[Shape]:
    """Smooth motions over the images, the constant first."""
    one, price = np.ones((image.size, 1)), 3.0 * float(np.log(image.size))
    if o.epoch_s is None:
        return [(one, 0.0)]
    t = o.epoch_s[image]
    return [
        (one, 0.0),
        (np.column_stack([one, t - np.mean(t)]), price),
        *((np.column_stack([one, wave]), 2.0 * price) for wave in _harmonic(o, image)),
        *((np.column_stack([one, later]), price + choice) for later, choice in _steps(t)),
        *((levels, price * (levels.shape[1] - 1)) for levels in _sessions(t)),
    ]


def _harmonic(o: Observations, image: Index) -> Iterator[Array]:
    """Cosine and sine (k, 2) of the argument of latitude, where the orbit's velocity is known."""
    if np.all(np.any(o.v_J, axis=-1)):
        r_J, v_J = (first_of_image(o, x)[image] for x in (o.r_J, o.v_J))
        u = argument_of_latitude(r_J, v_J + np.cross([0.0, 0.0, OMEGA_EARTH], r_J))
        yield np.column_stack([np.cos(u), np.sin(u)])


def _steps(t: Array) -> list[tuple[Mask, float]]:
    """Times (k,) after a step, with a tenth of the images and three at least on either side, and what the choice
    costs."""
    least = max(3, t.size // 10 + 1)
    if t.size < 2 * least:
        return []
    places = np.unique(np.linspace(least, t.size - least, STEPS).astype(np.int64))
    return [(t >= np.sort(t)[place], 2.0 * float(np.log(places.size))) for place in places]


def _sessions(t: Array) -> Iterator[Array]:
    """Which session (k, s) each image belongs to, where there are several of three images or more on average."""
    session = chained(t, SESSION_S)
    levels = int(np.max(session)) + 1
    if 1 < levels <= t.size / 3:
        yield (session[:, None] == np.arange(levels)).astype(np.float64)
