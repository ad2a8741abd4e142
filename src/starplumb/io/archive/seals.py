"""Digests over the rows of an archive, written with them: a row that was changed since is told.

They stand in the table ``meta`` under keys ``seal TABLE ID``, one for each campaign with all that belongs to it, each
withdrawal, event and issued mounting.  They tell what was changed by mistake, or without a thought of them; whoever
means to deceive writes them anew.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator
from hashlib import sha256
from typing import Any

OF_CAMPAIGN = {
    "campaign": "id",
    "input": "campaign",
    "image": "campaign",
    "unknown": "campaign",
    "normal": "campaign",
}
"""Tables with rows of a campaign, and the column that says of which."""
SEALED = {
    "meta": {"meta": "key"},
    "campaign": OF_CAMPAIGN,
    "withdrawn": {"withdrawn": "campaign"},
    "event": {"event": "id"},
    "validity": {"validity": "id"},
}
"""Tables by whose rows a seal is called, and those that it is about."""
PREFIX = "seal "


def seal_of(table: str, id_: str) -> str:
    """The key in ``meta`` of the digests of a row."""
    return f"{PREFIX}{table} {id_}"


def seal(database: sqlite3.Connection, table: str, id_: str) -> None:
    """Write the digests of rows that were just added; those that were there keep theirs."""
    text = json.dumps(_digests(database, table, id_))
    database.execute("INSERT OR IGNORE INTO meta VALUES(?, ?)", (seal_of(table, id_), text))


def changed(database: sqlite3.Connection, table: str, id_: str) -> list[str] | None:
    """Tables in which the rows of a seal are not what they were; None where there is no seal."""
    asked = "SELECT value FROM meta WHERE key = ?"
    row = database.execute(asked, (seal_of(table, id_),)).fetchone()
    if row is None:
        return None
    written, now = _written(row[0]), _digests(database, table, id_)
    return [name for name in now if written.get(name) != now[name]]


def _written(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def sealed(database: sqlite3.Connection) -> Iterator[tuple[str, str]]:
    """Table and id of every seal."""
    for (key,) in database.execute("SELECT key FROM meta WHERE key GLOB ?", (f"{PREFIX}*",)).fetchall():
        table, _, id_ = key.removeprefix(PREFIX).partition(" ")
        yield table, id_


def _digests(database: sqlite3.Connection, table: str, id_: str) -> dict[str, str]:
    return {
        name: _digest(database.execute(f"SELECT * FROM {name} WHERE {column} = ? ORDER BY rowid", (id_,)))
        for name, column in SEALED[table].items()
    }


def _digest(rows: Iterable[tuple[Any, ...]]) -> str:
    """SHA-256 of cells, each behind its kind and length."""
    found = sha256()
    for row in rows:
        for cell in row:
            data = cell if isinstance(cell, bytes) else repr(cell).encode()
            found.update(f"{type(cell).__name__} {len(data)} ".encode() + data)
        found.update(b"\n")
    return found.hexdigest()
