"""Files of one set: written beside their place, flushed, and renamed into it, the one that marks the set last."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ..physics.errors import InputError
from .interruption import uninterrupted
from .parts import half_placed, new_part, note_order, remove, stale

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@dataclass(frozen=True)
class Staging:
    """A set on its way to ``folder``: its files lie in ``part`` until they are all there.

    ``new`` is the first folder on the way that does not exist yet, None where ``folder`` does: it appears as a whole.
    """

    folder: Path
    part: Path
    new: Path | None

    def path(self, name: str) -> Path:
        """Where to write the file that will have this name."""
        return self.part / name if self.new is None else self.part / self.folder.relative_to(self.new) / name

    def write(self, name: str, content: Iterable[bytes]) -> None:
        """Write one file, some bytes at a time."""
        with self.path(name).open("xb") as file:
            file.writelines(content)

    def commit(self, names: Sequence[str], without: Iterable[str] = ()) -> None:
        """Give every file its place, in this order, and take away those of ``without``, before the last of them."""
        for name in names:
            flush(self.path(name))
        if self.new is not None and self._appear():
            return
        for name in names:
            if (self.folder / name).is_dir():
                raise IsADirectoryError(None, "a folder of that name is in the way", str(self.folder / name))
        with uninterrupted():
            if len(names) > 1:
                note_order(self.part, names)
            for name in names[:-1]:
                self.path(name).replace(self.folder / name)
            for name in without:
                (self.folder / name).unlink(missing_ok=True)
            if len(names) > 1 or without:
                flush(self.folder)  # the last one marks that the others are there
            for name in names[-1:]:
                self.path(name).replace(self.folder / name)
        flush(self.folder)

    def _appear(self) -> bool:
        """Rename the whole folder into its place; False where another process has made one meanwhile."""
        assert self.new is not None
        for folder, _, _ in os.walk(self.part):
            flush(Path(folder))
        try:
            self.part.rename(self.new)
        except OSError as error:
            if error.errno not in (errno.EEXIST, errno.ENOTEMPTY):
                raise
            self.folder.mkdir(parents=True, exist_ok=True)
            return False
        flush(self.new.parent)
        return True


def completed(folder: Path) -> bool:
    """Put in place what a killed process had begun to rename into a folder; whether there was such a set."""
    found = half_placed(folder)
    if found is None:
        return False
    part, names = found
    try:
        with uninterrupted():
            for name in names:
                if (part / name).exists():
                    (part / name).replace(folder / name)
        flush(folder)
    except OSError as error:
        raise cannot_write(folder, error) from None
    remove(part)
    return True


@contextmanager
def staged(folder: Path, keep: str | None = None, place: Path | None = None) -> Iterator[Staging]:
    """A set to be written to ``folder``, which is made if need be; what is not committed leaves nothing behind.

    What processes that are gone left unfinished there is removed, but for files named ``keep``.  Raises InputError, one
    sentence about ``place`` (by default the folder), where the disk refuses: that of any OSError of the block.
    """
    part: Path | None = None
    try:
        new = _first_missing(folder)
        at = folder if new is None else new.parent
        for left in stale(at):
            remove(left, keep)
        part = new_part(at)
        staging = Staging(folder, part, new)
        staging.path("").mkdir(parents=True, exist_ok=True)
        yield staging
    except OSError as error:
        raise cannot_write(folder if place is None else place, error) from None
    finally:
        if part is not None:
            remove(part)


def cannot_write(place: Path, error: OSError) -> InputError:
    """The sentence about a disk that refuses."""
    wanted = "more room there" if error.errno in NO_ROOM else "a place that can be written"
    reason = error.strerror or " ".join(str(error).split())
    return InputError(f"{place}: found no way to write there ({reason}), wanted {wanted}")


def require_room(path: Path, size: int) -> None:
    """Raise OSError where there is no room for a file of so many bytes; for libraries that do not say why they fail."""
    with path.open("xb") as file:
        take_room(file.fileno(), size)
    path.unlink()


def take_room(descriptor: int, size: int) -> None:
    """Make a file so many bytes long.  Raises OSError where there is no room for them, as far as the system can."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
    else:
        os.truncate(descriptor, size)


def flush(path: Path) -> None:
    """Have a file or folder on the disk itself, where a power cut leaves it, as far as the system can."""
    if path.is_dir() and os.name != "posix":
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def _first_missing(folder: Path) -> Path | None:
    """The first folder on the way to ``folder`` that does not exist; None where it does."""
    missing = None
    for place in (folder, *folder.parents):
        if place.is_dir():
            return missing
        if place.exists() or place.is_symlink():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(place))
        missing = place
    return missing
