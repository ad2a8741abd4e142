"""Errors of a campaign that several sightings share beyond their image or landmark, as sources of error.

==================================== ==========================================================================
``shared_by``                        one draw of the stated sigma for a pass, a session, the campaign, or a sample
                                     of the attitude's series, from which epochs are interpolated with weights
``correlation_time_s``               a process with the stated sigma and the correlation ``exp(-|dt| / time)``
``wander``                           such a process within each image, besides
``session_sigma``                    a further error, one draw a session
``common_sigma`` of landmarks        a further error, one draw for each survey (column ``source``)
``correlation_length`` of landmarks  a process on the ground with the stated sigma, within each survey
``sigma_time_s`` of images           a time tag that is late, one draw an image
==================================== ==========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..physics.covariance import square_root
from ..physics.earth import C_JT, itrf_to_geodetic
from ..physics.errors import InputError
from ..physics.orbit import GM_EARTH
from ..physics.series import Attitude
from .campaign import Campaign
from .considered import considered_sources
from .equation import Linearised, linearise
from .error_sources import Field, Source, as_stated, common_columns
from .geometry import position_axes
from .observations import Observations

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MOST_NUMBERS = 1 << 26
"""Doubles (0.5 GB) in what one sigma of each shared error does to each sighting."""
FORGOTTEN = 20.0
"""Correlation times after which a process remembers nothing (2e-9)."""
FEW_NEIGHBOURS = 40
"""Landmarks whose errors, correlated over a distance, are three unknowns each; of more, what images see of them."""
MOST_NEIGHBOURS = 1_000
"""Landmarks of a scenario whose errors may be drawn correlated over a distance."""
MOST_SHAPES = 400
"""Sums over images for which their covariance is exact, more only where each has but six."""
ROUNDS, SETTLED = 60, 1e-3
"""Rounds in which what is a landmark's own is found at most, and its change at which that has been."""
NEGLIGIBLE = 1e-10
"""Share of a process's variance that a draw may carry and yet be left out."""


def passes(campaign: Campaign) -> Index:
    """The pass (m,) of each image, in the order of time: as stated, else images less than half an orbit apart belong
    together."""
    if campaign.images.passes is not None:
        return numbered(campaign.images.passes)
    t_ns = campaign.images.t_ns
    radius = float(np.median(np.linalg.norm(campaign.ephemeris.r_J, axis=-1)))
    return chained(np.asarray(t_ns * 1e-9), np.pi * np.sqrt(radius**3 / GM_EARTH))


def sessions(campaign: Campaign) -> Index:
    """The session (m,) of each image: as stated, else its pass."""
    stated = campaign.images.sessions
    return passes(campaign) if stated is None else numbered(stated)


def numbered(names: Sequence[str]) -> Index:
    """Numbers of names, in the order in which they first occur."""
    places = {name: i for i, name in enumerate(dict.fromkeys(names))}
    return np.array([places[name] for name in names], dtype=np.int64)


def chained(t_s: Array, gap_s: float) -> Index:
    """Number of the chain of each time (m,): times less than a gap apart belong to one."""
    order = np.argsort(t_s, kind="stable")
    number = np.empty(t_s.size, dtype=np.int64)
    number[order] = np.cumsum(np.diff(t_s[order], prepend=t_s[order[:1]]) > gap_s)
    return number


def with_shared(campaign: Campaign, o: Observations, C_EK: Array | Callable[[], Array]) -> Observations:
    """The table ``o`` of a campaign with its shared errors among ``common_px``, as they act at the mounting C_EK.

    The mounting may be given as what computes it: without shared errors nobody asks.
    An error that is shared between images is then no longer the images' own.  Raises InputError where there are too
    many sightings for so many errors.
    """
    sources = shared_sources(campaign, o)
    near = _many_neighbours(campaign, o)
    if not sources and not near:
        return o
    draws = sum(source.groups * source.component.size for source in sources)
    draws += max(MOST_SHAPES, 6 * o.n_images) if near else 0
    if 2 * o.n * draws > MOST_NUMBERS:
        raise InputError(
            f"campaign {campaign.name!r}: found {o.n} sightings that share {draws} errors, wanted at most "
            f"{MOST_NUMBERS // (2 * o.n)} for so many; state fewer groups or a longer correlation time"
        )
    own: dict[str, Any] = {}
    mounting = C_EK() if callable(C_EK) else C_EK
    if campaign.attitude_errors.moved:
        own["cov_attitude_E"] = np.zeros_like(o.cov_attitude_E)
    if campaign.position_errors.moved:
        own["cov_position_J"] = np.zeros_like(o.cov_position_J)
    if campaign.landmarks.correlation_length is not None:
        own["cov_landmark_J"] = np.zeros_like(o.cov_landmark_J)
    model = linearise(o, mounting)
    stated = replace(o, **common_columns(sources, o, model), **own)
    return _with_neighbours(campaign, o, stated, model) if near else stated


