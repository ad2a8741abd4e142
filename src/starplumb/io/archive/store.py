"""The database of an archive: opened, checked to be one, and written in transactions that are whole or nothing.

SQLite with a write-ahead log and full synchronisation: two writers wait for one another, and what a killed one had not
committed never was.  The log is shared through memory, which drives of a network do not offer.
"""

from __future__ import annotations

import os
import sqlite3
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep
from typing import TypeVar

from ...disk.staging import cannot_write, flush, staged
from ...physics.errors import EpochError, InputError
from ..text.files import show, trouble
from .form import limit, require_archive
from .schema import statements
from .seals import seal

WAIT_S, PAUSE_S = 60.0, 0.02
"""How long a writer waits for another, and between two tries."""
Made = TypeVar("Made")
NETWORK = frozenset(
    (
        *(
            "nfs",
            "nfs4",
            "cifs",
            "smb2",
            "smb3",
            "smbfs",
            "afs",
            "ceph",
            "glusterfs",
            "lustre",
            "beegfs",
            "gpfs",
        ),
        *("ncpfs", "davfs", "fuse.sshfs", "fuse.glusterfs", "fuse.rclone", "fuse.s3fs", "fuse.gcsfuse"),
    )
)
"""Kinds of file systems that are elsewhere."""
_MAGIC = b"SQLite format 3\0"
MOUNTS = Path("/proc/self/mountinfo")


def create(path: Path, satellite: str) -> None:
    """Write an empty archive, whose campaigns are of ``satellite`` unless they say otherwise.

    Raises InputError where there is a file already, or none can be.
    """
    require_local(path)
    there = f"{path}: found a file there, wanted a new name: an archive is never overwritten"
    if path.exists() or path.is_symlink():
        raise InputError(there)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(path, error) from None
    with staged(path.parent, place=path) as staging:
        beside = staging.path(path.name)
        with _connected(f"{beside.absolute().as_uri()}?mode=rwc", path) as database:
            database.executescript(statements())
            database.execute("INSERT INTO meta VALUES('satellite', ?)", (satellite,))
            seal(database, "meta", "satellite")
            database.execute("PRAGMA journal_mode=WAL")  # stays so: two who open it need not agree on that
        flush(beside)
        try:
            os.link(beside, path)
        except FileExistsError:  # another process was quicker
            raise InputError(there) from None
        flush(path.parent)


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """The database of an archive, one that can only be read where it cannot be written.

    Raises InputError, one sentence, where the file is none or cannot be used.
    """
    if (found := trouble(path)) is not None:
        what = found.partition(", wanted")[0]
        hint = f"; starplumb archive init {path} makes one" if what == "found no such file" else ""
        raise InputError(f"{path}: {what}, wanted an archive{hint}")
    require_local(path)
    with _unchanged(path) as alone, _connected(address(path), path) as database, _whole(path):
        patiently(lambda: require_archive(database, path))
        limit(database, "main")
        mode = (
            "wal" if alone else patiently(lambda: database.execute("PRAGMA journal_mode=WAL").fetchone()[0])
        )
        if mode != "wal":
            raise InputError(
                f"{path}: found a drive on which SQLite keeps no write-ahead log ({mode}), wanted a local one"
            )
        yield database


def address(path: Path) -> str:
    """How SQLite is told of an archive: as one that nobody changes where neither it nor files beside it can be
    written, since SQLite then can have no log beside it."""
    return f"{path.absolute().as_uri()}?{'mode=ro&immutable=1' if _read_only(path) else 'mode=rw'}"


def _read_only(path: Path) -> bool:
    """Whether an archive can only be read, and has no log of what another program has added."""
    log = path.resolve().with_name(f"{path.resolve().name}-wal")
    written = all(os.access(one, os.W_OK, effective_ids=_EFFECTIVE) for one in (path, path.resolve().parent))
    return not written and not (log.is_file() and log.stat().st_size)


_EFFECTIVE = os.access in os.supports_effective_ids


@contextmanager
def _unchanged(path: Path) -> Iterator[bool]:
    """Whether an archive can only be read; SQLite then locks nothing.  Raises InputError where it was written
    meanwhile by another program, which may."""
    alone, before = _read_only(path), _written(path)
    yield alone
    if alone and not (_read_only(path) and before == _written(path)):
        raise InputError(
            f"{path}: found it written by another program while it was read, wanted a turn; the same command again"
        )


