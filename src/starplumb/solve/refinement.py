"""Normal equations of many runs of one scene, from one inverse of the covariance of its residuals.

The runs of a study share errors, weights and, but for 1e-4 or so, geometry: their covariances V of the residuals
differ little from V0 of the true scene.  The normal equations of X = [A, z] then follow from iterative refinement, for
which V is multiplied and never formed::

    R = X - V Y,    D = V0^-1 R,    X^T V^-1 X = Y^T X + Y^T R + R^T V^-1 R = Y^T X + Y^T R + R^T D + error

from ``Y = V0^-1 X``, and with ``Y <- Y + D`` where need be.  With ``rho = |1 - V0^-1 V|``, the rate of refinement, R is
of the order rho and the error of the order rho^3, in units of the stated sigmas.  Where that is not small enough,
nothing is said.  Source: N. J. Higham, Accuracy and Stability of Numerical Algorithms (2002), chapter 12; the rest that
a residual adds to a quadratic form is exact algebra.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..physics.covariance import square_root
from ..table.equation import Linearised, linearise
from ..table.observations import Observations
from .chunks import repeated_landmarks
from .whitening import groups

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Loading = tuple[Index, Array]
"""Errors that sets of residuals share: the residuals (g, w) of each set, and their shifts (..., g, w, d) by one
sigma."""

LARGEST = 600
"""Residuals that may be coupled with one another: the work grows with the square of their number."""
MOST_STEPS = 6
EXACT = 1e-7
"""Error of the normal equations, in sigmas, at which to stop."""
SLOW = 0.1
"""Rate of refinement from which V0 is not near enough."""


@dataclass(frozen=True)
class Covariance:
    """V (..., 2 n, 2 n) px^2 of residuals as what it is made of: each sighting's ``own`` (..., n, 2, 2), the
    ``loadings`` of errors that sets share, and ``common`` (2 n, p)."""

    own: Array
    loadings: tuple[Loading, ...]
    common: Array | None

    def times(self, rows: Array) -> Array:
        """``V y`` of vectors y, each a row of ``rows`` (..., s, 2 n)."""
        pairs = rows.reshape(*rows.shape[:-1], -1, 2)
        own, (x, y) = self.own[..., None, :, :, :], (pairs[..., 0], pairs[..., 1])
        total = np.empty_like(pairs)
        for i in range(2):
            total[..., i] = own[..., i, 0] * x + own[..., i, 1] * y
        total = total.reshape(rows.shape)
        for at, shifts in self.loadings:
            taken = np.moveaxis(_taken(rows, at), -2, -3)
            effect = np.moveaxis((taken @ shifts) @ shifts.mT, -3, -2)
            if _is_all(at, rows):
                total += effect.reshape(rows.shape)
            else:
                total[..., at] += effect
        if self.common is not None:
            total += (rows @ self.common) @ self.common.T
        return total


@dataclass(frozen=True)
class Scene:
    """What the runs share: a table without batch axes at the true mounting ``C_EK`` (3, 3).  Sightings of weight zero
    vanish."""

    table: Observations
    C_EK: Array

    @classmethod
    def of(cls, table: Observations, C_EK: Array) -> Scene | None:
        """None where this is no way to solve it: sightings are weighed by halves, do not determine the mounting, or
        share errors among too many."""
        shared = (table.cov_attitude_E, table.cov_position_J, table.cov_landmark_J)
        alike = not table.batch and all(part.ndim == 3 for part in shared)
        if not alike or not np.all(np.isin(table.weight, (0.0, 1.0))):
            return None
        scene = cls(table, C_EK)
        if not scene.seen.size or max(at.size for at in scene.coupled) > LARGEST:
            return None
        try:
            scale = scene.scale
        except np.linalg.LinAlgError:
            return None
        return scene if np.all(np.isfinite(scale)) else None

    @cached_property
    def seen(self) -> Index:
        """The sightings (k,) that count, image by image."""
        order = np.argsort(self.table.image, kind="stable")
        return np.asarray(order[self.table.weight[order] > 0.0])

    @cached_property
    def part(self) -> Observations:
        """Those sightings of the scene."""
        return self.table.select(self.seen)

    @cached_property
    def coupled(self) -> list[Index]:
        """The residuals (w,) of each set that shares no error with another."""
        every = np.arange(2 * self.seen.size)
        if self.table.common_px is not None or repeated_landmarks(self.part).size:
            return [every]
        return np.split(every, np.flatnonzero(np.diff(np.repeat(self.part.image, 2))) + 1)

    @cached_property
    def inverses(self) -> list[tuple[Index, Array]]:
        """V0^-1 of each set."""
        sets, V = self.coupled, self.covariance(self.part, self.model)
        rows = np.zeros((max(at.size for at in sets), 2 * self.seen.size))
        for at in sets:
            rows[np.arange(at.size), at] = 1.0
        product = V.times(rows)
        return [(at, np.asarray(np.linalg.inv(product[: at.size, at]))) for at in sets]

    @cached_property
    def model(self) -> Linearised:
        return linearise(self.part, self.C_EK)

    @cached_property
    def scale(self) -> Array:
        """A root L (3, 3) rad of the covariance of the mounting: in its units the columns of the design are of length
        1."""
        rows = _rows(self.model)[:3]
        return np.asarray(np.linalg.cholesky(np.linalg.inv(rows @ self.solved(rows).T)))

    @cached_property
    def gain(self) -> Array:
        """(3, 2 k) rad/px of the scene itself: a step is minus its product with the residuals."""
        rows = self.scale.T @ _rows(self.model)[:3]
        return np.asarray(self.scale @ self.solved(rows))

    def solved(self, rows: Array) -> Array:
        """``V0^-1 y`` of vectors y, each a row of ``rows`` (..., s, 2 k)."""
        flat = rows.reshape(-1, rows.shape[-1])
        if len(self.inverses) == 1:
            return (flat @ self.inverses[0][1]).reshape(rows.shape)
        out = np.empty_like(flat)
        for at, inverse in self.inverses:
            span = slice(at[0], at[-1] + 1)
            out[:, span] = flat[:, span] @ inverse
        return out.reshape(rows.shape)

    def covariance(self, o: Observations, model: Linearised) -> Covariance:
        """V of a table of the sightings seen, linearised; its shared errors are those of the scene."""
        repeated, R, t = repeated_landmarks(self.part), model.R, self.table
        place = np.isin(o.landmark, repeated)
        own = np.broadcast_to(o.noise_px, (*R.shape[:-2], 2, 2)).copy()
        once = np.flatnonzero(~place)
        if once.size:
            own += _spread(R, np.where(place[:, None, None], 0.0, self._landmark_roots))
        by_image = np.concatenate([model.H, R], axis=-1)
        roots = np.zeros((t.n_images, 6, 6))
        roots[:, :3, :3], roots[:, 3:, 3:] = square_root(t.cov_attitude_E), square_root(t.cov_position_J)
        loadings = list(_loadings(by_image, o.image, roots))
        if repeated.size:
            again = np.flatnonzero(place)
            found = _loadings(R[..., again, :, :], o.landmark[again], square_root(t.cov_landmark_J))
            loadings += [(_pixels(again)[at], shifts) for at, shifts in found]
        common = None if o.common_px is None else o.common_px.reshape(2 * o.n, -1)
        return Covariance(own, tuple(loadings), common)

    @cached_property
    def _landmark_roots(self) -> Array:
        return square_root(self.table.cov_landmark_J)[self.part.landmark]

    def squares(self, o: Observations, C_EK: Array) -> tuple[Array, Mask]:
        """``[A, z]^T V^-1 [A, z]`` (b, 4, 4) of b runs at the mountings C_EK (b, 3, 3), and in which it is exact (b,).

        ``o`` holds the sightings ``seen`` of the runs.
        """
        model = linearise(o, C_EK)
        V, X = self.covariance(o, model), _rows(model)
        X[..., :3, :] = self.scale.T @ X[..., :3, :]
        squares, exact = self._refined(V, X)
        back = np.eye(4)
        back[:3, :3] = np.linalg.inv(self.scale).T
        return np.asarray(back @ (0.5 * (squares + squares.mT)) @ back.T), exact

    def _refined(self, V: Covariance, X: Array) -> tuple[Array, Mask]:
        """``X V^-1 X^T`` (b, s, s) of rows X (b, s, 2 k), and for which of the b that is exact."""
        Y = self.solved(X)
        length = np.sqrt(np.vecdot(Y, X))
        for _ in range(MOST_STEPS):
            R = X - V.times(Y)
            D = self.solved(R)
            size = np.sqrt(np.abs(np.vecdot(D, R)))
            rate = np.max(size / np.maximum(length, 1e-300), axis=-1)
            error = np.max(size, axis=-1) ** 2 * rate
            squares, Y, length = Y @ X.mT + Y @ R.mT + D @ R.mT, Y + D, size
            if not np.any((error > EXACT) & (rate < SLOW)):
                break
        return squares, np.asarray((error <= EXACT) & (rate < SLOW))


def _rows(model: Linearised) -> Array:
    """[A, z] as rows (..., 4, 2 n)."""
    H, z = model.H, model.z_px
    out = np.empty((*z.shape[:-2], 4, *z.shape[-2:]))
    for i in range(3):
        out[..., i, :, :] = H[..., i]
    out[..., 3, :, :] = z
    return out.reshape(*out.shape[:-2], -1)


def _is_all(at: Index, rows: Array) -> bool:
    """Whether residuals (g, w) are all of them in their order."""
    return at.size == rows.shape[-1] and bool(np.array_equal(at.reshape(-1), np.arange(at.size)))


def _taken(rows: Array, at: Index) -> Array:
    """Residuals (..., g, w) of vectors (..., 2 n); a view where they are all of them."""
    return rows.reshape(*rows.shape[:-1], *at.shape) if _is_all(at, rows) else rows[..., at]


def _spread(R: Array, roots: Array) -> Array:
    """``R S (R S)^T`` (..., n, 2, 2) of R (..., n, 2, 3) and roots S (n, 3, 3), component by component: matrices that
    small cost more to call than to multiply."""
    x, y = ([sum(R[..., i, k] * roots[:, k, j] for k in range(3)) for j in range(3)] for i in range(2))
    out = np.empty((*R.shape[:-1], 2))
    out[..., 0, 0], out[..., 1, 1] = (sum(v * v for v in row) for row in (x, y))
    out[..., 0, 1] = out[..., 1, 0] = sum(v * w for v, w in zip(x, y, strict=True))
    return out


def _pixels(sightings: Index) -> Index:
    """Column and row (..., 2 k) of sightings (..., k)."""
    both = 2 * sightings[..., None] + np.arange(2)
    return both.reshape(*sightings.shape[:-1], -1)


def _loadings(shifts: Array, member: Index, roots: Array) -> Iterator[Loading]:
    """Shifts (..., k, 2, d) by errors of members, in units of sigma by their ``roots`` (count, d, d)."""
    batch, d = shifts.shape[:-3], shifts.shape[-1]
    for group, sightings in groups(member, len(roots)):
        taken = shifts[..., sightings, :, :].reshape(*batch, *sightings.shape[:1], -1, d)
        for i, which in enumerate(group):
            one = taken[..., i, :, :]
            taken[..., i, :, :] = (one.reshape(-1, d) @ roots[which]).reshape(one.shape)
        yield _pixels(sightings), taken


def seen_of(scene: Scene, o: Observations) -> Observations:
    """The sightings of a table that count in the scene."""
    if scene.seen.size == o.n and np.array_equal(scene.seen, np.arange(o.n)):
        return o
    return replace(o.select(scene.seen), epoch_s=None)
