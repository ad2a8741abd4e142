"""Every method on the same campaign: what each answers, how well it says to know it, and what it leaves out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from ..estimators import METHODS
from ..estimators.gls import Gls
from ..estimators.protocol import AlignmentEstimate, Estimator, Status, Verdict
from ..estimators.published.cross_product import CrossProduct
from ..estimators.published.ground_plane import GroundPlane
from ..estimators.published.image_plane import ImagePlane
from ..estimators.published.least_squares import LeastSquares
from ..estimators.published.observer import Observer, ObserverEstimate
from ..estimators.published.projective import Projective
from ..estimators.robust import Robust
from ..estimators.sequential import Sequential
from ..estimators.wahba import Wahba
from ..physics import so3
from ..physics.errors import InputError
from ..physics.units import ARCMIN, ARCSEC
from ..table.campaign import Campaign
from ..table.geometry import observe
from ..table.observations import Observations

Array = NDArray[np.float64]
Linear = LeastSquares | CrossProduct | ImagePlane | GroundPlane


@dataclass(frozen=True)
class Answer:
    """What one method makes of a campaign.

    ``correction_E`` (3,) rad of ``C_EK = exp(d) C_EK_model``; ``sigma_E`` (3,) rad with every stated error in it
    and ``naive_sigma_E`` as the method's own equations have it, None where it states none; ``from_gls`` (3,) its
    difference from gls in units of the sigma of gls, NaN where either must not be used; ``seconds`` of computing;
    ``remarks`` one short sentence each.
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


@dataclass(frozen=True)
class Case:
    """One method's run beside that of gls, as its remarks need it."""

    observations: Observations
    C_EK_model: Array
    estimate: AlignmentEstimate
    gls: AlignmentEstimate

    @property
    def theta_E(self) -> Array:
        """Initial error (3,) rad, by gls."""
        return so3.log(self.C_EK_model @ self.gls.C_EK.mT)

    @property
    def linear_bias(self) -> float:
        """Size of ``1/2 theta_z (z x theta)``, rad: what one linear step in a narrow field misses the answer by."""
        z_E, theta_E = self.gls.C_EK[:, 2], self.theta_E
        return float(np.linalg.norm(0.5 * (z_E @ theta_E) * np.cross(z_E, theta_E)))


def compare(
    campaign: Campaign, methods: Mapping[str, Callable[[], Estimator]] = METHODS
) -> tuple[Answer, ...]:
    """Run every method, with its default options, on the control points of a campaign.

    Raises EpochError where an image lies outside the orbit or attitude, InputError where there is nothing to use.
    """
    return tuple(answers(campaign, methods))


def answers(campaign: Campaign, methods: Mapping[str, Callable[[], Estimator]] = METHODS) -> Iterator[Answer]:
    """The same, method by method: on large campaigns some take minutes."""
    used = ~campaign.sightings.check
    if not np.any(used):
        raise InputError(
            f"campaign {campaign.name!r} has no observation with role control; wanted at least two markers"
        )
    observations = observe(campaign).select(used)
    gls = Gls()(observations, campaign.C_EK)
    for name, method in methods.items():
        yield _answer(name, method(), observations, campaign.C_EK, gls)


def _answer(
    name: str, estimator: Estimator, observations: Observations, C_EK: Array, gls: AlignmentEstimate
) -> Answer:
    start = perf_counter()
    estimate = estimator(observations, C_EK)
    seconds = perf_counter() - start
    naive = None
    if isinstance(estimator, Linear):
        naive = replace(estimator, covariance="naive")(observations, C_EK).sigma_E
    status = Status(int(estimate.status))
    from_gls = np.full(3, np.nan)
    if status.usable and Status(int(gls.status)).usable and gls.sigma_E is not None:
        from_gls = so3.log(estimate.C_EK @ gls.C_EK.mT) / gls.sigma_E
    return Answer(
        method=name,
        status=status,
        C_EK=estimate.C_EK,
        correction_E=so3.log(estimate.C_EK @ C_EK.mT),
        sigma_E=estimate.sigma_E if status.usable else None,
        naive_sigma_E=naive,
        from_gls=from_gls,
        seconds=seconds,
        remarks=tuple(_remarks(estimator, Case(observations, C_EK, estimate, gls))),
    )


def _remarks(estimator: Estimator, case: Case) -> list[str]:
    """What to know before this method's answer is used."""
    if isinstance(estimator, Projective) and not Status(int(case.estimate.status)).usable:
        return ["not applicable: no image has four markers well apart and off a line"]
    if not Status(int(case.estimate.status)).usable:
        return [Status(int(case.estimate.status)).text]
    remarks = _of_method(estimator, case)
    if case.observations.prior_E is not None and not isinstance(estimator, Gls | Robust | Sequential):
        remarks.append("does not use the prior knowledge of the mounting")
    worse = _worse(case)
    if worse is not None and worse > 1.05:
        remarks.append(f"sigma up to {worse:.3g} times that of gls")
    return remarks


def _of_method(estimator: Estimator, case: Case) -> list[str]:
    match estimator:
        case Gls():
            return ["weighs every stated error where it belongs, shared ones included"]
        case Robust():
            left_out = (
                0 if (verdict := case.estimate.verdict) is None else int(np.sum(verdict != Verdict.USED))
            )
            return [f"gls without the sightings that the others contradict: {left_out} left out"]
        case Sequential():
            return ["image after image; the same as gls while the mounting does not drift"]
        case LeastSquares() | CrossProduct() | ImagePlane() | GroundPlane():
            return [_step(estimator, case), "its weights ignore that an image's markers share errors"]
        case Projective():
            return ["uses no orbit: tilt trades against position", "each image by itself"]
        case Wahba():
            return ["closed form, any initial error; all sightings weigh the same; states no sigma"]
        case Observer():
            return _of_observer(case.estimate)
    return []


def _step(estimator: Linear, case: Case) -> str:
    size = float(np.linalg.norm(case.theta_E)) / ARCMIN
    if estimator.iterations > 1:
        return f"{estimator.iterations} linear steps: re-linearised, no bias at this initial error ({size:.3g} arcmin)"
    bias = case.linear_bias / ARCSEC
    return f"one linear step: biased by up to {bias:.2g} arcsec at this initial error ({size:.3g} arcmin)"


def _of_observer(estimate: AlignmentEstimate) -> list[str]:
    remarks = ["tuned, not weighed by the stated errors; its P is no covariance, so it states no sigma"]
    if isinstance(estimate, ObserverEstimate):
        cycles = int(estimate.cycles_needed)
        remarks.append(f"settled by cycle {cycles}" if cycles else "had not settled after its last cycle")
    return remarks


def _worse(case: Case) -> float | None:
    """Largest ratio of its sigma to that of gls over the axes; None where either states none."""
    if case.estimate.sigma_E is None or case.gls.sigma_E is None or not np.all(np.isfinite(case.gls.sigma_E)):
        return None
    return float(np.max(case.estimate.sigma_E / case.gls.sigma_E))
