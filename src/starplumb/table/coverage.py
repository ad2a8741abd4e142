"""Which exposures orbit and attitude cover."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics.errors import EpochError
from ..physics.series import COINCIDENCE_NS, Ephemeris
from ..physics.trackers import FusedAttitude
from .campaign import Campaign
from .geometry import stations

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
FEWEST_POSITIONS = 4
"""Positions without velocities that are joined to an orbit."""


def covered(campaign: Campaign, image: Index, row_px: ArrayLike) -> Mask:
    """Whether orbit and attitude cover the exposures (n,) of rows (n,) of images (n,)."""
    t_ns = campaign.images.exposed(image, row_px)
    moving = campaign.corrections.aberration or campaign.camera.scans
    attitude = campaign.attitude
    pointed = (
        np.any(attitude.used(t_ns), axis=0)
        if isinstance(attitude, FusedAttitude)
        else attitude.bursts.covers(t_ns)
    )
    return pointed & _orbit_covers(campaign.ephemeris, t_ns, moving)


def _orbit_covers(orbit: Ephemeris, t_ns: Index, moving: bool) -> Mask:
    """Whether an orbit gives the position at epochs (n,), and the velocity where that is needed (``moving``)."""
    inside = orbit.bursts.covers(t_ns)
    if orbit.v_J is not None:
        return inside
    after = np.clip(np.searchsorted(orbit.t_ns, t_ns), 1, max(orbit.t_ns.size - 1, 1)) % orbit.t_ns.size
    near = np.where(np.abs(orbit.t_ns[after] - t_ns) < np.abs(orbit.t_ns[after - 1] - t_ns), after, after - 1)
    first, last = orbit.bursts.bounds
    enough = last[near] - first[near] + 1 >= FEWEST_POSITIONS
    on_sample = np.abs(orbit.t_ns[near] - t_ns) <= COINCIDENCE_NS
    return np.asarray(inside & (enough | (on_sample & (not moving))))


def why_not(campaign: Campaign, image: int, row_px: float) -> str:
    """The sentence about an exposure that is not covered, naming image and epoch."""
    try:
        stations(campaign, np.array([image]), np.array([row_px]))
    except EpochError as error:
        return str(error)
    return ""
