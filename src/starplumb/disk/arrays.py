"""Arrays kept on disk between runs: a file is written whole or not at all, and one that is spoilt is not taken."""

from __future__ import annotations

import hashlib
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .staging import staged

Arrays = Mapping[str, NDArray[Any]]

DIGEST = "digest"
"""The array of a file that says what it depends on and that the others are what they were."""
_SPOILT = (
    *(OSError, EOFError, LookupError, ValueError, TypeError, SyntaxError),
    *(NotImplementedError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error),
)
"""What reading a file that holds no arrays ends in."""


def write_arrays(path: Path, arrays: Arrays, about: str) -> None:
    """Write arrays beside their place, then rename the file; ``about`` is what they depend on.

    Raises InputError where it cannot be written.
    """
    keywords: dict[str, Any] = {**arrays, DIGEST: np.array(_digest(arrays, about))}
    with staged(path.parent, place=path) as staging:
        with staging.path(path.name).open("xb") as file:
            np.savez(file, **keywords)
        staging.commit([path.name])


def read_arrays(path: Path, about: str) -> dict[str, NDArray[Any]] | None:
    """The arrays of a file; None where it is missing or spoilt, or depends on something else."""
    try:
        if not path.is_file():  # a pipe would keep us waiting
            return None
        with zipfile.ZipFile(path) as packed:  # as they are written nothing is packed
            size = sum(part.file_size for part in packed.infolist())
        if size > path.stat().st_size:
            return None
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        whole = str(arrays.pop(DIGEST)) == _digest(arrays, about)
    except _SPOILT:
        return None
    return arrays if whole else None


def _digest(arrays: Arrays, about: str) -> str:
    """SHA-256 of what arrays depend on, and of themselves."""
    found = hashlib.sha256(about.encode())
    for name, values in sorted(arrays.items()):
        found.update(f"{name} {values.dtype.str} {values.shape}".encode())
        found.update(np.ascontiguousarray(values).tobytes())
    return found.hexdigest()
