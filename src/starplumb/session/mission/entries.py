"""The campaigns of an archive as they are shown, found and told apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...io.archive.records import Event
from ...io.archive.rows import Entry, Instrument
from ...physics.errors import ArgumentError, InputError, did_you_mean
from ...physics.timescales import format_iso

SHORT = 12
"""Characters of an id that are shown."""
LEAST = 4
"""Characters of an id by which a user may name a campaign."""


def day(t_ns: int) -> str:
    """A time to the second in which it lies."""
    return format_iso([t_ns], "UTC")[0][:19]


def state(entry: Entry) -> str:
    """The status of a campaign, or why it was withdrawn."""
    return entry.status if entry.withdrawn is None else f"withdrawn: {entry.withdrawn[1]}"


def entry_document(entry: Entry) -> dict[str, Any]:
    """One campaign, as ``list --json`` prints it."""
    first, last = format_iso([entry.first_ns, entry.last_ns], "UTC")
    at = entry.withdrawn
    return {
        "schema": "starplumb-archive-entry/1",
        "id": entry.id,
        "name": entry.name,
        "satellite": entry.instrument.satellite,
        "from": entry.instrument.frame_from,
        "to": entry.instrument.frame_to,
        "first": first,
        "last": last,
        "added": entry.added_utc,
        "status": entry.status,
        "method": entry.method,
        "software": entry.software,
        "images": entry.images,
        "observations": entry.observations,
        "counts": why_not(entry) is None,
        "why_not": why_not(entry),
        "withdrawn": None if at is None else {"time": at[0], "reason": at[1]},
    }


def why_not(entry: Entry) -> str | None:
    """Why a campaign is not in the joint solution; None for one that is."""
    if entry.withdrawn is not None:
        return f"withdrawn: {entry.withdrawn[1]}"
    if not entry.stands:
        return f"its answer must not be used ({entry.status})"
    return None if entry.summable else "no normal equations were written with its result"


def instrument_of(
    name: str,
    firsts: Sequence[Instrument],
    all_: Sequence[Instrument],
    satellite: str | None,
    camera: str | None,
) -> Instrument:
    """The one instrument that fits what is asked for: without a camera that of a campaign, of several cameras their
    first.  Raises InputError where it is not one."""
    if not firsts:
        raise InputError(
            f"{name}: found no campaign, wanted one or more; starplumb archive add {name} WHAT adds one"
        )
    among = firsts if camera is None else all_
    chosen = [one for one in among if satellite in (None, one.satellite) and camera in (None, one.frame_from)]
    listed = "; ".join(map(str, all_[:6])) + ("; ..." if len(all_) > 6 else "")
    if len(chosen) != 1:
        several = len({one.satellite for one in chosen}) > 1
        by_camera = len(chosen) > 1 if camera is None else satellite is None
        wrong = "camera" if by_camera and not several else "satellite"
        asked = satellite if wrong == "satellite" else camera
        said = "found several mountings" if chosen else f"found {asked!r}"
        hint = did_you_mean(asked, [one.satellite for one in all_]) if asked and not chosen else ""
        raise ArgumentError(wrong, f"{said} in {name}, wanted one of: {listed}{hint}")
    return chosen[0]


def satellite_of(name: str, firsts: Sequence[Instrument], own: str, satellite: str | None) -> str:
    """The satellite that is meant: the one that is asked for, or the only one that the archive has campaigns of or is
    itself of.  Raises InputError where it knows several or others; one without campaigns and name takes any."""
    names = list(dict.fromkeys([*([own] if own else []), *(one.satellite for one in firsts)]))
    if satellite in names or not names:
        return satellite or ""
    if satellite is None and len(names) == 1:
        return names[0]
    said = "found several satellites" if satellite is None else f"found {satellite!r}"
    hint = did_you_mean(satellite, names) if satellite else ""
    listed = ", ".join(map(repr, names[:6])) + (", ..." if len(names) > 6 else "")
    raise ArgumentError("satellite", f"{said} in {name}, wanted one of: {listed}{hint}")


def event_of(found: Sequence[Event], what: str) -> Event | None:
    """An event by the first characters of its id; None for what is none."""
    hits = [event for event in found if len(what) >= LEAST and event.id.startswith(what)]
    return hits[0] if len(hits) == 1 else None


def require_counts(found: Sequence[Event], noted: Event) -> None:
    """Raise ArgumentError where an event that was noted was taken back before: it is the same one still."""
    reason = next(event.withdrawn for event in found if event.id == noted.id)
    if reason is not None:
        raise ArgumentError(
            "note",
            f"found this event withdrawn ({reason}); what is withdrawn stays so, wanted another note with the same "
            "time and kind",
        )


def require_stands(id_: str, reason: str | None) -> None:
    """Raise ArgumentError where what is to be withdrawn is so already."""
    if reason is not None:
        raise ArgumentError("campaign", f"found {id_[:SHORT]} withdrawn already ({reason}), wanted another")


def one_of(found: Sequence[Entry], campaign: str) -> Entry:
    """A campaign by the first characters of its id, or by its name.  Raises ArgumentError where it is not one."""
    hits = [e for e in found if e.name == campaign or (len(campaign) >= LEAST and e.id.startswith(campaign))]
    if len(hits) != 1:
        said = "no such campaign" if not hits else f"{len(hits)} campaigns"
        raise ArgumentError(
            "campaign",
            f"found {said} under {campaign!r}, wanted the first characters of one id, as list shows them",
        )
    return hits[0]
