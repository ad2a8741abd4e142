"""Results on disk: every file is written beside its place and renamed into it, so none is ever half there."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError

Column = Sequence[object] | NDArray[Any]
_ROWS = 1 << 12
_WORDS = {"NaN": "nan", "Infinity": "inf", "-Infinity": "-inf"}


def publish_beside(folder: Path, files: Mapping[str, str]) -> None:
    """:func:`publish` into a folder that may hold a user's own files: none of them is replaced.

    A file that already holds the very text counts as written.  Raises InputError about one that holds another.
    """
    for name, text in files.items():
        place = folder / name
        try:
            other = place.exists() and place.read_bytes() != text.encode("utf-8")
        except OSError:
            other = True
        if other:
            raise InputError(
                f"{place}: found a file that holds something else, wanted a folder without it; give another --out, or "
                "move the file away"
            )
    publish(folder, files)


def publish(folder: Path, files: Mapping[str, str | Iterable[str]], instead_of: Sequence[str] = ()) -> None:
    """Write text files into ``folder`` (made if need be), all or none; a large text may come in pieces.

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
                file.writelines([text] if isinstance(text, str) else text)
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


def csv_text(header: Sequence[str], columns: Sequence[Column]) -> str:
    """A CSV table from its columns, as ``csv_pieces`` makes it."""
    return "".join(csv_pieces(header, columns))


def csv_pieces(header: Sequence[str], columns: Sequence[Column]) -> Iterator[str]:
    """A CSV table from its columns, some rows at a time: a million rows as one text would take much memory.

    Floats have the fewest digits that read back to the same bits; masked entries of an array are left empty.
    Raises ValueError where columns differ in length.
    """
    n = len(columns[0]) if columns else 0
    for name, column in zip(header, columns, strict=True):
        if len(column) != n:
            raise ValueError(f"the column {name} has {len(column)} rows, wanted {n} as in the first")
    return _pieces(header, columns, n)


def _pieces(header: Sequence[str], columns: Sequence[Column], n: int) -> Iterator[str]:
    yield ",".join(header) + "\n"
    for start in range(0, n, _ROWS):
        cells = [_cells(column[start : start + _ROWS]) for column in columns]
        yield "\n".join(map(",".join, zip(*cells, strict=True))) + "\n"


def _cells(values: Column) -> list[str]:
    """The cells of a column, or some of them, as text."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return _decimals(values)
    cells = [value if isinstance(value, str) else _word(value) for value in values]
    return list(map(_quoted, cells)) if _special("".join(cells)) else cells


def _decimals(values: NDArray[np.float64]) -> list[str]:
    """Floats as text, by the serialiser that pydantic brings: ten times quicker than ``repr``."""
    from pydantic_core import to_json

    if not values.size:
        return []
    cells = to_json(np.asarray(values).tolist()).decode()[1:-1].split(",")
    if not np.isfinite(values).all():
        cells = [_WORDS.get(cell, cell) for cell in cells]
    if isinstance(values, np.ma.MaskedArray):
        for row in np.flatnonzero(np.ma.getmaskarray(values)).tolist():
            cells[row] = ""
    return cells


def _word(value: object) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)


def _special(text: str) -> bool:
    return any(mark in text for mark in ',"\r\n')


def _quoted(cell: str) -> str:
    return '"' + cell.replace('"', '""') + '"' if _special(cell) else cell
