"""Finished chunks of a study on disk: each is written whole or not at all, and those of another study are refused."""

from __future__ import annotations

import hashlib
import json
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..disk.publish import publish
from ..disk.staging import cannot_write, staged
from ..physics.errors import InputError
from .monte_carlo import Arrays, Study

MANIFEST = "study.json"
DIGEST = "digest"
"""The array of a chunk's file that says whose it is and that the others are what they were."""
_SPOILT = (
    *(OSError, EOFError, LookupError, ValueError, TypeError, SyntaxError),
    *(NotImplementedError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error),
)
"""What reading a file that is no chunk ends in."""


@dataclass(frozen=True)
class Store:
    """Chunks of one study in a folder of their own."""

    folder: Path
    study: Study

    @classmethod
    def open(cls, folder: Path, study: Study) -> Store:
        """Start or resume.  Raises InputError where the folder holds chunks of another study, or cannot be written."""
        manifest = folder / MANIFEST
        if not manifest.exists():
            publish(folder, {MANIFEST: json.dumps(study.fingerprint, indent=1)})
            return cls(folder, study)
        try:
            found = json.loads(manifest.read_text("utf-8")) if manifest.is_file() else None
        except OSError as error:
            raise cannot_write(folder, error) from None
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise InputError(
                f"{manifest}: found it damaged, wanted that of a study; remove {folder} or choose another one"
            )
        _require_same(found, study, folder)
        return cls(folder, study)

    def path(self, c: int) -> Path:
        return self.folder / f"{c:08d}.npz"

    def missing(self) -> list[int]:
        """Chunks that are missing, spoilt, or have another number of trials."""
        return [c for c in range(self.study.chunks) if not self._has(c)]

    def spoilt(self, chunks: list[int]) -> list[Path]:
        """The files of those chunks that hold none of this study, or no longer what was written."""
        return [self.path(c) for c in chunks if self.path(c).exists() and self._read(c) is None]

    def _has(self, c: int) -> bool:
        arrays = self._read(c)
        return arrays is not None and int(arrays["trials"]) == self.study.count(c)

    def _read(self, c: int) -> Arrays | None:
        """The arrays of chunk c; None where its file is missing or spoilt."""
        try:
            if not self.path(c).is_file():  # a pipe would keep us waiting
                return None
            with self.path(c).open("rb") as file:
                stored = np.load(file, allow_pickle=False)
                arrays = {name: stored[name] for name in stored.files}
            whole = str(arrays.pop(DIGEST)) == self._digest(c, arrays)
        except _SPOILT:
            return None
        return arrays if whole else None

    def _digest(self, c: int, arrays: Arrays) -> str:
        """SHA-256 of what a chunk depends on, its number and its arrays."""
        found = hashlib.sha256(json.dumps([self.study.fingerprint, c], sort_keys=True).encode())
        for name, values in sorted(arrays.items()):
            found.update(f"{name} {values.dtype.str} {values.shape}".encode())
            found.update(np.ascontiguousarray(values).tobytes())
        return found.hexdigest()

    def save(self, c: int, arrays: Arrays) -> None:
        """Write chunk c beside its place, then rename it.  Raises InputError where it cannot be written."""
        keywords: dict[str, Any] = {**arrays, DIGEST: np.array(self._digest(c, arrays))}
        with staged(self.folder, place=self.path(c)) as staging:
            with staging.path(self.path(c).name).open("xb") as file:
                np.savez(file, **keywords)
            staging.commit([self.path(c).name])

    def load(self) -> Iterator[Arrays]:
        """All chunks in their order, one at a time.  Raises InputError where one is gone since it was written."""
        for c in range(self.study.chunks):
            if (arrays := self._read(c)) is None:
                raise InputError(
                    f"{self.path(c)}: found it changed since it was written, wanted the chunk; run the command again"
                )
            yield arrays


def _require_same(found: dict[str, Any], study: Study, folder: Path) -> None:
    for key, wanted in study.fingerprint.items():
        if found.get(key) != wanted:
            raise InputError(
                f"{folder}: found chunks of another study ({key} = {_short(found.get(key))}), "
                f"wanted {key} = {_short(wanted)}; remove the folder or choose another one"
            )


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 80 else text[:77] + "..."
