"""What all documents have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Self, get_args

import numpy as np
from annotated_types import Len
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from ..io.text.files import show
from ..io.text.json_node import loaded
from ..io.text.numbers import MOST_FINITE
from ..io.text.write import json_text
from ..physics.errors import EpochError, InputError
from ..physics.timescales import parse

MOST_VALUES = 1_500_000
"""Of a document: more than any that is written has."""
MOST_LISTED = 10_000
"""So many things that are wrong are looked at."""
MOST_PROBLEMS = 3
"""So many of the things that are wrong with a document are said."""

Files = dict[str, str] | None
"""The other files of the set that a document is the mark of, each with its SHA-256; none in a printed document."""


def _countable(value: float) -> float:
    if not abs(value) < MOST_FINITE:
        raise ValueError("a number that no quantity has")
    return value


Finite = Annotated[float, AfterValidator(_countable)]
"""A number whose square a double holds."""
Number = Finite | None
"""A number, or null where none can be stated."""
Triple = Annotated[list[Finite], Len(3, 3)]
Numbers3 = Annotated[list[Number], Len(3, 3)]
"""About x, y, z of the star tracker."""
Matrix3 = Annotated[list[Triple], Len(3, 3)]
MatrixOrNulls3 = Annotated[list[Numbers3], Len(3, 3)]


def require_times(times: Sequence[str], scale: str = "UTC") -> None:
    """ValueError about the first of some texts that is no time in a scale."""
    try:
        parse(times, scale)
    except (EpochError, InputError) as error:  # of a text, of the scale
        raise ValueError(str(error)) from None


def require_shape(key: str, values: object, shape: tuple[int, ...]) -> None:
    """ValueError where lists of numbers, however deep, are not of a shape."""
    try:
        found = np.array(values, dtype=np.float64).shape
    except ValueError:  # rows of several lengths
        found = None
    if found != shape:
        size = "rows of several lengths" if found is None else _times(found)
        raise ValueError(f"{key}: found {size}, wanted {_times(shape)} numbers")


def _times(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


class Part(BaseModel):
    """A part of a document.  Keys that it does not know are kept: later versions may add some."""

    model_config = ConfigDict(
        frozen=True, extra="allow", allow_inf_nan=False, validate_by_name=True, strict=True, defer_build=True
    )


class Document(Part):
    """A whole document; ``schema`` names its kind and edition."""

    schema_: str = Field(alias="schema")

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Self:
        """The document of a dictionary, checked."""
        return cls.model_validate(document)

    @classmethod
    def from_json(cls, text: str, name: str) -> Self:
        """The document of a JSON text.  Raises InputError, one sentence, where it is not such a document."""
        wanted = cls.kind()
        try:
            given = loaded(text, MOST_VALUES)
        except (ValueError, RecursionError) as error:
            raise InputError(
                f"{name}: found text that is not JSON ({error}), wanted a {wanted} document"
            ) from None
        found = given.get("schema") if isinstance(given, dict) else None
        if found != wanted:
            raise InputError(f"{name}: schema: found {show(found)}, wanted {show(wanted)}")
        try:
            return cls.of(given)
        except ValidationError as error:
            raise InputError(f"{name}: {_problems(error)}, wanted a {wanted} document") from None

    @classmethod
    def kind(cls) -> str:
        """What ``schema`` is in such a document."""
        return str(get_args(cls.model_fields["schema_"].annotation)[0])

    def to_dict(self) -> dict[str, Any]:
        """The document as a dictionary, its keys in the order of the file."""
        return self.model_dump(by_alias=True, exclude_unset=True)

    def to_json(self) -> str:
        """The document as the text of its file."""
        return json_text(self.to_dict())


def _problems(error: ValidationError) -> str:
    """What is wrong, what is missing last: a wrong value says more than a key that is not there."""
    if error.error_count() > MOST_LISTED:  # each would take a thousand bytes
        return f"found {error.error_count():,} values that cannot be"
    found = sorted(error.errors(include_url=False), key=lambda detail: detail["type"] == "missing")
    lines = [_problem(detail["loc"], detail["type"], detail["msg"], detail["input"]) for detail in found]
    more = len(lines) - MOST_PROBLEMS
    return "; ".join(lines[:MOST_PROBLEMS]) + (f"; and {more} more" if more > 0 else "")


def _problem(loc: tuple[int | str, ...], kind: str, message: str, given: object) -> str:
    key = ".".join(str(part) for part in loc)
    if kind == "missing":
        return f"{key}: missing"
    if kind == "value_error":
        said = message.removeprefix("Value error, ")
        return f"{key}: {said}" if key else said
    return f"{key}: found {show(given)} ({message})"
