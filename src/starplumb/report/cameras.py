"""Several cameras on the terminal and in a report: the mounting of each, and of each against the first."""

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


def cameras_section(c: Calibration) -> tuple[tuple[str, ...], tuple[()], tuple[Table, ...]]:
    """Sentences, figures and tables of a report about cameras against each other; nothing for one."""
    tables, found = tuple(tables_of_cameras(c)), mountings(c)
    if not tables or found is None:
        return (), (), ()
    return tuple(_sentences(found)), (), tables


def _sentences(found: Mountings) -> Iterator[str]:
    """How well each camera is known against the first, and how well by what two calibrations apart would say."""
    own = found.covariance_of(0)
    for k, name in enumerate(found.names[1:], start=1):
        P, both = found.covariance_of(k), found.covariance_against_first(k)
        if own is None or P is None or both is None:
            yield f"{name} against {found.names[0]}: not known."
            continue
        sigma, apart = np.sqrt(np.diagonal(both)), np.sqrt(np.diagonal(own) + np.diagonal(P))
        yield (
            f"{name} against {found.names[0]} is known to {', '.join(f'{x / ARCSEC:.2g}' for x in sigma)} arcsec "
            f"about the star tracker's x, y, z; the two mountings, taken as independent, would leave "
            f"{', '.join(f'{x / ARCSEC:.2g}' for x in apart)}: what both cameras share cancels."
        )


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
