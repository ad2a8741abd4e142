"""Whether a database has the tables of an archive and nothing else, and how much work a question to it may be.

A view in the place of a table, or a trigger, is a program that whoever wrote the file would have us run.
"""

from __future__ import annotations

import sqlite3
from functools import cache

from ...physics.errors import InputError
from ..text.files import show
from .schema import APPLICATION_ID, EDITION, statements

Part = tuple[str, str, str, str | None]
"""Kind, name, table and SQL of what a database is made of."""
_PARTS = "SELECT type, name, tbl_name, sql FROM sqlite_master"
BETWEEN = 1_000_000
"""Steps of SQLite's machine between two looks at how many there were."""
STEPS, STEPS_A_BYTE = 300_000_000, 100
"""Steps that all questions of a command may take: the trend of 500 campaigns takes a hundredth of them."""


def require_archive(database: sqlite3.Connection, name: object) -> None:
    """Raise InputError for a database of another program or edition, and for other tables than those of an archive."""
    kind = database.execute("PRAGMA application_id").fetchone()[0]
    if kind != APPLICATION_ID:
        raise InputError(f"{name}: found a database of another program, wanted an archive")
    edition = database.execute("PRAGMA user_version").fetchone()[0]
    if edition != EDITION:
        raise InputError(
            f"{name}: found an archive of edition {edition}, wanted {EDITION}; another starplumb wrote it"
        )
    _require_own_parts(set(database.execute(_PARTS)), name)


def _require_own_parts(found: set[Part], name: object) -> None:
    needed, allowed = _own_parts()
    names = {part[1] for part in needed}
    for kind, one, _, _ in sorted(found - allowed, key=str):
        other = "another" if one in names else "an" if kind == "index" else "a"
        raise InputError(
            f"{name}: found {other} {show(kind)[1:-1]} {show(one)}, which no archive has, wanted the tables of an "
            "archive and nothing else; somebody has changed it"
        )
    for kind, one, _, _ in sorted(needed - found, key=str):
        raise InputError(
            f"{name}: found no {kind} {one}, wanted all tables of an archive; somebody has changed it"
        )


@cache
def _own_parts() -> tuple[frozenset[Part], frozenset[Part]]:
    """What an archive is made of, and the same with what SQLite's ANALYZE adds."""
    database = sqlite3.connect(":memory:")
    try:
        database.executescript(statements())
        needed = frozenset(database.execute(_PARTS))
        database.execute("ANALYZE")
        return needed, frozenset(database.execute(_PARTS))
    finally:
        database.close()


def limit(database: sqlite3.Connection, *of: str) -> None:
    """End what would go on without end in databases ``of`` these names: SQLite then says that it was interrupted."""
    size = sum(_value(database, f"{name}.page_count") * _value(database, f"{name}.page_size") for name in of)
    most, done = STEPS + STEPS_A_BYTE * size, 0

    def look() -> bool:
        nonlocal done
        done += BETWEEN
        return done > most

    database.set_progress_handler(look, BETWEEN)


def _value(database: sqlite3.Connection, name: str) -> int:
    return int(database.execute(f"PRAGMA {name}").fetchone()[0])
