"""The archive of a mission in a session: what :func:`starplumb.open_archive` returns."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from ...io.archive import blobs, records, store, unite
from ...io.archive.conflicts import known
from ...io.archive.insertion import insert
from ...io.archive.rows import Entry, Instrument, all_instruments, entries, instruments
from ...io.tables.cells import PRINTABLE
from ...physics.errors import ArgumentError, counted
from ...physics.timescales import format_iso
from ...report.page import Table
from ..arguments import Positive, Wanted, checked
from ..show import Shown
from .entries import (
    SHORT,
    day,
    entry_document,
    event_of,
    instrument_of,
    one_of,
    require_counts,
    require_stands,
    satellite_of,
    state,
)
from .known import from_the_last_on, mounting_at, time_of
from .known import known as known_of

if TYPE_CHECKING:
    from ...documents.prediction import Prediction
    from ..result import Result
    from .adding import Coming

Words = Annotated[
    str, Wanted(PRINTABLE, str.isprintable), Wanted("some words", lambda value: bool(value.strip()))
]
Satellite = Annotated[str, Wanted("the name of a satellite", lambda value: value.isprintable())]


def utc_now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")


@dataclass(frozen=True, repr=False, eq=False)
class Archive(Shown):
    """The archive of a mission at ``path``: its campaigns, their joint solution, events and what was issued."""

    made_by: ClassVar[str] = "open_archive"

    path: Path

    @checked
    def add(
        self,
        what: Result | str | Path | Sequence[str | Path],
        satellite: Satellite | None = None,
        unnamed: Satellite | None = None,
    ) -> dict[str, Any]:
        """Add results (a Result, the path of a ``result.json`` or of its folder) or campaigns (the path of a
        ``campaign.toml``, which is then calibrated by default), all or none.

        The same inputs with the same options are one entry, however often they are added.  The files of a campaign are
        kept beside the archive where they still are what the result was made from.  ``satellite`` is theirs, by
        default the one that a campaign states, else that of the archive, else ``unnamed``.  Raises InputError where
        sightings would count twice, or a landmark stood elsewhere before.
        """
        from ..result import Result
        from .adding import coming

        each = [what] if isinstance(what, Result | str | Path) else list(what)
        with store.opened(self.path) as database:
            default = self._default(database)
        if unnamed is not None and not default:
            default = unnamed
        found = [coming(one, satellite, default) for one in each]
        digests = {digest for one in found for digest in one.row.inputs.values()}
        absent = [digest for digest in digests if not blobs.place_of(self.path, digest).is_file()]
        with store.opened(self.path) as database:
            try:
                kept = [self._keep(one) for one in found]
                with store.transaction(database):
                    new = [self._insert(database, one) for one in found]
                of = dict(database.execute("SELECT id, satellite FROM campaign"))
            except BaseException:
                blobs.drop(self.path, unite.unnamed(database, absent))
                raise
        return {
            "schema": "starplumb-archive-add/1",
            "archive": str(self.path),
            "campaigns": [
                {
                    "id": c.row.id,
                    "name": c.row.name,
                    "satellite": of[c.row.id],
                    "status": c.row.status,
                    "new": fresh,
                    "kept": all_there,
                }
                for c, fresh, all_there in zip(found, new, kept, strict=True)
            ],
            "notices": [notice for one in found for notice in one.notices],
        }

    @staticmethod
    def _insert(database: sqlite3.Connection, one: Coming) -> bool:
        if known(database, one.row):
            return False
        insert(database, one.row, utc_now())
        return True

    def _keep(self, one: Coming) -> bool:
        """Whether all files of a campaign are kept now."""
        kept = [
            any(blobs.keep(self.path, digest, folder / name) for folder in one.folders)
            for name, digest in one.row.inputs.items()
        ]
        return all(kept)

    @property
    def entries(self) -> Sequence[Entry]:
        """All campaigns, withdrawn ones too, in the order of time."""
        with store.opened(self.path) as database:
            return tuple(entries(database))

    @property
    def listed(self) -> list[dict[str, Any]]:
        """All campaigns, as ``starplumb archive list --json`` prints them."""
        return [entry_document(entry) for entry in self.entries]

    @checked
    def show(self, satellite: str | None = None, camera: str | None = None) -> Any:
        """The joint solution of all campaigns that stand, of one satellite and camera where the archive has several.

        Raises InputError where there is none.
        """
        from .joint import shown

        with self._reading(satellite, camera) as (database, instrument):
            return shown(str(self.path), database, instrument)

    @checked
    def trend(
        self,
        satellite: str | None = None,
        camera: str | None = None,
        at: str | None = None,
        horizon_days: Positive = 30.0,
    ) -> Any:
        """The mounting against time: each campaign, what changes it, what will be, and what to do, seen from the time
        ``at`` (UTC, not before the last campaign; left out: of that) over ``horizon_days``."""
        from .trend import TrendFound
        from .trend_document import trend_document

        with self._reading(satellite, camera) as (database, instrument):
            found = known_of(str(self.path), database, instrument)
        return TrendFound(trend_document(found, from_the_last_on(found, "at", at), horizon_days))

    @checked
    def event(
        self, time: str, kind: Words, note: str = "", satellite: Satellite | None = None
    ) -> dict[str, Any]:
        """Note what happened to a satellite at a time (UTC): a safe mode, a manoeuvre, another star tracker.

        ``satellite`` can be left out where the archive has one.  Raises InputError for one that it does not know.
        """
        t_ns = time_of("time", time)
        if kind.startswith(records.WITHDRAWS):
            raise ArgumentError(
                "kind", f"found {kind!r}, wanted what happened; archive withdraw takes an event back"
            )
        with store.opened(self.path) as database, store.transaction(database):
            known_ones = instruments(database)
            name = satellite_of(str(self.path), known_ones, self._default(database), satellite)
            found = records.add_event(database, name, t_ns, kind, note, utc_now())
            require_counts(records.noted(database, name), found)
        return {
            "schema": "starplumb-archive-event/1",
            "archive": str(self.path),
            "id": found.id,
            "satellite": name,
            "time": format_iso([t_ns], "UTC")[0],
            "kind": kind,
            "note": note,
        }

    @checked
    def issue(
        self,
        reason: Words,
        start: str | None = None,
        end: str | None = None,
        satellite: str | None = None,
        camera: str | None = None,
    ) -> dict[str, Any]:
        """Issue what the trend foretells, valid from ``start`` (UTC; left out: the last campaign) to ``end`` (left out:
        until further notice); it stands in for what was issued before, which stays in the archive."""
        from .issued import issue_document, model_of
        from .kernel import frame_of

        with self._reading(satellite, camera) as (database, instrument):
            found = known_of(str(self.path), database, instrument)
            first = from_the_last_on(found, "start", start)
            last = None if end is None else time_of("end", end)
            if last is not None and last <= first:
                raise ArgumentError("end", f"found {end}, which is not after the start, wanted a later time")
            model = model_of(found.trend, first)
            with store.transaction(database):
                done = records.issue(database, instrument, (first, last), model, reason, utc_now())
            rigs = [entry.cameras for entry in entries(database, instrument)]
        return issue_document(str(self.path), done, frame_of(instrument.frame_from, rigs))

    @checked
    def withdraw(self, campaign: str, reason: Words) -> dict[str, Any]:
        """Withdraw a campaign, by the first characters of its id or by its name, or an event, by those of its id: it
        stays, and counts no more."""
        with store.opened(self.path) as database, store.transaction(database):
            event = event_of(records.all_events(database), campaign)
            if event is not None:
                require_stands(event.id, event.withdrawn)
                records.withdraw_event(database, event, reason, utc_now())
                return self._withdrawn(event.id, event.kind, reason)
            entry = one_of(entries(database), campaign)
            require_stands(entry.id, entry.withdrawn and entry.withdrawn[1])
            records.withdraw(database, entry.id, reason, utc_now())
        return self._withdrawn(entry.id, entry.name, reason)

    def _withdrawn(self, id_: str, name: str, reason: str) -> dict[str, Any]:
        return {
            "schema": "starplumb-archive-withdraw/1",
            "archive": str(self.path),
            "id": id_,
            "name": name,
            "reason": reason,
        }

    @checked
    def merge(self, other: str | Path) -> dict[str, Any]:
        """Add what another archive has and this one has not, all or nothing; the other stays as it is."""
        counts = unite.merge(self.path, Path(other))
        tables = {"campaigns": "campaign", "events": "event", "issued": "validity", "withdrawn": "withdrawn"}
        return {
            "schema": "starplumb-archive-merge/1",
            "archive": str(self.path),
            "merged": str(other),
            **{name: counts[table] for name, table in tables.items()},
        }

    @checked
    def rerun(self, campaign: str | None = None) -> dict[str, Any]:
        """Calibrate every campaign that is not withdrawn again, from its kept files with its own options, and say what
        changes; or one, by the first characters of its id or by its name."""
        from .rerun import rerun_document

        chosen = self.entries if campaign is None else (one_of(self.entries, campaign),)
        return rerun_document(self.path, tuple(entry for entry in chosen if entry.withdrawn is None))

    def verify(self) -> dict[str, Any]:
        """What is wrong with the archive: its rows against each other, against the digests that were written with them
        and against their results, and its kept files; which campaigns could not be run again for want of their files,
        and which files are kept for none."""
        from .verification import verify_document

        return verify_document(self.path)

    @contextmanager
    def _reading(
        self, satellite: str | None, camera: str | None
    ) -> Iterator[tuple[sqlite3.Connection, Instrument]]:
        """The database, and the one instrument that is meant."""
        with store.opened(self.path) as database:
            known = instruments(database), all_instruments(database)
            yield database, instrument_of(str(self.path), *known, satellite, camera)

    @staticmethod
    def _default(database: sqlite3.Connection) -> str:
        row = database.execute("SELECT value FROM meta WHERE key = 'satellite'").fetchone()
        return "" if row is None else str(row[0])

    @property
    def tables(self) -> Sequence[Table]:
        rows = [
            (
                e.id[:SHORT],
                e.name,
                e.instrument.satellite,
                day(e.first_ns),
                state(e),
                str(e.images),
                e.method,
            )
            for e in self.entries
        ]
        head = ("id", "campaign", "satellite", "first image (UTC)", "status", "images", "method")
        return (Table(str(self.path), head, rows, text_columns=5),)

    @property
    def sentences(self) -> Sequence[str]:
        found = self.entries
        stand = sum(entry.stands for entry in found)
        return (f"{counted(len(found), 'campaign')}, {stand} in use",)


def mounting_of(
    path: Path, t_ns: int, satellite: str | None, camera: str | None
) -> tuple[Prediction, Instrument]:
    """The mounting of an archive at an epoch: what was issued for it, else what the trend says."""
    found = Archive(path)
    with found._reading(satellite, camera) as (database, instrument):
        return mounting_at(known_of(str(path), database, instrument), t_ns), instrument


@checked
def open_archive(path: str | Path, create: bool = False, satellite: Satellite = "") -> Archive:
    """The archive of a mission in the file at ``path``; with ``create`` it is made if it is not there.

    ``satellite`` names the satellite of campaigns that are added without another, in an archive that is made.  Raises
    InputError where the file is none, or lies on a drive of a network.
    """
    where = Path(path)
    if create and not where.exists():
        store.create(where, satellite)
    with store.opened(where):
        return Archive(where)
