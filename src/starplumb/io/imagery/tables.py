"""What measuring writes: landmarks, observations, and a campaign that names them and all that the measured one did."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.earth import itrf_to_geodetic
from ...physics.units import DEG
from ..tables.columns import GEODETIC, SIGMA_ENU
from ..text.write import Column, csv_text

Array = NDArray[np.float64]

REPLACED = ("landmarks", "observations", "detections", "imagery", "reference", "measure")
"""Sections of the measured campaign that the one written has not, or has anew."""


@dataclass(frozen=True)
class Marks:
    """n marks that were measured: ids, ground points p_J (n, 3), pixels (n, 2) as the user counts them with covariances
    (n, 2, 2) px^2, and which are kept for checking (n,)."""

    image_ids: Sequence[str]
    landmark_ids: Sequence[str]
    p_J: Array
    pixel: Array
    covariance_px2: Array
    check: NDArray[np.bool_]

    def landmarks(self, sigma_m: Sequence[float]) -> str:
        """The table of landmarks, each with the reference's sigma east, north, up."""
        latitude, longitude, height = itrf_to_geodetic(self.p_J)
        n = len(self.landmark_ids)
        sigmas = [np.full(n, float(sigma)) for sigma in sigma_m]
        columns: list[Column] = [self.landmark_ids, latitude / DEG, longitude / DEG, height, *sigmas]
        return csv_text(("landmark_id", *GEODETIC, *SIGMA_ENU), columns)

    def detections(self) -> str:
        """The table of detections: the same without what they are of."""
        return self._table(labelled=False)

    def observations(self) -> str:
        """The table of observations with their ellipses."""
        return self._table(labelled=True)

    def _table(self, labelled: bool) -> str:
        sigma = np.sqrt(np.diagonal(self.covariance_px2, axis1=-2, axis2=-1))
        correlation = self.covariance_px2[:, 0, 1] / np.prod(sigma, axis=-1)
        role = np.where(self.check, "check", "control").tolist()
        sigmas = ("sigma_column_px", "sigma_row_px", "correlation")
        ellipse: list[Column] = [*self.pixel.mT, *sigma.mT, correlation]
        if not labelled:
            return csv_text(("image_id", "column_px", "row_px", *sigmas), [self.image_ids, *ellipse])
        header = ("image_id", "landmark_id", "column_px", "row_px", *sigmas, "role")
        return csv_text(header, [self.image_ids, self.landmark_ids, *ellipse, role])


def campaign_text(
    text: str,
    folder: Path,
    out: Path,
    names: Iterable[str],
    correlation_length_m: float | None,
    marks: str = "observations",
) -> str:
    """``campaign.toml`` as it stands, but with the tables measured (landmarks and ``marks``), and with the names of its
    files (``names``) as they are from the folder ``out``."""
    import tomlkit

    document = tomlkit.parse(text)
    for section in REPLACED:
        if section in document:
            del document[section]
    moved = {name: Path(os.path.relpath(folder / name, out)).as_posix() for name in names}
    _rename(document, moved)
    landmarks = tomlkit.table()
    landmarks.add("file", "landmarks.csv")
    if correlation_length_m is not None:
        landmarks.add("correlation_length_m", correlation_length_m)
    measured = tomlkit.table()
    measured.add("file", f"{marks}.csv")
    document["landmarks"], document[marks] = landmarks, measured
    return tomlkit.dumps(document)


FILE_KEYS = ("file", "look_angles", "orientation_file", "kernels")


def _rename(table: MutableMapping[str, Any], moved: Mapping[str, str]) -> None:
    """Replace the names of files in a table and in those within it."""
    for key, value in list(table.items()):
        if isinstance(value, dict):
            _rename(value, moved)
        elif isinstance(value, list):
            if key in FILE_KEYS:
                value[:] = [moved.get(str(name), name) for name in value]
            for part in value:
                if isinstance(part, dict):
                    _rename(part, moved)
        elif key in FILE_KEYS and str(value) in moved:
            table[key] = moved[str(value)]
