"""What ``starplumb project --json`` prints."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Len
from pydantic import Field

from .document import Document, Part

Pair = Annotated[list[float], Len(2, 2)]


class PlacedSite(Part):
    """A place in an image; its covariance is null where the error of the mounting is nowhere stated."""

    image_id: str
    landmark_id: str
    column_px: float
    row_px: float
    sigma_px: Pair | None
    covariance_px2: Annotated[list[Pair], Len(2, 2)] | None


class ProjectionDocument(Document):
    """Places on the ground in images; ``left_out`` counts pairs of image and place by why the place does not appear,
    ``in_no_image`` names places that appear in none."""

    schema_: Literal["starplumb-projection/1"] = Field(alias="schema")
    campaign: str
    mounting: str
    points: list[PlacedSite]
    left_out: dict[str, int]
    in_no_image: list[str]
    notices: list[str]
