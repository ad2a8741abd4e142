"""Times of a table that increase from row to row, of one that is whole or comes in pieces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...physics.errors import InputError
from ..text.files import show
from .read import Epochs, Table, epochs


def increasing(table: Table, scale: str) -> Epochs:
    """Epochs of a table, each later than the one before.  Raises InputError about the first that is not."""
    t_ns = epochs(table, scale)
    late = np.diff(t_ns) <= 0
    if late.any():
        row = int(np.argmax(late)) + 1
        again = "again" if t_ns[row] == t_ns[row - 1] else f"after {show(table.texts['time'][row - 1])}"
        found = f"{show(table.texts['time'][row])} {again} (row {table.row_number(row - 1)})"
        raise InputError(f"{table.where(row, 'time')}: found {found}, wanted times that increase")
    return t_ns


@dataclass
class Rising:
    """Samples of a large file, some at a time: their times in a ``scale`` increase, also from one piece to the next,
    and each is what ``require`` wants."""

    scale: str
    require: Callable[[Table], None]
    last: Table | None = None

    def __call__(self, table: Table | None) -> None:
        if table is None:
            return
        if self.last is not None:
            increasing(_joined(self.last, _row(table, 0)), self.scale)
        self.last = _row(table, len(table) - 1)
        increasing(table, self.scale)
        self.require(table)


def _row(table: Table, row: int) -> Table:
    return table.named_only([row], {name: [column[row]] for name, column in table.texts.items()})


def _joined(a: Table, b: Table) -> Table:
    """Two rows as one table."""
    rows = (a.row_number(0), b.row_number(0))
    texts: dict[str, Sequence[str]] = {name: [a.texts[name][0], b.texts[name][0]] for name in a.texts}
    return replace(a, texts=texts, rows=2, row_number=rows.__getitem__)
