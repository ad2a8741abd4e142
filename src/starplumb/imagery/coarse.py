"""Whole images, binned for the search, and what is wrong with those that are not worth one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..physics.errors import InputError
from .matching.orientation import orientation
from .scene import Raw, Scene, reduced

Array = NDArray[np.float64]

LEAST_KNOWN = 0.1
"""Part of an image that must have data, and that must not be saturated."""


@dataclass(frozen=True)
class Coarse:
    """An image binned (h, w); ``unfit`` says why it cannot be looked for, or is empty."""

    values: Array
    unfit: str = ""

    @cached_property
    def orientation(self) -> NDArray[np.complex128]:
        """Its orientations (h, w), 0 everywhere where it is unfit."""
        return orientation(np.full_like(self.values, np.nan) if self.unfit else self.values)


def coarse_images(scene: Scene, factor: int) -> list[Coarse]:
    """The images of a scene, binned; one that cannot be read, or shows nothing, is unfit."""
    return [_coarse(raw, factor, scene.saturation_dn) for raw in scene.raws]


def _coarse(raw: Raw, factor: int, saturation_dn: float | None) -> Coarse:
    try:
        values = reduced(raw, factor)
    except InputError as error:
        columns, rows = raw.size_px
        return Coarse(np.full((max(rows // factor, 1), max(columns // factor, 1)), np.nan), str(error))
    return Coarse(values, _unfit(values, saturation_dn))


def _unfit(values: Array, saturation_dn: float | None) -> str:
    known = values[np.isfinite(values)]
    if known.size < LEAST_KNOWN * values.size:
        part = 100.0 * (1.0 - known.size / max(values.size, 1))
        return f"{part:.0f} % of its pixels have no data: another band or file, or another imagery.nodata"
    if float(np.ptp(known)) == 0.0:
        return f"all of its pixels have the value {known[0]:g}: another band, or a file that was never filled"
    if saturation_dn is not None:
        full = float(np.mean(known >= saturation_dn))
        if full > 1.0 - LEAST_KNOWN:
            return (
                f"{100.0 * full:.0f} % of its pixels are full (imagery.saturation_dn = {saturation_dn:g}): "
                "overexposed, or a saturation that is not the file's"
            )
    return ""
