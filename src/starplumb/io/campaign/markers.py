"""Tables of landmarks, images, observations and detections, as the parts of a campaign they become."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from ...physics import timescales
from ...physics.earth import C_JT, geodetic_to_itrf, itrf_to_geodetic
from ...physics.errors import EpochError, InputError
from ...physics.units import DEG
from ...table.campaign import Detections, Images, Landmarks, Sightings
from ..gis.heights import Ground
from ..tables.cells import Array
from ..tables.columns import CARTESIAN, GEODETIC, SIGMA_ENU
from ..tables.declared import UNDECLARED, Declared
from ..tables.lookup import places
from ..tables.read import Table, TableSource, epochs, other_format, read_table
from ..text.files import nearest, show

Index = NDArray[np.int64]

LIMITS = {"latitude_deg": (-90.0, 90.0), "longitude_deg": (-180.0, 360.0), "height_m": (-1000.0, 9500.0)}
RADIUS_M = (6.3e6, 6.4e6)
_BLOCK = 1 << 14
MOST_ROWS = 10_000_000
"""A line scanner's rows are epochs, which orbit and attitude bound; beyond so many of them is a slip of the pen."""


@dataclass(frozen=True)
class Grid:
    """Pixels of an image as its user counts them: ``shift_px`` from ours (0.5 where (0, 0) is a corner), and
    how many."""

    columns: float
    rows: float
    shift_px: float


def read_landmarks(
    source: TableSource,
    notices: list[str],
    ground: Ground | None = None,
    declared: Declared = UNDECLARED,
) -> Landmarks:
    """Landmarks of a table or a vector file; ``ground`` says where heights come from and what they are above."""
    if path := other_format(source):
        from ..gis.vector import read_points

        table = read_points(path, flat=ground is not None and ground.dem is not None)
    else:
        numbers = (*GEODETIC, *CARTESIAN, "sigma_m", *SIGMA_ENU)
        table = read_table(
            source,
            texts=("landmark_id",),
            optional_texts=("source",),
            optional_numbers=numbers,
            declared=declared,
        )
    notices += table.notices
    return landmarks_from(table if ground is None else _raised(table, ground))


def _raised(table: Table, ground: Ground) -> Table:
    """The table with heights above the ellipsoid, taken from a DEM or raised by the geoid where that is said."""
    if ground.dem is None and ground.heights != "geoid":
        return table
    if CARTESIAN[0] in table.numbers:
        found = f"found Cartesian places beside {ground.words[0 if ground.dem else 1]}"
        raise InputError(f"{table.source}: {found}, wanted latitude_deg and longitude_deg with it")
    missing = [name for name in GEODETIC[:2] if name not in table.numbers]
    if missing:
        raise InputError(
            f"{table.source}: found no column {missing[0]}, wanted latitude_deg and longitude_deg"
        )
    latitude, longitude = (DEG * table.numbers[name] for name in GEODETIC[:2])
    stated = table.numbers.get("height_m")
    height = ground.ellipsoidal(table.source, stated, latitude, longitude, tuple(table.texts["landmark_id"]))
    return replace(table, numbers=table.numbers | {"height_m": height})


def landmarks_from(table: Table) -> Landmarks:
    """Landmarks from their columns: place geodetic or Cartesian, sigma one number or three (east, north, up).

    The covariance in J is ``C_JT diag(sigma^2) C_TJ``. Raises InputError for a place that is not on the
    Earth's surface, a sigma below 0 (0 claims an exact landmark) or a landmark that is there twice.
    """
    table.require_distinct("landmark_id", "each landmark once")
    if _one_of(table, GEODETIC, CARTESIAN) == GEODETIC:
        for name, (low, high) in LIMITS.items():
            x = table.numbers[name]
            table.require((x >= low) & (x <= high), name, f"{low:g} to {high:g}")
        latitude, longitude = (DEG * table.numbers[name] for name in GEODETIC[:2])
        r_J = geodetic_to_itrf(latitude, longitude, table.numbers["height_m"])
    else:
        r_J = table.columns(*CARTESIAN)
        require_radius(table, r_J, RADIUS_M, "a place on the ground, from the Earth's centre")
        latitude, longitude, _ = itrf_to_geodetic(r_J)
    columns = _one_of(table, ("sigma_m",), SIGMA_ENU)
    for name in columns:
        table.require(
            table.numbers[name] >= 0.0, name, "a sigma in metres, 0 or more (0 claims an exact landmark)"
        )
    sigma = np.broadcast_to(table.columns(*columns), (len(table), 3))
    sources = table.texts.get("source")
    return Landmarks(
        tuple(table.texts["landmark_id"]),
        r_J,
        _turned(sigma, latitude, longitude),
        sources=None if sources is None else tuple(sources),
    )


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
        names = ", ".join(map(table.declared.name, CARTESIAN))
        where = f"{table.source}, row {table.row_number(row)}, columns {names}"
        raise InputError(f"{where}: found {radius[row]:.7g} m, wanted {wanted}{unit}")


