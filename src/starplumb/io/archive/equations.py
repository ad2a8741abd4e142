"""The normal equations of an archive's campaigns, read back over unknowns by name."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mission.cameras import about_camera
from ...mission.joint import MOUNTING, Equations, Image, Known, summed
from ...table.cameras.known import RANGE
from . import cells
from .rows import Entry

Array = NDArray[np.float64]

AT_ONCE = 200
"""Campaigns whose rows are read together."""
Rows = Sequence[tuple[Any, ...]]


def equations(database: sqlite3.Connection, entries: Sequence[Entry], camera: str) -> Iterator[Equations]:
    """Of campaigns, each about the mounting of a camera in its result, what its images share under names that are its
    own."""
    for start in range(0, len(entries), AT_ONCE):
        some = entries[start : start + AT_ONCE]
        unknowns = _of_each(database, some, "unknown", "name, reference, expected, covariance")
        images = _of_each(database, some, "normal", "names_json, information, vector, constant, count")
        numbers = _numbers(row[1:] for entry in some for row in unknowns[entry.id])
        for entry in some:
            yield _equations(entry, unknowns[entry.id], numbers, images[entry.id], camera)


def _of_each(
    database: sqlite3.Connection, entries: Sequence[Entry], table: str, columns: str
) -> dict[str, list[tuple[Any, ...]]]:
    """Rows of a table by campaign, in the order in which they were written."""
    found: dict[str, list[tuple[Any, ...]]] = {entry.id: [] for entry in entries}
    marks = ", ".join("?" * len(found))
    asked = f"SELECT campaign, {columns} FROM {table} WHERE campaign IN ({marks}) ORDER BY rowid"
    for campaign, *row in database.execute(asked, list(found)):
        found[campaign].append(tuple(row))
    return found


def _equations(
    entry: Entry, unknowns: Rows, numbers: Iterator[Array], images: Rows, camera: str
) -> Equations:
    blocks = {}
    for name, _, _, covariance in unknowns:
        reference, expected = next(numbers), next(numbers)
        P = None if covariance is None else next(numbers).reshape(reference.size, reference.size)
        blocks[own_name(name, entry.id)] = Known(reference, expected, P)
    if MOUNTING not in blocks:
        raise ValueError("normal equations without the mounting")
    whole = summed(entry.C_EK, blocks, _images(images, entry.id))
    return about_camera(whole, entry.instrument.frame_from, camera, RANGE)


def _numbers(rows: Iterable[Sequence[Any]]) -> Iterator[Array]:
    """Those of many cells, one after another and read at once."""
    parts = [part for row in rows for part in row if part is not None]
    if not all(isinstance(part, bytes) and len(part) % 8 == 0 for part in parts):
        raise ValueError("numbers that are missing")
    values, start = cells.numbers(b"".join(parts)), 0
    for part in parts:
        yield values[start : start + len(part) // 8]
        start += len(part) // 8


def _images(rows: Rows, campaign: str) -> Iterator[Image]:
    """Equations of a campaign's images, those over the same unknowns already summed."""
    alike: dict[str, list[tuple[Any, ...]]] = {}
    for names, *sums in rows:
        alike.setdefault(names, []).append(tuple(sums))
    for names, some in alike.items():
        information, vectors, constants, counts = zip(*some, strict=True)
        b = cells.rows(vectors)
        yield (
            [own_name(name, campaign) for name in cells.names(names)],
            _square(cells.rows(information).sum(axis=0), b.shape[1]),
            b.sum(axis=0),
            sum(constants),
            sum(counts),
        )


def _square(upper: Array, n: int) -> Array:
    """A symmetric matrix (n, n) from its upper triangle, row by row."""
    N = np.zeros((n, n))
    N[_upper(n)] = upper
    return np.asarray(N + np.triu(N, 1).T)


@lru_cache(maxsize=64)
def _upper(n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    return np.triu_indices(n)


def own_name(name: str, campaign: str) -> str:
    """The name of an unknown among several campaigns: what the images of one share is its own."""
    return f"{name} of {campaign}" if name.startswith("shared[") else name
