"""Campaigns as rows of an archive: written whole, read back as they were."""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mission.joint import CAMERA
from ..text.files import MOST_TEXT
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


def marks(n: int) -> str:
    """So many places of values in a statement."""
    return ", ".join("?" * n)


def instruments(database: sqlite3.Connection) -> list[Instrument]:
    """Those that have campaigns, of several cameras by the first, in the order of their names; not that of a camera
    which another one's campaigns have as a further one, unless it leads in its turn."""
    rows = database.execute("SELECT DISTINCT satellite, frame_from, frame_to FROM campaign ORDER BY 1, 2, 3")
    found = [Instrument(*row) for row in rows]
    led = _led(database)
    return [one for one in found if not any((b, a) not in led for a, b in led if b == one)] or found


def _led(database: sqlite3.Connection) -> set[tuple[Instrument, Instrument]]:
    """First and further cameras of campaigns that are not withdrawn."""
    rows = database.execute(
        "SELECT DISTINCT c.satellite, c.frame_to, c.frame_from, u.name FROM unknown u JOIN campaign c "
        f"ON c.id = u.campaign WHERE {_FURTHER} AND c.id NOT IN (SELECT campaign FROM withdrawn)"
    )
    return {
        (Instrument(of, first, to), Instrument(of, name[len(CAMERA) : -1], to))
        for of, to, first, name in rows
    }


def all_instruments(database: sqlite3.Connection) -> list[Instrument]:
    """Those of further cameras too, which are in the campaigns of others."""
    rows = database.execute("SELECT satellite, frame_from, frame_to FROM instrument ORDER BY 1, 2, 3")
    return [Instrument(*row) for row in rows]


_FURTHER = "u.name > 'mounting[' AND u.name < 'mounting\\'"
"""Unknowns u that are mountings of further cameras: their names begin so, and an index finds them."""


def entries(database: sqlite3.Connection, instrument: Instrument | None = None) -> list[Entry]:
    """All campaigns, or those that say something of an instrument, in the order of time: those of its camera, and of
    cameras that are with it in another campaign."""
    if instrument is None:
        return _entries(database, "", ())
    of = (instrument.satellite, instrument.frame_to)
    return _linked(_entries(database, "WHERE satellite = ? AND frame_to = ? ", of), instrument.frame_from)


def entry(database: sqlite3.Connection, campaign: str) -> Entry:
    """The campaign of an id.  Raises LookupError where there is none."""
    for found in _entries(database, "WHERE c.id = ? ", (campaign,)):
        return found
    raise LookupError("its row is not found by its id")


def _entries(database: sqlite3.Connection, where: str, values: Sequence[str]) -> list[Entry]:
    rows = database.execute(
        "SELECT c.id, c.inputs, satellite, frame_from, frame_to, name, first_ns, last_ns, added_utc, software, method, "
        "options_json, status, matrix, covariance, (SELECT count(*) FROM image i WHERE i.campaign = c.id), "
        "(SELECT coalesce(sum(observations), 0) FROM image i WHERE i.campaign = c.id), "
        "EXISTS(SELECT 1 FROM normal n WHERE n.campaign = c.id), w.at_utc, w.reason, "
        f"(SELECT group_concat(u.name, char(10)) FROM unknown u WHERE u.campaign = c.id AND {_FURTHER}) "
        f"FROM campaign c LEFT JOIN withdrawn w ON w.campaign = c.id {where}ORDER BY first_ns, c.id",
        values,
    )
    return [_entry(row) for row in rows]


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
        cells.options(options),
        status,
        cells.numbers(matrix).reshape(3, 3),
        None if covariance is None else cells.covariance(covariance),
        images,
        observations,
        bool(summable),
        None if at is None else (at, reason),
        (frame_from, *(name[len(CAMERA) : -1] for name in names)),
    )


def result_text(database: sqlite3.Connection, campaign: str) -> str:
    """``result.json`` of a campaign.  Raises ValueError where there is none, or one without end."""
    row = database.execute("SELECT result_json FROM campaign WHERE id = ?", (campaign,)).fetchone()
    if row is None or not isinstance(row[0], bytes):
        raise ValueError("a campaign without its result")
    packed = zlib.decompressobj()
    try:
        data = packed.decompress(row[0], MOST_TEXT)
    except zlib.error as error:
        raise ValueError(f"a result that cannot be unpacked: {error}") from None
    if not packed.eof:
        raise ValueError("a result that breaks off, or does not end")
    return data.decode()


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
        f"SELECT count(*) FROM (SELECT t_ns FROM image WHERE campaign IN ({marks(len(chosen))}) "
        "GROUP BY t_ns HAVING count(DISTINCT campaign) > 1)"
    )
    return int(database.execute(asked, [entry.id for entry in chosen]).fetchone()[0])