def read_images(
    source: TableSource,
    scale: str,
    scans: bool,
    notices: list[str],
    declared: Declared = UNDECLARED,
    time_from_id: str | None = None,
) -> Images:
    """Images with their epochs; the line period, which a line scanner needs and a frame camera has not.

    The epochs are those of the column ``time``, or stand in the ids as ``time_from_id`` says.
    """
    table = read_table(
        source,
        texts=("image_id",) if time_from_id else ("image_id", "time"),
        optional_texts=("tracker", "pass", "session"),
        optional_numbers=("line_period_s", "sigma_time_s"),
        declared=declared,
    )
    notices += table.notices
    table.require_distinct("image_id", "each image once")
    period = table.numbers.get("line_period_s")
    if scans and period is None:
        raise InputError(f"{source}: found no column line_period_s, wanted it for a line-scan camera")
    if scans and period is not None:
        wanted = "a positive number of seconds (negative where later rows are exposed earlier)"
        table.require(period != 0.0, "line_period_s", wanted)
    elif period is not None:
        notices.append(f"{source}: ignored the column line_period_s, which a frame camera does not have")
        period = None
    sigma_time_s = table.numbers.get("sigma_time_s")
    if sigma_time_s is not None:
        table.require(sigma_time_s >= 0.0, "sigma_time_s", "a sigma in seconds, 0 or more")
    names = {name: tuple(texts) for name, texts in table.texts.items()}
    return Images(
        names["image_id"],
        _times_in_ids(table, time_from_id, scale) if time_from_id else epochs(table, scale),
        period,
        str(source),
        names.get("tracker"),
        names.get("pass"),
        names.get("session"),
        sigma_time_s,
    )


def images_of(source: TableSource, scale: str, time_from_id: str, declared: Declared) -> Images:
    """The images of a table of observations or detections, in its order, with the times in their ids."""
    only = {ours: name for ours, name in declared.columns.items() if ours == "image_id"}
    table = read_table(source, texts=("image_id",), declared=replace(declared, columns=only))
    first = {name: row for row, name in reversed(list(enumerate(table.texts["image_id"])))}
    rows = sorted(first.values())
    ids = tuple(table.texts["image_id"][row] for row in rows)
    seen = replace(table, texts={"image_id": ids}, row_number=lambda i: table.row_number(rows[i]))
    return Images(ids, _times_in_ids(seen, time_from_id, scale), name=str(source))


def _times_in_ids(table: Table, pattern: str, scale: str) -> NDArray[np.int64]:
    """``t_ns`` (n,) of ids by a pattern of ``datetime.strptime``; InputError about the first that does not fit."""
    ids, written = table.texts["image_id"], []
    for row, name in enumerate(ids):
        try:
            time = datetime.strptime(name, pattern)
        except ValueError:
            wanted = f"an id like {show(pattern)}, as images.time_from_id says"
            raise table.error(row, "image_id", name, wanted) from None
        written.append(time.isoformat(timespec="microseconds"))
    try:
        return np.asarray(timescales.parse(written, scale))
    except EpochError as error:
        raise table.error(error.row, "image_id", ids[error.row], f"a time in it ({error})") from None


def read_observations(
    source: TableSource,
    images: Sequence[str],
    landmarks: Sequence[str],
    grid: Grid,
    notices: list[str],
    declared: Declared = UNDECLARED,
) -> Sightings:
    """Sightings of known landmarks; every row is taken or refused, images and landmarks without one
    are reported."""
    table = read_table(
        source,
        texts=("image_id", "landmark_id"),
        numbers=("column_px", "row_px", "sigma_px"),
        optional_texts=("role",),
        declared=declared,
    )
    notices += table.notices
    image = _lookup(table, "image_id", images, "images")
    landmark = _lookup(table, "landmark_id", landmarks, "landmarks")
    _require_new_pairs(table, image, landmark, len(landmarks))
    column, row, sigma = _pixels(table, grid)
    check = _roles(table)
    notices += _unseen(source, "image", images, image) + _unseen(source, "landmark", landmarks, landmark)
    return Sightings(image, landmark, column, row, sigma, check)


