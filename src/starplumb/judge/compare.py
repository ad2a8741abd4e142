"""Every method on the same campaign: what each answers, how well it says to know it, and what it leaves out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from ..estimators import methods as all_methods
from ..estimators.gls import Gls
from ..estimators.protocol import AlignmentEstimate, Estimator, Status
from ..physics import so3
from ..table.campaign import Campaign
from ..table.observations import Observations
from .calibrate import Calibration, calibrate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Answer:
    """What one method makes of a campaign.

    ``status`` is that of the judgement, as ``calibrate`` has it.  ``correction_E`` (3,) rad of
    ``C_EK = exp(d) C_EK_model``; ``sigma_E`` (3,) rad with every stated error in it and ``naive_sigma_E`` as the
    method's own equations have it, None where it states none; ``from_gls`` (3,) its difference from gls in units of
    the sigma of gls, NaN where either must not be used; ``seconds`` of computing; ``remarks`` one short sentence each.
    """

    method: str
    status: Status
    C_EK: Array
    correction_E: Array
    sigma_E: Array | None
    naive_sigma_E: Array | None
    from_gls: Array
    seconds: float
    remarks: tuple[str, ...]


def compare(
    campaign: Campaign, methods: Mapping[str, Callable[[], Estimator]] | None = None
) -> tuple[Answer, ...]:
    """Run every method, with its default options, on the control points of a campaign.

    Raises EpochError where an image lies outside the orbit or attitude, InputError where there is nothing to use.
    """
    return tuple(answers(campaign, methods))


def answers(
    campaign: Campaign, methods: Mapping[str, Callable[[], Estimator]] | None = None
) -> Iterator[Answer]:
    """The same, method by method: on large campaigns some take minutes."""
    gls = _Timed(Gls())
    by_gls = calibrate(campaign, gls)
    for name, method in (methods or all_methods()).items():
        estimator = method()
        if isinstance(estimator, Gls) and estimator == gls.method:
            yield _answer(name, by_gls, gls, gls.estimate)
            continue
        timed = _Timed(estimator)
        yield _answer(name, calibrate(campaign, timed, by_gls), timed, gls.estimate)


@dataclass
class _Timed:
    """An estimator that keeps its estimate and how long it took."""

    method: Estimator
    seconds: float = 0.0
    estimate: AlignmentEstimate = field(init=False)

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        start = perf_counter()
        self.estimate = self.method(observations, C_EK)
        self.seconds = perf_counter() - start
        return self.estimate


def _answer(name: str, judged: Calibration, timed: _Timed, gls: AlignmentEstimate) -> Answer:
    estimate, status = timed.estimate, judged.status
    from_gls = np.full(3, np.nan)
    if status.usable and Status(int(gls.status)).usable and gls.sigma_E is not None:
        from_gls = so3.log(estimate.C_EK @ gls.C_EK.mT) / gls.sigma_E
    return Answer(
        method=name,
        status=status,
        C_EK=estimate.C_EK,
        correction_E=so3.log(estimate.C_EK @ judged.campaign.C_EK.mT),
        sigma_E=estimate.sigma_E if status.usable else None,
        naive_sigma_E=estimate.naive_sigma_E,
        from_gls=from_gls,
        seconds=timed.seconds,
        remarks=(*_judgement(judged, estimate), *_remarks(estimate, gls)),
    )


def _judgement(judged: Calibration, estimate: AlignmentEstimate) -> tuple[str, ...]:
    """What weighs most where the campaign's data make a method's answer worse than the method knows."""
    worse = judged.status is not Status.OK and Status(int(estimate.status)).usable
    return (f"{judged.status.name.lower()}: {judged.sentences[0]}",) if worse and judged.sentences else ()


def _remarks(estimate: AlignmentEstimate, gls: AlignmentEstimate) -> tuple[str, ...]:
    """What to know before this method's answer is used."""
    worse = _worse(estimate, gls) if Status(int(estimate.status)).usable else None
    if worse is None or worse <= 1.05:
        return estimate.describe(gls.C_EK)
    return (*estimate.describe(gls.C_EK), f"sigma up to {worse:.3g} times that of gls")


def _worse(estimate: AlignmentEstimate, gls: AlignmentEstimate) -> float | None:
    """Largest ratio of its sigma to that of gls over the axes; None where either states none."""
    if estimate.sigma_E is None or gls.sigma_E is None or not np.all(np.isfinite(gls.sigma_E)):
        return None
    return float(np.max(estimate.sigma_E / gls.sigma_E))
