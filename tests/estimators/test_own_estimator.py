"""An estimator that the package has never seen is judged like its own: by its answer, not by its class."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import AlignmentEstimate, Status, Verdict
from starplumb.estimators.robust import Robust
from starplumb.judge.calibrate import calibrate, shares
from starplumb.judge.compare import compare
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.plan import scene
from starplumb.table.equation import linearise
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors


@dataclass(frozen=True)
class ByScipy:
    """SciPy's least squares on residuals whitened by their dense covariance: a mounting and its covariance, no more.

    ``left_out`` are rows that its author does not trust.
    """

    left_out: tuple[int, ...] = ()
    covariance_factor: float = 1.0
    shift_sigma: float = 0.0

    def __call__(self, observations, C_EK):
        keep = ~np.isin(np.arange(observations.n), self.left_out)
        o = observations.select(keep)
        V = np.diag(np.repeat(o.sigma_px**2, 2))
        model = linearise(o, C_EK)
        for design, covariance, index in (
            (model.H, o.cov_attitude_E, o.image),
            (model.R, o.cov_position_J, o.image),
            (model.R, o.cov_landmark_J, o.landmark),
        ):
            for member in np.unique(index):
                J = np.where((index == member)[:, None, None], design, 0.0).reshape(-1, 3)
                V += J @ covariance[member] @ J.T
        L = np.linalg.cholesky(V)

        def whitened(theta):
            return np.linalg.solve(L, linearise(o, so3.exp(theta * ARCSEC) @ C_EK).z_px.reshape(-1))

        found = least_squares(whitened, np.zeros(3), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        P = np.linalg.inv(found.jac.T @ found.jac) * ARCSEC**2
        C = so3.exp(found.x * ARCSEC + self.shift_sigma * np.sqrt(np.diag(P))) @ C_EK
        verdict = np.where(keep, int(Verdict.USED), int(Verdict.SIGHTING))
        return AlignmentEstimate(
            C, self.covariance_factor * P, np.array(int(Status.OK)), np.array(found.nfev), verdict=verdict
        )


def delivered(rng, blunder=None):
    campaign = truth(FRAME, images=6, markers=6, tilt_deg=20.0, yaw_deg=50.0)
    campaign = scene.measured(
        campaign, Errors.draw(observe(campaign), rng), so3.exp(np.full(3, 50 * ARCSEC)) @ C_EK_TRUE
    )
    if blunder is None:
        return campaign
    s = campaign.sightings
    column_px = s.column_px + 40.0 * (np.arange(s.column_px.size) == blunder)
    return replace(campaign, sightings=replace(s, column_px=column_px))


def test_an_own_estimator_gets_the_whole_judgement(rng):
    """Where its answer is that of gls, so is all that is said of it."""
    campaign = delivered(rng)
    ours, own = calibrate(campaign, Gls()), calibrate(campaign, ByScipy())
    assert own.status is ours.status
    assert own.message == ours.message
    assert own.chi2_p == pytest.approx(ours.chi2_p, rel=1e-3)
    assert own.estimate.degrees_of_freedom == ours.estimate.degrees_of_freedom == 2 * 36 - 3
    for name in ("before_px", "after_px", "fit_px", "before_m", "after_m"):
        np.testing.assert_allclose(
            getattr(own.residuals, name), getattr(ours.residuals, name), rtol=1e-3, atol=5e-3
        )
    for name in ("statistic", "w", "redundancy", "detectable_px", "effect_E"):
        np.testing.assert_allclose(
            getattr(own.snooping, name), getattr(ours.snooping, name), rtol=1e-2, atol=2e-3
        )
    wanted = shares(ours)
    assert (
        set(shares(own))
        == set(wanted)
        == {
            "star tracker",
            "satellite position",
            "marker survey",
            "image measurement",
        }
    )
    for name, part in shares(own).items():
        np.testing.assert_allclose(part, wanted[name], rtol=1e-2, atol=1e-3 * np.max(wanted[name]))


def test_what_it_rejects_is_listed_with_its_statistic(rng):
    """A marker 40 px off, left out by hand and by robust: the same entry."""
    campaign = delivered(rng, blunder=7)
    own, robust = calibrate(campaign, ByScipy(left_out=(7,))), calibrate(campaign, Robust())
    assert [(r.image, r.landmark) for r in own.rejected] == [(1, 7)]
    assert own.rejected[0].reason.startswith("sighting: predicted minus measured -")
    assert own.rejected[0].statistic > 20.0
    assert [(r.image, r.landmark) for r in robust.rejected] == [(1, 7)]
    assert own.rejected[0].statistic == pytest.approx(robust.rejected[0].statistic, rel=1e-2)
    assert not own.residuals.used[7]


@pytest.mark.parametrize(
    ("own", "same"),
    [
        (ByScipy(), True),
        (ByScipy(shift_sigma=0.003), True),
        (ByScipy(shift_sigma=0.05), False),
        (ByScipy(covariance_factor=1.005), True),
        (ByScipy(covariance_factor=1.05), False),
        (ByScipy(covariance_factor=0.95), False),
    ],
)
def test_another_answer_is_not_judged_by_the_gain_of_gls(own, same, rng):
    """An answer that is not the minimum, or a covariance that is not that of it, says nothing of single sightings."""
    done = calibrate(delivered(rng), own)
    assert (done.snooping is not None) is same
    assert (done.chi2_p is not None) is same
    assert bool(shares(done)) is same
    assert np.all(np.isfinite(done.residuals.after_px))


def test_it_stands_in_the_comparison_with_its_own_notes(rng):
    """Its notes are shown, and where it states a larger sigma than gls that is said."""

    @dataclass(frozen=True)
    class Noted:
        def __call__(self, observations, C_EK):
            found = ByScipy(covariance_factor=4.0)(observations, C_EK)
            return replace(found, notes=("by hand",))

    (answer,) = compare(delivered(rng), {"mine": Noted})
    assert answer.remarks == ("by hand", "sigma up to 2 times that of gls")
    assert np.abs(answer.from_gls).max() < 1e-2
