"""Does a parameter that the data find rest on one image alone?

A clock or a lens that one image shows and the others hardly do takes up whatever is wrong with that image: its
residuals vanish, and no test of residuals sees it.  With the normal equations N of all images and N_i, b_i of one, at
the estimate, the answer without that image is::

    x_i = (N - N_i)^-1 b_i,     C_i = (N - N_i)^-1
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...estimators.fit import Fit
from ...estimators.protocol import ParameterVector
from ...solve.normals import image_normals
from ...table.parameter_names import UNITS, unit_of
from ..trust import NORMAL_95, Finding
from .separability import in_words

Array = NDArray[np.float64]

FOUND = 4.0
"""Sigmas from zero from which on a parameter is found."""
RESTS = 3.0
"""Times by which its sigma grows without one image, from which on it rests on that image: by nine tenths."""
MOST_IMAGES = 2_000
"""Images up to which this is asked: of more, one is never nine tenths."""


@dataclass(frozen=True)
class Resting:
    """A parameter ``name`` that rests on one ``image``: its ``sigma`` with and without it, and the half-widths (3,) rad
    of intervals about the answer that hold the one without it."""

    name: str
    image: int
    sigma: tuple[float, float]
    half_E: Array

    def finding(self, ids: Sequence[str]) -> Finding:
        unit = unit_of(self.name)
        here, there = (f"{one / UNITS[unit]:.2g} {unit}".rstrip() for one in self.sigma)
        return Finding(
            f"what is found of {in_words(self.name)} rests on image {ids[self.image]} alone (sigma {here}, without it "
            f"{there}): whatever is wrong with that image looks the same; the interval holds the answer without it; "
            "leave the parameter out, or take more images that show it",
            True,
            half_E=self.half_E,
        )


def resting(fit: Fit, found: ParameterVector | None) -> list[Resting]:
    """The parameters of an estimate that are found and rest on one image."""
    if found is None or not 1 < np.unique(fit.table.image[fit.table.weight > 0.0]).size <= MOST_IMAGES:
        return []
    sigma = np.sqrt(np.diagonal(found.covariance))[3:]
    asked = np.flatnonzero(np.abs(found.values) > FOUND * sigma)
    if asked.size == 0:
        return []
    images = list(image_normals(fit.whole, np.zeros(0, dtype=np.int64)))
    N = fit.whole.prior[0] + np.sum([one.information for one in images], axis=0)
    N[:3, :3] += np.eye(3) / np.pi**2  # no rotation is larger, however little the others say
    without = np.linalg.inv(N - np.array([one.information for one in images]))
    alone, every = np.diagonal(without, axis1=-2, axis2=-1), np.diagonal(np.linalg.inv(N))
    rest = []
    for j in asked.tolist():
        i = int(np.argmax(alone[:, 3 + j]))
        if alone[i, 3 + j] > RESTS**2 * every[3 + j]:
            x, C = without[i] @ images[i].vector, without[i]
            half_E = np.abs(x[:3]) + NORMAL_95 * np.sqrt(np.diagonal(C)[:3])
            sigmas = float(np.sqrt(every[3 + j])), float(np.sqrt(alone[i, 3 + j]))
            rest.append(Resting(found.names[j], images[i].image, sigmas, half_E))
    return rest


def rest_on_one(fit: Fit, found: ParameterVector | None, ids: Sequence[str]) -> list[Finding]:
    """What is said of them, the images named by their ids."""
    return [one.finding(ids) for one in resting(fit, found)]
