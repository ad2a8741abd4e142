"""Archives damaged by bytes, by pages and by rows, and the folders of results that are added to them."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from damage import BINARY, ODD_NUMBERS, Rng, damaged
from target import Target

PAGE = 4096
TABLES = ("satellite", "instrument", "campaign", "input", "image", "unknown", "normal", "event", "validity")
ROLLBACK = b"\1\1"
"""The way of writing in the head of a database, in place of the write-ahead log, which none in memory has."""


def page(rng: Rng, data: bytes) -> bytes:
    """A byte of the head of a page, or of where its cells are: kind, counts, offsets; of the first page all of it."""
    changed = bytearray(data)
    start = PAGE * int(rng.integers(max(len(data) // PAGE, 1)))
    at = start + int(rng.integers(100 if start == 0 else 24))
    if at < len(changed):
        changed[at] = rng.integers(256)
    return bytes(changed)


def pages(rng: Rng, data: bytes) -> bytes:
    """Pages that changed places, or one that is empty."""
    parts = [data[at : at + PAGE] for at in range(0, len(data), PAGE)]
    if not parts:
        return data
    i, j = rng.integers(len(parts), size=2)
    if rng.random() < 0.5:
        parts[i], parts[j] = parts[j], parts[i]
    else:
        parts[i] = bytes(len(parts[i]))
    return b"".join(parts)


def cell(rng: Rng, data: bytes) -> bytes:
    """A cell of a row that holds something else, which SQLite itself takes."""
    from missions import without_triggers

    database = sqlite3.connect(":memory:")
    try:
        database.deserialize(data[:18] + ROLLBACK + data[20:])
        database.execute("PRAGMA ignore_check_constraints=ON")
        database.execute("PRAGMA journal_mode=OFF")
        with without_triggers(database):
            _change(rng, database)
        database.commit()
        written = database.serialize()
        return written[:18] + data[18:20] + written[20:]
    except (sqlite3.DatabaseError, OverflowError, UnicodeDecodeError, UnicodeEncodeError):
        return data
    finally:
        database.close()


def _change(rng: Rng, database: sqlite3.Connection) -> None:
    table = TABLES[rng.integers(len(TABLES))]
    rows = database.execute(f"SELECT rowid, * FROM {table}").fetchall()
    if rows:
        row = rows[rng.integers(len(rows))]
        names = [found[1] for found in database.execute(f"PRAGMA table_info({table})")]
        at = int(rng.integers(len(names)))
        value = _other(rng, row[at + 1])
        database.execute(f"UPDATE {table} SET {names[at]} = ? WHERE rowid = ?", (value, row[0]))


def _other(rng: Rng, value: Any) -> Any:
    if rng.random() < 0.05:
        return None
    if isinstance(value, bytes):
        return damaged(rng, value, BINARY)
    if isinstance(value, str) and len(value) > 2:
        return damaged(rng, value.encode(), TEXTS).decode("utf-8", "replace")
    if isinstance(value, str):
        return ODD_NUMBERS[rng.integers(len(ODD_NUMBERS))]
    if isinstance(value, int):
        return int(rng.choice([0, -1, 1, 2**31, -(2**62), 2**63 - 1, -(2**63), value + 1]))
    return float(rng.choice([0.0, -1.0, 1e300, -1e300, 1e-300, np.inf, 1e6]))


def _texts() -> tuple[Any, ...]:
    import damage

    return (
        damage.odd_number,
        damage.other_number,
        damage.no_word,
        damage.other_word,
        damage.cut,
        damage.element,
    )


TEXTS = _texts()


def _read_archive(folder: Path) -> Any:
    import starplumb as sp

    archive = sp.open_archive(folder / "mission.db")
    listed, shown, trend = archive.listed, archive.show().document, archive.trend().document
    said = sp.predict(folder / "mission.db", "2026-06-01T00:00:00").document
    return listed, shown, trend, said, archive.verify()["faults"]


def archives() -> Iterator[Target]:
    """All of them."""
    import starplumb as sp
    from missions import mission

    with TemporaryDirectory() as name:
        folder = Path(name)
        archive = sp.open_archive(folder / "mission.db", create=True, satellite="SAT1")
        for path in mission(np.random.default_rng(3), folder, [0.0, 40.0]):
            result = sp.calibrate(sp.read_campaign(path))
            result.save(path.parent, report=False)
            archive.add(path.parent)
        archive.event("2020-01-21T00:00:00", "safe mode", "a note")
        archive.issue("first")
        data = (folder / "mission.db").read_bytes()
        found = {file: (path.parent / file).read_bytes() for file in ("result.json", "normals.json")}
        # digests would refuse every change of the other file before it is read
        stated = {key: value for key, value in json.loads(found["result.json"]).items() if key != "files"}
        found["result.json"] = json.dumps(stated).encode()

    def read_result(folder: Path) -> Any:
        from starplumb.session.mission.adding import coming

        return replace(coming(str(folder / "result.json"), None, "").row, result_text="")

    for title, kinds in (
        ("archive, bytes", (*BINARY, page, page, page, pages)),
        ("archive, rows", (cell,)),
    ):
        yield Target(title, {"mission.db": data}, ("mission.db",), _read_archive, kinds, ())
    yield Target("result's folder", found, tuple(found), read_result)
