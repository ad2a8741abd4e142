"""[imagery], [reference] and [measure] of ``campaign.toml``: what ``starplumb measure`` reads, and how."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from ..text.sections import Section, wrong
from ..text.values import Positive, Sigma, Text, WholePair, choice, number, printable

IMAGE_ID = "{image_id}"


def _pattern(value: object) -> object:
    if not isinstance(value, str) or IMAGE_ID not in value:
        raise wrong(value, 'a file name with the image\'s id in it, such as "raw/{image_id}.tif"')
    return printable(value)


def _names(value: object) -> object:
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list | tuple) or not value or not all(isinstance(name, str) for name in value):
        raise wrong(value, 'a list of file names or patterns, such as ["ortho/*.tif"]')
    return tuple(printable(name) for name in value)


def _band(value: object) -> object:
    if type(value) is not int or value < 1:
        raise wrong(value, "a positive whole number, 1 for the first band")
    return value


def _chip(value: object) -> object:
    if type(value) is not int or not 24 <= value <= 256:
        raise wrong(value, "a whole number of pixels from 24 to 256")
    return value


Share = Annotated[float, BeforeValidator(number("a part from 0 to 0.5", lambda x: 0.0 <= x <= 0.5))]
Finite = Annotated[float, BeforeValidator(number("a finite number"))]


class ImageryConfig(Section):
    """[imagery]: raw images."""

    files: Annotated[str, BeforeValidator(_pattern)] = Field(
        description='the raw images\' file names with the id in them, such as "raw/{image_id}.tif"'
    )
    band: Annotated[int, BeforeValidator(_band)] = Field(
        default=1, description="the band to read, 1 for the first"
    )
    nodata: Finite | None = Field(default=None, description="the value of pixels without data")
    saturation_dn: Positive | None = Field(default=None, description="the value of a pixel that is full")


class ReferenceConfig(Section):
    """[reference]: ground whose place is known."""

    kind: Annotated[Literal["ortho"], choice("ortho")] = Field(default="ortho", description='"ortho"')
    files: Annotated[tuple[str, ...], BeforeValidator(_names)] = Field(
        description='the names of the orthoimage\'s tiles or patterns of them, such as ["ortho/*.tif"]'
    )
    band: Annotated[int, BeforeValidator(_band)] = Field(
        default=1, description="the band to read, 1 for the first"
    )
    nodata: Finite | None = Field(
        default=None, description="the value of cells without data where the files do not say it"
    )
    crs: Text | None = Field(
        default=None, description="the reference system of files that do not state it, such as EPSG:4326"
    )
    dem: Text = Field(description="the name of a raster of ground heights")
    heights: Annotated[Literal["ellipsoidal", "geoid"], choice("ellipsoidal", "geoid")] = Field(
        description='what the heights are above, "ellipsoidal" or "geoid"'
    )
    geoid: Text | None = Field(default=None, description="the name of a raster of the geoid's heights")
    sigma_m: Sigma = Field(description="the reference's sigma (one, or east, north, up)")
    correlation_length_m: Positive | None = Field(
        default=None,
        description="the distance over which the reference's error is alike, a positive number",
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        if given.get("heights") == "geoid" and "geoid" not in given:
            yield "geoid", 'missing, wanted the name of a raster of the geoid beside heights = "geoid"'
        if "geoid" in given and given.get("heights") != "geoid":
            yield "geoid", 'found it without heights = "geoid", wanted both or neither'


class MeasureConfig(Section):
    """[measure]: how many chips of which size."""

    chip_px: Annotated[int, BeforeValidator(_chip)] = Field(
        default=48, description="pixels along a side of a chip, 24 to 256"
    )
    grid: WholePair = Field(default=(7, 7), description="chips wanted along the columns and rows of an image")
    check_share: Share = Field(
        default=0.2, description="the part of the chips that is kept for checking, 0 to 0.5"
    )
