"""What an estimator is, and the one door to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..table.observations import Observations
from .fit import Unknowns

Array = NDArray[np.float64]


class Status(IntEnum):
    """How an estimate ended; a batch keeps one per run, so that failures are counted and not lost."""

    OK = 0
    WEAK = 1
    SINGULAR = 2
    NOT_CONVERGED = 3
    REFUTED = 4

    @property
    def text(self) -> str:
        return _TEXTS[self]

    @property
    def usable(self) -> bool:
        return self in (Status.OK, Status.WEAK)


_TEXTS = {
    Status.OK: "",
    Status.WEAK: "usable, but part of the alignment is poorly determined",
    Status.SINGULAR: "the observations do not determine the alignment; wanted at least two markers "
    "well apart, or a prior (projective: four markers in one image, not on a line)",
    Status.NOT_CONVERGED: "the iterations did not converge; the observations contradict each other or the model",
    Status.REFUTED: "the observations contradict the answer, so that neither it nor its sigma can be believed",
}


class Verdict(IntEnum):
    """Why a sighting has a part in the solution or not."""

    USED = 0
    SIGHTING = 1
    IMAGE = 2
    LANDMARK = 3


@dataclass(frozen=True)
class ParameterVector:
    """Parameters estimated beside the alignment, and one covariance of both.

    ``names`` (p,), ``values`` (..., p) SI and radians with what was known beforehand, ``prior_sigma`` (p,), infinite
    for a free one, and ``range`` (p,), the largest error that makes sense; ``covariance`` (..., 3 + p, 3 + p) and
    ``information`` (..., 3 + p, 3 + p) of the alignment's error about E's axes and of the values, without the priors in
    the latter.  ``straight`` is the covariance by that information where ``covariance`` is another, since the residuals
    are bent so far out (:mod:`starplumb.estimators.bent`); else None.
    """

    names: tuple[str, ...]
    values: Array
    prior_sigma: Array
    range: Array
    covariance: Array
    information: Array
    straight: Array | None = None


@dataclass(frozen=True)
class Rival:
    """Another answer, on which sightings that were rejected agree.

    ``support`` (...) is the number of images that speak for it, each by its share of their sightings, over that of the
    images that speak for the answer: 0 for none, 1 for as many; ``turn_E`` (..., 3) rad leads from the answer to it,
    ``C_EK_other = exp(turn_E) C_EK``; ``images`` (...) counts those that speak for it.
    """

    support: Array
    turn_E: Array
    images: NDArray[np.int64]


NO_RIVAL = Rival(np.zeros(()), np.zeros(3), np.zeros((), dtype=np.int64))


@dataclass(frozen=True)
class AlignmentEstimate:
    """An estimated mounting with what is known of its error.

    ``C_EK`` (..., 3, 3); ``covariance_E`` (..., 3, 3) rad^2 of the estimate's error about E's axes with every stated
    error source in it, None where the method has no covariance; ``status`` (...) of :class:`Status`;
    ``chi2`` (...) with ``degrees_of_freedom``, None where the method has none; ``iterations`` (...).
    ``verdict`` (..., n) of :class:`Verdict` on each sighting, None where the method takes all; ``parameters`` what was
    estimated beside the alignment, None for nothing; ``rival`` what the sightings left out agree on, None where
    that was not looked for.

    ``unknowns`` of the generalised least squares whose answer this is, by which residuals, tests of sightings and
    contributions of error sources are judged; None where the method does not say, and the answer is then compared
    with that least squares.  ``naive_covariance_E`` (..., 3, 3) as the method's own equations have it.  ``notes`` are
    short sentences to know before the answer is used.
    """

    C_EK: Array
    covariance_E: Array | None
    status: NDArray[np.int64]
    iterations: NDArray[np.int64]
    chi2: Array | None = None
    degrees_of_freedom: NDArray[np.int64] | None = None
    verdict: NDArray[np.int64] | None = None
    parameters: ParameterVector | None = None
    unknowns: Unknowns | None = None
    naive_covariance_E: Array | None = None
    notes: tuple[str, ...] = ()
    rival: Rival | None = None

    @property
    def sigma_E(self) -> Array | None:
        """Standard deviations about E's axes (..., 3), rad."""
        return None if self.covariance_E is None else _sigma(self.covariance_E)

    @property
    def naive_sigma_E(self) -> Array | None:
        """Standard deviations about E's axes (..., 3), rad, as the method's own equations have them."""
        return None if self.naive_covariance_E is None else _sigma(self.naive_covariance_E)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about one run that belong into the message of a calibration."""
        return ()

    def describe(self, C_EK_best: Array) -> tuple[str, ...]:
        """Short sentences about one run for a comparison of methods: its notes, or why it must not be used.

        ``C_EK_best`` (3, 3) is the best answer at hand, that of gls: what a method makes of its initial error is
        measured by it.
        """
        status = Status(int(self.status))
        return self.notes if status.usable else (status.text,)


def stack(runs: list[AlignmentEstimate], batch: tuple[int, ...]) -> AlignmentEstimate:
    """Estimates of single runs as one with batch axes."""

    def gathered(parts: Sequence[object], *names: str) -> dict[str, Any]:
        columns = {name: [np.asarray(getattr(part, name)) for part in parts] for name in names}
        return {name: np.reshape(column, (*batch, *column[0].shape)) for name, column in columns.items()}

    names = ("C_EK", "covariance_E", "status", "iterations", "chi2", "degrees_of_freedom", "verdict")
    parameters = runs[0].parameters
    if parameters is not None:
        vectors = [run.parameters for run in runs]
        of_runs = gathered(vectors, "values", "covariance", "information")
        parameters = replace(parameters, **of_runs, straight=None)
    rivals = [run.rival or NO_RIVAL for run in runs]
    rival = Rival(**gathered(rivals, "support", "turn_E", "images"))
    return replace(runs[0], **gathered(runs, *names), parameters=parameters, rival=rival)


def _sigma(covariance: Array) -> Array:
    return np.asarray(np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)))


IGNORES_PRIOR = "does not use the prior knowledge of the mounting"


def without_prior(observations: Observations, *notes: str) -> tuple[str, ...]:
    """Notes of a method that takes no prior, with a sentence about it where there is one."""
    return notes if observations.prior_E is None else (*notes, IGNORES_PRIOR)


@runtime_checkable
class Estimator(Protocol):
    """A frozen set of options; calling it is pure.  ``C_EK`` is the model mounting (..., 3, 3)."""

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate: ...
