"""Unfinished work on disk: folders whose names say which process on which machine is writing into them.

A process that is killed leaves such a folder behind.  Whoever writes to the same place next removes it: the name tells
that its process is gone.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import zlib
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path
from platform import node
from typing import Any

ORDER = ".order"
"""The file that names what is being renamed."""
MOST_JSON, MOST_VALUES = 100_000_000, 3_000_000
"""Bytes and values of a document of ours."""
_PREFIX = ".starplumb"
_NAME = re.compile(rf"\{_PREFIX}-([0-9a-f]{{8}})-(\d+)-\d+\.part")
_numbers = count()


def new_part(folder: Path) -> Path:
    """A new folder in ``folder`` for what this process has not finished."""
    part = folder / f"{_PREFIX}-{_machine()}-{os.getpid()}-{next(_numbers)}.part"
    part.mkdir()
    return part


def stale(folder: Path) -> Iterator[Path]:
    """Such folders of processes of this machine that are gone."""
    try:
        # a link would have us remove what is elsewhere
        found = [
            Path(entry.path)
            for entry in os.scandir(folder)
            if entry.name.startswith(_PREFIX) and entry.is_dir(follow_symlinks=False)
        ]
    except OSError:
        return
    for part in found:
        named = _NAME.fullmatch(part.name)
        if named and named[1] == _machine() and not _lives(int(named[2])):
            yield part


def note_order(part: Path, names: Sequence[str]) -> None:
    """Note in such a folder which of its files are about to be renamed, in which order."""
    with (part / ORDER).open("w", encoding="utf-8") as file:
        json.dump(list(names), file)
        file.flush()
        os.fsync(file.fileno())


def half_placed(folder: Path) -> tuple[Path, list[str]] | None:
    """The folder and files of a set of which a process that is gone had renamed some, and not the last."""
    for part in stale(folder):
        names = read_json(part / ORDER)
        if not isinstance(names, list) or not all(map(_is_name, names)):
            continue
        left = [os.path.lexists(part / name) for name in names]
        if left and left[-1] and not all(left):
            return part, names
    return None


def _is_name(name: object) -> bool:
    """Whether it is that of a file in the folder itself."""
    return isinstance(name, str) and name not in ("", ".", "..") and Path(name).name == name


def read_json(path: Path) -> Any:
    """What a file that we may have written says; None where there is none, or one that we have not: anything may stand
    in a folder that came from elsewhere, a pipe or a file without end too."""
    try:
        if not path.is_file() or path.stat().st_size > MOST_JSON:
            return None
        data = path.read_bytes()
        return None if sum(map(data.count, (b",", b"[", b"{"))) > MOST_VALUES else json.loads(data)
    except (OSError, ValueError, RecursionError):
        return None


def remove(part: Path, keep: str | None = None) -> None:
    """Remove one with what it holds, as far as that can be done; of one that holds a file ``keep`` all but that."""
    if keep is None or not (part / keep).is_file():
        shutil.rmtree(part, ignore_errors=True)
        return
    for file in part.iterdir():
        if file.name != keep:
            file.unlink(missing_ok=True)


def _machine() -> str:
    """Processes of other machines, which may write to the same disk, cannot be asked whether they live."""
    return f"{zlib.crc32(node().encode()):08x}"


def _lives(pid: int) -> bool:
    if os.name != "posix":  # where asking a process would end it
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
