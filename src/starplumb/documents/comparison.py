"""``compare.json``: every method on one campaign."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from .document import Document, Numbers3, Part


class MethodAnswer(Part):
    """One method's answer; null where the method does not state it."""

    method: str
    status: str
    correction_arcsec: Numbers3 | None
    sigma_arcsec: Numbers3 | None
    naive_sigma_arcsec: Numbers3 | None
    difference_from_gls_sigma: Numbers3 | None
    seconds: float
    remarks: list[str]
    error_arcsec: Numbers3 | None = None


class ComparisonDocument(Document):
    """``compare.json``."""

    schema_: Literal["starplumb-compare/1"] = Field(alias="schema")
    campaign: str
    methods: list[MethodAnswer]
    inputs: dict[str, str]
