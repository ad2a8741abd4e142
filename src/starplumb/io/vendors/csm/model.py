"""What a model state and an ISD both describe: one image with its optics, orbit and attitude."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ....physics.errors import InputError
from .optics import CsmOptics

Array = NDArray[np.float64]

EARTH_M = (6.35e6, 6.39e6)
"""Radii that an ellipsoid of the Earth has; these models serve all planets."""


@dataclass(frozen=True)
class CsmModel:
    """Times are seconds after J2000 in TDB where the file knows the day, ``dated``; else after something of its own.

    ``q_FC`` (n, 4) takes the camera's axes C to the frame F, ``r_F`` (m, 3) m and ``v_F`` m/s or None. ``lines`` are
    (k, 3): a line (0.5 the centre of the first), its time, and the duration of the lines from there on; None for a
    frame, which is exposed at ``time_s``.
    """

    path: Path
    name: str
    size: tuple[int, int]
    optics: CsmOptics
    frame: Literal["ITRF", "GCRF"]
    orbit_s: Array
    r_F: Array
    v_F: Array | None
    attitude_s: Array
    q_FC: Array
    time_s: float
    lines: Array | None
    dated: bool


def require_earth(path: Path, major_m: float, minor_m: float) -> None:
    """Raise InputError for the ellipsoid of another planet."""
    if not (EARTH_M[0] < minor_m <= major_m < EARTH_M[1]):
        raise InputError(
            f"{path}: found an ellipsoid of {major_m / 1e3:.6g} and {minor_m / 1e3:.6g} km, wanted the Earth's"
        )


def require_whole(path: Path, start: tuple[float, float], summing: tuple[float, float]) -> None:
    """Raise InputError for a frame that is a part of its detector, or binned: versions of the model differ about it."""
    if start != (0.0, 0.0) or summing != (1.0, 1.0):
        found = f"found a frame that starts at {start} with {summing} detectors summed"
        raise InputError(f"{path}: {found}, wanted the whole detector, nothing summed")
