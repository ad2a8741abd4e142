"""What every reader of ground points returns, and how images are named."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ..text.files import show
from ..text.numbers import finite_float, number

Array = NDArray[np.float64]

_IMAGE_ENDINGS = re.compile(
    r"(\.(tiff?|jp2|j2k|png|jpe?g|img|ntf|nitf|cub|vrt|hdr|bil|bip|bsq|dat|raw|pix|h5|nc|aux|ovr))+\Z",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class GroundPoints:
    """n sightings of ground points, one row each.

    ``landmark_id`` and ``image_id`` (n,) names; ``latitude``, ``longitude`` (n,) rad; ``height`` (n,) m as the file has
    it, NaN where it has none; ``column_px``, ``row_px`` (n,) with (0, 0) the centre of the first pixel; ``sigma_enu``
    (n, 3) m and ``sigma_px`` (n,), NaN where the file has none.
    """

    landmark_id: tuple[str, ...]
    image_id: tuple[str, ...]
    latitude: Array
    longitude: Array
    height: Array
    column_px: Array
    row_px: Array
    sigma_enu: Array
    sigma_px: Array
    notices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Row:
    """A sighting as a file has it, at ``where``: place in the file's system, pixel from the centre of the first."""

    where: str
    name: str
    image: str
    x: float
    y: float
    height: float
    column_px: float
    row_px: float


def image_id(text: str) -> str:
    """The id of an image by the name of its file: without folder and the ending of an image, dots within kept."""
    name = re.split(r"[/\\]", text.strip())[-1]
    return _IMAGE_ENDINGS.sub("", name) or name


def finite(where: str, text: object, what: str = "a finite number") -> float:
    """The number that a text is.  Raises InputError."""
    value = number(text) if isinstance(text, str) else finite_float(text)
    if value is None or not np.isfinite(value):
        raise InputError(f"{where}: found {show(text)}, wanted {what}")
    return value


def require_heights_alike(rows: Sequence[Row]) -> Array | None:
    """Heights (n,) m, None where there are none.  Raises InputError where only some points have one."""
    height = np.array([row.height for row in rows])
    without = np.isnan(height)
    if without.all():
        return None
    if without.any():
        where = rows[int(np.argmax(without))].where
        raise InputError(f"{where}: found no height beside points that have one, wanted all of them or none")
    return height
