"""What ``starplumb check --json`` prints."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from .document import Document, Number, Part


class SeriesPart(Part):
    """The samples of orbit or attitude; times are in ``time_scale``, ``gaps`` the pairs of samples that none joins."""

    kind: Literal["ephemeris", "attitude"]
    file: str
    frame: str
    samples: int
    first: str
    last: str
    step_s: Number
    gaps: list[list[str]]


class ImagesPart(Part):
    """The images; those without marks and those whose beginning orbit or attitude do not cover are named."""

    count: int
    first: str
    last: str
    without_marks: list[str]
    not_covered: list[str]
    speed_m_s: Number
    rate_deg_s: Number


class LandmarksPart(Part):
    """The landmarks; those that no image shows are named."""

    count: int
    not_seen: list[str]


class MarksPart(Part):
    """Observations or detections: ``outside`` orbit or attitude, and how many an image has."""

    control: int
    check: int
    detections: int
    outside: int
    fewest_in_an_image: int
    most_in_an_image: int


class DigitsPart(Part):
    """The last digit of a column as a standard deviation against the stated sigma (both in ``unit``)."""

    column: str
    step: float
    step_unit: str
    sigma: float
    stated: float
    unit: str


class MisfitPart(Part):
    """How far marks lie from where the model mounting puts their landmarks; null without a mark."""

    median_px: Number
    largest_px: Number
    median_deg: Number
    behind_the_camera: int


class CheckDocument(Document):
    """What was read of a campaign, nothing solved; ``problems`` make it unusable, ``warnings`` say what to look at."""

    schema_: Literal["starplumb-check/1"] = Field(alias="schema")
    campaign: str
    time_scale: str
    camera: str
    frames: dict[str, str]
    series: list[SeriesPart]
    images: ImagesPart
    landmarks: LandmarksPart
    marks: MarksPart
    digits: list[DigitsPart]
    model_misfit: MisfitPart
    problems: list[str]
    warnings: list[str]
    notices: list[str]
    inputs: dict[str, str]
