"""Landmarks that cannot be what the table says: out of sight below the horizon, or one place under several ids."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...physics.earth import C_JT, itrf_to_geodetic
from ...physics.errors import counted
from ...physics.units import DEG
from ...table.campaign import Campaign
from ...table.observations import Observations
from .evidence import NOTICEABLE, Evidence, growth, listed, worst
from .image_errors import ImageErrors

Array = NDArray[np.float64]

SAME_M, SAME_SIGMAS = 1e-3, 0.01
"""Landmarks nearer than the larger of this many metres and of this part of their sigma are one place."""
OBLIQUE = np.array([0.48, 0.64, 0.6])
"""A direction of J along no meridian, parallel or axis, on which regular grids of places do not fall together."""


def places(
    campaign: Campaign, o: Observations, errors: ImageErrors, covariance_E: Array
) -> Iterator[Evidence]:
    """Landmarks below the horizon of an image that shows them, and ids that share a place."""
    yield from _below_horizon(campaign, o)
    yield from _same_place(campaign, o, errors, covariance_E)


def _below_horizon(campaign: Campaign, o: Observations) -> Iterator[Evidence]:
    latitude, longitude, _ = itrf_to_geodetic(o.p_J)
    up_J = C_JT(latitude, longitude)[..., 2]
    look_J = o.r_J - o.p_J
    sine = np.sum(look_J * up_J, axis=-1) / np.linalg.norm(look_J, axis=-1)
    rows = np.flatnonzero((sine < 0.0) & ((o.weight > 0.0) | campaign.sightings.check))
    if rows.size == 0:
        return
    deepest = rows[np.argmin(sine[rows])]
    names = [
        f"{campaign.landmarks.ids[o.landmark[i]]} in {campaign.images.ids[campaign.sightings.image[i]]}"
        for i in rows[:10]
    ]
    names += [""] * (rows.size - len(names))
    yield Evidence(
        "horizon",
        f"{counted(rows.size, 'sighting')} of landmarks below the horizon of the image: {listed(names)} "
        f"(the lowest by {-np.arcsin(sine[deepest]) / DEG:.1f} deg); the place, the image's time or the label is wrong",
        "correct or remove these rows",
        weakens=bool(np.any(o.weight[rows] > 0.0)),
        rows=tuple(name for name in names if name),
    )


def _same_place(
    campaign: Campaign, o: Observations, errors: ImageErrors, covariance_E: Array
) -> Iterator[Evidence]:
    used = np.unique(o.landmark[(o.weight > 0.0) & campaign.landmarks.surveyed[o.landmark]])
    r_J, covariance = campaign.landmarks.r_J[used], campaign.landmarks.covariance_J[used]
    reach = np.maximum(SAME_M, SAME_SIGMAS * np.sqrt(np.trace(covariance, axis1=-2, axis2=-1) / 3.0))
    pairs = _near(r_J, float(np.max(reach)))
    apart = np.linalg.norm(r_J[pairs[:, 0]] - r_J[pairs[:, 1]], axis=-1)
    pairs = pairs[apart <= np.minimum(reach[pairs[:, 0]], reach[pairs[:, 1]])]
    if len(pairs) == 0:
        return
    further = errors.by_pairs(used[pairs])
    ids = campaign.landmarks.ids
    names = [f"{ids[used[a]]} = {ids[used[b]]}" for a, b in pairs.tolist()]
    yield Evidence(
        "same place",
        f"the same place is listed under several ids: {listed(names)}; its error is then counted as several "
        f"independent ones, wrong by {worst(covariance_E, further)}",
        "give one id to one place",
        weakens=growth(covariance_E, further) > NOTICEABLE,
        covariance_E=further,
        rows=tuple(names),
    )


def _near(r_J: Array, reach: float) -> NDArray[np.int64]:
    """Pairs (k, 2) of places (n, 3) no further apart than ``reach``, m.

    Places that are near are near on every line: SciPy, whose tree takes a quarter of a second to load, is asked only
    where neighbours on an oblique line are.
    """
    if not np.any(np.diff(np.sort(r_J @ OBLIQUE)) <= reach):
        return np.zeros((0, 2), dtype=np.int64)
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(r_J).query_pairs(reach, output_type="ndarray"))