def _written(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_mtime_ns, found.st_size


@contextmanager
def _whole(path: Path) -> Iterator[None]:
    """Contents that are none of ours, in a sentence: SQLite itself keeps no check sums."""
    try:
        yield
    except EpochError as error:
        raise InputError(f"{path}: {error}") from None
    except (ValueError, LookupError, zlib.error) as error:
        reason = show(" ".join(str(error).split()))
        raise InputError(
            f"{path}: found a damaged archive ({reason}), wanted a whole one; starplumb archive verify looks into it"
        ) from None


@contextmanager
def transaction(database: sqlite3.Connection) -> Iterator[sqlite3.Connection]:
    """What is written within is there as a whole, or not at all."""
    patiently(lambda: database.execute("BEGIN IMMEDIATE"))
    try:
        yield database
        database.execute("COMMIT")
    except BaseException:
        if database.in_transaction:  # a full disk has ended it
            database.execute("ROLLBACK")
        raise


def patiently(does: Callable[[], Made]) -> Made:
    """What a function gives, tried again while another program has the database: SQLite itself waits for no one who
    mends what a killed writer left."""
    until = monotonic() + WAIT_S
    while True:
        try:
            return does()
        except sqlite3.OperationalError as error:
            if not _in_use(error) or monotonic() > until:
                raise
        sleep(PAUSE_S)


def _in_use(error: sqlite3.Error) -> bool:
    return "locked" in str(error) or "busy" in str(error)


@contextmanager
def _connected(where: str, named: Path) -> Iterator[sqlite3.Connection]:
    try:
        database = sqlite3.connect(where, timeout=WAIT_S, isolation_level=None, uri=True)
        try:
            database.execute("PRAGMA trusted_schema=OFF")
            database.execute("PRAGMA synchronous=FULL")
            database.execute("PRAGMA foreign_keys=ON")
            yield database
        finally:
            database.close()
    except sqlite3.Error as error:
        raise InputError(f"{named}: {_sentence(error)}") from None
    except UnicodeDecodeError:  # SQLite's own message about it
        raise InputError(f"{named}: found a damaged archive, wanted a whole one") from None


def _sentence(error: sqlite3.Error) -> str:
    """What SQLite objects to, in words."""
    text = " ".join(str(error).split())
    if "not a database" in text or "malformed" in text:
        return f"found a file that SQLite cannot read ({text}), wanted an archive"
    if _in_use(error):
        return f"found it in use by another program for {WAIT_S:.0f} s, wanted a turn; the same command again"
    if "interrupted" in text:
        return "found a search in it that does not end, wanted the rows of missions; somebody has changed it"
    if "disk I/O" in text:
        return f"found that the disk refuses ({text}), wanted room on a sound one; nothing was added"
    if "full" in text:
        return "found the disk full, wanted room; nothing was added"
    if "readonly" in text or "unable to open" in text:
        return (
            f"found no way to write it or the files beside it ({text}), wanted a folder that can be written"
        )
    return f"found that SQLite cannot go on ({text}), wanted a whole archive; starplumb archive verify looks into it"


def is_archive(path: Path) -> bool:
    """Whether a file is an SQLite database."""
    if not path.is_file():  # a pipe would keep us waiting
        return False
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except (OSError, ValueError):
        return False


def require_local(path: Path) -> None:
    """Raise InputError where a path lies on a drive of a network, as far as the system says so (Linux)."""
    kind = kind_of_drive(path.absolute().parent, _mounts())
    if kind in NETWORK:
        raise InputError(
            f"{path}: found a network drive ({kind}), wanted a local one, where two writers cannot harm the archive; "
            "keep one file per machine and unite them by starplumb archive merge"
        )


def _mounts() -> str:
    try:
        return MOUNTS.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def kind_of_drive(folder: Path, mounts: str) -> str:
    """The file system of a folder by the system's list of mounts; empty where it is not known."""
    place, best, kind = Path(os.path.realpath(folder)), -1, ""
    for line in mounts.splitlines():
        before, _, after = line.partition(" - ")
        fields = before.split()
        if len(fields) > 4 and after:
            point = Path(fields[4].replace("\\040", " "))
            if (place == point or point in place.parents) and len(point.parts) >= best:
                best, kind = len(point.parts), after.split()[0]
    return kind
