"""The texts of result files: JSON documents and CSV tables."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...disk.owned import FILES, Mark
from ...disk.publish import publish as publish
from ...disk.publish import write_text as write_text

Column = Sequence[object] | NDArray[Any]
_ROWS = 1 << 12
_encoded = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode
_WORDS = {"NaN": "nan", "Infinity": "inf", "-Infinity": "-inf"}


def json_text(document: Mapping[str, object]) -> str:
    """``document`` as indented JSON. Raises ValueError for NaN and infinities, which JSON has not.

    A list of numbers or words stands on one line: so a matrix is read, and Python's compiled encoder writes it.
    """
    return _indented(document, "\n") + "\n"


def _indented(value: Any, line: str) -> str:
    kind, inner = type(value), f"{line} "
    if kind is int or (kind is float and isfinite(value)):
        return repr(value)  # as the encoder has it, which takes its time to be set up
    if kind is str:
        return _encoded(value)
    if isinstance(value, Mapping) and value:
        rows = [f"{_encoded(str(key))}: {_indented(entry, inner)}" for key, entry in value.items()]
        return f"{{{inner}{f',{inner}'.join(rows)}{line}}}"
    if kind in (list, tuple) and any(issubclass(of, Mapping) for of in set(map(type, value))):
        return f"[{inner}{f',{inner}'.join(_indented(entry, inner) for entry in value)}{line}]"
    return _encoded(value)


def marked(name: str, document: Mapping[str, Any]) -> Mark:
    """``document`` as the mark of a set of files, with their digests in it where there are others."""

    def text(files: Mapping[str, str]) -> str:
        return json_text({**document, FILES: files} if files else document)

    return Mark(name, document["schema"], text)


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
