"""Calibrate a mounting that moves: estimate its motion, take it out of the attitudes, and judge what is left.

The campaign's attitudes are turned by the motion (:attr:`starplumb.table.campaign.Campaign.turn_E`), so that estimator,
tests and residuals see a mounting at rest.  The motion is estimated from the images' equations of one adjustment after
another, which leave out what the estimator rejected.  The answer is the mean mounting, its covariance that of the mean
in the average of models: what parts the models, and the larger scatter where there is some, are in it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...estimators.fit import Unknowns
from ...estimators.gls import Gls
from ...estimators.protocol import Estimator
from ...physics.units import ARCSEC
from ...table.campaign import Campaign
from ...table.phases import Phases, phases
from ..calibrate import Calibration, calibrate
from ..snooping import fit_at
from ..trust import NORMAL_95
from .asked import AUTO, NONE, kinds_asked
from .averaging import Motion, averaged
from .directed import directed_tests
from .found import FEWEST, Moves, described, reach, variance_of, when_of
from .regressors import Scales, families
from .sums import ImageSums, image_sums

Array = NDArray[np.float64]

ROUNDS = 2
"""Estimates of the motion: the second knows what the estimator rejected once the first was taken out."""


def calibrate_moving(campaign: Campaign, estimator: Estimator, drift: str = NONE) -> Calibration:
    """:func:`starplumb.judge.calibrate.calibrate`, the motion of the mounting estimated as ``drift`` asks.

    Raises ArgumentError for a model that the images do not tell.
    """
    if drift == NONE:
        return calibrate(campaign, estimator)
    where = phases(campaign)
    found = calibrate(campaign, Gls())  # leaves out nothing: what moves may look wrong to a mounting at rest
    turn: Array = np.zeros((len(campaign.images.ids), 3))
    moving = None
    for _ in range(ROUNDS):
        moving = _moves(campaign, found, turn, where, drift)
        if moving is None:
            return _untold(calibrate(campaign, estimator), drift)
        turn = _turn(campaign, moving, where)
        found = calibrate(replace(campaign, turn_E=turn), estimator)
    moving = _moves(campaign, found, turn, where, drift) or moving
    return _answer(found, moving, drift) if moving is not None and found.status.usable else found


def _moves(campaign: Campaign, found: Calibration, turn: Array, where: Phases, drift: str) -> Moves | None:
    """The tests and the motion about the answer of a campaign from which a motion ``turn`` (m, 3) is taken."""
    unknowns = found.estimate.unknowns or Unknowns()
    fit = fit_at(unknowns, found.observations, campaign.C_EK, found.estimate, found.residuals.used)
    sums = image_sums(fit)
    if sums is None or sums.size < FEWEST:
        return None
    sums = sums.moved(turn[sums.image])
    when = when_of(campaign, where, sums.image)
    scales = Scales.of(when, where.orbit if np.all(np.isfinite(when.u)) else None)
    tried = families(when, scales)
    tests = directed_tests(sums, when, scales, tried)
    kinds = kinds_asked(drift, tried, when, scales)
    if not tests:
        return None
    motion = averaged(sums, when, scales, kinds, variance_of(tests))
    return Moves(sums, when, scales, tried, tests, motion, drift)


def _turn(campaign: Campaign, moving: Moves, where: Phases) -> Array:
    """How far (m, 3) rad the mounting is turned from its mean at each image; 0 where no orbit covers an image."""
    assert moving.motion is not None
    still = replace(
        moving.motion, coefficients=np.concatenate([np.zeros((1, 3)), moving.motion.coefficients[1:]])
    )
    d, _ = still.at(when_of(campaign, where, np.arange(len(campaign.images.ids))))
    return np.nan_to_num(d)


def _untold(found: Calibration, drift: str) -> Calibration:
    sentence = (
        f"--drift {drift}: the images are too few, or too close together, to tell a motion; none is estimated"
    )
    return replace(found, sentences=(*found.sentences, sentence))


def _answer(found: Calibration, moving: Moves, drift: str) -> Calibration:
    """The judged answer with the motion in it: its covariance, its interval and what is said of it."""
    motion = moving.motion
    assert motion is not None
    further = _more(motion.mean_covariance, _rests(moving.sums))
    covariance = found.estimate.covariance_E
    if covariance is None or found.interval_95_E is None:
        return found
    wide = np.sqrt(found.interval_95_E**2 + NORMAL_95**2 * np.diagonal(further))
    data = found.from_data
    if data is not None and data.sigma_E is not None:
        data = replace(data, sigma_E=np.sqrt(data.sigma_E**2 + np.diagonal(further)))
    beyond = _more(covariance, _rests(moving.sums))
    moved = _with_mean(motion, beyond)
    return replace(
        found,
        estimate=replace(found.estimate, covariance_E=covariance + further),
        interval_95_E=wide,
        from_data=data,
        moves=replace(moving, motion=moved, further_E=further),
        sentences=(*found.sentences, _said(moved, moving, drift)),
    )


def _rests(sums: ImageSums) -> Array:
    """Covariance (3, 3) rad^2 of a mounting at rest by the images' equations."""
    M, _ = sums.equations(np.ones((sums.size, 1)))
    return np.asarray(np.linalg.inv(M + sums.prior))


def _more(covariance: Array, than: Array) -> Array:
    """What a covariance (3, 3) has more than another along any axis."""
    values, axes = np.linalg.eigh(covariance - than)
    return np.asarray((axes * np.maximum(values, 0.0)) @ axes.mT)


def _with_mean(motion: Motion, further: Array) -> Motion:
    """The motion about its mean, which the answer has in it, with a larger covariance of that."""
    covariance = motion.covariance.copy()
    covariance[:3, :3] += further
    coefficients = motion.coefficients.copy()
    coefficients[0] = 0.0
    return replace(motion, coefficients=coefficients, covariance=covariance)


def _said(motion: Motion, moving: Moves, drift: str) -> str:
    kind, weight = max(motion.weights.items(), key=lambda item: item[1])
    away = reach(motion, moving.when)
    axis = int(np.argmax(away))
    size = f"up to {away[axis] / ARCSEC:.2g} arcsec about {'xyz'[axis]} from its mean, with 95 % probability"
    if drift != AUTO:
        return f"the mounting moves as estimated ({drift}), {size}; starplumb predict gives it at a time"
    if kind == "constant":
        return f"the images prefer a mounting at rest ({100 * weight:.0f} %); it lies {size}"
    how = described(moving.tests[0].columns) if moving.found is not None else f"perhaps ({kind})"
    return f"the mounting moves {how}, {size}; starplumb predict gives it at a time"
