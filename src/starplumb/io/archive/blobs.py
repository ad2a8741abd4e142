"""The files that campaigns were made from, kept beside an archive: compressed, each once, by its digest."""

from __future__ import annotations

import gzip
from collections.abc import Iterable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from ...disk.staging import staged

MOST_BYTES = 1_000_000_000
"""Of one kept file."""


def folder_of(archive: Path) -> Path:
    """The folder beside an archive that keeps its files."""
    return archive.with_name(f"{archive.name}.files")


def place_of(archive: Path, digest: str) -> Path:
    """Where a file of this digest (``sha256:...``) is kept."""
    name = digest.removeprefix("sha256:")
    return folder_of(archive) / name[:2] / f"{name}.gz"


def keep(archive: Path, digest: str, path: Path) -> bool:
    """Keep the file at a path if its bytes have this digest; whether it is kept now."""
    place = place_of(archive, digest)
    if place.is_file():
        return True
    try:
        data = path.read_bytes()
    except OSError:
        return False
    if f"sha256:{sha256(data).hexdigest()}" != digest:
        return False
    _write(place, gzip.compress(data, compresslevel=6, mtime=0))
    return True


def all_kept(archive: Path) -> list[str]:
    """The digests of all files that are kept."""
    return sorted(f"sha256:{place.stem}" for place in folder_of(archive).glob("??/*.gz"))


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
    here, there = place_of(source, digest), place_of(target, digest)
    if not there.is_file() and here.is_file():
        _write(there, here.read_bytes())
    return there.is_file()


def _write(place: Path, data: bytes) -> None:
    with staged(place.parent) as staging:
        staging.write(place.name, [data])
        staging.commit([place.name])


def kept(archive: Path, digest: str) -> bytes | None:
    """The bytes of a kept file; None where it is missing or they are no longer what they were."""
    try:
        with gzip.open(place_of(archive, digest)) as file:
            data = file.read(MOST_BYTES)
    except (OSError, EOFError, ValueError):
        return None
    return data if f"sha256:{sha256(data).hexdigest()}" == digest else None
