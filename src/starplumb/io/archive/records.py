"""Events, validity intervals and withdrawals: the rows of an archive beside its campaigns."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

from . import cells
from .rows import Instrument
from .seals import seal


@dataclass(frozen=True)
class Event:
    """Something that happened to a satellite: its ``kind`` in a word or two, and a note; ``withdrawn`` is why it was
    taken back, None for one that counts."""

    id: str
    satellite: str
    t_ns: int
    kind: str
    note: str
    withdrawn: str | None = None


@dataclass(frozen=True)
class Validity:
    """A mounting that was issued, valid from a time to another (None: until further notice), as a ``model`` and the
    reason; ``supersedes`` is the id of the one that it stands in for."""

    id: str
    instrument: Instrument
    from_ns: int
    to_ns: int | None
    model: Mapping[str, Any]
    issued_utc: str
    supersedes: str | None
    reason: str


def digest(*parts: object) -> str:
    """The digest by which a row is known, the same for the same content."""
    return sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def add_event(
    database: sqlite3.Connection, satellite: str, t_ns: int, kind: str, note: str, now: str
) -> Event:
    """Add an event; the same twice is one."""
    event = Event(digest(satellite, t_ns, kind, note), satellite, t_ns, kind, note)
    database.execute("INSERT OR IGNORE INTO satellite VALUES(?)", (satellite,))
    database.execute(
        "INSERT OR IGNORE INTO event VALUES(?, ?, ?, ?, ?, ?)", (event.id, satellite, t_ns, kind, note, now)
    )
    seal(database, "event", event.id)
    return event


WITHDRAWS = "withdraws "
"""How the kind of an event begins that takes back another one, whose id follows; its note is the reason."""


def withdraw_event(database: sqlite3.Connection, event: Event, reason: str, now: str) -> None:
    """Take back an event: both stay, neither counts."""
    add_event(database, event.satellite, event.t_ns, f"{WITHDRAWS}{event.id}", reason, now)


def all_events(database: sqlite3.Connection) -> list[Event]:
    """Those of all satellites, also those that were taken back."""
    names = database.execute("SELECT DISTINCT satellite FROM event ORDER BY 1").fetchall()
    return [event for (name,) in names for event in noted(database, name)]


def events(database: sqlite3.Connection, satellite: str) -> list[Event]:
    """Those of a satellite in the order of time, without those that were taken back."""
    return [event for event in noted(database, satellite) if event.withdrawn is None]


def noted(database: sqlite3.Connection, satellite: str) -> list[Event]:
    """Those of a satellite in the order of time, also those that were taken back."""
    rows = database.execute(
        "SELECT id, satellite, t_ns, kind, note FROM event WHERE satellite = ? ORDER BY t_ns, id",
        (satellite,),
    )
    found = [Event(id_, of, cells.epoch(t_ns), kind, note) for id_, of, t_ns, kind, note in rows]
    gone = {e.kind.removeprefix(WITHDRAWS): e.note for e in found if e.kind.startswith(WITHDRAWS)}
    return [replace(e, withdrawn=gone.get(e.id)) for e in found if not e.kind.startswith(WITHDRAWS)]


def withdraw(database: sqlite3.Connection, campaign: str, reason: str, now: str) -> None:
    """Withdraw a campaign; the first reason stays."""
    database.execute("INSERT OR IGNORE INTO withdrawn VALUES(?, ?, ?)", (campaign, now, reason))
    seal(database, "withdrawn", campaign)


def issue(
    database: sqlite3.Connection,
    instrument: Instrument,
    span: tuple[int, int | None],
    model: Mapping[str, Any],
    reason: str,
    now: str,
) -> Validity:
    """Add a validity interval, which stands in for the one that was issued last."""
    before = issued(database, instrument)
    supersedes = before[-1].id if before else None
    text = json.dumps(model, sort_keys=True)
    key = digest(instrument.key, span, text, supersedes, reason)
    database.execute(
        "INSERT OR IGNORE INTO validity VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (key, *instrument.key, *span, text, now, supersedes, reason),
    )
    seal(database, "validity", key)
    return Validity(key, instrument, *span, model, now, supersedes, reason)


def issued(database: sqlite3.Connection, instrument: Instrument) -> list[Validity]:
    """What was issued of an instrument, the last at the end."""
    rows = database.execute(
        "SELECT id, from_ns, to_ns, model_json, issued_utc, supersedes, reason FROM validity "
        "WHERE satellite = ? AND frame_from = ? AND frame_to = ? ORDER BY issued_utc, rowid",
        instrument.key,
    )
    return [
        Validity(id_, instrument, cells.epoch(first), _end(last), cells.model(model), at, before, reason)
        for id_, first, last, model, at, before, reason in rows
    ]


def _end(t_ns: int | None) -> int | None:
    return None if t_ns is None else cells.epoch(t_ns)
