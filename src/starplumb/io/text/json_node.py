"""JSON files as named values, with a sentence for whatever is missing or is not what it should be."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from .files import show
from .numbers import finite_float

Array = NDArray[np.float64]
MOST_VALUES = 3_000_000
"""Of a JSON file."""


def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of its pairs, for ``json``; ValueError for a key that stands twice: which value is meant is open."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"the key {show(key)} stands twice in one object")
        found[key] = value
    return found


def loaded(text: str, most: int = MOST_VALUES) -> Any:
    """What a JSON text is.  Raises ValueError for what is none, a key that stands twice, and more than ``most`` values:
    each takes a hundred bytes."""
    if text.count(",") + text.count("[") + text.count("{") > most:
        raise ValueError(f"more than {most:,} values")
    try:
        return json.loads(text, object_pairs_hook=unique)
    except ValueError as error:  # Python's own words are advice to programmers
        if "integer string conversion" in str(error):
            raise ValueError("a whole number of thousands of digits") from None
        raise


@dataclass(frozen=True)
class JsonNode:
    """An object of a JSON file; ``key`` is where it stands, with dots between."""

    path: Path
    value: Mapping[str, Any]
    key: str = ""

    @classmethod
    def of(cls, path: Path, text: str) -> JsonNode:
        """The object that a text is. Raises InputError."""
        try:
            value = loaded(text)
        except (ValueError, RecursionError) as error:
            reason = " ".join(str(error).split())
            raise InputError(f"{path}: found text that is not JSON ({reason}), wanted an object") from None
        if not isinstance(value, dict):
            raise InputError(f"{path}: found {show(value)}, wanted an object with named values")
        return cls(path, value)

    def has(self, name: str) -> bool:
        """Whether there is such a value."""
        return name in self.value

    def child(self, name: str) -> JsonNode:
        """An object in it."""
        value = self._get(name)
        if not isinstance(value, dict):
            raise self.error(name, value, "an object with named values")
        return JsonNode(self.path, value, self._place(name))

    def text(self, name: str, default: str | None = None) -> str:
        """A text in it."""
        value = self._get(name) if default is None else self.value.get(name, default)
        if not isinstance(value, str):
            raise self.error(name, value, "a text")
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """A finite number in it."""
        value = self._get(name) if default is None else self.value.get(name, default)
        found = finite_float(value)
        if found is None:
            raise self.error(name, value, "a finite number")
        return found

    def count(self, name: str) -> int:
        """A positive whole number in it."""
        value = self.number(name)
        if value < 1 or value != int(value):
            raise self.error(name, self.value[name], "a positive whole number")
        return int(value)

    def numbers(self, name: str, *shape: int) -> Array:
        """Finite numbers in it, a list or lists of lists, brought into ``shape`` (-1: any number)."""
        value = self._get(name)
        wanted = f"finite numbers, {' x '.join('n' if n < 0 else str(n) for n in shape)}"
        try:
            found = np.array(value, dtype=object)
            each = [finite_float(item) for item in found.ravel().tolist()]
            return np.array(each, dtype=np.float64).reshape(shape)  # None is no float
        except (ValueError, TypeError):
            raise self.error(name, value, wanted) from None

    def error(self, name: str, found: object, wanted: str) -> InputError:
        """The sentence about a value."""
        return InputError(f"{self.path}, {self._place(name)}: found {show(found)}, wanted {wanted}")

    def _get(self, name: str) -> Any:
        if name not in self.value:
            raise InputError(f"{self.path}: found no {self._place(name)}, wanted it")
        return self.value[name]

    def _place(self, name: str) -> str:
        return f"{self.key}.{name}" if self.key else name
