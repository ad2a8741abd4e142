"""Where places on the ground appear in images, and how well that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..table.appearance import Seen, appearance
from ..table.campaign import Campaign, Landmarks, Sightings
from ..table.equation import linearise
from ..table.geometry import observe

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Projected:
    """Places that appear in images, a row each: ``image`` and ``site`` (k,) with ``pixel`` (k, 2) and the covariance of
    its error (k, 2, 2) px^2; ``absent`` counts the others by why they do not appear."""

    image: Index
    site: Index
    pixel: Array
    covariance_px: Array
    absent: dict[Seen, int]

    @classmethod
    def joined(cls, parts: Sequence[Projected]) -> Projected:
        """Those of several, one after another."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            np.concatenate([part.image for part in parts]),
            np.concatenate([part.site for part in parts]),
            np.concatenate([part.pixel for part in parts]),
            np.concatenate([part.covariance_px for part in parts]),
            {why: sum(part.absent[why] for part in parts) for why in parts[0].absent},
        )


def projected(
    campaign: Campaign,
    C_EK: Array,
    covariance_E: Array,
    p_J: Array,
    covariance_J: Array,
    asked: list[tuple[int, Index]],
    skip: bool = False,
) -> Projected:
    """Pixels of places p_J (n, 3) with their covariances (n, 3, 3) m^2, for each image asked for with its places.

    ``cov z = H (P + A) H^T + R (Q + S) R^T`` with the errors of the mounting (``covariance_E`` rad^2), of the image's
    attitude and position, and of the place, taken as independent.  Raises EpochError for an image outside orbit or
    attitude, unless ``skip``.
    """
    images, sites, pixels = [], [], []
    absent = dict.fromkeys(list(Seen)[1:], 0)
    for which, chosen in asked:
        found = appearance(campaign, C_EK, which, p_J[chosen], skip)
        seen = found.seen == Seen.YES
        images.append(np.full(int(seen.sum()), which))
        sites.append(chosen[seen])
        pixels.append(found.pixel[seen])
        for why in absent:
            absent[why] += int(np.sum(found.seen == why))
    image, site = np.concatenate(images), np.concatenate(sites)
    pixel = np.concatenate(pixels)
    covariance = _covariance(campaign, C_EK, covariance_E, p_J, covariance_J, (image, site, pixel))
    return Projected(image, site, pixel, covariance, absent)


def _covariance(
    campaign: Campaign,
    C_EK: Array,
    covariance_E: Array,
    p_J: Array,
    covariance_J: Array,
    seen: tuple[Index, Index, Array],
) -> Array:
    image, site, pixel = seen
    n = image.size
    if not n:
        return np.empty((0, 2, 2))
    landmarks = Landmarks(tuple(map(str, range(len(p_J)))), p_J, covariance_J)
    marks = Sightings(image, site, pixel[:, 0], pixel[:, 1], np.ones(n), np.zeros(n, dtype=np.bool_))
    table = observe(replace(campaign, landmarks=landmarks, sightings=marks))
    at = linearise(table, C_EK)
    turn = covariance_E + table.cov_attitude_E[image]
    shift = table.cov_position_J[image] + covariance_J[site]
    return np.asarray(at.H @ turn @ at.H.mT + at.R @ shift @ at.R.mT)
