"""The one rule that turns all that was found about an answer into its status, its message and its 95 % interval.

A finding informs, weakens or refutes.  One that refutes leaves no answer; one that weakens leaves an answer that may be
used within its interval, which is widened by what was found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..estimators.protocol import Status

Array = NDArray[np.float64]

NORMAL_95 = 1.96
"""Half-width, in sigmas, of the interval that holds a normal error with probability 0.95."""
IMPLAUSIBLE_P = 1e-4
"""A chi-square less probable than this, on either side, is reported."""


@dataclass(frozen=True)
class Finding:
    """One sentence about an answer.

    ``weakens`` tells whether the answer is then only weakly to be trusted, ``refutes`` whether it is not to be used,
    and ``informs`` that nothing changes: it belongs to the notices of the result, not to its message.  ``covariance_E``
    (3, 3) rad^2 is added to the answer's covariance about E for its interval, ``reach_E`` (3,) rad is how far from
    the answer another one lies that the interval must hold, and ``half_E`` (3,) rad half-widths that it must have.
    """

    sentence: str
    weakens: bool
    informs: bool = False
    refutes: bool = False
    covariance_E: Array | None = None
    reach_E: Array | None = None
    half_E: Array | None = None

    @property
    def weight(self) -> int:
        """2 for what refutes, 1 for what weakens, 0 for the rest."""
        return 2 if self.refutes else int(self.weakens)


def probability(p: float) -> str:
    """A probability in words, ``p = 2.1e-06``; one below the smallest number is not called zero."""
    return f"p = {p:.1e}" if p > 0.0 else "p < 1e-300"


def judged(own: Status, findings: Sequence[Finding]) -> Status:
    """Status of an answer of which an estimator says ``own`` and that has these findings."""
    from ..estimators.protocol import Status

    if not own.usable:
        return own
    heaviest = max((finding.weight for finding in findings), default=0)
    return (own, Status.WEAK, Status.REFUTED)[heaviest]


def said(findings: Sequence[Finding]) -> tuple[str, ...]:
    """The sentences of a message, heaviest first."""
    told = [finding for finding in findings if not finding.informs]
    return tuple(finding.sentence for finding in sorted(told, key=lambda finding: -finding.weight))


def interval_95(
    covariance_E: Array | None, from_data_E: Array | None, findings: Sequence[Finding]
) -> Array | None:
    """Half-widths (3,) rad of the 95 % intervals about E's axes; None where nothing states any.

    The larger of what the stated errors, with what the findings add, and the residuals (``from_data_E``) say; and wide
    enough to hold another answer that the data support.
    """
    least = [finding.half_E for finding in findings if finding.half_E is not None]
    if covariance_E is None:
        return np.asarray(np.max(least, axis=0)) if least else None
    added = [finding.covariance_E for finding in findings if finding.covariance_E is not None]
    total = covariance_E + np.sum(added, axis=0) if added else covariance_E
    stated = NORMAL_95 * np.sqrt(np.diagonal(total))
    half = stated if from_data_E is None else np.maximum(stated, from_data_E)
    reaches = [np.abs(finding.reach_E) + stated for finding in findings if finding.reach_E is not None]
    return np.asarray(np.max([half, *reaches, *least], axis=0))
