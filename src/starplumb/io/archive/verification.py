"""An archive looked into: whether its rows refer to each other, are what their ids say, and are as they were added."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from typing import Any

from . import cells, records, rows, seals
from .rows import Instrument

MOST = 100
"""Faults that are told of one kind."""
_IDLE = {
    "satellite": "SELECT name FROM satellite WHERE name NOT IN (SELECT satellite FROM campaign) "
    "AND name NOT IN (SELECT satellite FROM event)",
    "instrument": "SELECT frame_from FROM instrument i WHERE NOT EXISTS(SELECT 1 FROM campaign c WHERE "
    "c.satellite = i.satellite AND c.frame_to = i.frame_to AND (c.frame_from = i.frame_from OR EXISTS("
    "SELECT 1 FROM unknown u WHERE u.campaign = c.id AND u.name = 'mounting[' || i.frame_from || ']')))",
}
"""Rows that nothing needs, named in a column."""
_LACKING = {
    "inputs": "SELECT id, name FROM campaign c WHERE NOT EXISTS(SELECT 1 FROM input i WHERE i.campaign = c.id)",
    "images": "SELECT id, name FROM campaign c WHERE NOT EXISTS(SELECT 1 FROM image i WHERE i.campaign = c.id)",
}


def faults(database: sqlite3.Connection) -> Iterator[str]:
    """What is wrong with the rows of an archive, a sentence each."""
    for (text,) in database.execute(f"PRAGMA integrity_check({MOST})"):
        if text != "ok":
            yield f"the database is damaged: {text}"
    for table, row, parent, _ in database.execute("PRAGMA foreign_key_check").fetchmany(MOST):
        yield f"the table {table}, row {row}: what it refers to in {parent} is missing"
    for table, asked in _IDLE.items():
        for (name,) in database.execute(asked).fetchmany(MOST):
            yield f"the table {table}: {name!r} is of no campaign"
    for what, asked in _LACKING.items():
        for id_, name in database.execute(asked).fetchmany(MOST):
            yield f"{label('campaign', id_, name)} has no {what}"
    for table in ("campaign", "withdrawn", "event", "validity", "meta"):
        yield from _of_table(database, table)
    yield from _stray(database)


def label(table: str, id_: str, name: str = "") -> str:
    """What messages call a row by its id, and by its name where it has one."""
    named = f" ({name})" if name else ""
    return f"{NAMES[table]} {id_[:12]}{named}"


NAMES = {
    "campaign": "campaign",
    "withdrawn": "the withdrawal of campaign",
    "event": "event",
    "validity": "the issued mounting",
    "meta": "what the archive says of itself,",
}
"""What messages call a row of a table."""


def _of_table(database: sqlite3.Connection, table: str) -> Iterator[str]:
    """Rows that are not what their ids or their digests say."""
    key = seals.SEALED[table][table]
    name = {"campaign": "name", "event": "kind"}.get(table, "''")
    where = f" WHERE key NOT GLOB '{seals.PREFIX}*'" if table == "meta" else ""
    for id_, named in database.execute(f"SELECT {key}, {name} FROM {table}{where}").fetchall():
        called = label(table, id_, named)
        if database.execute(f"SELECT * FROM {table} WHERE {key} = ?", (id_,)).fetchone() is None:
            yield f"{called} is not found by its id: an index of its table is damaged"
            continue
        if table in _ID and _ID[table](database, id_) != id_:
            yield f"{called} is not what its id says: its rows were changed"
        changed = seals.changed(database, table, id_)
        if changed is None:
            yield f"{called} has no digest of its rows: an earlier starplumb added it, or it was taken away"
        elif changed:
            yield f"{called} is not as it was added: its rows in {', '.join(changed)} were changed"


def _stray(database: sqlite3.Connection) -> Iterator[str]:
    """Digests of rows that are no longer there."""
    for table, id_ in seals.sealed(database):
        key = seals.SEALED.get(table, {}).get(table)
        if (
            key is None
            or database.execute(f"SELECT 1 FROM {table} WHERE {key} = ?", (id_,)).fetchone() is None
        ):
            yield f"{table} {id_[:12]} was added once and is no longer there"


def _campaign_id(database: sqlite3.Connection, id_: str) -> str | None:
    asked = "SELECT inputs, options_json FROM campaign WHERE id = ?"
    inputs_id, options = database.execute(asked, (id_,)).fetchone()
    inputs = sorted(rows.inputs_of(database, id_).values())
    return records.digest(inputs, _mapping(options)) if records.digest(inputs) == inputs_id else None


def _mapping(text: str) -> Any:
    try:
        return cells.mapping(text)
    except ValueError:
        return None


def _event_id(database: sqlite3.Connection, id_: str) -> str:
    asked = "SELECT satellite, t_ns, kind, note FROM event WHERE id = ?"
    return records.digest(*database.execute(asked, (id_,)).fetchone())


def _validity_id(database: sqlite3.Connection, id_: str) -> str:
    asked = (
        "SELECT satellite, frame_from, frame_to, from_ns, to_ns, model_json, supersedes, reason FROM validity "
        "WHERE id = ?"
    )
    satellite, camera, tracker, first, last, *rest = database.execute(asked, (id_,)).fetchone()
    return records.digest(Instrument(satellite, camera, tracker).key, (first, last), *rest)


_ID = {"campaign": _campaign_id, "event": _event_id, "validity": _validity_id}
"""The id that the content of a row gives."""
