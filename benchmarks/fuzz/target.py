"""What is damaged and read: one reader with valid files of its format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from damage import PLAIN, TEXT, Same
from numpy.typing import NDArray

Array = NDArray[np.float64]
Compare = Callable[[bytes, Any], None]
"""Given the content and what was read from it; raises AssertionError where they are not the same numbers."""


@dataclass(frozen=True)
class Target:
    """One reader: the ``files`` that it needs, those that are ``damaged``, and how they are read in their folder.

    ``same`` are the changes that must not matter; ``compare`` holds a result against a second parser; ``folder`` made
    by ``make`` where files are written by a library.
    """

    name: str
    files: Mapping[str, bytes]
    damaged: tuple[str, ...]
    read: Callable[[Path], Any]
    kinds: tuple[Callable[..., bytes], ...] = TEXT
    same: tuple[Same, ...] = PLAIN
    compare: Compare | None = None
