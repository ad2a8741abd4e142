"""A table of places with markers, of which images are planned."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...physics.units import DEG
from ...plan.choice.views import Sites
from ..tables.columns import GEODETIC
from ..tables.read import read_table

LIMITS = {"latitude_deg": (-90.0, 90.0), "longitude_deg": (-180.0, 360.0), "height_m": (-1000.0, 9500.0)}


def read_site_table(path: Path, notices: list[str]) -> Sites:
    """Sites of a table with ``site,latitude_deg,longitude_deg,height_m`` and, if known, ``clear_probability``.

    Raises InputError for a place that is none on the ground and a probability that is none.
    """
    table = read_table(path, texts=("site",), numbers=GEODETIC, optional_numbers=("clear_probability",))
    notices += table.notices
    table.require_distinct("site", "each site once")
    for name, (low, high) in LIMITS.items():
        values = table.numbers[name]
        table.require((values >= low) & (values <= high), name, f"a number from {low:g} to {high:g}")
    clear = table.numbers.get("clear_probability", np.ones(len(table)))
    table.require((clear > 0.0) & (clear <= 1.0), "clear_probability", "a probability above 0, at most 1")
    latitude, longitude, height = (table.numbers[name] for name in GEODETIC)
    return Sites(tuple(table.texts["site"]), DEG * latitude, DEG * longitude, height, clear)
