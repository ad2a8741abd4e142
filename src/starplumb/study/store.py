"""Finished chunks of a study on disk: each is written whole or not at all, and those of another study are refused."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..disk.arrays import read_arrays, write_arrays
from ..disk.parts import read_json
from ..disk.publish import publish
from ..physics.errors import InputError
from .monte_carlo import Arrays, Study

MANIFEST = "study.json"


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
        found = read_json(manifest)
        if not isinstance(found, dict):
            raise InputError(
                f"{manifest}: found it damaged, wanted that of a study; remove {folder} or choose another one"
            )
        _require_same(found, study, folder)
        return cls(folder, study)

    def remove_empty(self, with_parent: bool) -> None:
        """Take the folder away, and the one it is in if it holds nothing else, where no chunk was ever finished."""
        if any(self.folder.glob("*.npz")):
            return
        with suppress(OSError):
            (self.folder / MANIFEST).unlink(missing_ok=True)
            self.folder.rmdir()
            if with_parent:
                self.folder.parent.rmdir()

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
        return read_arrays(self.path(c), self._about(c))

    def _about(self, c: int) -> str:
        """What a chunk depends on, and its number."""
        return json.dumps([self.study.fingerprint, c], sort_keys=True)

    def save(self, c: int, arrays: Arrays) -> None:
        """Write chunk c beside its place, then rename it.  Raises InputError where it cannot be written."""
        write_arrays(self.path(c), arrays, self._about(c))

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
