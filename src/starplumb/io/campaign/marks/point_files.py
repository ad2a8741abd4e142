"""Files of ground points in place of the tables of landmarks and observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ....physics.errors import InputError
from ...gis.heights import Ground
from ...points.ground_points import GroundPoints
from ...points.read import read_ground_points
from ...tables.cells import Array
from ...tables.columns import GEODETIC, SIGMA_ENU
from ...tables.declared import Declared
from ...tables.read import Table
from ...text.files import show
from .ground_tables import Merged


@dataclass(frozen=True)
class PointFiles:
    """Files of ground points by their ``names`` in a folder, read as one table; ``crs`` is the reference system of
    those that do not state it."""

    folder: Path
    names: tuple[str, ...]
    crs: str | None = None

    def __str__(self) -> str:
        more = f" and {len(self.names) - 1} more" if len(self.names) > 1 else ""
        return f"{self.folder / self.names[0]}{more}"

    @classmethod
    def of(
        cls, folder: Path, named: str | Sequence[str], crs: str | None, endings: tuple[str, ...]
    ) -> PointFiles | None:
        """The files that a campaign names, one, several or by a pattern; None where they do not all end so.

        Raises InputError for a pattern that no file fits.
        """
        given = [named] if isinstance(named, str) else list(named)
        if not all(name.lower().endswith(endings) for name in given):
            return None
        names = [name for pattern in given for name in _expanded(folder, pattern)]
        return cls(folder, tuple(dict.fromkeys(names)), crs)

    @property
    def paths(self) -> tuple[Path, ...]:
        return tuple(map(self.folder.joinpath, self.names))

    @cached_property
    def files(self) -> list[tuple[Path, GroundPoints]]:
        """What each file holds."""
        return [(path, read_ground_points(path, self.crs)) for path in self.paths]

    def observations(self, declared: Declared, shift_px: float) -> Table:
        """The sightings as a table, its pixels counted by a user whose count is ``shift_px`` ahead of ours.

        Points at the very same place are one landmark, named as first met.
        """
        merged, notices = self._merged(None)
        images, landmarks, column, row, sigma = (list(each) for each in zip(*merged.sightings, strict=True))
        numbers = {"column_px": np.array(column) + shift_px, "row_px": np.array(row) + shift_px}
        numbers |= self._stated(("sigma_px",), np.array(sigma)[:, None])
        places = [f"{path}, point {name}" for path, name in zip(merged.found_in, landmarks, strict=True)]
        texts: dict[str, Sequence[str]] = {
            "image_id": list(map(str, images)),
            "landmark_id": list(map(str, landmarks)),
        }
        table = Table(self, numbers, texts, len(places), int, notices, declared, places)
        return self._with_sigma(table.with_stated(), "sigma_px")

    def landmarks(self, ground: Ground, declared: Declared, notices: list[str]) -> Table:
        """The places as a table, their heights those of the files or of ``ground``."""
        merged, told = self._merged(ground)
        notices += told
        names, *values = zip(*merged.places.values(), strict=True)
        columns = np.array(values, dtype=np.float64)
        numbers = dict(zip(GEODETIC, columns[:3], strict=True)) | self._stated(SIGMA_ENU, columns[3:].mT)
        texts: dict[str, Sequence[str]] = {"landmark_id": list(map(str, names))}
        places = [f"{self}, point {name}" for name in names]
        table = Table(self, numbers, texts, len(places), int, [], declared, places)
        return self._with_sigma(table.with_stated(), SIGMA_ENU[0])

    def _merged(self, ground: Ground | None) -> tuple[Merged, list[str]]:
        merged = Merged()
        notices: list[str] = []
        for path, points in self.files:
            notices += points.notices
            height = np.zeros(len(points.landmark_id))
            if ground is not None:
                own = None if np.isnan(points.height).all() else points.height
                height = ground.ellipsoidal(path, own, points.latitude, points.longitude, points.landmark_id)
            merged.add(path, points, height, points.sigma_enu, points.sigma_px)
        return merged, notices

    def _stated(self, names: Sequence[str], values: Array) -> dict[str, Array]:
        """Columns of the files' own sigmas (n, k), none where they have none."""
        known = np.isfinite(values).all(axis=1)
        if known.any() and not known.all():
            raise InputError(f"{self}: found sigmas for some of the points only, wanted them for all or none")
        return dict(zip(names, values.mT, strict=True)) if known.all() else {}

    def _with_sigma(self, table: Table, name: str) -> Table:
        if name not in table.numbers:
            key = "sigma_px" if name == "sigma_px" else "sigma_m"
            raise InputError(f"{self}: found no sigmas, wanted them stated ({table.declared.key}.{key})")
        return table


def _expanded(folder: Path, pattern: str) -> list[str]:
    """The names of files that fit a pattern, in their order; of a plain name that name."""
    place = folder / pattern
    if place.exists() or not any(mark in place.name for mark in "*?["):
        return [pattern]
    if names := sorted(found.name for found in place.parent.glob(place.name)):
        return [str(Path(pattern).with_name(name)) for name in names]
    raise InputError(f"{folder}: found no file that fits {show(pattern)}, wanted at least one")
