"""The files that campaigns were made from, kept beside an archive: compressed, each once, by its digest."""

from __future__ import annotations

import gzip
import os
import re
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from ...disk.staging import staged
from ..text.files import fingerprint, trouble

MOST_BYTES = 1_000_000_000
"""Of one kept file."""
LEVEL = 6
"""Of packing."""
PIECE = 1 << 20
"""Bytes that are unpacked at a time."""


def folder_of(archive: Path) -> Path:
    """The folder beside an archive that keeps its files: beside the file itself, by whatever link it is named."""
    place = archive.resolve()
    return place.with_name(f"{place.name}.files")


def is_digest(text: str) -> bool:
    """Whether a text is a digest as :func:`starplumb.io.text.files.fingerprint` writes them: it names a file."""
    return re.fullmatch("sha256:[0-9a-f]{64}", text) is not None


def place_of(archive: Path, digest: str) -> Path:
    """Where a file of this digest (``sha256:...``) is kept.  Raises ValueError for what is none."""
    if not is_digest(digest):
        raise ValueError(f"a digest that is none: {digest}")
    name = digest.removeprefix("sha256:")
    return folder_of(archive) / name[:2] / f"{name}.gz"


def keep(archive: Path, digest: str, path: Path) -> bool:
    """Keep the file at a path if its bytes have this digest; whether it is kept now."""
    place = place_of(archive, digest)
    if place.is_file():
        return True
    if trouble(path) is not None or path.stat().st_size > MOST_BYTES:
        return False
    try:
        if fingerprint(path) != digest:
            return False
        with path.open("rb") as file:
            _write(place, _packed(iter(lambda: file.read(PIECE), b"")))
    except OSError:
        return False
    return True


def all_kept(archive: Path) -> list[str]:
    """The digests of all files that are kept."""
    found = (f"sha256:{place.stem}" for place in folder_of(archive).glob("??/*.gz"))
    return sorted(filter(is_digest, found))


def drop(archive: Path, digests: Iterable[str]) -> None:
    """Keep files no longer, and folders that hold no other."""
    with suppress(OSError):
        for place in [place_of(archive, digest) for digest in digests]:
            place.unlink(missing_ok=True)
            for folder in (place.parent, place.parent.parent):
                with suppress(OSError):
                    folder.rmdir()


def copy(source: Path, target: Path, digest: str) -> bool:
    """Have another archive keep a file that one keeps; whether it is kept there now."""
    there = place_of(target, digest)
    if not there.is_file() and is_kept(source, digest):
        _write(there, _packed(pieces(source, digest)))
    return there.is_file()


def _packed(pieces: Iterable[bytes]) -> Iterator[bytes]:
    member = zlib.compressobj(LEVEL, wbits=31)
    yield from map(member.compress, pieces)
    yield member.flush()


def _write(place: Path, data: Iterable[bytes]) -> None:
    with staged(place.parent) as staging:
        staging.write(place.name, data)
        staging.commit([place.name])


def is_there(archive: Path, digest: str) -> bool:
    """Whether something stands where a file would be kept."""
    return is_digest(digest) and os.path.lexists(place_of(archive, digest))


def is_kept(archive: Path, digest: str) -> bool:
    """Whether a file is kept, and its bytes are what they were."""
    found = sha256()
    if (
        not is_digest(digest) or trouble(place_of(archive, digest)) is not None
    ):  # a pipe would keep us waiting
        return False
    try:
        for piece in pieces(archive, digest):
            found.update(piece)
    except (OSError, EOFError, ValueError, zlib.error):
        return False
    return f"sha256:{found.hexdigest()}" == digest


def pieces(archive: Path, digest: str) -> Iterator[bytes]:
    """The bytes of a kept file, some at a time.  Raises ValueError beyond the size that is allowed."""
    size = 0
    with gzip.open(place_of(archive, digest)) as file:
        while piece := file.read(PIECE):
            size += len(piece)
            if size > MOST_BYTES:
                raise ValueError(f"more than {MOST_BYTES:,} bytes")
            yield piece
