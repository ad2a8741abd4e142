"""How a table is adjusted: as a whole, or in chunks of whole images where it is large.  All sizes stand here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..table.observations import MAY_LACK, PER_SIGHTING, Observations

Index = NDArray[np.int64]
Rows = slice | Index

LARGE = 10_000
"""A table of more sightings than this is adjusted in chunks..."""
MANY = 60
"""...and so is one with more landmarks than this seen more than once: their errors are then a sparse system..."""
APART = 500
"""...and one of more sightings than this that share no landmark, which needs no sparse system."""
CHUNK = 4_096
"""Sightings of a chunk: with all that is computed from them they fit the processor's cache."""
SAMPLE = 30_000
"""Sightings of the sample from which the adjustment of a table several times larger starts."""


def repeated_landmarks(o: Observations) -> Index:
    """The landmarks (q,) seen more than once."""
    return np.flatnonzero(np.bincount(o.landmark, minlength=o.n_landmarks) > 1)


def in_chunks(o: Observations) -> bool:
    """Whether a table is adjusted in chunks: it is large and has no batch axes."""
    if o.batch or not o.cov_attitude_E.ndim == o.cov_position_J.ndim == o.cov_landmark_J.ndim == 3:
        return False
    repeated = repeated_landmarks(o).size
    return o.n > LARGE or repeated > MANY or (o.n > APART and repeated == 0)


def sampled(o: Observations) -> bool:
    """Whether to start from the estimate of a sample: in a large table of landmarks seen once."""
    return o.n >= 2 * SAMPLE and in_chunks(o) and repeated_landmarks(o).size == 0


def sample(o: Observations) -> Observations:
    """Whole images drawn from the table (always the same ones), some ten thousand sightings in all."""
    drawn = np.random.default_rng(0).random(o.n_images) < SAMPLE / o.n
    return part(o, np.flatnonzero(drawn[o.image]))


def part(o: Observations, rows: Rows) -> Observations:
    """Some rows (a slice is not copied), with all images and landmarks as they are (no batch axes)."""
    own = {name: getattr(o, name)[rows] for name in ("image", "landmark", *PER_SIGHTING)}
    own |= {name: getattr(o, name)[rows] for name in (*MAY_LACK, "camera") if getattr(o, name) is not None}
    return replace(o, **own)


def blocks(o: Observations) -> Iterator[tuple[Index, list[Rows]]]:
    """Images (g,) with equally many sightings each, as many as a chunk holds, and their rows, image after image.

    An image larger than a chunk comes alone, its rows in pieces.
    """
    ordered = bool(np.all(o.image[:-1] <= o.image[1:]))
    order = None if ordered else np.argsort(o.image, kind="stable")
    counts = np.bincount(o.image, minlength=o.n_images)
    starts = np.cumsum(counts) - counts
    for count in np.unique(counts[counts > 0]):
        same = np.flatnonzero(counts == count)
        apart = np.flatnonzero(np.diff(starts[same]) != count)  # the next run does not follow at once
        step = max(1, CHUNK // int(count))
        for first in range(0, same.size, step):
            images = same[first : first + step]
            i = np.searchsorted(apart, first)
            together = i == apart.size or apart[i] >= first + images.size - 1
            yield images, _rows(order, starts[images], int(count), together)


def _rows(order: Index | None, starts: Index, count: int, together: bool) -> list[Rows]:
    """Rows of runs of ``count`` that begin at ``starts`` of ``order``, cut into pieces where one run is too long;
    ``together``: they follow one another at once."""
    begin, end = int(starts[0]), int(starts[0]) + count * starts.size
    rows: Index | None = None
    if order is not None or not together:
        rows = (starts[:, None] + np.arange(count)).reshape(-1)
        rows = rows if order is None else order[rows]
    step = CHUNK if starts.size == 1 else end - begin
    cuts = range(0, count * starts.size, step)
    if rows is None:
        return [slice(begin + at, min(begin + at + step, end)) for at in cuts]
    return [rows[at : at + step] for at in cuts]
