"""``budget.json``: what each error source of a scenario contributes."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from .document import Document, Files, Matrix3, Number, Part, Triple

Source = dict[str, str | Number | list[Number]]
"""A source: the names of its numbers end in its unit, as in ``sigma_arcsec`` and ``sensitivity_arcsec_per_arcsec``."""


class DirectionPart(Part):
    """A principal axis of the error."""

    sigma_arcsec: float
    axis_tracker: Triple
    axis_camera: Triple
    in_words: str


class MethodBudget(Part):
    """The budget of one method: the error that it has, and the one that it states."""

    sigma_arcsec: Triple
    covariance_arcsec2: Matrix3
    stated_sigma_arcsec: Triple | None
    sources: list[Source]
    directions: list[DirectionPart]
    in_words: list[str]


class TargetPart(Part):
    """What each source must shrink to for a wanted accuracy."""

    target_arcsec: float
    sources: list[Source]
    factor_all_sources: float
    in_words: list[str]


class DetectableMotion(Part):
    """Amplitudes of a mounting that moves which tests of the images find with 90 % probability."""

    detectable_arcsec: Number
    tests: dict[str, Number]
    in_words: str


class BudgetDocument(Document):
    """``budget.json``."""

    schema_: Literal["starplumb-budget/1"] = Field(alias="schema")
    fingerprint: dict[str, str] | None = None
    scenario: str
    description: str
    images: int
    sightings: int
    stated_model_is_true: bool
    methods: dict[str, MethodBudget]
    motion: DetectableMotion | None = None
    left_out: list[str]
    target: TargetPart | None
    files: Files = None
