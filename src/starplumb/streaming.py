"""The adjustment of tables too large to hold a design of: whole images at a time, a few megabytes each.

Images share nothing but the common parameters where every landmark is seen once, so their reduced normal equations are
simply added up (:mod:`starplumb.adjustment`), and nothing grows with the number of sightings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .adjustment import invert_information, normal_equations, whiten
from .model import Linearised
from .observations import PER_SIGHTING, Observations

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LARGE = 10_000
"""Sightings from which a table is taken in chunks."""
CHUNK = 4_096
"""Sightings of a chunk, more where an image has more: what fits the processor's cache with all that is made of it."""
SAMPLE = 30_000
"""Sightings of the sample from which the adjustment of a table several times larger starts."""

Part = tuple[Observations, Linearised, Array]
"""A table with its linearisation and design A (n, 2, k)."""


@dataclass(frozen=True)
class Sum:
    """Solution of one linear step: ``x`` (k,), ``information`` and ``covariance`` (k, k), ``chi2`` at the minimum."""

    x: Array
    information: Array
    covariance: Array
    chi2: Array


def streams(o: Observations) -> bool:
    """Whether a table is large, without batch axes and of landmarks seen once, so that it can be taken in chunks."""
    return o.n > LARGE and o.batch == () and bool(np.bincount(o.landmark).max() == 1)


def sampled(o: Observations) -> bool:
    """Whether a sample is worth to start from."""
    return o.n >= 2 * SAMPLE and streams(o)


def chunks(o: Observations) -> Iterator[Observations]:
    """Parts of the table of whole images, each with its own images and landmarks only."""
    ordered = bool(np.all(o.image[:-1] <= o.image[1:]))
    order = None if ordered else np.argsort(o.image, kind="stable")
    counts = np.bincount(o.image, minlength=o.n_images)
    ends = np.cumsum(counts)
    first, start = 0, 0
    while start < o.n:
        last = min(max(int(np.searchsorted(ends, start + CHUNK)), first), o.n_images - 1)
        rows = slice(start, int(ends[last])) if order is None else order[start : ends[last]]
        yield _part(o, rows, np.arange(first, last + 1))
        first, start = last + 1, int(ends[last])


def _part(o: Observations, rows: slice | Index, images: Index) -> Observations:
    """Some rows with the covariances of their images (g,), which are all of these, and of their landmarks."""
    image = np.searchsorted(images, o.image[rows])
    own = {name: getattr(o, name)[rows] for name in PER_SIGHTING}  # of a slice these are views
    return replace(
        o,
        **own,
        image=image,
        landmark=np.arange(image.size),
        cov_attitude_E=o.cov_attitude_E[images],
        cov_position_J=o.cov_position_J[images],
        cov_landmark_J=o.cov_landmark_J[o.landmark[rows]],
        common_px=None if o.common_px is None else o.common_px[rows],
        epoch_s=None,
    )


def sample(o: Observations) -> Observations:
    """Whole images spread over the table, a few ten thousand sightings in all."""
    rows = np.flatnonzero(o.image % int(np.ceil(o.n / SAMPLE)) == 0)
    return _part(o, rows, np.unique(o.image[rows]))


def stream(o: Observations, linear: Callable[[Observations], Part], prior: tuple[Array, Array]) -> Sum:
    """The step of :func:`starplumb.adjustment.solve` for a table of single landmarks, chunk by chunk.

    ``linear`` makes the linear problem of a part; ``prior`` is the information and step on the k common parameters.
    """
    information, step = prior[0].copy(), prior[1]
    right, chi2 = -(prior[0] @ step), float(step @ prior[0] @ step)
    for part in chunks(o):
        table, model, A = linear(part)
        n = normal_equations(table, whiten(table, model, A))
        information += n.YY
        right += n.Yz[:, 0]
        chi2 += float(n.zz)
    covariance = invert_information(information)
    x = -(np.where(np.isfinite(covariance), covariance, 0.0) @ right)
    return Sum(x, information, covariance, np.asarray(chi2 + right @ x))
