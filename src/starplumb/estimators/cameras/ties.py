"""Tie points in an adjustment: first the surveyed landmarks alone, then what the tie points add."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ...physics.units import DEG
from ...solve.reliability import excess
from ...table.cameras.mounting import CameraMounting
from ...table.cameras.ties import mean_height, meeting_points
from ...table.campaign import Campaign
from ...table.observations import Observations
from ..campaign_table import table_of
from ..fit import Fit, State
from ..gls import Gls
from ..protocol import AlignmentEstimate, Estimator, Status, Verdict

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

LEVEL = 1e-4
"""Probability that any tie point of a good campaign is left out."""
POINTING = 1.0 * DEG
"""Sigma of a camera's mounting beyond which its rays do not say where a tie point lies."""
PASSES = 60


def with_ties(campaign: Campaign, estimator: Estimator) -> tuple[Campaign, Estimator]:
    """The campaign with its tie points in their places, and an estimator that uses them; as they are without any."""
    tie = campaign.landmarks.tie
    return (campaign, estimator) if tie is None else (placed(campaign, estimator), Tied(estimator, tie))


def without_ties(fit: Fit, tie: Mask | None) -> Fit:
    """The adjustment of the sightings of surveyed landmarks only, where it stands."""
    if tie is None:
        return fit
    weight = np.where(tie[fit.table.landmark], 0.0, fit.table.weight)
    return replace(fit, table=replace(fit.table, weight=weight))


def placed(campaign: Campaign, estimator: Estimator) -> Campaign:
    """The campaign with its tie points where the rays meet, by the mountings that the surveyed landmarks give.

    Raises InputError where there are none of these.
    """
    landmarks = campaign.landmarks
    if landmarks.tie is None:
        return campaign
    o = table_of(campaign)
    known = ~campaign.sightings.check & landmarks.surveyed[o.landmark]
    if not np.any(known):
        raise InputError(
            f"campaign {campaign.name!r} has no control observation of a surveyed landmark; wanted at least two: tie "
            "points alone leave the alignment open"
        )
    found = estimator(o.select(known), campaign.C_EK)
    if not Status(int(found.status)).usable:
        return campaign
    pointing, ties = _pointing(o, found), np.flatnonzero(landmarks.tie)
    r_J = np.array(landmarks.r_J)
    places = meeting_points(pointing, found.C_EK, ties, mean_height(campaign))
    there = np.all(np.isfinite(places), axis=-1)
    r_J[ties[there]] = places[there]
    return replace(campaign, landmarks=replace(landmarks, r_J=r_J))


def _pointing(o: Observations, found: AlignmentEstimate) -> Observations:
    """The sightings of cameras whose mounting is known, the parameters that were estimated applied."""
    p, unknowns = found.parameters, found.unknowns
    if p is None or unknowns is None:
        return o
    lost = [k for k, sigma in _of_cameras(found) if np.max(sigma) > POINTING]
    at = Fit(unknowns, o, State(found.C_EK, p.values), found.C_EK).whole.observations
    return at if not lost else at.select(~np.isin(np.asarray(o.camera), lost))


def _of_cameras(found: AlignmentEstimate) -> Iterator[tuple[int, Array]]:
    """Number and sigmas (3,) of the mounting of each further camera."""
    assert found.parameters is not None
    assert found.unknowns is not None
    sigma, at = np.sqrt(np.diagonal(found.parameters.covariance))[3:], 0
    for parameter in found.unknowns.parameters:
        if isinstance(parameter, CameraMounting):
            yield parameter.camera, sigma[at : at + 3]
        at += len(parameter.names)


@dataclass(frozen=True)
class Tied:
    """An estimator, and what tie points (L,) add to its answer.

    The ``method`` sees the surveyed landmarks only: a place that nobody knows says nothing of which sightings agree.
    From its answer, one least squares of what it uses and of all sightings of tie points; with a method that leaves out
    what does not fit, the worst of a tie point leave while their test objects.
    """

    method: Estimator
    tie: Mask

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        o, tied = observations, self.tie[observations.landmark]
        found = self.method(replace(o, weight=np.where(tied, 0.0, o.weight)), C_EK)
        if not Status(int(found.status)).usable:
            return found
        if found.unknowns is None:
            raise InputError(
                "landmarks: found tie points (sigma inf), wanted the method default, gls or robust with them"
            )
        values = np.zeros(0) if found.parameters is None else found.parameters.values
        gls, state = Gls(found.unknowns.parameters), State(found.C_EK, values)
        used, answer = o.weight > 0.0, found
        verdict = np.zeros(o.n, dtype=np.int64) if found.verdict is None else found.verdict.copy()
        for _ in range(PASSES):
            used &= verdict == int(Verdict.USED)
            kept = replace(o, weight=np.where(used, o.weight, 0.0))
            answer = gls.estimate(kept, C_EK, state)
            values = np.zeros(0) if answer.parameters is None else answer.parameters.values
            state = State(answer.C_EK, values)
            fit = Fit(gls.unknowns, kept, state, C_EK)
            out = np.zeros(o.n, dtype=np.bool_) if found.verdict is None else _worst(fit, used & tied)
            if not np.any(out):
                break
            verdict[out] = int(Verdict.SIGHTING)
        dof = None if answer.degrees_of_freedom is None else answer.degrees_of_freedom - _places(fit, tied)
        return replace(
            answer,
            degrees_of_freedom=dof,
            verdict=None if found.verdict is None else verdict,
            notes=found.notes,
            rival=found.rival,
        )


def _worst(fit: Fit, tied: Mask) -> Mask:
    """The sightings to which their test objects, the worst of each tie point."""
    tested = fit.tested()
    if tested is None or not np.any(tied):
        return np.zeros(tied.size, dtype=np.bool_)
    level = LEVEL / max(int(np.sum(tied)), 1)
    T = np.where(tied, excess(tested, fit.table.weight > 0.0, level, level)[0], 0.0)
    largest = np.zeros(fit.table.n_landmarks)
    np.maximum.at(largest, fit.table.landmark, T)
    return np.asarray((T > 1.0) & (largest[fit.table.landmark] <= T))


def _places(fit: Fit, tied: Mask) -> int:
    """How many numbers the places of the tie points are: those that their sightings determine."""
    o, information = fit.table, np.zeros((fit.table.n_landmarks, 3, 3))
    for rows, (table, model, _) in fit.parts():
        W = np.linalg.inv(table.noise_px) * (table.weight * tied[rows])[:, None, None]
        np.add.at(information, table.landmark, model.R.mT @ W @ model.R)
    P = o.cov_landmark_J[np.unique(o.landmark[tied])]
    N = information[np.unique(o.landmark[tied])]
    share = N @ np.linalg.inv(N + np.linalg.inv(P))
    return round(float(np.sum(np.trace(share, axis1=-2, axis2=-1))))
