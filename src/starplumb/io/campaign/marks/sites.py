"""A table of places on the ground that are to be found in images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....physics.errors import InputError
from ...gis.heights import Ground
from ...tables.cells import Array
from ...tables.columns import CARTESIAN, GEODETIC, SIGMA_ENU
from ...tables.read import Table, TableSource, other_format, read_table
from ...text.files import MOST_TEXT
from .landmarks import one_of, raised, surveyed

MOST_SITES = 300_000
"""Places of a table: each takes some kilobytes in every image that sees it."""


@dataclass(frozen=True)
class Sites:
    """n places: their names, ``r_J`` (n, 3) m with ``covariance_J`` (n, 3, 3) m^2, and the image in which each is asked
    for, None for all; ``notices`` are sentences for the user."""

    ids: tuple[str, ...]
    r_J: Array
    covariance_J: Array
    images: tuple[str, ...] | None = None
    notices: tuple[str, ...] = ()


def one_site(coordinates: Mapping[str, float]) -> Table:
    """A table of one place, by the names of its columns."""
    numbers = {name: np.array([value], dtype=np.float64) for name, value in coordinates.items()}
    return Table("place", numbers, {"landmark_id": ["place"]}, 1, int, [], places=["place"])


def read_sites(
    source: TableSource | Table, ground: Ground, height_m: float | None, sigma: Sequence[float]
) -> Sites:
    """Places of a table or a vector file with the columns of landmarks; ``landmark_id`` may be missing, and an
    ``image_id`` may say in which image each is asked for.

    Heights are the table's own, or those of ``ground`` or ``height_m``; ``sigma`` (3,) m east, north, up is that of a
    table without one.  Raises InputError for a place that is none on the ground, and for heights that nobody states.
    """
    if isinstance(source, Table):
        table = source
    elif path := other_format(source):
        from ...gis.vector import read_points

        table = read_points(path, flat=ground.dem is not None or height_m is not None)
    else:
        table = read_table(
            source,
            optional_texts=("landmark_id", "image_id"),
            optional_numbers=(*GEODETIC, *CARTESIAN, "sigma_m", *SIGMA_ENU),
            most=MOST_TEXT,
        )
        if not {GEODETIC[0], CARTESIAN[0]} & set(table.numbers):
            one_of(table, GEODETIC, CARTESIAN)
        if len(table) > MOST_SITES:
            raise InputError(
                f"{source}: found {len(table):,} places, wanted at most {MOST_SITES:,} at a time"
            )
    names = table.texts.get("landmark_id") or [f"row {table.row_number(i)}" for i in range(len(table))]
    table = replace(table, texts=table.texts | {"landmark_id": names})
    table = _with_heights(table, ground, height_m)
    if not {"sigma_m", *SIGMA_ENU} & set(table.numbers):
        stated = {name: np.full(len(table), each) for name, each in zip(SIGMA_ENU, sigma, strict=True)}
        table = replace(table, numbers=table.numbers | stated)
    images = table.texts.get("image_id")
    asked = None if images is None else tuple(images)
    return Sites(tuple(names), *surveyed(table), asked, tuple(table.notices))


def _with_heights(table: Table, ground: Ground, height_m: float | None) -> Table:
    """The table with a height for every geodetic place."""
    flat = "latitude_deg" in table.numbers and "height_m" not in table.numbers
    if ground.dem is None and flat:
        if height_m is None:
            raise InputError(
                f"{table.source}: found places without heights, wanted a column height_m, one height for all "
                "(--height-m) or a DEM (--dem)"
            )
        return replace(table, numbers=table.numbers | {"height_m": np.full(len(table), height_m)})
    if height_m is not None:
        raise InputError(f"{table.source}: found heights beside --height-m, wanted only one of the two")
    return raised(table, ground)
