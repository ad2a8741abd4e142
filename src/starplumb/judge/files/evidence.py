"""What the files themselves tell of an answer: digits, sampling, samples, errors that are shared, places.

Each finding says what was found, what it means for the answer in arc seconds against its sigma, and what to do.  A
finding that could widen the answer's sigma by less than :data:`NOTICEABLE` about every axis is not worth a sentence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.units import ARCSEC

Array = NDArray[np.float64]

NOTICEABLE = 1.05
"""Growth of a sigma about some axis from which on a finding weakens an answer: a sigma from stated errors is itself not
known better than that (5 % is the precision of a sigma from 200 degrees of freedom), and what is below it changes
no 95 % interval by more than its second digit."""


@dataclass(frozen=True)
class Evidence:
    """One finding about what a campaign was made from.

    ``kind`` names the check; ``weakens`` an answer that is usable within its widened interval; ``refuses`` one whose
    error cannot be bounded; ``covariance_E`` (3, 3) rad^2 is what the finding adds to the answer's covariance about E,
    None where it adds nothing that is known; ``rows`` are the ids of images, landmarks or samples it is about.
    """

    kind: str
    sentence: str
    remedy: str
    weakens: bool = True
    refuses: bool = False
    covariance_E: Array | None = None
    rows: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The finding and its remedy in one line."""
        return f"{self.sentence}; {self.remedy}" if self.remedy else self.sentence


def growth(covariance_E: Array, further: Array) -> float:
    """Largest factor, over all axes, by which a further covariance widens a sigma of the answer."""
    L = np.linalg.cholesky(covariance_E)
    whitened = np.linalg.solve(L, np.linalg.solve(L, further).mT)
    return float(np.sqrt(1.0 + max(np.linalg.eigvalsh(whitened)[-1], 0.0)))


def worst(covariance_E: Array, further: Array) -> str:
    """Sigma added and sigma stated, in arc seconds, about the axis of E that is hit hardest."""
    added, stated = (np.sqrt(np.maximum(np.diagonal(c), 0.0)) / ARCSEC for c in (further, covariance_E))
    axis = int(np.argmax(added / stated))
    return f"up to {added[axis]:.2g} arcsec about {'xyz'[axis]}, where the sigma is {stated[axis]:.2g} arcsec"


def listed(names: list[str], most: int = 3) -> str:
    """The first names and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
