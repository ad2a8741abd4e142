"""Results on disk: every file is written beside its place and renamed into it, so none is ever half there."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from starplumb.errors import InputError


def publish(folder: Path, files: Mapping[str, str], instead_of: Sequence[str] = ()) -> None:
    """Write text files into ``folder`` (made if need be), all or none.

    Every file is written and flushed under another name first; when all of them lie there they are renamed.
    Those of ``instead_of`` that are not among them are removed: what an earlier run left no longer holds.
    Raises InputError where the folder cannot be written to; then nothing of the new content is left behind.
    """
    staged: list[tuple[Path, Path]] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            place = folder / name
            beside = place.with_name(f".{place.name}.{os.getpid()}.part")
            staged.append((beside, place))
            with beside.open("w", encoding="utf-8", newline="\n") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
        for _, place in staged:
            if place.is_dir():
                raise IsADirectoryError(None, "a folder of that name is in the way", str(place))
        for beside, place in staged:
            beside.replace(place)
        for name in set(instead_of) - set(files):
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder}: found no way to write there ({error.strerror}), wanted a folder that can be written"
        ) from None
    finally:
        for beside, _ in staged:
            beside.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write one text file; as ``publish``."""
    publish(path.parent, {path.name: text})


def json_text(document: Mapping[str, object]) -> str:
    """``document`` as indented JSON. Raises ValueError for NaN and infinities, which JSON has not."""
    return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def csv_text(header: Sequence[str], columns: Sequence[Iterable[object]]) -> str:
    """A CSV table from its columns; floats as ``repr``, which reads back to the same bits.

    Raises ValueError where columns differ in length.
    """
    lines = [",".join(header)]
    lines += [",".join(map(_cell, row)) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


def _cell(value: object) -> str:
    if isinstance(value, float):
        return repr(float(value))
    text = str(value)
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\r\n') else text
