"""Campaigns as rows of an archive: written whole, read back as they were."""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mission.joint import CAMERA
from . import cells

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Instrument:
    """What one mounting is of: a satellite, and the frames that the mounting takes from and to."""

    satellite: str
    frame_from: str
    frame_to: str

    @property
    def key(self) -> tuple[str, str, str]:
        return self.satellite, self.frame_from, self.frame_to

    def __str__(self) -> str:
        of = f"{self.satellite!r}, " if self.satellite else ""
        return f"{of}{self.frame_from} to {self.frame_to}"


@dataclass(frozen=True)
class ImageRow:
    """An image of a campaign: its time, place on the orbit, temperatures, and a digest of its marks."""

    image_id: str
    t_ns: int
    u: float | None
    beta: float | None
    temperatures_c: Mapping[str, float]
    statistic: float | None
    observations: int
    sightings: str | None


@dataclass(frozen=True)
class NewCampaign:
    """A campaign before it is added; ``unknowns`` and ``normals`` are empty where it has no normal equations."""

    id: str
    inputs_id: str
    instrument: Instrument
    name: str
    first_ns: int
    last_ns: int
    software: str
    method: str
    options: Mapping[str, Any]
    status: str
    C_EK: Array
    covariance_E: Array | None
    result_text: str
    inputs: Mapping[str, str]
    images: Sequence[ImageRow]
    unknowns: Sequence[tuple[str, str, Array, Array, Array | None]]
    normals: Sequence[tuple[str, Sequence[str], Array, Array, float, int]]


@dataclass(frozen=True, eq=False)
class Entry:
    """A campaign of an archive; ``withdrawn`` is when and why, None for one that stands; ``summable`` whether it has
    normal equations.  ``cameras`` are all of several, the first one that of the instrument."""

    id: str
    inputs_id: str
    instrument: Instrument
    name: str
    first_ns: int
    last_ns: int
    added_utc: str
    software: str
    method: str
    options: Mapping[str, Any]
    status: str
    C_EK: Array
    covariance_E: Array | None
    images: int
    observations: int
    summable: bool
    withdrawn: tuple[str, str] | None
    cameras: tuple[str, ...]

    @property
    def stands(self) -> bool:
        """Whether it counts: usable, and not withdrawn."""
        return self.withdrawn is None and self.status in ("ok", "weak")


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
        f"INSERT INTO campaign VALUES({_marks(16)})",
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


def _marks(n: int) -> str:
    return ", ".join("?" * n)


def _many(database: sqlite3.Connection, table: str, width: int, rows: Iterable[tuple[Any, ...]]) -> None:
    database.executemany(f"INSERT INTO {table} VALUES({_marks(width)})", rows)


def _image_row(campaign: str, image: ImageRow) -> tuple[Any, ...]:
    temperatures = json.dumps(dict(image.temperatures_c), sort_keys=True) if image.temperatures_c else None
    place = (campaign, image.image_id, image.t_ns, image.u, image.beta, temperatures)
    return (*place, image.statistic, image.observations, image.sightings)


def _bytes(values: Array | None) -> bytes | None:
    return None if values is None else np.ascontiguousarray(values, dtype="<f8").tobytes()


def instruments(database: sqlite3.Connection) -> list[Instrument]:
    """Those that have campaigns, of several cameras by the first, in the order of their names."""
    rows = database.execute("SELECT DISTINCT satellite, frame_from, frame_to FROM campaign ORDER BY 1, 2, 3")
    return [Instrument(*row) for row in rows]


def all_instruments(database: sqlite3.Connection) -> list[Instrument]:
    """Those of further cameras too, which are in the campaigns of others."""
    rows = database.execute("SELECT satellite, frame_from, frame_to FROM instrument ORDER BY 1, 2, 3")
    return [Instrument(*row) for row in rows]


_FURTHER = "u.name > 'mounting[' AND u.name < 'mounting\\'"
"""Unknowns u that are mountings of further cameras: their names begin so, and an index finds them."""


