"""What a report of a fault should name: versions of everything that computes, and of the extras that are there."""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version

from .. import __version__


def lines() -> Iterator[str]:
    """The package, Python and the machine; then each dependency with its version, the extras' where installed."""
    yield f"starplumb {__version__}"
    yield f"Python {sys.version.split()[0]} on {platform.platform()}, {platform.machine()}"
    for name in _dependencies():
        try:
            yield f"{name} {version(name)}"
        except PackageNotFoundError:
            yield f"{name}: not installed"


def _dependencies() -> list[str]:
    """Names of the dependencies, those of users' extras after them; of none where the package is not installed."""
    try:
        stated = requires("starplumb") or []
    except PackageNotFoundError:
        return []
    needed = [text for text in stated if "extra ==" not in text]
    extra = [text for text in stated if re.search(r"extra == .(spice|gis|cluster|fast)\b", text)]
    return [re.split(r"[^A-Za-z0-9_.-]", text)[0] for text in (*needed, *extra)]
