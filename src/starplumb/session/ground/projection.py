"""From the ground to pixels: one place, a table of places or the campaign's own landmarks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ...disk.owned import require_own
from ...documents.numbers import numbers
from ...ground.projection import Projected, projected
from ...io.campaign.marks.sites import Sites, one_site, read_sites
from ...io.gis.heights import Ground, Heights
from ...io.tables.columns import CARTESIAN, GEODETIC
from ...io.tables.read import Frame as TableFrame
from ...io.tables.read import Table, TableSource
from ...io.text.files import read_beginning
from ...io.text.write import csv_text, write_text
from ...physics.errors import ArgumentError
from ...table.appearance import Seen
from ..arguments import Folder, NotNegative, Wanted, checked
from ..campaign import Campaign
from ..frames import Frame
from ..mounting import alone, mounting_of
from ..result import Result
from ..show import Shown
from .location import image_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Coordinates = Annotated[Sequence[float], Wanted("three numbers")]

_WORDS = {
    Seen.BESIDE: "beside the image",
    Seen.BELOW_HORIZON: "below the horizon",
    Seen.NOT_COVERED: "outside attitude or orbit",
}
_KEYS = {
    Seen.BESIDE: "beside_the_image",
    Seen.BELOW_HORIZON: "below_the_horizon",
    Seen.NOT_COVERED: "not_covered",
}
PIXELS = "pixels.csv"
HEADER = ("image_id", "landmark_id", "column_px", "row_px", "sigma_column_px", "sigma_row_px", "correlation")
MOST_NAMED = 5


@dataclass(frozen=True, repr=False, eq=False)
class Projection(Shown):
    """Places in images: what :func:`starplumb.project` returns.  ``document`` is what --json prints."""

    document: dict[str, Any]
    sources: tuple[Path, ...] = ()

    @property
    def frame(self) -> Frame:
        """A row for each image in which a place appears: pixel, and sigmas with their correlation (NaN: not stated)."""
        rows = [_row(point) for point in self.document["points"]]
        columns = list(map(list, zip(*rows, strict=True))) if rows else [[] for _ in HEADER]
        return Frame("Places in images", HEADER, tuple(columns))

    @property
    def csv(self) -> str:
        """The same as a CSV table; a sigma that is not stated is left empty."""
        frame = self.frame
        numbers_of = [
            np.ma.masked_invalid(np.array(column, dtype=np.float64)) for column in frame.columns[2:]
        ]
        return csv_text(HEADER, [*frame.columns[:2], *numbers_of])

    @checked
    def save(self, folder: Folder) -> None:
        """Write ``pixels.csv``.  Raises InputError where another file has that name."""
        place = Path(folder) / PIXELS
        require_own(place, self.sources, _is_pixels)
        write_text(place, self.csv)

    @property
    def notices(self) -> Sequence[str]:
        """What should be known of the mounting and the places."""
        return tuple(self.document["notices"])

    @property
    def told(self) -> Sequence[str]:
        """What was left out."""
        counts = {_WORDS[why]: self.document["left_out"][key] for why, key in _KEYS.items()}
        parts = [f"{count} {words}" for words, count in counts.items() if count]
        lines = [f"left out: {', '.join(parts)} (pairs of image and place)"] if parts else []
        if names := self.document["in_no_image"]:
            more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
            lines.append(f"in no image: {', '.join(names[:MOST_NAMED])}{more}")
        return tuple(lines)

    @property
    def answer(self) -> Sequence[str]:
        """A line for each image in which a place appears."""
        return tuple(map(_sentence, self.document["points"]))

    @property
    def sentences(self) -> Sequence[str]:
        d = self.document
        shown = self.answer[:MOST_NAMED]
        more = [f"... {len(self.answer) - len(shown)} more"] if len(self.answer) > len(shown) else []
        notes = (f"note: {notice}" for notice in self.notices)
        return (*shown, *more, f"mounting: {d['mounting']}", *self.told, *notes)


@checked
def project(
    campaign: Campaign,
    result: Result | str | Path | None = None,
    *,
    latitude_deg: float | None = None,
    longitude_deg: float | None = None,
    height_m: float | None = None,
    itrf_m: Coordinates | None = None,
    points: object | None = None,
    image: str | None = None,
    dem: str | Path | None = None,
    heights: Heights | None = None,
    geoid: str | Path | None = None,
    sigma_m: NotNegative = 0.0,
    sigma_height_m: NotNegative = 0.0,
) -> Projection:
    """The pixels at which places on the ground appear, with their covariance: the inverse of :func:`locate`.

    One place is ``latitude_deg``, ``longitude_deg`` and ``height_m`` above the ellipsoid, or ``itrf_m``: x, y, z.
    ``points`` is a data frame or the path of a table with the columns of landmarks, and ``image_id`` where each place
    is asked for in one image.  Without any of them the places are the campaign's landmarks.  ``image`` asks for one
    image only; ``result`` is as for :func:`locate`.  Places of a table without heights have ``height_m``, or stand on
    a ``dem``; ``sigma_m`` (east, north) and ``sigma_height_m`` are the sigmas of a place that states none.

    A place that does not appear in an image is left out and counted.  Raises InputError where a place, an image, a
    result or a height is unknown, and for an image that attitude or orbit do not cover, unless the campaign was read
    with ``outside="skip"``.
    """
    words = ("dem", "heights", "geoid")
    ground = Ground(
        None if dem is None else Path(dem), heights, None if geoid is None else Path(geoid), words
    )
    source = _source(latitude_deg, longitude_deg, itrf_m, points)
    if source is None:
        marks = campaign.loaded.campaign.landmarks
        sites = Sites(marks.ids, marks.r_J, marks.covariance_J)
    else:
        sites = read_sites(source, ground, height_m, (sigma_m, sigma_m, sigma_height_m))
    return _projection(campaign, result, sites, image)


def _source(
    latitude_deg: float | None, longitude_deg: float | None, itrf_m: Sequence[float] | None, points: object
) -> TableSource | Table | None:
    """The table of the places asked for, one place as a table of one row; None for the campaign's own landmarks."""
    if (latitude_deg is None) != (longitude_deg is None):
        missing, there = ("longitude", "latitude") if longitude_deg is None else ("latitude", "longitude")
        raise ArgumentError(f"{there}_deg", f"found without {missing}_deg, wanted both or neither")
    given = {"latitude_deg": latitude_deg, "itrf_m": itrf_m, "points": points}
    names = [name for name, value in given.items() if value is not None]
    if len(names) > 1:
        raise ArgumentError(names[1], f"found beside {names[0]}, wanted only one of the two")
    if latitude_deg is not None and longitude_deg is not None:
        return one_site(dict(zip(GEODETIC, (latitude_deg, longitude_deg), strict=False)))
    if itrf_m is not None:
        if len(itrf_m) != 3:
            raise ArgumentError("itrf_m", f"found {len(itrf_m)} numbers, wanted three numbers")
        return one_site(dict(zip(CARTESIAN, itrf_m, strict=True)))
    if points is None:
        return None
    return Path(points) if isinstance(points, str | Path) else TableFrame.of("points", points)


