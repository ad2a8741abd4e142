"""Tables of observations and detections, as the parts of a campaign they become."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....physics.covariance import ellipse_of, ellipse_parts
from ....physics.errors import InputError
from ....table.appearance import MOST_ROWS
from ....table.campaign import Detections, Sightings
from ...tables.cells import Array
from ...tables.columns import SIGMA_PX
from ...tables.declared import UNDECLARED, Declared
from ...tables.lookup import places
from ...tables.read import Table, TableSource, read_table
from ...text.files import nearest, show
from ...text.numbers import SIGMA_WORDS, is_sigma
from .point_files import PointFiles

Index = NDArray[np.int64]
CORRELATED = 0.9999
"""Correlation of column and row up to which a mark is measured in two directions: beyond, rounding decides."""


@dataclass(frozen=True)
class Grid:
    """Pixels of an image as its user counts them: ``shift_px`` from ours (0.5 where (0, 0) is a corner), and
    how many."""

    columns: float
    rows: float
    shift_px: float


@dataclass(frozen=True)
class Grids:
    """The pixels of several cameras by name, all counted from one place, and which of them took each image (m,)."""

    of_camera: dict[str, Grid]
    of_image: Index

    @classmethod
    def of_one(cls, grid: Grid, images: int) -> Grids:
        return cls({"": grid}, np.zeros(images, dtype=np.int64))

    @property
    def shift_px(self) -> float:
        return next(iter(self.of_camera.values())).shift_px


def read_observations(
    source: TableSource | PointFiles,
    images: Sequence[str],
    landmarks: Sequence[str],
    grid: Grid | Grids,
    notices: list[str],
    declared: Declared = UNDECLARED,
    surveyed: object = "the table of landmarks",
) -> tuple[Sightings, Table]:
    """Sightings of known landmarks, and the table that names their rows (its columns dropped).

    Every row is taken or refused, images and landmarks without one are reported; ``surveyed`` is what messages call
    the landmarks.
    """
    if isinstance(source, PointFiles):
        table = source.observations(declared, grid.shift_px)
    else:
        table = read_table(
            source,
            texts=("image_id", "landmark_id"),
            numbers=("column_px", "row_px", "sigma_px"),
            optional_texts=("role",),
            declared=declared,
            may_be_empty=True,
            instead={"sigma_px": SIGMA_PX},
            each=_Pieces(images, landmarks, grid),
        )
    notices += table.notices
    if len(table) and not landmarks:
        raise InputError(
            f"{surveyed}: found it without rows beside {len(table)} observations, wanted at least one row"
        )
    image, landmark = _marked(table, images, landmarks)
    _require_new_pairs([table], image * len(landmarks) + landmark, images, landmarks)
    pixels, check = _pixels(table, grid, image), _roles(table)
    if len(table):
        notices += _unseen(source, "image", images, image) + _unseen(source, "landmark", landmarks, landmark)
    return Sightings(image, landmark, check=check, **pixels), bare(table)


@dataclass
class _Pieces:
    """Observations looked at some at a time, before all of them are held."""

    images: Sequence[str]
    landmarks: Sequence[str]
    grid: Grid | Grids
    rows: list[Table] = field(default_factory=list)
    pairs: list[Index] = field(default_factory=list)

    def __call__(self, table: Table | None) -> None:
        if table is None:
            pair = np.concatenate(self.pairs)
            self.pairs.clear()
            _require_new_pairs(self.rows, pair, self.images, self.landmarks)
            return
        image, landmark = _marked(table, self.images, self.landmarks)
        _pixels(table, self.grid, image)
        _roles(table)
        self.rows.append(bare(table))
        self.pairs.append(image * len(self.landmarks) + landmark)


def _marked(table: Table, images: Sequence[str], landmarks: Sequence[str]) -> tuple[Index, Index]:
    """Image and landmark (n,) of observations."""
    image = _lookup(table, "image_id", images, "images")
    return image, _lookup(table, "landmark_id", landmarks, "landmarks")


def read_detections(
    source: TableSource,
    images: Sequence[str],
    grid: Grid | Grids,
    notices: list[str],
    declared: Declared = UNDECLARED,
) -> tuple[Detections, Table]:
    """Marker images whose landmark is not known, and the table that names their rows (its columns dropped)."""

    def look(part: Table | None) -> None:
        if part is not None:
            _pixels(part, grid, _lookup(part, "image_id", images, "images"))

    table = read_table(
        source,
        texts=("image_id",),
        numbers=("column_px", "row_px", "sigma_px"),
        declared=declared,
        instead={"sigma_px": SIGMA_PX},
        each=look,
    )
    notices += table.notices
    image = _lookup(table, "image_id", images, "images")
    notices += _unseen(source, "image", images, image)
    return Detections(image, **_pixels(table, grid, image)), bare(table)


def bare(table: Table) -> Table:
    """The rows of a table without what they hold."""
    return replace(table, numbers={}, texts={})


def _lookup(table: Table, column: str, known: Sequence[str], what: str) -> Index:
    """Index of each id among the known ones. Raises InputError about the first that is not."""
    ids = table.texts[column]
    index = places(ids, known)
    if (index < 0).any():
        row = int(np.argmax(index < 0))
        wanted = f"one of the {len(known)} {what} of the campaign{meant(ids[row], known)}"
        raise table.error(row, column, ids[row], wanted)
    return index


def meant(name: str, known: Sequence[str]) -> str:
    """What an unknown id may have been meant to be, in brackets; programs that take ids for numbers lose zeros."""
    bare = name.lstrip("0")
    if padded := [other for other in known if other.lstrip("0") == bare]:
        return f" (perhaps {show(padded[0])}, with zeros before it: have the column read as text)"
    near = nearest(name, known)
    return f" (perhaps {show(near)})" if near else ""


def _require_new_pairs(
    parts: Sequence[Table], pair: Index, images: Sequence[str], landmarks: Sequence[str]
) -> None:
    """Raise InputError where an image and a landmark (counted as ``image * landmarks + landmark``) are together again,
    in a table or in its parts."""
    if not _again(np.sort(pair)).any():
        return
    order = np.argsort(pair, kind="stable")
    row = int(np.min(order[1:][_again(pair[order])]))
    earlier = int(np.argmax(pair == pair[row]))
    image, landmark = divmod(int(pair[row]), len(landmarks))
    starts = np.cumsum([0, *map(len, parts)])

    def part_of(row: int) -> tuple[Table, int]:
        k = int(np.searchsorted(starts, row, side="right")) - 1
        return parts[k], row - int(starts[k])

    table, at = part_of(row)
    first, first_at = part_of(earlier)
    found = f"found {show(landmarks[landmark])} in image {show(images[image])} again"
    where = table.where(at, "landmark_id")
    raise InputError(f"{where}: {found} (first in row {first.row_number(first_at)}), wanted each pair once")


def _again(ordered: Index) -> NDArray[np.bool_]:
    """Which of ordered values but the first are as the one before."""
    return np.asarray(ordered[1:] == ordered[:-1])


def _pixels(table: Table, grid: Grid | Grids, image: Index) -> dict[str, Any]:
    """Column, row and their noise; a pixel must lie in the image as its user counts, then (0, 0) is moved to our
    place."""
    noise = _noise(table)
    grids = grid if isinstance(grid, Grids) else Grids.of_one(grid, int(np.max(image, initial=0)) + 1)
    for k, (camera, own) in enumerate(grids.of_camera.items()):
        others = grids.of_image[image] != k
        for name, count in (("column_px", own.columns), ("row_px", own.rows)):
            low, high = bounds_px(count, own.shift_px)
            x = table.numbers[name]
            whose = f" of the camera {camera}" if len(grids.of_camera) > 1 else ""
            table.require(
                others | ((x >= low) & (x <= high)), name, f"{low:.12g} to {high:.12g}, the image{whose}"
            )
    shift = grids.shift_px
    column, row = table.numbers["column_px"] - shift, table.numbers["row_px"] - shift
    return {"column_px": column, "row_px": row, **noise}


def _noise(table: Table) -> dict[str, Array | None]:
    """``sigma_px`` and ``ellipse`` of the marks, from one sigma or from two and their correlation."""
    wanted = f"a positive number of pixels, {SIGMA_WORDS}"
    if SIGMA_PX[0] not in table.numbers:
        table.require(is_sigma(table.numbers["sigma_px"], exact=False), "sigma_px", wanted)
        return {"sigma_px": table.numbers["sigma_px"], "ellipse": None}
    if "sigma_px" in table.numbers:
        found = f"found the column {table.declared.name(SIGMA_PX[0])} beside {table.declared.key}.sigma_px"
        raise InputError(f"{table.source}: {found}, wanted only one of the two")
    column, row, correlation = (table.numbers[name] for name in SIGMA_PX)
    for name in SIGMA_PX[:2]:
        table.require(is_sigma(table.numbers[name], exact=False), name, wanted)
    limit = f"a correlation of column and row, from -{CORRELATED} to {CORRELATED}"
    table.require(np.abs(correlation) <= CORRELATED, SIGMA_PX[2], limit)
    sigma, ellipse = ellipse_of(column, row, correlation)
    return {"sigma_px": sigma, "ellipse": ellipse}


def noise_columns(marks: Sightings | Detections) -> tuple[tuple[str, ...], tuple[Array, ...]]:
    """Names and columns of the noise of marks: one sigma, or two and their correlation."""
    if marks.ellipse is None:
        return ("sigma_px",), (marks.sigma_px,)
    return SIGMA_PX, ellipse_parts(marks.sigma_px, marks.ellipse)


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
    return np.fromiter(map("check".__eq__, roles), dtype=np.bool_, count=len(roles))


def _unseen(source: object, kind: str, ids: Sequence[str], seen: Index) -> list[str]:
    """A notice about images or landmarks without a row."""
    unseen = [ids[i] for i in np.flatnonzero(np.bincount(seen, minlength=len(ids)) == 0).tolist()]
    if not unseen:
        return []
    named = ", ".join(unseen[:3]) + (f" and {len(unseen) - 3} more" if len(unseen) > 3 else "")
    return [f"{source}: found no row of the {kind}{'s' * (len(unseen) > 1)} {named}, so it adds nothing"]
