"""Finished chunks of a study on disk: each is written whole or not at all, and those of another study are refused."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

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
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if manifest.exists():
                _require_same(json.loads(manifest.read_text("utf-8")), study, folder)
            else:
                _write(manifest, json.dumps(study.fingerprint, indent=1).encode())
        except json.JSONDecodeError:
            raise InputError(
                f"{manifest}: found it damaged, wanted that of a study; remove {folder} or choose another one"
            ) from None
        except OSError as error:
            raise InputError(
                f"{folder}: found no way to write there ({error.strerror}), wanted a folder that can be written"
            ) from None
        return cls(folder, study)

    def path(self, c: int) -> Path:
        return self.folder / f"{c:08d}.npz"

    def missing(self) -> list[int]:
        """Chunks that are missing, damaged, or have another number of trials."""
        return [c for c in range(self.study.chunks) if not self._has(c)]

    def _has(self, c: int) -> bool:
        try:
            with self.path(c).open("rb") as file:
                stored = np.load(file, allow_pickle=False)
                # reading all of it checks its check sums
                return int({name: stored[name] for name in stored.files}["trials"]) == self.study.count(c)
        except (OSError, KeyError, ValueError, zipfile.BadZipFile):
            return False

    def save(self, c: int, arrays: Arrays) -> None:
        """Write chunk c beside its place, then rename it."""
        beside = self.path(c).with_suffix(f".{os.getpid()}.part")
        with beside.open("wb") as file:
            keywords: dict[str, Any] = dict(arrays)
            np.savez(file, **keywords)
        beside.replace(self.path(c))

    def load(self) -> Iterator[Arrays]:
        """All chunks in their order, one at a time."""
        for c in range(self.study.chunks):
            with np.load(self.path(c), allow_pickle=False) as stored:
                yield {name: stored[name] for name in stored.files}


def _write(path: Path, content: bytes) -> None:
    beside = path.with_suffix(f".{os.getpid()}.part")
    beside.write_bytes(content)
    beside.replace(path)


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
