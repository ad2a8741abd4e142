"""What each candidate image tells of the mounting, beside the errors that it shares with other images.

To first order the residuals of an image are ``z = H theta + sum_s E_s xi_s`` (:mod:`starplumb.table.equation`,
:mod:`starplumb.table.error_sources`).  Draws that only this image has are eliminated; those of its pass, its site and
the campaign stay beside the mounting as unknowns of which N(0, 1) is known::

    N = A^T V^-1 A,   A = [H, E_campaign, E_pass, E_site],   V = D + G G^T - F F^T

with D the noise of single sightings, G what the image has for itself, and F what its site's markers have in common.
The survey errors of L markers are 3 L draws; the mounting feels them through the shift, the turn and the size of the
whole group, whose seven draws F are kept for the site, and the rest counts as the image's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...table.equation import Linearised
from ...table.error_sources import Effect, Source
from ...table.observations import Observations

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Level = Literal["sighting", "marker", "network", "image", "pass", "campaign"]
"""Who shares one draw of a source: nobody, the sightings of a marker, the markers of a site, and so on."""

MODES = 7
"""Draws of a site's markers that are kept: three shifts, three turns and the size of the group."""
LEAST = 1e-4
"""What an image tells of a direction is left out where it is less than this part of what is known beforehand."""
MOST_ROWS = 1 << 21
"""Numbers of whitened rows that are formed at once (16 MB)."""


@dataclass(frozen=True)
class Information:
    """What n images tell: ``N_i = factor_i factor_i^T`` over its own unknowns [mounting, campaign | pass | site].

    ``factor`` (n, d, r) with d = common + of_pass + of_site, the mounting in rad, draws in sigmas; ``pass_of`` and
    ``site_of`` (n,) number the pass and the site of each; ``names`` (d,) the source of each unknown.
    """

    factor: Array
    common: int
    of_pass: int
    of_site: int
    pass_of: Index
    site_of: Index
    names: tuple[str, ...]

    @property
    def n(self) -> int:
        return len(self.factor)

    def only(self, chosen: Index) -> Information:
        """Of some of the images."""
        return replace(
            self, factor=self.factor[chosen], pass_of=self.pass_of[chosen], site_of=self.site_of[chosen]
        )

    def weighted(self, part: Array) -> Information:
        """With a part (n,) of what each tells, as of images that may turn out cloudy."""
        return replace(self, factor=self.factor * np.sqrt(part)[:, None, None])

    @property
    def sources(self) -> tuple[str, ...]:
        """The sources of error that images share."""
        return tuple(dict.fromkeys(self.names[3:]))

    def without(self, source: str) -> Information:
        """As if the errors of a source were known."""
        kept = np.array([name != source for name in self.names])
        ends = np.cumsum([self.common, self.of_pass, self.of_site])
        common, of_pass, of_site = (int(np.sum(part)) for part in np.split(kept, ends[:-1]))
        names = tuple(name for name in self.names if name != source)
        return replace(
            self, factor=self.factor[:, kept], common=common, of_pass=of_pass, of_site=of_site, names=names
        )


@dataclass(frozen=True)
class Blocks:
    """Effects (n, 2, q) of unit draws on the residuals of n sightings, by who shares them; ``noise`` (n, 2, 2) px^2."""

    noise: Array
    image: Array
    campaign: Array
    of_pass: Array
    network: Array
    modes: Array
    names: tuple[str, ...]


def blocks(
    o: Observations,
    model: Linearised,
    sources: Sequence[Source],
    level: Mapping[str, Level],
    site_of_landmark: Index | None,
) -> Blocks:
    """The effects of sources by their level.  ``site_of_landmark`` (L,) are the sites whose images share their markers;
    None where every image has markers of its own."""
    found: dict[Level, list[Array]] = {}
    markers = [s for s in sources if level[s.name] == "marker"]
    for source in sources:
        found.setdefault(level[source.name], []).append(Effect.of(source, o, model).block)
    names = [
        s.name
        for key in ("campaign", "pass", "network")
        for s in sources
        if level[s.name] == key
        for _ in s.component
    ]
    joined = {key: np.concatenate(parts, axis=-1) for key, parts in found.items()}
    nothing = np.zeros((o.n, 2, 0))
    own, marker = joined.get("sighting", nothing), joined.get("marker", nothing)
    modes = np.zeros((o.n, 2, 0))
    if site_of_landmark is not None and markers:
        gain = np.concatenate([source.gain for source in markers], axis=-1)
        r_J = _places(o, len(gain))
        modes = marker @ _modes(r_J, gain, site_of_landmark)[o.landmark]
        names += [" and ".join(source.name for source in markers)] * MODES
    return Blocks(
        own @ own.mT + marker @ marker.mT,
        joined.get("image", nothing),
        joined.get("campaign", nothing),
        joined.get("pass", nothing),
        joined.get("network", nothing),
        modes,
        ("", "", "", *names),
    )


