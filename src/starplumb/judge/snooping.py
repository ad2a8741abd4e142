"""What each sighting of a campaign is worth: how well it fits, what it could hide, and why some were rejected.

For an error of one pixel in a column or row, e its whitened shift and R the control that the other observations have
over it (:mod:`starplumb.solve.reliability`)::

    w = e^T v / sqrt(e^T R e)                  Baarda's standardised residual, N(0, 1)
    tau = w / sqrt(chi2 / dof)                 Pope's, which needs no trust in the size of the stated sigmas
    detectable = delta_0 / sqrt(e^T R e)       smallest error found with 80 % power at the level 0.1 %, pixels
    effect = |d theta / d error| detectable    what the largest hidden one does to the alignment: external reliability

Sources: W. Baarda, Publications on Geodesy 2 (4) and 2 (5), 1967-1968; A. J. Pope, NOAA Technical Report NOS 65
NGS 1, 1976.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import Fit, State, Unknowns
from ..estimators.gls import marginal, step_length
from ..estimators.protocol import AlignmentEstimate, Verdict
from ..estimators.usable import determined
from ..physics.units import ARCSEC
from ..solve.chunks import part
from ..solve.reliability import Reliability, Tested
from ..table.observations import Observations
from .contributions import Spread

Index = NDArray[np.int64]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DELTA_0 = 3.2905 + 0.8416
"""Shift of w that is found with 80 % power at the level 0.1 % (two-sided): 4.13."""
SAME = 0.01
"""Difference, in sigmas, of two answers and, relative, of two covariances up to which they are the same."""


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
    effects on the alignment.  ``scale`` is sqrt(chi2 / dof), 1 where there is no degree of freedom; ``spread`` what
    each source of error does to the alignment.
    """

    tested: Tested
    w: Array
    redundancy: Array
    detectable_px: Array
    effect_E: Array
    scale: float
    spread: Spread

    @property
    def statistic(self) -> Array:
        return np.asarray(np.sqrt(self.tested.sightings[0]))

    @property
    def tau(self) -> Array:
        return np.asarray(self.w / self.scale)


def fit_at(
    unknowns: Unknowns, o: Observations, C_EK_model: Array, estimate: AlignmentEstimate, used: Mask
) -> Fit:
    """The adjustment at an estimate, of the sightings used (n,); parameters it does not know are not applied."""
    p = estimate.parameters
    values = p.values if p is not None and p.names == unknowns.names else np.zeros(len(unknowns.names))
    weighted = o if np.all(used) else replace(o, weight=np.where(used, o.weight, 0.0))
    return Fit(unknowns, weighted, State(estimate.C_EK, values), C_EK_model)


def recognised(fit: Fit, estimate: AlignmentEstimate) -> AlignmentEstimate:
    """An estimate (no batch axes) that says nothing of its adjustment, as that of the fit where answer and covariance
    agree: with the fit's unknowns, and chi-square where it states none.

    A gain that is not that of least squares does not carry an error of a sighting to the answer as the fit has it.
    """
    if estimate.unknowns is not None or estimate.parameters is not None or estimate.covariance_E is None:
        return estimate
    solution = fit.solve()
    if not determined(solution.covariance[:3, :3]) or not step_length(solution, 3) < SAME:
        return estimate
    root = np.linalg.cholesky(marginal(solution.information, 3))  # N = L L^T: L^T P L is the identity
    if not np.max(np.abs(root.mT @ estimate.covariance_E @ root - np.eye(3))) < SAME:
        return estimate
    if estimate.chi2 is None or estimate.degrees_of_freedom is None:
        o = fit.table
        dof = np.asarray(2 * np.sum(o.weight > 0.0) - 3 * (o.prior_E is None))
        estimate = replace(estimate, chi2=solution.chi2, degrees_of_freedom=dof)
    return replace(estimate, unknowns=fit.unknowns)


def snoop(fit: Fit, estimate: AlignmentEstimate) -> Snooping | None:
    """Reliability at an estimate (no batch axes); None where its parameters are not all determined."""
    if estimate.chi2 is None or estimate.degrees_of_freedom is None:
        return None
    n, dof = fit.table.n, int(estimate.degrees_of_freedom)
    T, freedom = np.empty(n), np.empty(n, dtype=np.int64)
    w, detectable_px = np.empty((n, 2)), np.empty((n, 2))
    redundancy, effect_E, spread = np.empty(n), np.empty(n), Spread.of(fit.table)
    for some in fit.tested_parts():
        tested, rows = some.tested, some.rows
        T[rows], freedom[rows] = tested.sightings
        redundancy[rows] = tested.redundancy
        K = tested.influence[:, :3]
        gain = np.stack([_times(K, tested.per_px[:, :, c]) for c in range(2)], axis=-1)
        w[rows], detectable_px[rows] = _of_pixels(tested)
        effect = np.linalg.norm(gain, axis=1) * detectable_px[rows]
        effect_E[rows] = np.max(effect, axis=-1)
        spread.add(some, gain)
    of_all = fit.whole.of_groups((T, freedom))
    if of_all is None:
        return None
    scale = float(np.sqrt(estimate.chi2 / dof)) if dof > 0 else 1.0
    return Snooping(of_all, w, redundancy, detectable_px, effect_E, scale, spread)


