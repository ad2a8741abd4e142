"""Algorithm 1 of Lebedev and Tkachenko (2012), equations (2)-(13): a projective map for each image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.earth import C_JT, itrf_to_geodetic
from ...physics.errors import InputError
from ...solve.whitening import groups
from ...table.observations import TAILS, Observations
from ..protocol import AlignmentEstimate, Status, without_prior
from ..usable import determined, status_of
from .linear_steps import SOURCE_AXES, STEP_LIMIT, propagate

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]
Index = NDArray[np.int64]

MIN_MARKERS = 4
"""Eight parameters at two equations a marker."""

# q c_1 = (a_1, a_4, -a_7) and q c_2 = (a_2, a_5, -a_8) of (a_1 .. a_8), F = 1
_FIRST, _SECOND = np.zeros((3, 8)), np.zeros((3, 8))
_FIRST[[0, 1, 2], [0, 3, 6]] = _SECOND[[0, 1, 2], [1, 4, 7]] = 1.0, 1.0, -1.0


@dataclass(frozen=True, kw_only=True)
class ProjectiveEstimate(AlignmentEstimate):
    """Adds where each image was taken from: ``r_J`` (..., m, 3) m, NaN for one that was left out."""

    r_J: Array

    def describe(self, C_EK_best: Array) -> tuple[str, ...]:
        """Its notes, or a sentence that no image of the campaign has what it needs."""
        if int(self.status) == Status.SINGULAR:
            return ("not applicable: no image has four markers well apart and off a line",)
        return super().describe(C_EK_best)


@dataclass(frozen=True)
class Projective:
    """Attitude and position of each image from the map between its markers and their images alone.

    Markers (X, Y, 0) in the level frame T about their mean, seen at ``(x*, y*) = (X, Y) / Z*`` by a camera
    straight above (6), (7), appear at ``x = (a_1 x* + a_2 y* + a_3) / (a_7 x* + a_8 y* + 1)``, y with a_4,
    a_5, a_6 (8).  The eight are fitted to (12) by least squares and taken apart by (11), F = 1::

        c_1 = (a_1, a_4, -a_7)/q,   c_2 = (a_2, a_5, -a_8)/q,   c_3 = c_1 x c_2,   r_E = Z*/q (-a_3, -a_6, 1)

    The constraints (10), ``|c_1| = |c_2|`` and ``c_1 . c_2 = 0``, hold but for noise: q is the mean of the two
    lengths and C' the nearest rotation.  ``C_EK = C_EJ C_JT C'^T D``, (13).

    ``heights="removed"`` carries each marker along the line of sight from the measured position onto Z = 0;
    ``"ignored"``, as published, drops its Z and is biased by tens of arcsec for each metre that heights scatter
    (33 km images).
    A scanner's rows are first turned and shifted to its first sighting by the measured motion; since the
    turn needs the mounting, it is repeated by Newton's method, ``iterations`` times.

    Mapping: the source's camera is ours turned by pi about x, ``D = diag(1, -1, -1)``.

    Images with fewer than four markers, or none off a line, are left out; the others' corrections are
    averaged, each with the inverse of the variance that equal noise in its markers gives it.  SINGULAR
    where no image is left. Tilt trades against position (nothing else holds either), so about x and y it is
    some hundred times worse than the methods that use the orbit.
    """

    heights: Literal["removed", "ignored"] = "removed"
    iterations: int = 2

    def __call__(self, observations: Observations, C_EK: Array) -> ProjectiveEstimate:
        o = observations
        batch = np.broadcast_shapes(o.batch, C_EK.shape[:-2])
        C = np.broadcast_to(C_EK, (*batch, 3, 3))
        if self.iterations < 1:
            raise InputError(f"iterations: found {self.iterations}, wanted 1 or more")
        for _ in range(self.iterations):
            fits = [
                self._fit(_apart(o, rows), C[..., None, :, :], images, rows)
                for images, rows in groups(o.image, o.n_images)
                if rows.shape[-1] >= MIN_MARKERS
            ]
            d_E, gain, solved, apart = _combine(fits, o, batch)
            C_before, C = C, so3.exp(d_E) @ C
        P = propagate(o, C_before, gain)
        known = solved & determined(P)
        converged = (np.sum(d_E * d_E, axis=-1) < STEP_LIMIT**2) & (apart < STEP_LIMIT)
        status = status_of(o, C, determined=known, converged=converged, covariance_E=P)
        r_J = np.full((*batch, o.n_images, 3), np.nan)
        for fit in fits:
            r_J[..., fit.images, :] = np.where(fit.solved[..., None], fit.r_J, np.nan)
        P = np.where(known[..., None, None], P, np.inf)
        notes = without_prior(o, "uses no orbit: tilt trades against position", "each image by itself")
        return ProjectiveEstimate(C, P, status, np.full(batch, self.iterations), notes=notes, r_J=r_J)

    def _fit(self, o: Observations, C_EK: Array, images: Index, rows: Index) -> _Fit:
        """Of each image the projective map, its decomposition and the gain of its correction."""
        C_JT_, origin_J, foot, scale = self._plane(o)
        C_first = o.C_EJ[..., :1, :, :]
        xy_K, slope_K = _turned(o, C_EK, C_first)
        a, inverse, solved = _map(foot / scale[..., None, None], xy_K * SOURCE_AXES[:2], o.weight)
        C, q = _decompose(a)
        C_ET = C_first[..., 0, :, :] @ C_JT_
        C_found = C_ET @ (SOURCE_AXES[:, None] * C).mT
        r_E = (scale / q)[..., None] * np.stack([-a[..., 2], -a[..., 5], np.ones_like(q)], axis=-1)
        r_T = (r_E[..., None, :] @ C)[..., 0, :]
        depth = 1.0 + np.sum(foot / scale[..., None, None] * a[..., None, 6:], axis=-1)
        gain = (
            _by_sighting(C_ET @ _turn_by_parameters(C, q) @ inverse)
            * depth[..., None, None]
            * SOURCE_AXES[:2]
        )
        # turning the rows took the mounting: x = d + M x with M = d answer / d mounting, zero for a frame
        M = -np.sum(gain @ slope_K, axis=-3)
        repeat = np.linalg.inv(np.eye(3) - np.where(solved[..., None, None], M, 0.0))
        return _Fit(
            images=images,
            rows=rows,
            solved=solved,
            d_E=(repeat @ so3.log(C_found @ C_EK.mT)[..., None])[..., 0],
            gain=repeat[..., None, :, :] @ gain,
            r_J=origin_J + (C_JT_ @ r_T[..., None])[..., 0],
        )

    def _plane(self, o: Observations) -> tuple[Array, Array, Array, Array]:
        """Level frame C_JT and origin_J about the markers' mean, markers in its plane, m, and Z*, m.

        A marker stands where it appears to be, at its range along the apparent direction: light effects are
        in it.
        """
        r_J = o.r_J[..., :1, :]
        p_J = r_J + o.range_m[..., None] * (o.e_E[..., None, :] @ o.C_EJ)[..., 0, :]
        share = o.weight / np.maximum(np.sum(o.weight, axis=-1, keepdims=True), 1e-300)
        origin_J = np.where(
            np.any(share > 0.0, axis=-1)[..., None], np.sum(share[..., None] * p_J, axis=-2), p_J[..., 0, :]
        )
        latitude, longitude, _ = itrf_to_geodetic(origin_J)
        C = C_JT(latitude, longitude)
        marker_T, station_T = (p_J - origin_J[..., None, :]) @ C, (r_J - origin_J[..., None, :]) @ C
        if self.heights == "removed":
            reach = station_T[..., 2:] / (station_T[..., 2:] - marker_T[..., 2:])
            marker_T = station_T + reach * (marker_T - station_T)
        return C, origin_J, marker_T[..., :2], np.linalg.norm(station_T[..., 0, :], axis=-1)


@dataclass(frozen=True)
class _Fit:
    """Images (g,) of M sightings each, ``rows`` (g, M): corrections d_E (..., g, 3), their gains (..., g, M, 3, 2) upon
    the tangents' residual, positions (..., g, 3)."""

    images: Index
    rows: Index
    solved: Bool
    d_E: Array
    gain: Array
    r_J: Array


