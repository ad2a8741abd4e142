"""The published tables and scenarios that travel with the package."""

from __future__ import annotations

import csv
import tomllib
from importlib.resources import files
from typing import Any

NAMES = {
    "table1": "paper2019_table1_two_images",
    "table2": "paper2019_table2_one_image",
    "table3": "paper2019_table3_first_correction",
    "table4": "paper2019_table4_convergence",
    "sensitivity": "slides2012_sensitivity",
    "totals": "slides2012_totals",
    "algorithm1": "slides2012_algorithm1",
    "images-sigma": "slides2012_images_sigma",
    "images-max": "slides2012_images_max",
}
"""Names of the tables at the command line, and the files that hold them."""


def scenario(document: str) -> dict[str, Any]:
    """Scenario of a document, ``paper2019`` or ``slides2012``: every assumption a key."""
    return tomllib.loads(files(__package__).joinpath(f"{document}.toml").read_text(encoding="utf-8"))


def published(name: str) -> list[dict[str, str]]:
    """Rows of a published table, as printed."""
    text = files(__package__).joinpath("tables", f"{NAMES[name]}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def source(name: str) -> str:
    """Where a published table stands."""
    text = files(__package__).joinpath("tables", f"{NAMES[name]}.csv").read_text(encoding="utf-8")
    return text.splitlines()[0].removeprefix("# ")
