"""Results on disk: the files of one set, all or none."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from ..physics.errors import InputError
from .owned import Mark, require_not_read, require_replaceable
from .parts import remove, stale
from .staging import Staging, staged

Content = str | Iterable[str] | Callable[[Path], None]
"""A text, its pieces, or what a library writes to the path that it is given."""


def publish(
    folder: Path,
    files: Mapping[str, Content],
    instead_of: Sequence[str] = (),
    *,
    mark: Mark | None = None,
    inputs: Sequence[Path] = (),
    also: Sequence[str] = (),
) -> None:
    """Write files into ``folder`` (made if need be), all or none; a large text may come in pieces.

    Every file is written and flushed beside its place first; when all of them lie there they are renamed, ``mark``
    last, which holds the digests of the others.  A folder that is new appears as a whole.  Those of ``instead_of`` that
    an earlier run left and this one does not write are removed: they no longer hold; those of ``also`` stay in the set.
    Raises InputError where the folder cannot be written to, where a file there is one of ``inputs``, and, with a
    ``mark``, where one is not of an earlier such set; then nothing of the new content is left behind.
    """
    names = [*files, *([] if mark is None else [mark.name])]
    of_mark = None if mark is None else (mark.name, mark.kind)
    require_replaceable(folder, names, inputs, of_mark)
    others = _old(folder, {*instead_of, *also} - set(names), inputs, of_mark)
    stay = {name: fingerprint(folder / name) for name in others if name in also and (folder / name).is_file()}
    with staged(folder, keep=None if mark is None else mark.name) as staging:
        for name, content in files.items():
            _put(staging, name, content)
        if mark is not None:
            written = {name: fingerprint(staging.path(name)) for name in files}
            _put(staging, mark.name, mark.text(written | stay))
        staging.commit(names, [name for name in others if name not in stay])
    for part in stale(folder):
        remove(part)


def publish_beside(folder: Path, files: Mapping[str, str], inputs: Sequence[Path] = ()) -> None:
    """:func:`publish` into a folder that may hold a user's own files: none of them is replaced.

    A file that already holds the very text counts as written.  Raises InputError about one that holds another.
    """
    for name, text in files.items():
        place = folder / name
        require_not_read(place, inputs)
        try:
            other = place.exists() and not _holds(place, b"".join(encoded([text])))
        except OSError:
            other = True
        if other:
            raise InputError(
                f"{place}: found a file that holds something else, wanted a folder without it; give another folder, or "
                "move the file away"
            )
    publish(folder, files)


def _holds(place: Path, data: bytes) -> bool:
    return place.is_file() and place.stat().st_size == len(data) and place.read_bytes() == data


def write_text(path: Path, text: str) -> None:
    """Write one text file; as ``publish``."""
    publish(path.parent, {path.name: text})


def encoded(pieces: Iterable[str]) -> Iterator[bytes]:
    """Pieces of text as UTF-8; a byte of a file's name that is no UTF-8 is written as JSON has it, ``\\udcff``."""
    for piece in pieces:
        yield piece.encode("utf-8", "backslashreplace")


def fingerprint(path: Path) -> str:
    """``sha256:`` and the digest of a file's bytes."""
    with path.open("rb") as file:
        return "sha256:" + hashlib.file_digest(file, "sha256").hexdigest()


def unlike(folder: Path, files: Mapping[str, str] | None, names: Sequence[str]) -> list[str]:
    """Those of ``names`` that a mark names in its ``files`` and that ``folder`` has not, or with another content."""
    told = {} if files is None else files
    return [
        name
        for name in names
        if name in told and not ((folder / name).is_file() and fingerprint(folder / name) == told[name])
    ]


def _put(staging: Staging, name: str, content: Content) -> None:
    if callable(content):
        content(staging.path(name))
    else:
        staging.write(name, encoded([content] if isinstance(content, str) else content))


def _old(folder: Path, names: set[str], inputs: Sequence[Path], mark: tuple[str, str] | None) -> list[str]:
    """Those of ``names`` in ``folder`` that may be removed: others are the user's own and stay."""
    found: list[str] = []
    for name in sorted(names):
        try:
            found += require_replaceable(folder, [name], inputs, mark)
        except InputError:
            continue
    return found