def _projection(
    campaign: Campaign, result: Result | str | Path | None, sites: Sites, image: str | None
) -> Projection:
    loaded, mounting = campaign.loaded, mounting_of(campaign, result)
    parts, stated = [], True
    for own, asked in _by_camera(campaign, _asked(campaign, sites, image)):
        mounting = mounting_of(own, result)
        stated &= mounting.covariance_E is not None
        spread = np.zeros((3, 3)) if mounting.covariance_E is None else mounting.covariance_E
        flown, places = replace(own.loaded.campaign, turn_E=mounting.turn_E), (sites.r_J, sites.covariance_J)
        parts.append(projected(flown, mounting.C_EK, spread, *places, asked, loaded.outside == "skip"))
    found = Projected.joined(parts)
    absent = np.setdiff1d(np.arange(len(sites.ids)), found.site)
    return Projection(
        {
            "schema": "starplumb-projection/1",
            "campaign": campaign.name,
            "mounting": mounting.origin,
            "points": list(_points(campaign, sites, found, stated)),
            "left_out": {_KEYS[why]: count for why, count in found.absent.items()},
            "in_no_image": [sites.ids[i] for i in absent.tolist()],
            "notices": [*mounting.notices, *sites.notices],
        },
        loaded.sources,
    )


def _by_camera(
    campaign: Campaign, asked: list[tuple[int, Index]]
) -> Iterator[tuple[Campaign, list[tuple[int, Index]]]]:
    """The images asked for by the camera that took them, each with the campaign of that camera alone."""
    rig = campaign.loaded.campaign.rig
    of = [0 if rig is None else int(rig.of_image[image]) for image, _ in asked]
    for k in sorted(set(of)):
        mine = [one for one, camera in zip(asked, of, strict=True) if camera == k]
        yield alone(campaign, mine[0][0]), mine


def _asked(campaign: Campaign, sites: Sites, image: str | None) -> list[tuple[int, Index]]:
    """The images asked for, each with its places."""
    every = np.arange(len(sites.ids))
    if image is not None:
        only = image_of(campaign, image)
        if sites.images is not None:
            every = np.flatnonzero([image_of(campaign, name) == only for name in sites.images])
        return [(only, every)]
    if sites.images is None:
        return [(i, every) for i in range(len(campaign.images))]
    of = np.array([image_of(campaign, name) for name in sites.images])
    return [(int(i), np.flatnonzero(of == i)) for i in np.unique(of)]


def _points(campaign: Campaign, sites: Sites, found: Projected, stated: bool) -> Iterable[dict[str, Any]]:
    shift = campaign.loaded.shift_px
    for k in np.lexsort((found.image, found.site)).tolist():
        column, row = found.pixel[k] + shift
        covariance = found.covariance_px[k]
        yield {
            "image_id": campaign.images[found.image[k]],
            "landmark_id": sites.ids[found.site[k]],
            "column_px": float(column),
            "row_px": float(row),
            "sigma_px": numbers(np.sqrt(np.diagonal(covariance))) if stated else None,
            "covariance_px2": numbers(covariance) if stated else None,
        }


def _is_pixels(path: Path) -> bool:
    """Whether a file is such a table: by its first line."""
    return read_beginning(path).startswith(",".join(HEADER).encode())


def _row(point: dict[str, Any]) -> tuple[object, ...]:
    nothing = float("nan")
    sigma = point["sigma_px"] or (nothing, nothing)
    cross = (
        point["covariance_px2"][0][1] / (sigma[0] * sigma[1])
        if point["covariance_px2"] and min(sigma)
        else nothing
    )
    return point["image_id"], point["landmark_id"], point["column_px"], point["row_px"], *sigma, cross


def _sentence(point: dict[str, Any]) -> str:
    sigma = "sigma not stated"
    if point["sigma_px"]:
        sigma = "sigma {:.2f} and {:.2f} px".format(*point["sigma_px"])
    where = f"column {point['column_px']:.3f}, row {point['row_px']:.3f}"
    return f"{point['image_id']}: {point['landmark_id']} at {where}, {sigma}"
