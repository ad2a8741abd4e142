"""The main job on true campaigns: signs of the reported correction, check points, residuals, judgement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.estimators.published.observer import Observer
from starplumb.estimators.wahba import Wahba
from starplumb.judge.calibrate import calibrate
from starplumb.judge.residuals import Accuracy, rms
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCMIN, ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors

CAMERAS = {"frame": FRAME, "line": LINE}


def delivered(rng, camera=FRAME, theta=(0.0, 0.0, 0.0), **options):
    """A campaign as an operator would hold it, and the errors in it."""
    campaign = truth(camera, **options)
    errors = Errors.draw(observe(campaign), rng)
    return scene.measured(campaign, errors, so3.exp(np.array(theta)) @ C_EK_TRUE), errors


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_correction_is_minus_the_models_error(camera, axis, rng):
    """``C_EK_model = exp(theta) C_EK_true`` is corrected by ``exp(d)`` with d about -theta, about each axis of E."""
    theta = 0.5 * DEG * np.eye(3)[axis]
    campaign, _ = delivered(rng, camera, theta, images=8, markers=8)
    done = calibrate(campaign, Gls())
    assert np.all(np.abs(done.correction_E + theta) < 4.5 * done.estimate.sigma_E)
    assert done.correction_E[axis] == pytest.approx(-0.5 * DEG, abs=60 * ARCSEC)
    np.testing.assert_allclose(so3.exp(done.correction_E) @ campaign.C_EK, done.estimate.C_EK, atol=1e-14)


def test_a_perfect_campaign_gives_the_truth_back(rng):
    campaign = replace(truth(LINE, images=3, markers=5), C_EK=so3.exp([0.01, -0.02, 0.5]) @ C_EK_TRUE)
    done = calibrate(campaign, Gls())
    assert np.linalg.norm(so3.log(done.estimate.C_EK @ C_EK_TRUE.mT)) < 0.01 * ARCSEC
    assert rms(done.residuals.after_px) < 1e-3
    after = done.accuracy(after=True)
    assert after is not None
    assert after.rmse < 1e-3


def test_geolocation_error_before_is_the_models_lever(rng):
    """A model turned by 200 arcsec about an axis across the boresight misses by 200 arcsec times the range."""
    theta = 200 * ARCSEC * C_EK_TRUE[:, 0]
    campaign, _ = delivered(rng, FRAME, theta, images=4, markers=8, tilt_deg=0.0)
    done = calibrate(campaign, Gls())
    before, after = done.accuracy(after=False), done.accuracy(after=True)
    distance = np.mean(done.observations.range_m)
    assert before.rmse == pytest.approx(200 * ARCSEC * distance, rel=0.05)
    # the tracker's 5 arcsec, the position's 3 m and the marker's metre remain
    assert 5 < after.rmse < 60
    assert before.n == after.n == 32


def test_accuracy_by_hand():
    found = Accuracy.of(np.array([[3.0, 4.0], [0.0, 0.0], [0.0, 5.0]]))
    assert found.rmse == pytest.approx(np.sqrt(50 / 3))
    assert found.ce90 == pytest.approx(5.0)
    assert found.n == 3
    assert Accuracy.of(np.zeros((0, 2))) is None
    assert Accuracy.of(np.array([[np.nan, 0.0]])) is None


def test_ce90_of_many_normal_errors(rng):
    """For equal normal errors on both axes CE90 = 2.1460 sigma and the rmse sqrt(2) sigma."""
    found = Accuracy.of(rng.standard_normal((200_000, 2)))
    assert found.ce90 == pytest.approx(2.1460, rel=0.01)
    assert found.rmse == pytest.approx(np.sqrt(2), rel=0.01)


def test_check_points_are_kept_out_and_judged_apart(rng):
    campaign, _ = delivered(rng, FRAME, images=4, markers=6)
    check = np.zeros(24, dtype=bool)
    check[[1, 8, 20]] = True
    s = campaign.sightings
    spoilt = replace(s, check=check, column_px=s.column_px + 500.0 * check)
    done = calibrate(replace(campaign, sightings=spoilt), Gls())
    without = calibrate(replace(campaign, sightings=replace(s, check=check)), Gls())
    np.testing.assert_array_equal(done.estimate.C_EK, without.estimate.C_EK)
    np.testing.assert_array_equal(done.residuals.used, ~check)
    pixel_m = 690e3 * FRAME.pitch / FRAME.focal_length
    assert done.accuracy(after=True, check=True).rmse == pytest.approx(500 * pixel_m, rel=0.1)
    assert done.accuracy(after=True).rmse < 100
    assert done.accuracy(after=True, check=True).n == 3
    assert calibrate(campaign, Gls()).accuracy(after=True, check=True) is None


def test_no_control_points_at_all_is_the_users_mistake(rng):
    campaign, _ = delivered(rng, FRAME, images=1, markers=3)
    s = campaign.sightings
    with pytest.raises(InputError, match="no observation with role control"):
        calibrate(replace(campaign, sightings=replace(s, check=~s.check)), Gls())


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_image_errors_are_reported_with_their_own_sign(camera, rng):
    """A tracker far worse than all else: the error reported of each image is the one it had, less what they share.

    What is common to all images is taken for the mounting's: ``C_EK = exp(common) C_EK_true``.
    """
    options = {"images": 12, "markers": 12, "tilt_deg": 15.0, "yaw_deg": 60.0}
    campaign = truth(camera, **options)
    errors = Errors.draw(observe(campaign), rng)
    errors = replace(errors, alpha_E=40 * errors.alpha_E)
    campaign = replace(campaign, cov_attitude_E=40**2 * campaign.cov_attitude_E)
    done = calibrate(scene.measured(campaign, errors, C_EK_TRUE), Gls())
    common = so3.log(done.estimate.C_EK @ C_EK_TRUE.mT)
    np.testing.assert_allclose(done.residuals.alpha_E + common, errors.alpha_E, atol=60 * ARCSEC)
    assert np.std(errors.alpha_E) > 200 * ARCSEC


def test_what_remains_is_the_noise(rng):
    """Markers of one site seen from many images: with the shared errors taken out the residual is the pixel noise."""
    campaign, _ = delivered(rng, FRAME, images=6, markers=25, shared_site=True)
    done = calibrate(campaign, Gls())
    left = rms(done.residuals.fit_px / campaign.sightings.sigma_px[:, None])
    assert 0.8 < left < 1.05
    assert rms(done.residuals.after_px) > 5 * rms(done.residuals.fit_px)


def test_too_little_to_go_by_is_singular_and_says_so(rng):
    campaign, _ = delivered(rng, FRAME, images=1, markers=1)
    done = calibrate(campaign, Gls())
    assert done.status == Status.SINGULAR
    assert "at least two markers" in done.message


def test_the_closed_form_has_an_answer_without_a_covariance(rng):
    campaign, _ = delivered(rng, FRAME, (1.0, -2.0, 0.5), images=4, markers=6)
    done = calibrate(campaign, Wahba())
    assert done.status.usable
    assert done.chi2_p is None
    assert done.estimate.sigma_E is None
    assert np.linalg.norm(so3.log(done.estimate.C_EK @ C_EK_TRUE.mT)) < 300 * ARCSEC
    assert "this method states no sigma: least squares with every stated error" in done.message
    by_gls = calibrate(campaign, Gls())
    apart = np.abs(so3.log(by_gls.C_EK @ done.C_EK.mT))
    np.testing.assert_allclose(done.interval_95_E, apart + by_gls.interval_95_E, rtol=1e-6)


@pytest.mark.slow
def test_chi_square_of_sound_campaigns_is_spread_evenly(rng):
    p = [calibrate(delivered(rng, FRAME, images=3, markers=4)[0], Gls()).chi2_p for _ in range(60)]
    assert kstest(p, "uniform").pvalue > 1e-3


def test_the_observer_says_how_large_the_initial_error_was_and_that_it_has_settled() -> None:
    campaign = truth(images=2)
    turn = so3.exp(np.array([20.0, -35.0, 10.0]) * ARCMIN)
    done = calibrate(replace(campaign, C_EK=turn @ campaign.C_EK), Observer(cycles=30))
    said = " ".join(done.sentences)
    assert "the very first equation put the initial error at" in said
    assert "the estimate has settled" in said