def _apart(o: Observations, rows: Index) -> Observations:
    """The sightings ``rows`` (g, M) of g images, these as the last batch axis."""
    none = np.zeros(rows.shape[-1], dtype=np.int64)
    own = {name: getattr(o, name) for name in TAILS}
    own = {name: np.take(own[name], rows, axis=own[name].ndim - 1 - len(TAILS[name])) for name in own}
    return replace(o, image=none, landmark=none, common_px=None, ellipse=None, **own)


def _turned(o: Observations, C_EK: Array, C_first: Array) -> tuple[Array, Array]:
    """Tangents (..., n, 2) as seen in the attitude of the first sighting, and d tangents / d_E (..., n, 2, 3).

    ``s_K' = C_EK^T T C_EK s_K`` with ``T = C_EJ,first C_EJ^T``; as the mounting turns by d_E, ``T e_E`` moves by
    ``(Phi(T e_E) - T Phi(e_E)) d_E``.
    """
    s_K = np.concatenate([o.xy_K, np.ones((*o.xy_K.shape[:-1], 1))], axis=-1)
    C_KE = C_EK.mT[..., None, :, :]
    T = C_first @ o.C_EJ.mT
    e_E = s_K @ C_EK.mT
    turned_E = (T @ e_E[..., None])[..., 0]
    s = (C_KE @ turned_E[..., None])[..., 0]
    slope = C_KE @ (so3.skew(turned_E) - T @ so3.skew(e_E))
    xy = s[..., :2] / s[..., 2:]
    return xy, (slope[..., :2, :] - xy[..., None] * slope[..., 2:, :]) / s[..., 2, None, None]


