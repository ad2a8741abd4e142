"""Sections of ``campaign.toml`` that name tables of landmarks, images and marks."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from ..points.read import MARKED_SUFFIXES
from ..tables.columns import SIGMA_ENU
from ..tables.declared import Declared
from ..tables.keys import TableKeys, TimedKeys
from ..tables.read import TABLE_SUFFIXES
from ..text.sections import wrong
from ..text.values import Positive, Sigma, Text, choice, file_name

VECTOR_SUFFIXES = (".gpkg", ".geojson", ".json", ".shp")


def _files(*endings: str) -> Callable[[object], object]:
    """Validator of the name of one file, or of those of several files of ground points (a list, or a pattern)."""
    one, point = file_name(*endings), file_name(*MARKED_SUFFIXES)

    def check(value: object) -> object:
        if isinstance(value, str):
            return one(value)
        if isinstance(value, list | tuple) and value and all(isinstance(name, str) for name in value):
            return tuple(map(point, value))
        raise wrong(value, "a file name, or a list of names of files of ground points")

    return check


class LandmarksConfig(TableKeys):
    """[landmarks]"""

    file: Annotated[
        str | tuple[str, ...], BeforeValidator(_files(*TABLE_SUFFIXES, *VECTOR_SUFFIXES, *MARKED_SUFFIXES))
    ] = Field(description="the name of the file of landmarks")
    sigma_m: Sigma | None = Field(
        default=None, description="the landmarks' sigma where their file has none (one, or east, north, up)"
    )
    crs: Text | None = Field(
        default=None, description="the reference system of files of ground points that do not state it"
    )
    dem: Text | None = Field(default=None, description="the name of a raster of ground heights")
    heights: Annotated[Literal["ellipsoidal", "geoid"], choice("ellipsoidal", "geoid")] | None = Field(
        default=None, description='"ellipsoidal" or "geoid"'
    )
    geoid: Text | None = Field(default=None, description="the name of a raster of the geoid's heights")
    common_sigma_m: Sigma | None = Field(
        default=None, description="a further error that the landmarks of one survey share (east, north, up)"
    )
    correlation_length_m: Positive | None = Field(
        default=None,
        description="the distance over which errors of neighbouring landmarks are alike, a positive number",
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        yield from super().rules(given)
        if "dem" in given and "heights" not in given:
            yield "heights", 'missing, wanted what the heights of the DEM are above, "ellipsoidal" or "geoid"'
        if given.get("heights") == "geoid" and "geoid" not in given:
            yield "geoid", 'missing, wanted the name of a raster of the geoid beside heights = "geoid"'
        if "geoid" in given and given.get("heights") != "geoid":
            yield "geoid", 'found it without heights = "geoid", wanted both or neither'

    def declared(self, key: str) -> Declared:
        sigma = {} if self.sigma_m is None else dict(zip(SIGMA_ENU, self.sigma_m, strict=True))
        return replace(super().declared(key), stated=sigma, stated_by="sigma_m")


class MarksConfig(TableKeys):
    """What [observations] and [detections] have in common."""

    sigma_px: Positive | None = Field(
        default=None,
        description="the sigma of every mark where the file has none, a positive number of pixels",
    )

    def declared(self, key: str) -> Declared:
        sigma = {} if self.sigma_px is None else {"sigma_px": self.sigma_px}
        return replace(super().declared(key), stated=sigma, stated_by="sigma_px")


class ObservationsConfig(MarksConfig):
    """[observations]: a table, or files of ground points, a list or a pattern such as "*.points"."""

    file: Annotated[str | tuple[str, ...], BeforeValidator(_files(*TABLE_SUFFIXES, *MARKED_SUFFIXES))] = (
        Field(description="the name of a table (CSV, Parquet or Arrow) or of files of ground points")
    )
    crs: Text | None = Field(
        default=None, description="the reference system of files of ground points that do not state it"
    )


class DetectionsConfig(MarksConfig):
    """[detections]"""

    file: Annotated[str, BeforeValidator(file_name(*TABLE_SUFFIXES))] = Field(
        description="the name of a table (CSV, Parquet or Arrow)"
    )


def _dated(value: object) -> object:
    """A pattern of ``datetime.strptime`` from which a whole date and time come back."""
    moment = datetime(2001, 11, 23, 14, 25, 36)
    try:
        good = isinstance(value, str) and datetime.strptime(moment.strftime(value), value) == moment
    except (ValueError, TypeError, re.error):
        good = False
    if not good:
        raise wrong(
            value, 'a pattern with a whole date and time such as "SAT1_%Y%m%dT%H%M%S.%fZ_L1A", no zone'
        )
    return value


class ImagesConfig(TimedKeys):
    """[images]: a table, or the images of the observations with their times in their ids."""

    file: Annotated[str, BeforeValidator(file_name(*TABLE_SUFFIXES))] | None = Field(
        default=None, description="the name of a table (CSV, Parquet or Arrow)"
    )
    time_from_id: Annotated[str, BeforeValidator(_dated)] | None = Field(
        default=None, description='how an image_id has its time, such as "SAT1_%Y%m%dT%H%M%S.%fZ_L1A"'
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        yield from super().rules(given)
        if "file" not in given and "time_from_id" not in given:
            yield "file", f"missing, wanted {cls.model_fields['file'].description} (or time_from_id)"
        if "time" in given and "time_from_id" in given:
            yield "time", "found beside time_from_id, wanted only one of the two"
