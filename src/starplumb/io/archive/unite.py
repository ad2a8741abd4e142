"""Archives united: rows are known by their content, so that union is safe."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Sequence
from pathlib import Path

from ...physics.errors import InputError
from . import blobs
from .form import limit
from .records import WITHDRAWS
from .rows import Entry, entries, inputs_of, marks
from .seals import SEALED, changed, seal_of
from .store import address, opened, transaction

TAKEN = ("campaign", "event", "validity", "withdrawn")
"""Tables whose rows are taken from another archive, in an order in which each refers only to those before it."""


_SEVERAL = (
    "SELECT name FROM unknown WHERE name LIKE 'landmark[%' GROUP BY name "
    "HAVING count(DISTINCT reference) > 1 OR count(DISTINCT covariance) > 1"
)
"""Landmarks that campaigns have with several places or surveys: of the others no two need be compared."""


def merge(target: Path, source: Path) -> dict[str, int]:
    """Add to an archive what another has and it has not; how many rows of each kind were new.

    All or nothing.  Raises InputError where a landmark stands at two places, or sightings would count twice.
    """
    if source.exists() and target.exists() and source.samefile(target):
        raise InputError(f"{source}: found the archive itself, wanted another to take campaigns from")
    with opened(source):  # a log that is left there is read in
        pass
    with opened(target) as database:
        database.execute("ATTACH DATABASE ? AS other", (address(source),))
        limit(database, "main", "other")
        with transaction(database):
            for table in ("satellite", "instrument"):
                database.execute(f"INSERT OR IGNORE INTO main.{table} SELECT * FROM other.{table}")
            taken = {table: _taken(database, source, table) for table in TAKEN}
            _require_consistent(database, source, set(taken["campaign"]))
            named = [digest for one in taken["campaign"] for digest in inputs_of(database, one).values()]
            if wrong := [digest for digest in named if not blobs.is_digest(digest)]:
                raise ValueError(f"a digest that is none: {wrong[0]}")
            back = _taking_back(database, taken["event"])
    for digest in named:
        blobs.copy(source, target, digest)
    counts = {table: len(new) for table, new in taken.items()}
    return counts | {"event": counts["event"] - back, "withdrawn": counts["withdrawn"] + back}


def _taking_back(database: sqlite3.Connection, new: Sequence[str]) -> int:
    """How many of some events take back another one."""
    asked = f"SELECT kind FROM main.event WHERE id IN ({marks(len(new))})"
    return sum(kind.startswith(WITHDRAWS) for (kind,) in database.execute(asked, new))


def _taken(database: sqlite3.Connection, source: Path, table: str) -> list[str]:
    """The ids of rows of a table that were new, added with all that belongs to them and with their digests."""
    column = SEALED[table][table]
    known = f"SELECT {column} FROM main.{table}"
    asked = f"SELECT {column} FROM other.{table} WHERE {column} NOT IN ({known}) ORDER BY rowid"
    new = [id_ for (id_,) in database.execute(asked).fetchall()]
    for id_ in new:
        rows = {**SEALED[table], "meta": "key"}
        for name, of in rows.items():
            key = seal_of(table, id_) if name == "meta" else id_
            database.execute(
                f"INSERT INTO main.{name} SELECT * FROM other.{name} WHERE {of} = ? ORDER BY rowid", (key,)
            )
        if other := changed(database, table, id_):
            raise InputError(
                f"{source}: found rows of {table} {id_[:12]} changed since they were added (in {', '.join(other)}), "
                f"wanted them as they were; starplumb archive verify {source} says more"
            )
    return new


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
        f"WHERE a.name IN ({_SEVERAL})"
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


def unnamed(database: sqlite3.Connection, digests: Iterable[str]) -> list[str]:
    """Those of digests that no campaign names as an input."""
    asked = "SELECT 1 FROM input WHERE sha256 = ?"
    return [digest for digest in digests if database.execute(asked, (digest,)).fetchone() is None]


def left_over(path: Path) -> list[str]:
    """Kept files that no campaign names, as an addition leaves them that was killed: the same addition uses them."""
    with opened(path) as database:
        return unnamed(database, blobs.all_kept(path))
