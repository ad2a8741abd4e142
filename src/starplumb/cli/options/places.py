"""Where a command may write: never over a file that it reads, and never over one that starplumb has not written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

Given = Path | str | None | Iterable["Given"]
"""Files that a command reads, as its arguments have them; a name that is no file (``model``) counts for nothing."""


def require_place(
    folder: Path, names: Iterable[str], read: Iterable[Given], mark: tuple[str, str] | None = None
) -> None:
    """Raise InputError, before long work, where ``names`` cannot be written into ``folder``.

    None of them may be a file that is ``read``; with a ``mark``, its name and kind, all must be of an earlier such set.
    """
    from ...disk.owned import require_replaceable

    require_replaceable(folder, names, list(paths(read)), mark)


def paths(given: Iterable[Given]) -> Iterator[Path]:
    """The files among arguments."""
    for value in given:
        if isinstance(value, str | Path):
            yield Path(value)
        elif value is not None:
            yield from paths(value)