def _with_neighbours(c: Campaign, o: Observations, stated: Observations, model: Linearised) -> Observations:
    """The table ``stated`` of ``o`` with the errors that many landmarks have in common with their neighbours."""
    share, columns = _neighbourly(c, o, model)
    names = (*(stated.common_of or ()), *["neighbours"] * columns.shape[-1])
    if stated.common_px is not None:
        columns = np.concatenate([stated.common_px, columns], axis=-1)
    own = share[:, None, None] * o.cov_landmark_J
    return replace(stated, common_px=columns, common_of=names, cov_landmark_J=own)


def shared_sources(campaign: Campaign, o: Observations) -> tuple[Source, ...]:
    """The errors of a campaign that its table does not have a place of their own for, those of many neighbouring
    landmarks left aside."""
    own = (*_attitude(campaign, o), *_position(campaign), *_landmarks(campaign), *_times(campaign))
    return (*own, *considered_sources(campaign, o))


def _attitude(c: Campaign, o: Observations) -> Iterator[Source]:
    stated = c.attitude_errors
    root = square_root(o.cov_attitude_E)
    t_s = (c.images.exposed(o.image, c.sightings.row_px) - c.images.t_ns.min()) * 1e-9
    if stated.shared_by == "sample":
        yield _of_samples(c.one_attitude, c.images.exposed(o.image, c.sightings.row_px), root[o.image])
    else:
        yield from _moved(c, "attitude", "alpha_E", root)
    if stated.wander_sigma is not None:
        own = stated.wander_sigma
        own = own[o.image] if own.ndim == 3 else own
        L = np.broadcast_to(np.diag(own) if own.ndim == 1 else own, (o.n, 3, 3))
        yield correlated("attitude wander", "turn_E", L, t_s, o.image, stated.wander_time_s)
    if stated.session_sigma is not None:
        own = stated.session_sigma
        L = np.broadcast_to(np.diag(own) if own.ndim == 1 else own, (o.n_images, 3, 3))
        yield as_stated("attitude session", "alpha_E", L, sessions(c))


def _position(c: Campaign) -> Iterator[Source]:
    axes_J, stated = position_axes(c), c.position_errors
    yield from _moved(c, "position", "rho_J", axes_J * c.sigma_position)
    if stated.session_sigma is not None:
        yield as_stated("position session", "rho_J", axes_J * stated.session_sigma, sessions(c))


def _moved(c: Campaign, name: str, field: Field, L: Array) -> Iterator[Source]:
    """The stated error of each image, L (m, 3, 3) its square root, where images share it."""
    stated = c.attitude_errors if field == "alpha_E" else c.position_errors
    if stated.correlation_time_s is not None:
        t_s = (c.images.t_ns - c.images.t_ns.min()) * 1e-9
        time_s = stated.correlation_time_s
        yield correlated(name, field, L, t_s, chained(t_s, FORGOTTEN * time_s), time_s)
    elif stated.moved:
        yield as_stated(name, field, L, groups(c, stated.shared_by))


def groups(c: Campaign, shared_by: str | None) -> Index:
    """Which draw each image (m,) takes."""
    match shared_by:
        case "pass":
            return passes(c)
        case "session":
            return sessions(c)
        case "campaign":
            return np.zeros(len(c.images.ids), dtype=np.int64)
    return np.arange(len(c.images.ids))


def _landmarks(c: Campaign) -> Iterator[Source]:
    landmarks = c.landmarks
    survey = numbered(landmarks.sources or ("",) * len(landmarks.ids))
    if landmarks.common_sigma is not None:
        latitude, longitude, _ = itrf_to_geodetic(landmarks.r_J)
        yield as_stated("survey", "pi_J", C_JT(latitude, longitude) * landmarks.common_sigma, survey)
    seen = np.unique(c.sightings.landmark)
    if landmarks.correlation_length is not None and seen.size <= FEW_NEIGHBOURS:
        L = square_root(landmarks.covariance_J)
        yield neighbours(landmarks.r_J, L, seen, survey, landmarks.correlation_length)


def _many_neighbours(c: Campaign, o: Observations) -> bool:
    """Whether the errors of landmarks are correlated over a distance, of more than are worth three columns each."""
    return c.landmarks.correlation_length is not None and np.unique(o.landmark).size > FEW_NEIGHBOURS


