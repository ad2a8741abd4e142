"""A campaign on its way into an archive: all of its rows, and the digests by which a later change is told."""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from ...mission.joint import CAMERA
from .rows import Array, ImageRow, NewCampaign, marks
from .seals import seal


def insert(database: sqlite3.Connection, c: NewCampaign, now: str) -> None:
    """Add a campaign, within a transaction."""
    database.execute("INSERT OR IGNORE INTO satellite VALUES(?)", (c.instrument.satellite,))
    further = [name[len(CAMERA) : -1] for name, *_ in c.unknowns if name.startswith(CAMERA)]
    for camera in (c.instrument.frame_from, *further):
        key = (c.instrument.satellite, camera, c.instrument.frame_to)
        database.execute("INSERT OR IGNORE INTO instrument VALUES(?, ?, ?)", key)
    row = (c.id, c.inputs_id, *c.instrument.key, c.name, c.first_ns, c.last_ns, now, c.software, c.method)
    options = json.dumps(c.options, sort_keys=True)
    database.execute(
        f"INSERT INTO campaign VALUES({marks(16)})",
        (
            *row,
            options,
            c.status,
            *map(_bytes, (c.C_EK, c.covariance_E)),
            zlib.compress(c.result_text.encode()),
        ),
    )
    _many(database, "input", 3, ((c.id, name, digest) for name, digest in c.inputs.items()))
    _many(database, "image", 9, (_image_row(c.id, image) for image in c.images))
    _many(
        database,
        "unknown",
        6,
        ((c.id, name, unit, *map(_bytes, (r, e, P))) for name, unit, r, e, P in c.unknowns),
    )
    _many(
        database,
        "normal",
        7,
        (
            (c.id, i, json.dumps(list(names)), _bytes(N), _bytes(b), k, n)
            for i, names, N, b, k, n in c.normals
        ),
    )
    seal(database, "campaign", c.id)


def _many(database: sqlite3.Connection, table: str, width: int, rows: Iterable[tuple[Any, ...]]) -> None:
    database.executemany(f"INSERT INTO {table} VALUES({marks(width)})", rows)


def _image_row(campaign: str, image: ImageRow) -> tuple[Any, ...]:
    temperatures = json.dumps(dict(image.temperatures_c), sort_keys=True) if image.temperatures_c else None
    place = (campaign, image.image_id, image.t_ns, image.u, image.beta, temperatures)
    return (*place, image.statistic, image.observations, image.sightings)


def _bytes(values: Array | None) -> bytes | None:
    return None if values is None else np.ascontiguousarray(values, dtype="<f8").tobytes()
