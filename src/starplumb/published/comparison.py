"""A recomputed table beside the published one: figures, their sampling errors, and a verdict for each row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Verdict = Literal["agrees", "same order", "cannot be recovered"]

SAME_ORDER = 3.0
"""Figures within this factor of one another are of the same order."""
CENTRAL = (0.005, 0.995)
"""Quantiles between which the publication's own sample would fall in 99 of 100 repetitions."""


@dataclass(frozen=True)
class Recomputed:
    """Figures (k,) of one row: ``value``, its sampling error ``sampling``, and ``low`` .. ``high``, between which the
    publication's own, smaller sample would fall by our simulation."""

    value: Array
    sampling: Array
    low: Array
    high: Array

    @classmethod
    def exact(cls, value: ArrayLike) -> Recomputed:
        """Figures without sampling error."""
        v = np.asarray(value, dtype=np.float64)
        return cls(v, np.zeros_like(v), v, v)

    @classmethod
    def of_series(cls, statistics: Array) -> Recomputed:
        """Median over series (s, k) of the publication's size: an outlier spoils one series, not the comparison."""
        value = np.median(statistics, axis=0)
        # the median of s normal numbers is pi/2 times as uncertain in variance as their mean
        spread = 0.7413 * np.subtract(*np.quantile(statistics, (0.75, 0.25), axis=0))
        sampling = np.sqrt(0.5 * np.pi / len(statistics)) * spread
        low, high = np.quantile(statistics, CENTRAL, axis=0)
        return cls(value, sampling, low, high)


@dataclass(frozen=True)
class Row:
    """One row: published figures (k,) (NaN where none is), ours, the verdict and its reason.

    A row that the document could not have has no published figures and no verdict.
    """

    label: str
    ours: Recomputed
    published: Array | None = None
    verdict: Verdict | None = None
    why: str = ""


@dataclass(frozen=True)
class Comparison:
    """A table: its title, columns, rows, and remarks."""

    name: str
    title: str
    source: str
    columns: tuple[str, ...]
    runs: int
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = field(default=())

    def document(self) -> dict[str, Any]:
        """The table for a program; numbers that do not exist are null."""
        return {
            "name": self.name,
            "title": self.title,
            "source": self.source,
            "columns": list(self.columns),
            "runs": self.runs,
            "rows": [_row_document(row) for row in self.rows],
            "notes": list(self.notes),
        }


def _row_document(row: Row) -> dict[str, Any]:
    return {
        "label": row.label,
        "published": None if row.published is None else _numbers(row.published),
        "ours": _numbers(row.ours.value),
        "sampling_error": _numbers(row.ours.sampling),
        "published_sample_low": _numbers(row.ours.low),
        "published_sample_high": _numbers(row.ours.high),
        "verdict": row.verdict,
        "why": row.why,
    }


def _numbers(values: Array) -> list[float | None]:
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in values]


def judge(
    label: str,
    columns: Sequence[str],
    published: ArrayLike,
    ours: Recomputed,
    allowance: ArrayLike,
    why: str = "",
) -> Row:
    """A row with its verdict.

    A figure agrees when the publication's sample could have been ours (``low`` .. ``high``) or when it departs from
    ours by no more than ``allowance`` (k,), in the table's units; it is of the same order within a factor of three;
    NaN is not judged.  The row's verdict is that of its worst figure; those that do not agree are named, with ``why``.
    """
    figure = np.asarray(published, dtype=np.float64)
    judged = np.isfinite(figure)
    possible = (figure >= ours.low) & (figure <= ours.high)
    agrees = possible | (np.abs(figure - ours.value) <= np.asarray(allowance)) | ~judged
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = figure / ours.value
        near = agrees | ((ratio < SAME_ORDER) & (ratio > 1.0 / SAME_ORDER))
    if np.all(agrees):
        return Row(label, ours, figure, "agrees")
    off = ", ".join(
        f"{name} {_times(r)}" for name, r, fine in zip(columns, ratio, agrees, strict=True) if not fine
    )
    verdict: Verdict = "same order" if np.all(near) else "cannot be recovered"
    return Row(label, ours, figure, verdict, f"published/ours: {off}" + (f"; {why}" if why else ""))


def _times(ratio: float) -> str:
    return f"{ratio:.2g}" if abs(ratio) < 1000.0 else "above 1000"