def _map(seen: Array, xy: Array, weight: Array) -> tuple[Array, Array, Bool]:
    """Least squares of (12): a (..., 8), the pseudoinverse (..., 8, 2 n) behind it, whether it is determined.

    Columns are scaled to length 1; a ratio of singular values below 1e-9 is rounding (markers on a line).
    """
    shape = np.broadcast_shapes(seen.shape[:-1], xy.shape[:-1], weight.shape)
    A = np.zeros((*shape, 2, 8))
    A[..., 0, 0:2] = A[..., 1, 3:5] = seen
    A[..., 0, 2] = A[..., 1, 5] = 1.0
    A[..., 6:8] = -xy[..., None] * seen[..., None, :]
    w = weight[..., None, None]
    A = (w * A).reshape(*shape[:-1], 2 * shape[-1], 8)
    b = np.broadcast_to(w[..., 0] * xy, (*shape, 2)).reshape(*shape[:-1], 2 * shape[-1], 1)
    length = np.linalg.norm(A, axis=-2)
    length = np.where(length > 0.0, length, 1.0)
    U, S, Vt = np.linalg.svd(A / length[..., None, :], full_matrices=False)
    solved = S[..., -1] > 1e-9 * S[..., 0]
    S = np.where(solved[..., None], S, 1.0)
    inverse = (Vt.mT / S[..., None, :]) @ U.mT / length[..., :, None]
    return np.where(solved[..., None], (inverse @ b)[..., 0], _STRAIGHT_DOWN), inverse, solved


_STRAIGHT_DOWN = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""Parameters of the camera straight above: used where there is no answer."""


def _decompose(a: Array) -> tuple[Array, Array]:
    """(11), (10): rotation C' (..., 3, 3) from T to the source's camera, and q (...)."""
    first, second = a @ _FIRST.mT, a @ _SECOND.mT
    q = 0.5 * (np.linalg.norm(first, axis=-1) + np.linalg.norm(second, axis=-1))
    first, second = first / q[..., None], second / q[..., None]
    return so3.nearest(np.stack([first, second, np.cross(first, second)], axis=-1)), q


def _turn_by_parameters(C: Array, q: Array) -> Array:
    """d phi / d a (..., 3, 8) of the nearest rotation, ``C' <- C' (E + Phi(phi))``.

    ``phi = (c_3 . dc_2, -c_3 . dc_1, (c_2 . dc_1 - c_1 . dc_2)/2)``: the nearest rotation takes the
    antisymmetric part.
    """
    by_first, by_second = C.mT @ _FIRST, C.mT @ _SECOND
    phi = [by_second[..., 2, :], -by_first[..., 2, :], 0.5 * (by_first[..., 1, :] - by_second[..., 0, :])]
    return np.asarray(np.stack(phi, axis=-2) / q[..., None, None])


def _by_sighting(gain: Array) -> Array:
    """(..., 3, 2 n) as (..., n, 3, 2)."""
    return np.moveaxis(gain.reshape(*gain.shape[:-1], -1, 2), -2, -3)


def _combine(fits: list[_Fit], o: Observations, batch: tuple[int, ...]) -> tuple[Array, Array, Bool, Array]:
    """Weighted mean of the images' corrections (..., 3), its gain (..., n, 3, 2), where there is one, and how far
    (..., rad) the image farthest from it is: a mean of rotation vectors is one of rotations that are close."""
    total, d_E = np.zeros(batch), np.zeros((*batch, 3))
    gain = np.zeros((*batch, o.n, 3, 2))
    for fit in fits:
        weight = np.where(fit.solved, 1.0 / np.sum(fit.gain**2, axis=(-3, -2, -1)), 0.0)
        total = total + np.sum(weight, axis=-1)
        d_E = d_E + np.sum(weight[..., None] * fit.d_E, axis=-2)
        gain[..., fit.rows, :, :] = weight[..., None, None, None] * fit.gain
    solved = total > 0.0
    total = np.where(solved, total, 1.0)
    mean_E, apart = d_E / total[..., None], np.zeros(batch)
    for fit in fits:
        off = np.linalg.norm(fit.d_E - mean_E[..., None, :], axis=-1)
        apart = np.maximum(apart, np.max(np.where(fit.solved, off, 0.0), axis=-1))
    return mean_E, gain / total[..., None, None, None], solved, apart
