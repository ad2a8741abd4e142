"""``measure.json``: what became of every place at which ``starplumb measure`` looked for a chip."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Len
from pydantic import Field

from ..document import Document, Number, Part

Pair = Annotated[list[float], Len(2, 2)]


class MeasuredImagePart(Part):
    """An image: measured, or left out for a reason; ``offset_px`` is how far it was found from where the model mounting
    puts it, ``floor_px`` what its chips scatter beyond their own sigmas."""

    image_id: str
    status: Literal["measured", "left out"]
    reason: str
    size_px: Annotated[list[int], Len(2, 2)]
    candidates: int
    used: int
    check: int
    offset_px: Pair | None
    floor_px: float | None
    windows: Annotated[list[int], Len(2, 2)] = Field(description="windows that agree, and those tried")


class CandidatePart(Part):
    """A place; what there is only of a chip that was matched is null for others.  ``normalised`` is the residual over
    its sigma: that of the place and what the reference's own error adds."""

    image_id: str
    landmark_id: str
    column_px: float
    row_px: float
    predicted_column_px: float
    predicted_row_px: float
    verdict: str
    reason: str
    role: Literal["control", "check"] | None
    sigma_column_px: Number
    sigma_row_px: Number
    correlation: Number
    peak: Number
    second: Number
    agreement: Number
    kept: Number
    gain: Number
    blur_px: Number
    residual_column_px: Number
    residual_row_px: Number
    normalised: Pair | None


class MeasureDocument(Document):
    """Images and candidates; ``floor_px`` is what was added to the sigmas of matching, for what chips scatter beyond
    them and beyond the reference's own error."""

    schema_: Literal["starplumb-measure/1"] = Field(alias="schema")
    status: Literal["ok", "failed"]
    message: str
    campaign: str
    images: list[MeasuredImagePart]
    candidates: list[CandidatePart]
    floor_px: float
    inputs: dict[str, str]
    software: dict[str, str]