def _places(o: Observations, n_landmarks: int) -> Array:
    r_J = np.zeros((n_landmarks, 3))
    r_J[o.landmark] = o.p_J
    return r_J


def _modes(r_J: Array, gain: Array, site: Index) -> Array:
    """Draws of the markers (L, q, 7) that move the shift, turn and size of their site's group; orthonormal in each."""
    phi = np.zeros((len(r_J), gain.shape[-1], MODES))
    for one in np.unique(site):
        mine = np.flatnonzero(site == one)
        away = r_J[mine] - r_J[mine].mean(axis=0)
        away = away / max(float(np.sqrt(np.mean(np.sum(away**2, axis=-1)))), 1.0)
        turns = np.cross(np.eye(3), away[:, None]).swapaxes(-1, -2)
        fields = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns, away[..., None]], axis=-1)
        felt = (gain[mine].mT @ fields).reshape(-1, MODES)
        u, s, _ = np.linalg.svd(felt, full_matrices=False)
        phi[mine, :, : s.size] = np.where(s > 1e-6 * s[0], u, 0.0).reshape(mine.size, -1, s.size)
    return phi


def information(o: Observations, H: Array, parts: Blocks) -> Array:
    """N (m, d, d) of the m images of a table over [mounting, campaign, pass, site]."""
    inverse_root = np.linalg.inv(np.linalg.cholesky(parts.noise))
    columns = (H, parts.campaign, parts.of_pass, parts.network, parts.modes, parts.image)
    X = inverse_root @ np.concatenate(columns, axis=-1)
    squares = _sums(X, o.image, o.n_images)
    own, modes = parts.image.shape[-1], parts.modes.shape[-1]
    d = X.shape[-1] - own
    a, left = np.arange(d), np.arange(d - modes, d + own)
    sign = np.diag(np.concatenate([np.full(modes, -1.0), np.ones(own)]))
    Q = squares[:, left[:, None], left] + sign
    side = squares[:, left[:, None], a]
    N = squares[:, :d, :d] - side.mT @ np.linalg.solve(Q, side)
    return np.asarray(0.5 * (N + N.mT))


def _sums(X: Array, image: Index, m: int) -> Array:
    """Sums over the sightings of each image of ``X^T X``, (m, c, c)."""
    order = np.argsort(image, kind="stable")
    counts = np.bincount(image, minlength=m)
    first = np.cumsum(counts) - counts
    most, c = int(counts.max()), X.shape[-1]
    squares = np.empty((m, c, c))
    step = max(1, MOST_ROWS // (2 * most * c))
    for start in range(0, m, step):
        some = np.arange(start, min(start + step, m))
        place = np.arange(most)
        rows = order[np.minimum(first[some][:, None] + place, order.size - 1)]
        there = place < counts[some][:, None]
        padded = np.where(there[..., None, None], X[rows], 0.0).reshape(some.size, 2 * most, c)
        squares[some] = padded.mT @ padded
    return squares


def factors(N: Array, known: Array) -> Array:
    """Factors (n, d, r) of information N (n, d, d) where ``known`` (d,) are the sigmas beforehand, of the smallest rank
    that leaves out nothing which matters."""
    values, axes = np.linalg.eigh(N * known[:, None] * known)
    rank = max(int(np.max(np.sum(values > LEAST, axis=-1), initial=0)), 1)
    kept = np.sqrt(np.maximum(values[:, -rank:], 0.0))
    return np.asarray(axes[:, :, -rank:] * kept[:, None, :] / known[:, None])
