"""``reproduce.json``: published tables recomputed."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from .document import Document, Number, Part


class RowPart(Part):
    """A row: the published figures, ours with their sampling error, and the verdict with its reason."""

    label: str
    published: list[Number] | None
    ours: list[Number]
    sampling_error: list[Number]
    published_sample_low: list[Number]
    published_sample_high: list[Number]
    verdict: str | None
    why: str


class TablePart(Part):
    """A published table."""

    name: str
    title: str
    source: str
    columns: list[str]
    runs: int
    rows: list[RowPart]
    notes: list[str]


class ReproductionDocument(Document):
    """``reproduce.json``."""

    schema_: Literal["starplumb-reproduce/1"] = Field(alias="schema")
    trials: int
    seed: int
    verdicts: dict[str, int]
    tables: list[TablePart]
    software: dict[str, str]
