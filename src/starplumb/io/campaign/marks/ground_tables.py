"""Ground points of other programs as ``landmarks.csv`` and ``observations.csv``, with heights and sigmas supplied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....physics.errors import InputError
from ....physics.units import DEG
from ...gis.heights import Ground
from ...points.ground_points import GroundPoints
from ...points.read import read_ground_points
from ...tables.columns import GEODETIC, SIGMA_ENU
from ...text.files import composed, show
from ...text.numbers import SIGMA_WORDS, is_sigma
from ...text.write import csv_text

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sigmas:
    """What the user says about sigmas, for files that have none."""

    enu_m: tuple[float, float, float] | None = None
    px: float | None = None

    def of(self, path: Path, points: GroundPoints) -> tuple[Array, Array]:
        """Sigmas east, north, up (n, 3) m and of the pixels (n,); InputError where stated twice, or not at all."""
        n = len(points.landmark_id)
        enu = _only(path, "--sigma-m", points.sigma_enu, self.enu_m, "sigmas of the places")
        px = _only(path, "--sigma-px", points.sigma_px, self.px, "sigmas of the pixels")
        for what, values, good in (
            ("a pixel sigma", px, is_sigma(px, exact=False)),
            ("a sigma", enu, is_sigma(enu)),
        ):
            if not np.all(good):
                found = np.ravel(values)[np.argmin(good)]
                raise InputError(
                    f"{path}: found {what} of {found:g}, wanted a positive number, {SIGMA_WORDS}"
                )
        return np.broadcast_to(enu, (n, 3)), np.broadcast_to(px, (n,))


def _only(path: Path, option: str, own: Array, stated: object, what: str) -> Array:
    """The file's own values or the stated one."""
    missing = np.isnan(own).all()
    if missing and stated is None:
        raise InputError(f"{path}: found no {what}, wanted them stated ({option})")
    if not missing and stated is not None:
        raise InputError(f"{path}: found {what} beside {option}, wanted only one of the two")
    return np.asarray(stated, dtype=np.float64) if missing else own


@dataclass(frozen=True)
class GroundTables:
    """Texts of the two tables by file name, and what they hold."""

    files: dict[str, str]
    landmarks: int
    observations: int
    images: list[str]


def tables(
    paths: Sequence[Path], ground: Ground, sigmas: Sigmas, crs: str | None
) -> tuple[GroundTables, list[str]]:
    """The tables of one or several files, and notices for the user.

    Points at the same place are one landmark, named as first met.  Raises InputError for one name at two places, and
    for a landmark that is twice in one image.
    """
    merged = Merged()
    notices: list[str] = []
    for path in paths:
        points = read_ground_points(path, crs)
        notices += points.notices
        height = None if np.isnan(points.height).all() else points.height
        height = ground.ellipsoidal(path, height, points.latitude, points.longitude, points.landmark_id)
        merged.add(path, points, height, *sigmas.of(path, points))
    observations = list(zip(*merged.sightings, strict=True))
    landmarks = list(zip(*merged.places.values(), strict=True))
    header = ("image_id", "landmark_id", "column_px", "row_px", "sigma_px")
    files = {
        "landmarks.csv": csv_text(("landmark_id", *GEODETIC, *SIGMA_ENU), landmarks),
        "observations.csv": csv_text(header, observations),
    }
    images = list(dict.fromkeys(observations[0]))
    return GroundTables(
        files, len(merged.places), len(merged.sightings), [str(name) for name in images]
    ), notices


class Merged:
    """Landmarks by their place and sightings, as files are added."""

    def __init__(self) -> None:
        self.places: dict[tuple[float, float, float], tuple[object, ...]] = {}
        self.sightings: list[tuple[object, ...]] = []
        self.found_in: list[Path] = []
        self._named: dict[str, tuple[float, float, float]] = {}
        self._seen: set[tuple[str, str]] = set()

    def add(self, path: Path, points: GroundPoints, height: Array, enu: Array, px: Array) -> None:
        latitude, longitude = points.latitude / DEG, points.longitude / DEG
        for i, name in enumerate(map(composed, points.landmark_id)):
            place = (float(latitude[i]), float(longitude[i]), float(height[i]))
            if self._named.setdefault(name, place) != place:
                raise InputError(
                    f"{path}: found the point {show(name)} at another place again, wanted each name once"
                )
            known = self.places.setdefault(place, (name, *place, *enu[i].tolist()))
            pair = (composed(points.image_id[i]), str(known[0]))
            if pair in self._seen:
                raise InputError(
                    f"{path}: found {show(pair[1])} twice in image {show(pair[0])}, wanted it once"
                )
            self._seen.add(pair)
            self.found_in.append(path)
            self.sightings.append((*pair, float(points.column_px[i]), float(points.row_px[i]), float(px[i])))
