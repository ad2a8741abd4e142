"""What ``starplumb diagnose --json`` prints."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from .document import Document, Number, Part


class Undone(Part):
    """A mistake that was undone; ``evidence`` is what the files themselves show of it, empty for nothing."""

    key: str
    what: str
    remedy: str
    evidence: str


class TrialPart(Part):
    """A campaign calibrated with some mistakes undone; ``obstacle`` says why there is no solution, where that is so."""

    undone: list[Undone]
    score: Number
    chi2: Number
    degrees_of_freedom: int
    chi2_p: Number
    rms_px: Number
    correction_deg: Number
    obstacle: str


class DiagnosisDocument(Document):
    """The diagnosis; trials are the best first, ``shown`` are further mistakes that the files themselves show."""

    schema_: Literal["starplumb-diagnosis/1"] = Field(alias="schema")
    verdict: Literal["named", "partly", "unexplained", "none"]
    message: str
    stated: TrialPart
    best: TrialPart | None
    rivals: list[TrialPart]
    shown: list[Undone]
    trials: list[TrialPart]
