"""Many campaigns at once: each is calibrated by itself, none stops the rest, and what is done is not done again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

from ... import __version__
from ...disk.publish import unlike
from ...documents.result import ResultDocument
from ...io.text.files import fingerprint, read_text
from ...physics.errors import AlignmentFailed, InputError, StarplumbError
from ...study.run import Processes, Scheduler, choose
from ..calibration import NotIdentified, calibrate
from ..campaign import read_campaign
from .adding import options_of

UNUSABLE = "unusable input"
"""Status of a campaign that could not be calibrated at all."""

NOT_WRITTEN = "not written"
"""Status of a campaign whose result could not be written where it belongs."""


@dataclass(frozen=True)
class Asked:
    """What is asked of every campaign."""

    method: str = "default"
    estimate: tuple[str, ...] = ()
    start: str = "closed-form"
    reach_deg: float = 2.0
    prior: Path | None = None
    drift: str = "none"
    outside: Any = "refuse"
    report: bool = False

    @property
    def plain(self) -> bool:
        """Whether a result says all of it, so that one that is there can be told to be what is asked for."""
        beyond = (self.estimate, self.start, self.prior, self.drift, self.outside)
        return beyond == ((), "closed-form", None, "none", "refuse")


@dataclass(frozen=True)
class Fleet:
    """Campaigns by the paths of their ``campaign.toml``, and the folders of their results."""

    campaigns: tuple[Path, ...]
    places: tuple[Path, ...]
    asked: Asked

    def run(self, c: int, told: Callable[[int], None] = lambda campaigns: None) -> Any:
        """Calibrate one of them and write its result; what came of it, whatever that is.

        ``told`` would hear of parts of it, as of a study's chunk; a campaign has none.
        """
        path, place = self.campaigns[c], self.places[c]
        if (there := _there(path, place, self.asked)) is not None:
            return _outcome(path, place, there.status, there.message, resumed=True)
        found, failed = _guarded(path, partial(self._calibrated, path), UNUSABLE)
        if failed is not None:
            return failed
        save, status, message = found
        _, failed = _guarded(path, partial(save, place), NOT_WRITTEN)
        return _outcome(path, place, status, message) if failed is None else failed

    def _calibrated(self, path: Path) -> tuple[Callable[[Path], Any], str, str]:
        """How the answer of a campaign is saved, its status and its message."""
        asked = self.asked
        try:
            result = calibrate(
                read_campaign(path, asked.outside),
                asked.estimate,
                asked.method,
                asked.reach_deg,
                asked.prior,
                asked.start,
                asked.drift,
            )
        except NotIdentified as refused:
            return refused.save, "not_converged", str(refused)
        return partial(result.save, report=asked.report), result.status, result.message


def _guarded(path: Path, work: Callable[[], Any], failure: str) -> tuple[Any, dict[str, Any] | None]:
    """What some work gives, or what came of its campaign where it fails: no campaign stops another, whatever it is."""
    try:
        return work(), None
    except StarplumbError as error:
        return None, _outcome(path, None, failure, str(error))
    except Exception as error:
        return None, _outcome(path, None, failure, f"{path}: {type(error).__name__}: {error}")


def _outcome(
    path: Path, place: Path | None, status: str, message: str, *, resumed: bool = False
) -> dict[str, Any]:
    where = None if place is None else str(place)
    return {
        "campaign": str(path),
        "status": status,
        "message": message,
        "result": where,
        "resumed": resumed,
        "archived": None,
    }


def _there(path: Path, place: Path, asked: Asked) -> ResultDocument | None:
    """A result that is there already, of the same files, method and software; None where it must be made."""
    file = place / "result.json"
    if not asked.plain or not file.is_file():
        return None
    try:
        found = ResultDocument.from_json(read_text(file), str(file))
        same = all(
            fingerprint(path if name == path.name else path.parent / name) == digest
            for name, digest in found.inputs.items()
        )
    except (InputError, OSError):
        return None
    wanted = {"method": asked.method, "estimate": [], "drift": "none"}
    ours = found.software.get("starplumb") == __version__
    whole = not unlike(place, found.files, list(found.files or ()))
    return found if same and whole and ours and found.inputs and options_of(found) == wanted else None


def places_of(campaigns: Sequence[Path], out: Path | None) -> tuple[Path, ...]:
    """Where the results go: ``result`` beside each campaign, or a folder of its own in ``out``."""
    if out is None:
        return tuple(path.parent / "result" for path in campaigns)
    return tuple(out / name for name in names_of(campaigns))


def names_of(campaigns: Sequence[Path]) -> list[str]:
    """Names of campaigns by their folders, or files; the same name again has a number."""
    names: list[str] = []
    for path in campaigns:
        name = path.absolute().parent.name if path.name == "campaign.toml" else path.stem
        again = sum(other == name or other.startswith(f"{name}-") for other in names)
        names.append(f"{name}-{again + 1}" if again else name)
    return names


def outcomes(fleet: Fleet, jobs: int | None, address: str | None) -> Iterator[dict[str, Any]]:
    """What came of each campaign, as they are done."""
    left = list(range(len(fleet.campaigns)))
    try:
        for c, found in _results(fleet, choose(jobs, address, len(left)), left):
            left.remove(c)
            yield found
    except InputError as error:
        if address is not None or jobs == 1:
            raise
        # a campaign may have killed its worker again and again: find out which, one by one
        for c in list(left):
            try:
                yield from (found for _, found in _results(fleet, Processes(1), [c]))
            except InputError:
                yield _outcome(fleet.campaigns[c], None, UNUSABLE, f"{fleet.campaigns[c]}: {error}")


def _results(
    fleet: Fleet, scheduler: Scheduler, which: Sequence[int]
) -> Iterator[tuple[int, dict[str, Any]]]:
    """By the same schedulers that run studies, a campaign in place of a chunk."""
    yield from cast(
        "Iterator[tuple[int, dict[str, Any]]]", scheduler.results(cast("Any", fleet), list(which))
    )


def flown(
    campaigns: Sequence[Path],
    asked: Asked,
    out: Path | None,
    jobs: int | None,
    address: str | None,
    archive: Path | None,
    watched: Callable[[Iterator[dict[str, Any]]], Any] = lambda items: items,
) -> dict[str, Any]:
    """Calibrate campaigns, add their results to an archive, and say what came of each and how the satellites are.

    Raises InputError where a campaign is named twice, or the archive is none.
    """
    from .archive import open_archive
    from .fleet_document import fleet_document

    resolved = [path.resolve() for path in campaigns]
    twice = next((path for i, path in enumerate(resolved) if path in resolved[:i]), None)
    if twice is not None:
        raise InputError(f"{twice}: found twice among the campaigns, wanted each once")
    store = None if archive is None else open_archive(archive, create=True)
    fleet = Fleet(tuple(campaigns), places_of(campaigns, out), asked)
    names = dict(zip(map(str, campaigns), names_of(campaigns), strict=True))
    found = []
    for one in watched(outcomes(fleet, jobs, address)):
        if store is not None and one["result"] is not None:
            one = one | _archived(store, one, names[one["campaign"]])
        found.append(one)
    order = {str(path): i for i, path in enumerate(campaigns)}
    found.sort(key=lambda one: order[one["campaign"]])
    return fleet_document(found, store)


def _archived(store: Any, one: dict[str, Any], name: str) -> dict[str, Any]:
    """Add a result to the archive; what is wrong with that is no fault of the calibration, but is said."""
    try:
        done = store.add(one["result"], unnamed=name)
    except InputError as error:
        return {"archived": False, "message": "; ".join(filter(None, (str(error), one["message"])))}
    return {"archived": True, "id": done["campaigns"][0]["id"]}


def complaint(document: dict[str, Any]) -> AlignmentFailed | None:
    """The list of campaigns that have no usable answer, or could not be archived; None where all have."""
    failed = [one for one in document["campaigns"] if one["failed"]]
    if not failed:
        return None
    listed = "; ".join(f"{one['campaign']} ({one['status']}: {one['message'][:120]})" for one in failed)
    return AlignmentFailed(
        f"{len(failed)} of {len(document['campaigns'])} campaigns have no answer that can be used: {listed}"
    )
