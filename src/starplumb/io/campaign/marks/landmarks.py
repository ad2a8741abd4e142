"""Tables of landmarks, as the part of a campaign they become."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ....physics.earth import C_JT, geodetic_to_itrf, itrf_to_geodetic
from ....physics.errors import InputError
from ....physics.units import DEG
from ....table.campaign import Landmarks
from ...gis.heights import HEIGHTS_M, Ground
from ...tables.cells import NUMBER, Array
from ...tables.columns import CARTESIAN, GEODETIC, SIGMA_ENU
from ...tables.declared import UNDECLARED, Declared
from ...tables.read import Table, TableSource, other_format, read_table
from ...text.numbers import SIGMA_WORDS, is_sigma
from .point_files import PointFiles

LIMITS = {"latitude_deg": (-90.0, 90.0), "longitude_deg": (-180.0, 360.0), "height_m": HEIGHTS_M}
RADIUS_M = (6.3e6, 6.4e6)
_BLOCK = 1 << 14
MOST_LANDMARKS = 3_000_000
"""Of a campaign: half a gigabyte."""
TIE_M = 1e5
"""Sigma of the place of a tie point, once its rays have met: far beyond what they leave open."""


def read_landmarks(
    source: TableSource | PointFiles,
    notices: list[str],
    ground: Ground | None = None,
    declared: Declared = UNDECLARED,
) -> Landmarks:
    """Landmarks of a table, perhaps none yet, or of a vector file.

    ``ground`` says where heights come from and what they are above.
    """
    if isinstance(source, PointFiles):
        return landmarks_from(source.landmarks(ground or Ground(), declared, notices))
    if path := other_format(source):
        from ...gis.vector import read_points

        table = read_points(path, flat=ground is not None and ground.dem is not None)
        table = replace(table, declared=declared).with_stated()
    else:
        numbers = (*GEODETIC, *CARTESIAN, "sigma_m", *SIGMA_ENU)
        table = read_table(
            source,
            texts=("landmark_id",),
            optional_texts=("source",),
            optional_numbers=numbers,
            declared=declared,
            may_be_empty=True,
            unknown=numbers,
            most_rows=MOST_LANDMARKS,
        )
    notices += table.notices
    return landmarks_from(table if ground is None else raised(table, ground))


def raised(table: Table, ground: Ground) -> Table:
    """The table with heights above the ellipsoid, taken from a DEM or raised by the geoid where that is said."""
    if ground.dem is None and ground.heights != "geoid":
        return table
    if CARTESIAN[0] in table.numbers:
        found = f"found Cartesian places beside {ground.words[0 if ground.dem else 1]}"
        raise InputError(f"{table.source}: {found}, wanted latitude_deg and longitude_deg with it")
    missing = [name for name in GEODETIC[:2] if name not in table.numbers]
    if missing:
        lacks, *both = map(table.declared.name, (missing[0], *GEODETIC[:2]))
        raise InputError(f"{table.source}: found no column {lacks}, wanted {' and '.join(both)}")
    latitude, longitude = (DEG * table.numbers[name] for name in GEODETIC[:2])
    stated, known = table.numbers.get("height_m"), np.flatnonzero(np.isfinite(latitude))
    names = tuple(table.texts["landmark_id"][row] for row in known.tolist())
    height = np.full(len(table), np.nan)
    height[known] = ground.ellipsoidal(
        *(table.source, None if stated is None else stated[known]), latitude[known], longitude[known], names
    )
    return replace(table, numbers=table.numbers | {"height_m": height})


def landmarks_from(table: Table) -> Landmarks:
    """Landmarks from their columns, as :func:`surveyed`; InputError for a landmark that is there twice."""
    table.require_distinct("landmark_id", "each landmark once")
    tie = tie_points(table)
    r_J, covariance_J = (
        np.zeros((len(table), 3)),
        np.broadcast_to(TIE_M**2 * np.eye(3), (len(table), 3, 3)).copy(),
    )
    known = np.flatnonzero(~tie)
    r_J[known], covariance_J[known] = surveyed(table if not tie.any() else some_rows(table, known))
    sources = table.texts.get("source")
    return Landmarks(
        tuple(table.texts["landmark_id"]),
        r_J,
        covariance_J,
        sources=None if sources is None else tuple(sources),
        tie=tie if tie.any() else None,
    )


def tie_points(table: Table) -> NDArray[np.bool_]:
    """Rows (n,) of tie points: coordinates empty (the height may be a DEM's) and sigma ``inf``.

    Raises InputError about a row that is neither this nor a surveyed landmark.
    """
    places = [name for name in (*GEODETIC, *CARTESIAN) if name in table.numbers]
    sigmas = [name for name in ("sigma_m", *SIGMA_ENU) if name in table.numbers]
    tie: NDArray[np.bool_] = np.zeros(len(table), dtype=np.bool_)
    if places and sigmas:
        empty, endless = np.isnan(table.columns(*places)), np.isinf(table.columns(*sigmas))
        tie = np.asarray(empty.all(axis=-1) & endless.all(axis=-1))
    for name in (*places, *sigmas):
        x = table.numbers[name]
        for row in np.flatnonzero(~np.isfinite(x) & ~tie)[:1].tolist():
            found = None if np.isnan(x[row]) else "inf"
            raise table.error(
                row, name, found, f"{NUMBER} in every row (a tie point has no coordinates and sigma inf)"
            )
    return tie


def some_rows(table: Table, rows: NDArray[np.int64]) -> Table:
    """Some of the rows, named as in the whole table."""
    texts: dict[str, Sequence[str]] = {
        name: [words[row] for row in rows.tolist()] for name, words in table.texts.items()
    }
    numbers = {name: x[rows] for name, x in table.numbers.items()}
    return replace(table.named_only(rows.tolist(), texts), numbers=numbers)


def surveyed(table: Table) -> tuple[Array, Array]:
    """Places ``r_J`` (n, 3), given geodetic or Cartesian, and their covariance (n, 3, 3) from a sigma or three (east,
    north, up): ``C_JT diag(sigma^2) C_TJ``.

    Raises InputError for a place that is not on the Earth's surface, and a sigma below 0 (0 claims an exact place).
    """
    if one_of(table, GEODETIC, CARTESIAN) == GEODETIC:
        for name, (low, high) in LIMITS.items():
            x = table.numbers[name]
            table.require((x >= low) & (x <= high), name, f"{low:g} to {high:g}")
        latitude, longitude = (DEG * table.numbers[name] for name in GEODETIC[:2])
        r_J = geodetic_to_itrf(latitude, longitude, table.numbers["height_m"])
    else:
        r_J = table.columns(*CARTESIAN)
        require_radius(table, r_J, RADIUS_M, "a place on the ground, from the Earth's centre")
        latitude, longitude, _ = itrf_to_geodetic(r_J)
    columns = one_of(table, ("sigma_m",), SIGMA_ENU)
    for name in columns:
        table.require(
            is_sigma(table.numbers[name]),
            name,
            f"a sigma in metres, 0 or more (0 claims an exact landmark, else {SIGMA_WORDS})",
        )
    sigma = np.broadcast_to(table.columns(*columns), (len(table), 3))
    return r_J, _turned(sigma, latitude, longitude)


def _turned(sigma: Array, latitude: Array, longitude: Array) -> Array:
    """``C_JT diag(sigma^2) C_TJ`` (n, 3, 3); in blocks, since the rotations would take as much memory again."""
    covariance_J = np.empty((len(sigma), 3, 3))
    for start in range(0, len(sigma), _BLOCK):
        part = slice(start, start + _BLOCK)
        C = C_JT(latitude[part], longitude[part])
        np.matmul(C * sigma[part, None, :] ** 2, C.mT, out=covariance_J[part])
    return covariance_J


def require_radius(table: Table, r: Array, limits: tuple[float, float], what: str) -> None:
    """Raise InputError about the first position (n, 3) whose length is not within ``limits`` (m)."""
    radius = np.linalg.norm(r, axis=-1)
    good = (radius >= limits[0]) & (radius <= limits[1])
    if not good.all():
        row = int(np.argmin(good))
        wanted = f"{what} {limits[0] / 1e3:g} to {limits[1] / 1e3:g} km"
        unit = " (are these kilometres?)" if limits[0] <= 1e3 * np.median(radius) <= limits[1] else ""
        where = table.where(row, *CARTESIAN)
        raise InputError(f"{where}: found {radius[row]:.7g} m, wanted {wanted}{unit}")


def one_of(table: Table, a: tuple[str, ...], b: tuple[str, ...]) -> tuple[str, ...]:
    """Which of two sets of columns the table has. Raises InputError unless it is exactly one."""
    there = [columns for columns in (a, b) if table.has(*columns)]
    if len(there) != 1:
        first, second = ([table.declared.name(name) for name in names] for names in (a, b))
        found = f"both {first[0]} and {second[0]}" if there else f"neither {first[0]} nor {second[0]}"
        raise InputError(
            f"{table.source}: found {found}, wanted the columns {', '.join(first)} or {', '.join(second)}"
        )
    return there[0]