def entries(database: sqlite3.Connection, instrument: Instrument | None = None) -> list[Entry]:
    """All campaigns, or those that say something of an instrument, in the order of time: those of its camera, and of
    cameras that are with it in another campaign."""
    where = "" if instrument is None else "WHERE satellite = ? AND frame_to = ? "
    rows = database.execute(
        "SELECT c.id, c.inputs, satellite, frame_from, frame_to, name, first_ns, last_ns, added_utc, software, method, "
        "options_json, status, matrix, covariance, (SELECT count(*) FROM image i WHERE i.campaign = c.id), "
        "(SELECT coalesce(sum(observations), 0) FROM image i WHERE i.campaign = c.id), "
        "EXISTS(SELECT 1 FROM normal n WHERE n.campaign = c.id), w.at_utc, w.reason, "
        f"(SELECT group_concat(u.name, char(10)) FROM unknown u WHERE u.campaign = c.id AND {_FURTHER}) "
        f"FROM campaign c LEFT JOIN withdrawn w ON w.campaign = c.id {where}ORDER BY first_ns, c.id",
        () if instrument is None else (instrument.satellite, instrument.frame_to),
    )
    found = [_entry(row) for row in rows]
    return found if instrument is None else _linked(found, instrument.frame_from)


def _linked(found: list[Entry], camera: str) -> list[Entry]:
    """Those of a camera, of cameras that share a campaign with it, and so on."""
    cameras = {camera}
    while more := {name for e in found if cameras & set(e.cameras) for name in e.cameras} - cameras:
        cameras |= more
    return [e for e in found if cameras & set(e.cameras)]


def _entry(row: tuple[Any, ...]) -> Entry:
    (id_, inputs, satellite, frame_from, frame_to, name, first, last, added, software, method, options) = row[
        :12
    ]
    status, matrix, covariance, images, observations, summable, at, reason, further = row[12:]
    names = [] if further is None else further.splitlines()
    return Entry(
        id_,
        inputs,
        Instrument(satellite, frame_from, frame_to),
        name,
        cells.epoch(first),
        cells.epoch(last),
        added,
        software,
        method,
        cells.mapping(options),
        status,
        cells.numbers(matrix).reshape(3, 3),
        None if covariance is None else cells.numbers(covariance).reshape(3, 3),
        images,
        observations,
        bool(summable),
        None if at is None else (at, reason),
        (frame_from, *(name[len(CAMERA) : -1] for name in names)),
    )


def result_text(database: sqlite3.Connection, campaign: str) -> str:
    """``result.json`` of a campaign.  Raises ValueError where there is none."""
    row = database.execute("SELECT result_json FROM campaign WHERE id = ?", (campaign,)).fetchone()
    if row is None or not isinstance(row[0], bytes):
        raise ValueError("a campaign without its result")
    return zlib.decompress(row[0]).decode()


def inputs_of(database: sqlite3.Connection, campaign: str) -> dict[str, str]:
    """The files that a campaign was made from, and their digests."""
    return dict(
        database.execute(
            "SELECT name, sha256 FROM input WHERE campaign = ? ORDER BY rowid", (campaign,)
        ).fetchall()
    )


def images_of(database: sqlite3.Connection, campaign: str) -> list[ImageRow]:
    """The images of a campaign in the order of time.  Raises ValueError where there are none."""
    rows = database.execute(
        "SELECT image_id, t_ns, u_rad, beta_rad, temperatures_json, statistic, observations, sightings "
        "FROM image WHERE campaign = ? ORDER BY t_ns, image_id",
        (campaign,),
    )
    found = [
        ImageRow(
            i,
            cells.epoch(t_ns),
            cells.number(u),
            cells.number(beta),
            cells.temperatures(degrees),
            chi2,
            n,
            digest,
        )
        for i, t_ns, u, beta, degrees, chi2, n, digest in rows
    ]
    if not found:
        raise ValueError("a campaign without its images")
    return found


def moments_again(database: sqlite3.Connection, chosen: Sequence[Entry]) -> int:
    """How many moments have images in two or more of some campaigns."""
    asked = (
        f"SELECT count(*) FROM (SELECT t_ns FROM image WHERE campaign IN ({_marks(len(chosen))}) "
        "GROUP BY t_ns HAVING count(DISTINCT campaign) > 1)"
    )
    return int(database.execute(asked, [entry.id for entry in chosen]).fetchone()[0])
