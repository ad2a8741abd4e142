"""TOML documents from disk, checked against a model; all that is wrong with one is reported in one line."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from ...physics.errors import InputError
from .files import read_text
from .sections import Section, complaints

MOST_TOML = 4_000_000
"""Bytes: a thousand times a campaign that somebody writes."""
MOST_TOLD = 20
"""Of the problems of a file, in one sentence."""
MOST_PARTS = 64
"""Of a key, with dots between."""
_DEEP = re.compile(r"""(?:\.[ \t]*+(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+){64}""")
_SectionT = TypeVar("_SectionT", bound=Section)


def read_toml(path: Path) -> dict[str, Any]:
    """The document as a dictionary. Raises InputError with the line where it is not TOML."""
    text = read_text(path, MOST_TOML)
    if deep := _DEEP.search(text):  # tomllib takes their number squared
        at = text.count("\n", 0, deep.start()) + 1
        raise InputError(
            f"{path}, line {at}: found a key of more than {MOST_PARTS} parts, wanted section.key"
        )
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        where = re.search(r" \(at line (\d+), column (\d+)\)$", reason)
        if digits := re.search(r"[0-9_]{4000,}", text) if "integer string conversion" in reason else None:
            at = text.count("\n", 0, digits.start()) + 1
            found = f"found a whole number of {len(digits[0])} digits"
            raise InputError(f"{path}, line {at}: {found}, wanted one that a double holds") from None
        if where is None:
            raise InputError(
                f"{path}: found text that is not TOML ({reason}), wanted key = value lines and [sections]"
            ) from None
        line, column = where.groups()
        reason = reason[: where.start()]
        raise InputError(
            f"{path}, line {line}, column {column}: found text that is not TOML ({reason}), wanted valid TOML"
        ) from None


def plain(value: Any) -> Any:
    """A dictionary as TOML would give it: NumPy arrays and tuples as lists, paths as text, keys of None left out.

    TOML knows no null: a key whose value is None is one that the file would not have.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def check(document: Mapping[str, Any], model: type[_SectionT], name: Path | str) -> _SectionT:
    """The document as a ``model``. Raises InputError that lists everything wrong, each with its key."""
    try:
        return model.model_validate(dict(document))
    except ValidationError as error:
        raise refuse(name, complaints(error)) from None


def refuse(name: Path | str, problems: list[str]) -> InputError:
    """One error of one line for any number of problems."""
    count = f"{len(problems):,} problems: " if len(problems) > 1 else ""
    more = f"; and {len(problems) - MOST_TOLD:,} more" if len(problems) > MOST_TOLD else ""
    return InputError(f"{name}: {count}{'; '.join(problems[:MOST_TOLD])}{more}")
