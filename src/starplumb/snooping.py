"""What each sighting of a campaign is worth: how well it fits, what it could hide, and why some were rejected.

For an error of one pixel in a column or row, e its whitened shift and R the control that the other observations have
over it (:mod:`starplumb.reliability`)::

    w = e^T v / sqrt(e^T R e)                  Baarda's standardised residual, N(0, 1)
    tau = w / sqrt(chi2 / dof)                 Pope's, which needs no trust in the size of the stated sigmas
    detectable = delta_0 / sqrt(e^T R e)       smallest error found with 80 % power at the level 0.1 %, pixels
    effect = |d theta / d error| detectable    what the largest hidden one does to the alignment: external reliability

Sources: W. Baarda, Publications on Geodesy 2 (4) and 2 (5), 1967-1968; A. J. Pope, NOAA Technical Report NOS 65
NGS 1, 1976.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .estimators.gls import Gls
from .estimators.protocol import AlignmentEstimate, Estimator, Verdict
from .estimators.robust import Robust
from .estimators.selfcal import Problem, SelfCalibration, State
from .observations import Observations
from .reliability import Reliability, reliability
from .units import ARCSEC

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DELTA_0 = 3.2905 + 0.8416
"""Shift of w that is found with 80 % power at the level 0.1 % (two-sided): 4.13."""


@dataclass(frozen=True)
class Rejection:
    """A sighting left out of the solution, with the statistic that spoke against it: sqrt(T), in sigmas."""

    image: int
    landmark: int
    statistic: float
    reason: str


@dataclass(frozen=True)
class Snooping:
    """Reliability of n sightings at an estimate; of a rejected one as if it had a part in the solution.

    ``statistic`` (n,) is sqrt(T), ``w`` and ``tau`` (n, 2) for column and row, ``redundancy`` (n,) 0 .. 1,
    ``detectable_px`` (n, 2) infinite where nothing controls the sighting, ``effect_E`` (n,) rad the larger of the two
    effects on the alignment.
    """

    tested: Reliability
    scale: float
    """sqrt(chi2 / dof), 1 where there is no degree of freedom."""

    @cached_property
    def statistic(self) -> Array:
        return np.asarray(np.sqrt(self.tested.sightings[0]))

    @cached_property
    def _controlled(self) -> Array:
        """sqrt(e^T R e) (n, 2) of an error of one pixel in column and in row."""
        e, R = self.tested.per_px, self.tested.control
        return np.asarray(np.sqrt(np.maximum(np.einsum("nic,nij,njc->nc", e, R, e), 0.0)))

    @cached_property
    def w(self) -> Array:
        along = np.einsum("nic,ni->nc", self.tested.per_px, self.tested.residual)
        zero = np.zeros_like(along)
        return np.asarray(np.divide(along, self._controlled, out=zero, where=self._controlled > 0.0))

    @property
    def tau(self) -> Array:
        return np.asarray(self.w / self.scale)

    @property
    def redundancy(self) -> Array:
        return self.tested.redundancy

    @cached_property
    def detectable_px(self) -> Array:
        nothing = np.full_like(self._controlled, np.inf)
        return np.asarray(np.divide(DELTA_0, self._controlled, out=nothing, where=self._controlled > 0.0))

    @cached_property
    def effect_E(self) -> Array:
        per_px = np.linalg.norm((self.tested.influence @ self.tested.per_px)[:, :3, :], axis=1)
        return np.asarray(np.max(per_px * self.detectable_px, axis=-1))


def calibration_of(estimator: Estimator) -> SelfCalibration | None:
    """The adjustment behind an estimator; None for one that does not weight the errors an image shares."""
    if isinstance(estimator, Robust):
        return estimator.calibration
    if isinstance(estimator, Gls):
        return SelfCalibration()
    return estimator if isinstance(estimator, SelfCalibration) else None


def problem_at(
    calibration: SelfCalibration, o: Observations, C_EK_model: Array, estimate: AlignmentEstimate, used: Mask
) -> Problem:
    """The linear problem at an estimate, of the sightings used (n,)."""
    values = np.zeros(0) if estimate.parameters is None else estimate.parameters.values
    weighted = replace(o, weight=np.where(used, o.weight, 0.0))
    return calibration.problem(weighted, State(estimate.C_EK, values), C_EK_model)


def snoop(problem: Problem, estimate: AlignmentEstimate) -> Snooping | None:
    """Reliability at an estimate (no batch axes); None where its parameters are not all determined."""
    tested = reliability(problem.observations, problem.model, problem.A, problem.prior)
    if tested is None or estimate.chi2 is None or estimate.degrees_of_freedom is None:
        return None
    dof = int(estimate.degrees_of_freedom)
    return Snooping(tested, float(np.sqrt(estimate.chi2 / dof)) if dof > 0 else 1.0)


def rejections(problem: Problem, snooping: Snooping, verdict: NDArray[np.int64]) -> tuple[Rejection, ...]:
    """Every rejected sighting with its statistic and the reason in words, in the order of the table."""
    o, z = problem.observations, problem.model.z_px
    groups: dict[tuple[int, int], tuple[float, str]] = {}
    for i in np.unique(o.image[verdict == int(Verdict.IMAGE)]):
        groups[int(Verdict.IMAGE), int(i)] = _wrong_image(problem, verdict, int(i))
    for place in np.unique(o.landmark[verdict == int(Verdict.LANDMARK)]):
        groups[int(Verdict.LANDMARK), int(place)] = _wrong_landmark(problem, verdict, int(place))
    found = []
    for row in np.flatnonzero(verdict != int(Verdict.USED)):
        image, landmark = int(o.image[row]), int(o.landmark[row])
        if verdict[row] == int(Verdict.SIGHTING):
            statistic = float(snooping.statistic[row])
            reason = f"sighting: predicted minus measured {z[row, 0]:+.1f}, {z[row, 1]:+.1f} px, {statistic:.1f} sigma"
        else:
            member = image if verdict[row] == int(Verdict.IMAGE) else landmark
            statistic, reason = groups[int(verdict[row]), member]
        found.append(Rejection(image, landmark, statistic, reason))
    return tuple(found)


def _with_group(problem: Problem, rows: Mask) -> Reliability | None:
    """The problem with a rejected group of sightings back in the solution."""
    weight = np.where(rows, 1.0, problem.observations.weight)
    o = replace(problem.observations, weight=weight)
    return reliability(o, problem.model, problem.A, problem.prior)


def _wrong_image(problem: Problem, verdict: NDArray[np.int64], image: int) -> tuple[float, str]:
    """Statistic of an image rejected as a whole, and what kind of error it has."""
    o, model = problem.observations, problem.model
    rows = (o.image == image) & (verdict == int(Verdict.IMAGE))
    tested = _with_group(problem, rows)
    statistic = float("nan") if tested is None else float(np.sqrt(tested.images[0][image]))
    shift = np.median(model.z_px[rows], axis=0)
    reason = (
        f"image as a whole: its {int(np.sum(rows))} sightings are off by {shift[0]:+.1f}, {shift[1]:+.1f} px together, "
        f"which at the stated sigmas is {statistic:.1f} sigma"
    )
    # a later epoch turns the attitude by omega dt, which moves z by -H omega dt, and carries the camera by v dt
    moves = model.R[rows] @ o.v_J[rows][..., None] - model.H[rows] @ o.omega_E[rows][..., None]
    per_s = np.median(moves[..., 0], axis=0)
    late = -float(per_s @ shift / (per_s @ per_s)) if np.any(per_s) else 0.0
    along_track = np.linalg.norm(shift + per_s * late) < 0.1 * np.linalg.norm(shift)
    turn = np.linalg.lstsq(-model.H[rows].reshape(-1, 3), model.z_px[rows].reshape(-1), rcond=None)[0]
    cause = f"an attitude error of {', '.join(f'{angle:+.0f}' for angle in turn / ARCSEC)} arcsec"
    return (
        statistic,
        f"{reason}; {f'an epoch {late:+.4g} s later or ' if along_track else ''}{cause} explains it",
    )


def _wrong_landmark(problem: Problem, verdict: NDArray[np.int64], landmark: int) -> tuple[float, str]:
    """Statistic of a landmark rejected with all its sightings."""
    o = problem.observations
    rows = (o.landmark == landmark) & (verdict == int(Verdict.LANDMARK))
    tested = _with_group(problem, rows)
    statistic = float("nan")
    if tested is not None and landmark in tested.repeated:
        statistic = float(np.sqrt(tested.landmarks[0][int(np.searchsorted(tested.repeated, landmark))]))
    return statistic, (
        f"landmark as a whole: its {int(np.sum(rows))} sightings agree on another place, {statistic:.1f} sigma "
        "from the surveyed one"
    )
