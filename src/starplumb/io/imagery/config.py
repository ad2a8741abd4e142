"""[imagery], [reference] and [measure] of ``campaign.toml``: what ``starplumb measure`` reads, and how."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from ..text.sections import Section, wrong
from ..text.values import Positive, Sigma, Text, WholePair, choice, number, printable, vector

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


def _size(value: object) -> object:
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = [value]
    if not isinstance(value, list | tuple) or len(value) not in (1, 2):
        raise wrong(value, "a disc's diameter in metres, or the length and width of a cross's bars")
    return vector(len(value), "positive numbers", lambda x: 0.0 < x < _LARGEST_M)(value)


_LARGEST_M = 1e4


def _of_points(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Rules of [reference] with kind = "points"."""
    files, size = given.get("files"), given.get("size_m")
    if isinstance(files, list) and len(files) > 1:
        yield "files", f"found {len(files)} files, wanted one table of landmarks"
    wanted = {"disc": 1, "cross": 2}.get(str(given.get("shape", "light")), 0)
    count = 0 if size is None else len(size) if isinstance(size, list) else 1
    if count != wanted:
        of = {
            0: "no size of a light",
            1: "the diameter of a disc",
            2: "the length and width of a cross's bars",
        }
        yield "size_m", f"found {count or 'no'} numbers, wanted {of[wanted]}"
    if wanted == 2 and isinstance(size, list) and count == 2 and not size[0] > size[1]:
        yield "size_m", f"found {size}, wanted bars that are longer than wide"


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
    read_noise_dn: Positive | None = Field(
        default=None, description="the noise of a pixel without light, beside dn_per_electron"
    )
    dn_per_electron: Positive | None = Field(
        default=None, description="by how much an electron raises a pixel, beside read_noise_dn"
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        for one, other in (("read_noise_dn", "dn_per_electron"), ("dn_per_electron", "read_noise_dn")):
            if one in given and other not in given:
                yield other, f"missing, wanted it beside {one}, or neither (the images then tell their noise)"


class ReferenceConfig(Section):
    """[reference]: ground whose place is known."""

    kind: Annotated[Literal["ortho", "chips", "points"], choice("ortho", "chips", "points")] = Field(
        default="ortho", description='"ortho", "chips" or "points"'
    )
    files: Annotated[tuple[str, ...], BeforeValidator(_names)] = Field(
        description='the names of the orthoimage\'s tiles or patterns of them, such as ["ortho/*.tif"]; of points, '
        "that of the table of landmarks; of chips, the folders of their libraries"
    )
    shape: Annotated[Literal["light", "disc", "cross"], choice("light", "disc", "cross")] = Field(
        default="light", description='what points are, "light", "disc" or "cross"'
    )
    size_m: Annotated[tuple[float, ...], BeforeValidator(_size)] | None = Field(
        default=None, description="a disc's diameter, or the length and width of a cross's bars"
    )
    dark: bool = Field(default=False, description="true where points may be darker than what is around them")
    band: Annotated[int, BeforeValidator(_band)] = Field(
        default=1, description="the band to read, 1 for the first"
    )
    nodata: Finite | None = Field(
        default=None, description="the value of cells without data where the files do not say it"
    )
    crs: Text | None = Field(
        default=None, description="the reference system of files that do not state it, such as EPSG:4326"
    )
    dem: Text | None = Field(default=None, description="the name of a raster of ground heights")
    heights: Annotated[Literal["ellipsoidal", "geoid"], choice("ellipsoidal", "geoid")] | None = Field(
        default=None, description='what the heights are above, "ellipsoidal" or "geoid"'
    )
    geoid: Text | None = Field(default=None, description="the name of a raster of the geoid's heights")
    sigma_m: Sigma | None = Field(default=None, description="the reference's sigma (one, or east, north, up)")
    correlation_length_m: Positive | None = Field(
        default=None,
        description="the distance over which the reference's error is alike, a positive number",
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        if given.get("kind") == "points":
            yield from _of_points(given)
        elif given.get("kind") == "chips":
            for key in ("dem", "heights", "crs", "band", "nodata"):
                if key in given:
                    yield key, 'found it beside kind = "chips", wanted none: a library holds its own'
        else:
            for key in ("dem", "heights", "sigma_m"):
                if key not in given:
                    yield key, f"missing, wanted {cls.model_fields[key].description}"
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
