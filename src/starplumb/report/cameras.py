"""Several cameras on the terminal: the mounting of each, and of each against the first."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..judge.calibrate import Calibration
from ..judge.mountings import Mountings, mountings
from ..physics.units import ARCSEC
from .page import Table

Array = NDArray[np.float64]


def tables_of_cameras(c: Calibration) -> Iterator[Table]:
    """The corrections of all cameras with their sigmas, and the sigmas of each against the first; nothing for one."""
    found = mountings(c)
    if found is not None and len(found.names) > 1:
        yield Table("Mountings", ("arcsec about", "x", "y", "z"), list(_rows(found)))


def _rows(found: Mountings) -> Iterator[tuple[str, ...]]:
    first = found.names[0]
    for k, name in enumerate(found.names):
        P = found.covariance_of(k)
        told = ("not valid",) * 3 if P is None else _fixed(found.correction_E[k])
        yield f"{name}: correction", *told
        yield f"{name}: sigma", *_sigma(P)
        if k:
            yield f"{name} against {first}: sigma", *_sigma(found.covariance_against_first(k))


def _sigma(P: Array | None) -> tuple[str, ...]:
    return ("not valid",) * 3 if P is None else _fixed(np.sqrt(np.diagonal(P)))


def _fixed(angles: Array) -> tuple[str, ...]:
    return tuple(f"{angle / ARCSEC:.3f}" for angle in angles)
