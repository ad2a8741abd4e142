"""Sections of a TOML document as pydantic models whose complaints say what was found and what is wanted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, ValidationError, model_validator
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from .files import cut, nearest, show

MOST_KEYS = 1_000
"""Of a section: each that is unknown is compared with those that are known."""


def wrong(found: object, wanted: str) -> PydanticCustomError:
    """The complaint ``found ..., wanted ...`` about one value."""
    return _sentence(f"found {show(found)}, wanted {wanted}")


def _sentence(text: str) -> PydanticCustomError:
    return PydanticCustomError("sentence", "{text}", {"text": text})


class Section(BaseModel):
    """A table of a TOML document: unknown keys are refused, nothing is converted, complaints come together.

    ``description`` of a field says what is wanted of it, and is what a user reads when the key is missing.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Complaints ``(key, sentence)`` about keys that depend on each other."""
        yield from ()

    @model_validator(mode="wrap")
    @classmethod
    def _all_at_once(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if isinstance(data, dict) and len(data) > MOST_KEYS:
            text = f"found {len(data):,} keys, wanted at most {MOST_KEYS:,}"
            many: InitErrorDetails = {"type": _sentence(text), "loc": (), "input": None}
            raise ValidationError.from_exception_data(cls.__name__, [many])
        given = _as_meant(cls, data) if isinstance(data, dict) else {}
        problems: list[InitErrorDetails] = []
        section: Self | None = None
        try:
            section = handler(data)
        except ValidationError as error:
            for detail in error.errors(include_url=False):
                if detail["type"] != "missing" or detail["loc"][-1] not in given:
                    problems.append(_put_in_words(cls, detail))
        if isinstance(data, dict):
            for key, text in cls.rules(given):
                problems.append({"type": _sentence(text), "loc": (key,), "input": None})
        if problems or section is None:
            raise ValidationError.from_exception_data(cls.__name__, problems)
        return section


def complaints(error: ValidationError) -> list[str]:
    """Every complaint of a validation as ``section.key: sentence``."""
    lines = []
    for detail in error.errors(include_url=False):
        key = ".".join(cut(str(part)) for part in detail["loc"])
        lines.append(f"{key}: {detail['msg']}" if key else detail["msg"])
    return lines


def _keys(model: type[BaseModel]) -> dict[str, str]:
    """Keys as a user writes them, with what is wanted of each."""
    return {field.alias or name: field.description or "a value" for name, field in model.model_fields.items()}


def _as_meant(model: type[BaseModel], data: dict[str, Any]) -> dict[str, Any]:
    """``data`` and, for each unknown key, the known one nearest to it: that one is not called missing too."""
    known = _keys(model)
    meant = {nearest(key, known): value for key, value in data.items() if key not in known}
    return {key: value for key, value in meant.items() if key is not None} | data


def _put_in_words(model: type[BaseModel], detail: ErrorDetails) -> InitErrorDetails:
    kind, found = detail["type"], detail["input"]
    known = _keys(model)
    key = str(detail["loc"][-1]) if detail["loc"] else ""
    if kind == "sentence":
        text = detail["msg"]
    elif kind == "missing":
        text = f"missing, wanted {known[key]}"
    elif kind == "extra_forbidden":
        meant = nearest(key, known)
        wanted = f"the nearest known one is {meant}" if meant else f"wanted one of {', '.join(known)}"
        text = f"unknown key, {wanted}"
    elif kind in ("model_type", "dict_type", "model_attributes_type"):
        text = f"found {show(found)}, wanted a section with keys of its own"
    else:
        text = f"found {show(found)}, wanted {known.get(key) or detail['msg']}"
    return {"type": _sentence(text), "loc": detail["loc"], "input": found}