def _neighbourly(c: Campaign, o: Observations, model: Linearised) -> tuple[Array, Array]:
    """Errors of landmarks correlated by ``exp(-distance / length)``, in as few columns as answers depend on: the share
    of its stated covariance that is a landmark's own (L,), and the rest as errors in common (n, 2, r), px.

    An answer sees a survey by what it does to whole images: sums F^T z of an image's residuals, weighted by the noise,
    times shapes 1, x, y, ... of the pixels.  With K the covariance of all residuals by the survey and D the part of
    it that is landmarks' own::

        K ~ D + (K - D) F [F^T (K - D) F]^-1 F^T (K - D)

    is exact for all these sums, whatever D is, and D is chosen so that it is for each residual too (Nystroem's
    approximation; D is iterated like the uniquenesses of a factor analysis).
    """
    A = model.R @ square_root(c.landmarks.covariance_J)[o.landmark]  # px by a unit error
    F, KF, own = _seen_by_images(c, o, A)
    size = np.maximum(np.vecdot(A, A).sum(axis=-1), 1e-300)
    count = np.maximum(np.bincount(o.landmark, minlength=o.n_landmarks), 1)
    share, wide = np.ones(o.n_landmarks), KF.reshape(2 * o.n, -1)
    for _ in range(ROUNDS):
        left = wide - np.repeat(share[o.landmark], 2)[:, None] * own.reshape(wide.shape)
        values, vectors = np.linalg.eigh(F.reshape(wide.shape).T @ left)
        kept = values > NEGLIGIBLE * max(float(values[-1]), 0.0)
        U, before = left @ (vectors[:, kept] / np.sqrt(values[kept])), share
        explained = np.vecdot(U, U).reshape(o.n, 2).sum(axis=-1) / size
        share = np.clip(1.0 - np.bincount(o.landmark, explained, o.n_landmarks) / count, 0.0, 1.0)
        if np.max(np.abs(share - before)) < SETTLED:
            break
    return before, U.reshape(o.n, 2, -1)


def _seen_by_images(c: Campaign, o: Observations, A: Array) -> tuple[Array, Array, Array]:
    """F, K F and D F (n, 2, r), D the whole covariance of each landmark; A (n, 2, 3) as above."""
    landmarks, length = c.landmarks, float(c.landmarks.correlation_length or 1.0)
    survey = numbered(landmarks.sources or ("",) * o.n_landmarks)
    seen, place = np.unique(o.landmark, return_inverse=True)
    weight, images = np.linalg.inv(o.noise_px + A @ A.mT), np.unique(o.image)
    pixel = np.stack([c.sightings.column_px, c.sightings.row_px], axis=-1)
    degree = next((d for d in (3, 2, 1) if images.size * (d + 1) * (d + 2) <= MOST_SHAPES), 1)
    columns: list[tuple[Array, Array, Array]] = []
    for image in images:
        rows = np.flatnonzero(o.image == image)
        shapes = weight[rows] @ _polynomials(pixel[rows], degree)
        mine, at = np.unique(o.landmark[rows], return_inverse=True)
        sums = np.zeros((mine.size, 3, shapes.shape[-1]))
        np.add.at(sums, at, A[rows].mT @ shapes)
        apart = landmarks.r_J[seen][:, None] - landmarks.r_J[mine]
        alike = np.exp(-np.sqrt(np.vecdot(apart, apart)) / length) * (survey[seen][:, None] == survey[mine])
        same = np.zeros((seen.size, *sums.shape[1:]))
        same[np.searchsorted(seen, mine)] = sums
        F = np.zeros((o.n, 2, shapes.shape[-1]))
        F[rows] = shapes
        columns.append((F, A @ np.tensordot(alike, sums, axes=1)[place], A @ same[place]))
    F, KF, own = (np.concatenate(parts, axis=-1) for parts in zip(*columns, strict=True))
    return F, KF, own


def _polynomials(pixel: Array, degree: int) -> Array:
    """Independent shifts of column and row (n, 2, s) that are polynomials of the pixels (n, 2)."""
    middle = pixel - pixel.mean(axis=0)
    x, y = middle.T / max(float(np.abs(middle).max()), 1.0)
    powers = np.stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=-1)
    shapes, sizes, _ = np.linalg.svd(powers, full_matrices=False)
    shapes = shapes[:, sizes > 1e-6 * sizes[0]]
    both = np.zeros((len(pixel), 2, 2, shapes.shape[1]))
    both[:, 0, 0] = both[:, 1, 1] = shapes
    return both.reshape(len(pixel), 2, -1)


