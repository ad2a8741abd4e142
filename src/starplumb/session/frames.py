"""Columns as a data frame of whatever library the user has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..io.text.write import Column
from ..physics.errors import InputError
from ..report.page import Table
from ..report.text import counted
from .show import Shown

if TYPE_CHECKING:
    from pandas import DataFrame

SHOWN = 5
"""Rows of a frame that its text shows."""


@dataclass(frozen=True, repr=False, eq=False)
class Frame(Shown):
    """Named columns of equal length: ``to_frame`` for pandas; polars, PyArrow and others take it as it is."""

    title: str
    names: tuple[str, ...]
    columns: tuple[Column, ...]

    def __len__(self) -> int:
        return len(self.columns[0]) if self.columns else 0

    def to_dict(self) -> dict[str, Any]:
        """The columns by name, NaN where a number does not exist: polars and others make a frame of it."""
        return {name: _plain(column) for name, column in zip(self.names, self.columns, strict=True)}

    def to_frame(self) -> DataFrame:
        """The columns as a pandas data frame."""
        try:
            import pandas
        except ImportError:
            raise InputError(
                "to_frame needs pandas, which is not installed; install it (pip install pandas) or use to_dict"
            ) from None
        return pandas.DataFrame(self.to_dict())

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """The columns for any library of the Arrow PyCapsule interface."""
        import pyarrow

        return pyarrow.table(self.to_dict()).__arrow_c_stream__(requested_schema)

    @property
    def tables(self) -> Sequence[Table]:
        first = {name: column[:SHOWN] for name, column in self.to_dict().items()}
        rows = [tuple(map(_cell, row)) for row in zip(*first.values(), strict=True)]
        more = f", the first {SHOWN}" if len(self) > SHOWN else ""
        return (Table(f"{self.title}: {counted(len(self), 'row')}{more}", self.names, rows),)


def _plain(column: Column) -> Any:
    return column.filled(np.nan) if isinstance(column, np.ma.MaskedArray) else column


def _cell(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
