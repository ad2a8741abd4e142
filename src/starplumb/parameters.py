"""What else than the alignment a campaign may be asked to estimate.

Each kind of parameter says how its value changes the observation table and how it then changes the residual, its
design, in pixels per unit; the adjustment takes it from there.  Units are SI and radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .model import Linearised
from .observations import Observations

Array = NDArray[np.float64]


class Parameter(Protocol):
    """One or several numbers of one kind.

    ``names`` (s,) with ``sigma`` (s,) what is known of them beforehand, infinite for a free one; ``range`` (s,) is the
    largest error that makes sense, by which a free one is held (it is told as unknown where the data do no better).
    """

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def sigma(self) -> tuple[float, ...]: ...

    @property
    def range(self) -> tuple[float, ...]: ...

    def apply(self, observations: Observations, value: Array) -> Observations:
        """The table as it would read if the parameters were wrong by ``value`` (..., s)."""
        ...

    def design(self, observations: Observations, model: Linearised, value: Array) -> Array:
        """d z / d value (..., n, 2, s) px per unit, ``observations`` and ``model`` being those at ``value``."""
        ...


def stacked(parameters: Sequence[Parameter], name: str) -> tuple[str, ...] | Array:
    """The names, sigmas or ranges of all parameters one after the other."""
    return tuple(entry for parameter in parameters for entry in getattr(parameter, name))