def neighbours(r_J: Array, L: Array, seen: Index, survey: Index, length: float) -> Source:
    """Errors of the landmarks ``seen`` among those at ``r_J`` (n, 3), L (n, 3, 3) their square roots, correlated by
    ``exp(-distance / length)`` within each ``survey`` (n,)."""
    if seen.size > MOST_NEIGHBOURS:
        raise InputError(
            f"landmarks.correlation_length_m: found {seen.size} landmarks, wanted at most {MOST_NEIGHBOURS} "
            "whose errors are correlated over a distance"
        )
    apart = r_J[seen][:, None] - r_J[seen]
    correlation = np.exp(-np.sqrt(np.vecdot(apart, apart)) / length)
    root = root_of(correlation * (survey[seen][:, None] == survey[seen]))
    blocks = L[seen][:, :, None, :] * root[:, None, :, None]
    pattern = np.zeros((len(r_J), 3, 3 * root.shape[1]))
    pattern[seen] = blocks.reshape(seen.size, 3, -1)
    return as_stated("neighbours", "pi_J", pattern, np.zeros(len(r_J), dtype=np.int64))


def _times(c: Campaign) -> Iterator[Source]:
    if c.images.sigma_time_s is not None:
        m = len(c.images.ids)
        yield as_stated("time", "late_s", c.images.sigma_time_s[:, None, None], np.arange(m))


def correlated(name: str, field: Field, L: Array, t_s: Array, group: Index, time_s: float) -> Source:
    """Elements off by ``L_j x(t_j)``, x a process of variance 1 and correlation ``exp(-|dt| / time)`` in each group.

    ``L`` (J, d, d), ``t_s`` and ``group`` (J,).  With the correlation ``R = U w U^T`` of a group of r draws, the
    pattern (J, d, d r) is L times ``U sqrt(w)``.
    """
    roots = {int(g): _in_time(t_s[group == g], time_s) for g in np.unique(group)}
    width, d = max((root.shape[1] for root in roots.values()), default=0), L.shape[-1]
    pattern = np.zeros((t_s.size, d, width * d))
    for g, root in roots.items():
        members, r = group == g, root.shape[1]
        blocks = L[members][:, :, None, :] * root[:, None, :, None]
        pattern[members, :, : r * d] = blocks.reshape(-1, d, r * d)
    return as_stated(name, field, pattern, group)


def _in_time(t_s: Array, time_s: float) -> Array:
    return root_of(np.exp(-np.abs(t_s[:, None] - t_s) / time_s))


def root_of(correlation: Array) -> Array:
    """A square root (k, r) of a correlation (k, k), with as few columns as it needs."""
    values, vectors = np.linalg.eigh(correlation)
    kept = values > NEGLIGIBLE * values[-1]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


def _of_samples(attitude: Attitude, t_ns: NDArray[np.int64], L: Array) -> Source:
    """White noise of the samples of a series, as it is interpolated at epochs (n,); L (n, 3, 3) its square root.

    Epochs that have samples in common, even by way of others, form a group; of fewer epochs than samples it takes as
    many columns as there are epochs.
    """
    samples, weights = attitude.weights(t_ns)
    used, place = np.unique(np.where(weights != 0.0, samples, samples[:, :1]), return_inverse=True)
    place = place.reshape(samples.shape)
    joined = np.zeros(used.size + 1, dtype=np.int64)  # windows that reach over the gap behind each sample
    np.add.at(joined, np.min(place, axis=1), 1)
    np.add.at(joined, np.max(place, axis=1), -1)
    chain = np.concatenate([[0], np.cumsum(np.cumsum(joined)[: used.size - 1] == 0)])
    first = np.searchsorted(chain, np.arange(chain[-1] + 1))
    group = chain[place[:, 0]]
    width = int(np.max(np.bincount(chain)))
    shares = np.zeros((t_ns.size, width))
    np.add.at(shares, (np.arange(t_ns.size)[:, None], place - first[group][:, None]), weights)
    roots = np.zeros((t_ns.size, int(np.max(np.minimum(np.bincount(chain), np.bincount(group))))))
    for number, taken in enumerate(np.bincount(chain)):
        members = group == number
        own = shares[members, :taken]
        own = own if taken <= len(own) else root_of(own @ own.T)
        roots[members, : own.shape[1]] = own
    pattern = L[:, :, None, :] * roots[:, None, :, None]
    return as_stated("attitude", "turn_E", pattern.reshape(t_ns.size, 3, -1), group)
