"""What a command may replace: files that starplumb wrote into that set before, and never one that was read."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..physics.errors import InputError
from .parts import read_json, stale

FILES = "files"
"""The key of a mark under which the other files of its set stand with their digests."""

_OF_GDAL = re.compile(r"/+vsi[a-z0-9_]*(/|$)", re.IGNORECASE)


@dataclass(frozen=True)
class Mark:
    """The document that is renamed last: once it is there its set is whole, and it names the others with their digests.

    ``kind`` is its ``schema``; ``text`` makes it of the digests.
    """

    name: str
    kind: str
    text: Callable[[dict[str, str]], str]


def require_replaceable(
    folder: Path,
    names: Iterable[str],
    inputs: Sequence[Path] = (),
    mark: tuple[str, str] | None = None,
) -> set[str]:
    """Those of ``names`` that are in ``folder``, all of them files that may be replaced.

    None of ``inputs`` may be, by whatever name or link; with a ``mark`` (its name and kind) only what it says its set
    holds.  Raises InputError about the first that may not.
    """
    require_on_disk(folder)
    there = {name for name in names if (folder / name).is_symlink() or (folder / name).exists()}
    for name in sorted(there):
        require_not_read(folder / name, inputs)
    if mark is not None and (foreign := sorted(there - _written(folder, *mark, there))):
        raise InputError(
            f"{folder / foreign[0]}: found a file that is not of an earlier {mark[0]} there, wanted a folder "
            "without it; give another folder, or move the file away"
        )
    return there


def require_on_disk(place: Path) -> None:
    """Raise InputError for a name that GDAL takes for memory, an archive or a server."""
    if _OF_GDAL.match(str(place)):
        raise InputError(f"{place}: found a name of GDAL's own (/vsi...), wanted one of a file on a disk")


def require_not_read(place: Path, inputs: Sequence[Path]) -> None:
    """Raise InputError where ``place`` is one of ``inputs``, by whatever name or link."""
    if any(_same(place, path) for path in inputs):
        raise InputError(f"{place}: found a file that is read here, wanted another place for what is written")


def require_own(place: Path, inputs: Sequence[Path], own: Callable[[Path], bool]) -> None:
    """Raise InputError where something stands at ``place`` that is read, or that is none of our ``own`` kind."""
    require_on_disk(place)
    if not (place.is_symlink() or place.exists()):
        return
    require_not_read(place, inputs)
    if not own(place):
        raise InputError(
            f"{place}: found something there that this command has not written, wanted a new place; "
            "choose another name, or move it away"
        )


def _same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except (OSError, ValueError):
        return False


def _written(folder: Path, name: str, kind: str, there: set[str]) -> set[str]:
    """Those of ``there`` that marks of this kind name: of the set that is there, and of one that a killed process had
    begun to put there.  A mark of the first edition names none, and is trusted for all."""
    found: set[str] = set()
    for document in _marks(folder, name, kind):
        files = document.get(FILES)
        found |= {name, *files} if isinstance(files, dict) else there
    return found


def _marks(folder: Path, name: str, kind: str) -> Iterator[dict[str, Any]]:
    for place in (folder, *stale(folder)):
        document = read_json(place / name)
        if isinstance(document, dict) and _family(document.get("schema")) == _family(kind):
            yield document


def _family(schema: object) -> str:
    """A schema's name without its edition."""
    return str(schema).rpartition("/")[0]
