"""One rotation of each campaign, and what their errors have in common.

Campaigns over the mounting x (about a common one) and the blocks o that several have (landmarks, surveys), each with a
mounting of its own.  With all that the campaigns and the surveys say of o, its mean o* and covariance P_o*,
campaign k leaves::

    y_k = -N_xx^-1 (b_x + N_xo o*),   cov(y_k, y_l) = N_xx^-1 [k = l] + G_k P_o* G_l^T,   G_k = -N_xx^-1 N_xo

so that a survey's error, which recurs in every campaign, is one error of all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.units import ARCSEC
from .joint import MOUNTING, Equations, Image, linked, shared_names, summed

Array = NDArray[np.float64]

FEWEST = 3
"""Campaigns from whose scatter a sigma can be told at all."""
NEGLIGIBLE = 0.03
"""Size of an error in common, over the campaigns' own sigmas and summed over them, below which it is left out."""
MOST_COMMON = 24
"""Errors in common that are kept, the largest."""


@dataclass(frozen=True)
class Points:
    """Rotations ``value_E`` (m, 3) rad of m campaigns from ``C_EK`` (3, 3), with the covariance ``own_E`` (m, 3, 3)
    rad^2 of each campaign's own error and what unit draws of errors in ``common_E`` (m, 3, r) rad do to all."""

    C_EK: Array
    value_E: Array
    own_E: Array
    common_E: Array

    @property
    def sigma_E(self) -> Array:
        """Standard deviation (m, 3) of each, both kinds of error in it."""
        total = self.own_E + self.common_E @ self.common_E.mT
        return np.sqrt(np.diagonal(total, axis1=-2, axis2=-1))

    def about(self, C_EK: Array) -> Points:
        """The same from another mounting close by."""
        moved = so3.log(so3.exp(self.value_E) @ self.C_EK @ C_EK.T)
        return replace(self, C_EK=C_EK, value_E=moved)

    def chosen(self, which: NDArray[np.int64]) -> Points:
        """Some of the campaigns."""
        return replace(
            self, value_E=self.value_E[which], own_E=self.own_E[which], common_E=self.common_E[which]
        )


def points(parts: Sequence[Equations]) -> Points:
    """Of campaigns with their normal equations."""
    names = shared_names(parts)
    few = linked(parts, names)
    others = [name for name in names if name != MOUNTING]
    x = [part.places[MOUNTING] for part in few]
    own = np.linalg.inv(
        np.array([part.information[at[:, None], at] for part, at in zip(few, x, strict=True)])
    )
    b = np.array([part.vector[at] for part, at in zip(few, x, strict=True)])
    free = [_free(part, P) for part, P in zip(few, own, strict=True)]
    places, o, P_o = _common(few, others, [(r, left, vector, 0.0, 0) for r, _, left, vector in free])
    root = np.linalg.cholesky(P_o) if o.size else P_o
    value, common = -(own @ b[..., None])[..., 0], np.zeros((len(few), 3, o.size))
    for k, (r, G, _, _) in enumerate(free):
        if r:
            where = np.concatenate([places[name] for name in r])
            value[k] += G @ o[where]
            common[k] = G @ root[where]
    return Points(few[0].C_EK, ARCSEC * value, ARCSEC**2 * own, _compressed(ARCSEC * common, ARCSEC**2 * own))


def _free(part: Equations, own: Array) -> tuple[list[str], Array, Array, Array]:
    """The blocks of a campaign beside the mounting and G of them, with the information and the vector that are left for
    them where the mounting, of the covariance ``own`` (3, 3) arcsec^2 without them, is free."""
    r = [name for name in part.blocks if name != MOUNTING]
    x, at, N = part.places[MOUNTING], part.at(r), part.information
    N_xr = N[x[:, None], at]
    G = -own @ N_xr
    return r, G, N[at[:, None], at] + N_xr.T @ G, part.vector[at] + G.T @ part.vector[x]


def _common(
    parts: Sequence[Equations], names: Sequence[str], free: Sequence[Image]
) -> tuple[Mapping[str, NDArray[np.int64]], Array, Array]:
    """Places, mean and covariance of the blocks that campaigns share, from their references, each mounting being
    free."""
    blocks = {name: known for part in reversed(parts) for name, known in part.blocks.items()}
    whole = summed(parts[0].C_EK, {name: blocks[name] for name in names}, free).with_known(names)
    P = np.asarray(np.linalg.inv(whole.information), dtype=np.float64)
    return whole.places, -P @ whole.vector, P


def _compressed(common: Array, own: Array) -> Array:
    """The same covariance by as few errors in common as tell (m, 3, r)."""
    m, _, width = common.shape
    if width == 0:
        return common
    whitened = np.linalg.solve(np.linalg.cholesky(own), common).reshape(3 * m, width)
    _, s, V = np.linalg.svd(whitened, full_matrices=False)
    return np.asarray(common @ V[: max(1, min(int(np.sum(s > NEGLIGIBLE)), MOST_COMMON))].T)


def scatter(found: Points) -> tuple[Array | None, int]:
    """Standard deviation (3,) rad of the mean of campaigns by their scatter, whatever is stated, with its degrees of
    freedom; None for too few.  What their errors have in common scatters nothing and stands as stated."""
    m = len(found.value_E)
    if m < FEWEST:
        return None, max(m - 1, 0)
    W = np.linalg.inv(found.own_E)
    gain = np.linalg.solve(np.sum(W, axis=0), W)
    mean = np.sum(gain @ found.value_E[..., None], axis=0)[:, 0]
    moved = (gain @ (found.value_E - mean)[..., None])[..., 0]
    shared = np.sum(gain @ found.common_E, axis=0)
    variance = m / (m - 1.0) * np.sum(moved**2, axis=0) + np.sum(shared**2, axis=-1)
    return np.sqrt(variance), m - 1