def _of_pixels(tested: Reliability) -> tuple[Array, Array]:
    """Baarda's w and the detectable error, px, of an error in column and row (n, 2)."""
    w, detectable = np.zeros(tested.v.shape), np.full(tested.v.shape, np.inf)
    R, residual = tested.control, tested.residual
    for c in range(2):
        e0, e1 = tested.per_px[:, 0, c], tested.per_px[:, 1, c]
        square = e0 * e0 * R[:, 0, 0] + 2.0 * e0 * e1 * R[:, 0, 1] + e1 * e1 * R[:, 1, 1]
        controlled = np.sqrt(np.maximum(square, 0.0))
        shows = controlled > 0.0
        np.divide(e0 * residual[:, 0] + e1 * residual[:, 1], controlled, out=w[:, c], where=shows)
        np.divide(DELTA_0, controlled, out=detectable[:, c], where=shows)
    return w, detectable


def _times(K: Array, e: Array) -> Array:
    """K e of each, (n, 3, 2) by (n, 2)."""
    return np.asarray(K[:, :, 0] * e[:, :1] + K[:, :, 1] * e[:, 1:])


def rejections(
    fit: Fit, snooping: Snooping, verdict: NDArray[np.int64], picture: Index
) -> tuple[Rejection, ...]:
    """Every rejected sighting with its statistic and the reason in words, in the order of the table; ``picture`` (n,)
    names the image of each, which shares its errors with those of other cameras."""
    rows = np.flatnonzero(verdict != int(Verdict.USED))
    if rows.size == 0:
        return ()
    o, z = fit.table, fit.problem(fit.table.select(rows)).model.z_px
    groups: dict[tuple[int, int], tuple[float, str]] = {}
    for i in np.unique(o.image[verdict == int(Verdict.IMAGE)]):
        groups[int(Verdict.IMAGE), int(i)] = _wrong_image(fit, verdict, int(i))
    for place in np.unique(o.landmark[verdict == int(Verdict.LANDMARK)]):
        groups[int(Verdict.LANDMARK), int(place)] = _wrong_landmark(fit, verdict, int(place))
    found, statistics = [], snooping.statistic
    for row, off in zip(rows.tolist(), z.tolist(), strict=True):
        image, landmark = int(o.image[row]), int(o.landmark[row])
        if verdict[row] == int(Verdict.SIGHTING):
            statistic = float(statistics[row])
            reason = (
                f"sighting: predicted minus measured {off[0]:+.1f}, {off[1]:+.1f} px, {statistic:.1f} sigma"
            )
        else:
            member = image if verdict[row] == int(Verdict.IMAGE) else landmark
            statistic, reason = groups[int(verdict[row]), member]
        found.append(Rejection(int(picture[row]), landmark, statistic, reason))
    return tuple(found)


def _with_group(fit: Fit, rows: Index) -> Tested | None:
    """The adjustment with a rejected group of sightings back in the solution."""
    weight = fit.table.weight.copy()
    weight[rows] = 1.0
    return replace(fit, table=replace(fit.table, weight=weight)).tested()


def _statistic_of_image(fit: Fit, rows: Index, image: int) -> float:
    """sqrt(T) of an image with its sightings back in the solution."""
    o = fit.table
    if not np.any(np.isin(o.landmark[o.image != image], o.landmark[rows])):
        # to an image of landmarks of its own all the others are what is known beforehand
        own = part(o, rows)
        alone = fit.problem(replace(own, weight=np.ones(rows.size)))
        rest = fit.whole.solution
        tested = replace(alone, prior=(rest.information, rest.x)).tested()
    else:
        tested = _with_group(fit, rows)
    return float("nan") if tested is None else float(np.sqrt(tested.images[0][image]))


def _wrong_image(fit: Fit, verdict: NDArray[np.int64], image: int) -> tuple[float, str]:
    """Statistic of an image rejected as a whole, and what kind of error it has."""
    rows = np.flatnonzero((fit.table.image == image) & (verdict == int(Verdict.IMAGE)))
    statistic = _statistic_of_image(fit, rows, image)
    problem = fit.problem(fit.table.select(rows))
    o, model = problem.observations, problem.model
    shift = np.median(model.z_px, axis=0)
    reason = (
        f"image as a whole: its {rows.size} sightings are off by {shift[0]:+.1f}, {shift[1]:+.1f} px together, "
        f"which at the stated sigmas is {statistic:.1f} sigma"
    )
    # a later epoch turns the attitude by omega dt, which moves z by -H omega dt, and carries the camera by v dt
    moves = model.R @ o.v_J[..., None] - model.H @ o.omega_E[..., None]
    per_s = np.median(moves[..., 0], axis=0)
    late = -float(per_s @ shift / (per_s @ per_s)) if np.any(per_s) else 0.0
    along_track = np.linalg.norm(shift + per_s * late) < 0.1 * np.linalg.norm(shift)
    turn = np.linalg.lstsq(-model.H.reshape(-1, 3), model.z_px.reshape(-1), rcond=None)[0]
    cause = f"an attitude error of {', '.join(f'{angle:+.0f}' for angle in turn / ARCSEC)} arcsec"
    return (
        statistic,
        f"{reason}; {f'an epoch {late:+.4g} s later or ' if along_track else ''}{cause} explains it",
    )


def _wrong_landmark(fit: Fit, verdict: NDArray[np.int64], landmark: int) -> tuple[float, str]:
    """Statistic of a landmark rejected with all its sightings."""
    rows = np.flatnonzero((fit.table.landmark == landmark) & (verdict == int(Verdict.LANDMARK)))
    tested = _with_group(fit, rows)
    statistic = float("nan")
    if tested is not None and landmark in tested.repeated:
        statistic = float(np.sqrt(tested.landmarks[0][int(np.searchsorted(tested.repeated, landmark))]))
    return statistic, (
        f"landmark as a whole: its {rows.size} sightings agree on another place, {statistic:.1f} sigma "
        "from the surveyed one"
    )