def read_detections(
    source: TableSource,
    images: Sequence[str],
    grid: Grid,
    notices: list[str],
    declared: Declared = UNDECLARED,
) -> Detections:
    """Marker images whose landmark is not known."""
    table = read_table(
        source, texts=("image_id",), numbers=("column_px", "row_px", "sigma_px"), declared=declared
    )
    notices += table.notices
    image = _lookup(table, "image_id", images, "images")
    notices += _unseen(source, "image", images, image)
    return Detections(image, *_pixels(table, grid))


def _one_of(table: Table, a: tuple[str, ...], b: tuple[str, ...]) -> tuple[str, ...]:
    """Which of two sets of columns the table has. Raises InputError unless it is exactly one."""
    there = [columns for columns in (a, b) if table.has(*columns)]
    if len(there) != 1:
        found = f"both {a[0]} and {b[0]}" if there else f"neither {a[0]} nor {b[0]}"
        raise InputError(
            f"{table.source}: found {found}, wanted the columns {', '.join(a)} or {', '.join(b)}"
        )
    return there[0]


def _lookup(table: Table, column: str, known: Sequence[str], what: str) -> Index:
    """Index of each id among the known ones. Raises InputError about the first that is not."""
    ids = table.texts[column]
    index = places(ids, known)
    if (index < 0).any():
        row = int(np.argmax(index < 0))
        near = nearest(ids[row], known)
        hint = f" (perhaps {show(near)})" if near else ""
        raise table.error(row, column, ids[row], f"one of the {len(known)} {what} of the campaign{hint}")
    return index


def _require_new_pairs(table: Table, image: Index, landmark: Index, n_landmarks: int) -> None:
    pair = image * n_landmarks + landmark
    if np.all(np.diff(np.sort(pair))):
        return
    _, first, back = np.unique(pair, return_index=True, return_inverse=True)
    earlier = first[back]
    row = int(np.argmax(earlier != np.arange(pair.size)))
    ids = f"{show(table.texts['landmark_id'][row])} in image {show(table.texts['image_id'][row])}"
    where = f"{table.source}, row {table.row_number(row)}, column landmark_id"
    first_row = table.row_number(int(earlier[row]))
    raise InputError(f"{where}: found {ids} again (first in row {first_row}), wanted each pair once")


def _pixels(table: Table, grid: Grid) -> tuple[Array, Array, Array]:
    """Column, row and sigma; a pixel must lie in the image as its user counts, then (0, 0) is moved to our
    place."""
    table.require(table.numbers["sigma_px"] > 0.0, "sigma_px", "a positive number of pixels")
    for name, count in (("column_px", grid.columns), ("row_px", grid.rows)):
        low, high = bounds_px(count, grid.shift_px)
        x = table.numbers[name]
        table.require((x >= low) & (x <= high), name, f"{low:.12g} to {high:.12g}, the image")
    shift = grid.shift_px
    return table.numbers["column_px"] - shift, table.numbers["row_px"] - shift, table.numbers["sigma_px"]


def bounds_px(count: float, shift_px: float) -> tuple[float, float]:
    """First and last coordinate, as its user counts, of an image of ``count`` columns or rows, finite or not."""
    low = shift_px - 0.5
    return (low, low + count) if np.isfinite(count) else (-MOST_ROWS, MOST_ROWS)


def _roles(table: Table) -> NDArray[np.bool_]:
    roles = table.texts.get("role")
    if roles is None:
        return np.zeros(len(table), dtype=np.bool_)
    if unknown := set(roles) - {"control", "check"}:
        row = next(row for row, role in enumerate(roles) if role in unknown)
        raise table.error(row, "role", roles[row], '"control" or "check"')
    check = np.fromiter(map("check".__eq__, roles), dtype=np.bool_, count=len(roles))
    if check.all():
        raise InputError(
            f"{table.source}, column role: found only check points, wanted some with the role control"
        )
    return check


def _unseen(source: TableSource, kind: str, ids: Sequence[str], seen: Index) -> list[str]:
    """A notice about images or landmarks without a row."""
    unseen = [ids[i] for i in np.flatnonzero(np.bincount(seen, minlength=len(ids)) == 0).tolist()]
    if not unseen:
        return []
    named = ", ".join(unseen[:3]) + (f" and {len(unseen) - 3} more" if len(unseen) > 3 else "")
    return [f"{source}: found no row of the {kind}{'s' * (len(unseen) > 1)} {named}, so it adds nothing"]
