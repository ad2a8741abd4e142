"""Where a method that has to start somewhere does so: at the closed form, or at the model mounting as published."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..table.observations import Observations
from .protocol import AlignmentEstimate, Estimator, Status
from .wahba import Wahba

Array = NDArray[np.float64]
Start = Literal["closed-form", "model"]


def closed_form(observations: Observations, C_EK: Array) -> Array:
    """The closed form (..., 3, 3); the mounting given where the observations do not determine it."""
    found = Wahba()(observations, C_EK)
    return np.where((found.status != int(Status.SINGULAR))[..., None, None], found.C_EK, C_EK)


@dataclass(frozen=True)
class FromClosedForm:
    """A method that starts at the closed form, whatever the model mounting."""

    method: Estimator

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        return self.method(observations, closed_form(observations, C_EK))


@dataclass(frozen=True)
class FromModel:
    """A method that starts at the model mounting, and says what error of it the method bears."""

    method: Estimator
    bears: str

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        found = self.method(observations, C_EK)
        start = f"starts from the model mounting, of which it bears an error of {self.bears}"
        return replace(found, notes=(*found.notes, start))
