"""Archives united, and looked into: rows are known by their content, so that union is safe."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from pathlib import Path

from ...physics.errors import InputError
from . import blobs
from .rows import Entry, entries, inputs_of
from .schema import NAMES
from .store import opened, transaction


def merge(target: Path, source: Path) -> dict[str, int]:
    """Add to an archive what another has and it has not; how many rows of each kind were new.

    All or nothing.  Raises InputError where a landmark stands at two places, or sightings would count twice.
    """
    if source.exists() and target.exists() and source.samefile(target):
        raise InputError(f"{source}: found the archive itself, wanted another to take campaigns from")
    with opened(source):  # a log that is left there is read in
        pass
    with opened(target) as database:
        database.execute("ATTACH DATABASE ? AS other", (str(source),))
        with transaction(database):
            new = {
                row[0]
                for row in database.execute(
                    "SELECT id FROM other.campaign WHERE id NOT IN (SELECT id FROM main.campaign)"
                )
            }
            counts = {table: _added(database, table) for table in NAMES}
            _require_consistent(database, source, new)
        missing = [digest for one in sorted(new) for digest in inputs_of(database, one).values()]
    for digest in missing:
        blobs.copy(source, target, digest)
    return counts


def _added(database: sqlite3.Connection, table: str) -> int:
    """Rows of a table that were new; what a campaign that was there already has is not taken again."""
    before = database.total_changes
    order = " ORDER BY rowid"
    database.execute(f"INSERT OR IGNORE INTO main.{table} SELECT * FROM other.{table}{order}")
    return database.total_changes - before


def _require_consistent(database: sqlite3.Connection, source: Path, new: set[str]) -> None:
    stands = {entry.id: entry for entry in entries(database) if entry.stands}
    twice = database.execute(
        "SELECT a.campaign, b.campaign, a.image_id FROM image a JOIN image b ON a.t_ns = b.t_ns "
        "AND a.sightings = b.sightings AND a.campaign < b.campaign"
    )
    for a, b, image in twice:
        if {a, b} & new and a in stands and b in stands and _one_mounting(stands[a], stands[b]):
            raise InputError(
                f"{source}: found the sightings of image {image} in {a[:12]} and {b[:12]}; they would count twice, "
                "wanted one of the two withdrawn first"
            )
    other = database.execute(
        "SELECT a.name, a.campaign, b.campaign FROM unknown a JOIN unknown b ON a.name = b.name "
        "AND a.campaign < b.campaign AND (a.reference <> b.reference OR a.covariance <> b.covariance) "
        "WHERE a.name LIKE 'landmark[%'"
    )
    for name, a, b in other:
        if {a, b} & new and a in stands and b in stands:
            same = stands[a].instrument.satellite == stands[b].instrument.satellite
            if same and not _one_place(database, name, a, b):
                raise InputError(
                    f"{source}: found {name} at another place, or of another survey, in {a[:12]} than in {b[:12]}; "
                    "wanted one landmark under one id"
                )


def _one_mounting(a: Entry, b: Entry) -> bool:
    """Whether two campaigns may have sightings of one camera: they are of one, or one of them has several."""
    alike = (
        a.instrument.satellite == b.instrument.satellite and a.instrument.frame_to == b.instrument.frame_to
    )
    return a.instrument == b.instrument or (alike and len(a.cameras) + len(b.cameras) > 2)


def _one_place(database: sqlite3.Connection, name: str, a: str, b: str) -> bool:
    import numpy as np

    from .conflicts import SAME_PLACE_M

    (r_a, P_a), (r_b, P_b) = (
        map(
            np.frombuffer,
            database.execute(
                "SELECT reference, covariance FROM unknown WHERE name = ? AND campaign = ?", (name, one)
            ).fetchone(),
        )
        for one in (a, b)
    )
    return bool(np.max(np.abs(r_a - r_b)) <= SAME_PLACE_M and np.allclose(P_a, P_b, rtol=1e-6, atol=1e-9))


def faults(path: Path) -> Iterator[str]:
    """What is wrong with an archive, a sentence each."""
    with opened(path) as database:
        for (text,) in database.execute("PRAGMA integrity_check"):
            if text != "ok":
                yield f"the database is damaged: {text}"
        for table, row, parent, _ in database.execute("PRAGMA foreign_key_check"):
            yield f"the table {table}, row {row}: what it refers to in {parent} is missing"
        half = database.execute(
            "SELECT c.id, c.name FROM campaign c WHERE NOT EXISTS(SELECT 1 FROM input i WHERE i.campaign = c.id)"
        )
        for id_, name in half:
            yield f"campaign {id_[:12]} ({name}) has no inputs"
        yield from _changed(database)


def _changed(database: sqlite3.Connection) -> Iterator[str]:
    """Campaigns whose rows do not add up to what they are known by."""
    from .records import digest

    for entry in entries(database):
        inputs = sorted(inputs_of(database, entry.id).values())
        if digest(inputs) != entry.inputs_id or digest(inputs, entry.options) != entry.id:
            yield f"campaign {entry.id[:12]} ({entry.name}) is not what its id says: its rows were changed"


def unnamed(database: sqlite3.Connection, digests: Iterable[str]) -> list[str]:
    """Those of digests that no campaign names as an input."""
    asked = "SELECT 1 FROM input WHERE sha256 = ?"
    return [digest for digest in digests if database.execute(asked, (digest,)).fetchone() is None]


def left_over(path: Path) -> list[str]:
    """Kept files that no campaign names, as an addition leaves them that was killed: the same addition uses them."""
    with opened(path) as database:
        return unnamed(database, blobs.all_kept(path))


def unkept(path: Path) -> dict[str, list[str]]:
    """Inputs that are not kept beside an archive, or no longer as they were, by campaign."""
    found = {}
    with opened(path) as database:
        for entry in entries(database):
            lost = [n for n, d in inputs_of(database, entry.id).items() if not blobs.is_kept(path, d)]
            if lost:
                found[entry.id] = lost
    return found
