"""Numbers of a campaign's description that fit better than stated: against full adjustments, and against chance."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.judge import unmodelled as judged
from starplumb.judge.calibrate import calibrate
from starplumb.judge.conventions.unknowns import unknowns
from starplumb.judge.snooping import fit_at
from starplumb.judge.unmodelled import better, unmodelled
from starplumb.physics import so3
from starplumb.plan.scene import measured
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors

TURNED = {"images": 8, "markers": 10, "tilt_deg": 20.0}


def campaign_of(rng, camera, **scene):
    # frames turned by quarters, lines by halves: what is late along the track is then no turn of the camera
    scene = {**TURNED, "yaw_deg": 180.0 if camera is LINE else 90.0, **scene}
    flown = truth(camera, **scene)
    return measured(flown, Errors.draw(observe(flown), rng), C_EK_TRUE)


def fit_of(campaign, estimator=None):
    o = observe(campaign)
    estimate = (estimator or Gls())(o, campaign.C_EK)
    fit = fit_at(estimate.unknowns, o, campaign.C_EK, estimate, np.ones(o.n, dtype=bool))
    return fit, estimate


def keys(found):
    return [one.mistake.key for one in found]


@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line-scan"])
def test_each_number_is_that_of_an_adjustment_that_estimates_it(camera, rng):
    """Fall of chi-square, value, sigma and turn of the answer, against the whole iteration with one number more."""
    campaign = campaign_of(rng, camera)
    fit, plain = fit_of(campaign)
    found = list(better(campaign, fit))
    assert len(found) == 6 if camera is FRAME else 5
    for one in found:
        free = replace(one.mistake.free[0], sigma=(np.inf,))
        full = Gls((free,))(observe(campaign), campaign.C_EK)
        turn = so3.log(full.C_EK @ plain.C_EK.mT)
        sigma = np.sqrt(full.parameters.covariance[3, 3])
        assert one.value[0] == pytest.approx(full.parameters.values[0], abs=0.05 * sigma)
        assert one.sigma[0] == pytest.approx(sigma, rel=0.05)
        assert one.gain == pytest.approx(float(plain.chi2 - full.chi2), abs=0.02 + 0.05 * one.gain)
        np.testing.assert_allclose(one.turn_E, turn, atol=0.05 * np.max(plain.sigma_E))


def with_clock(campaign, late_s):
    return replace(campaign, images=replace(campaign.images, t_ns=campaign.images.t_ns + round(late_s * 1e9)))


def test_a_late_clock_is_named_and_the_interval_holds_the_truth(rng):
    """20 ms are 150 m of orbit, twenty sigmas; chi-square of the whole does not tell."""
    campaign = with_clock(campaign_of(rng, FRAME, yaw_deg=5.0), 0.02)
    done = calibrate(campaign, Gls())
    assert done.status is Status.WEAK
    assert done.chi2_p > 1e-4
    assert "the images' times are" in done.message
    assert "ms too late" in done.message
    assert "--estimate time_offset" in done.message
    error = np.abs(so3.log(done.C_EK @ C_EK_TRUE.mT))
    assert np.max(error / done.sigma_E) > 10.0
    assert np.all(error <= done.interval_95_E)


def test_a_wrong_focal_length_is_named(rng):
    campaign = campaign_of(rng, FRAME)
    wrong = replace(campaign, camera=replace(FRAME, focal_length=FRAME.focal_length * (1.0 + 5e-4)))
    found = unmodelled(wrong, fit_of(wrong)[0])
    said = re.search(r"the focal length is ([\d.]+) \(\+- ([\d.]+)\) mm too large", found.sentence)
    size, sigma = (float(number) for number in said.groups())
    assert size == pytest.approx(1.1, abs=3.0 * sigma)
    assert sigma < 0.05


def test_what_is_estimated_is_not_tried(rng):
    campaign = campaign_of(rng, FRAME)
    mistakes = {m.key: m for m in unknowns(campaign)}
    fit, _ = fit_of(campaign, Gls(mistakes["clock.time_offset"].free))
    assert "clock.time_offset" not in keys(better(campaign, fit))
    assert "camera.focal_length" in keys(better(campaign, fit))


@pytest.mark.parametrize(
    ("scale", "over", "said"), [(1.0, 1.01, True), (1.0, 0.99, False), (4.0, 4.04, True), (4.0, 3.96, False)]
)
def test_a_gain_is_said_beyond_one_in_ten_thousand_over_all_numbers(monkeypatch, rng, scale, over, said):
    """Six numbers: each at 1e-4 / 6, in units of the variance factor; a fit better than stated is no licence."""
    campaign = campaign_of(rng, FRAME, images=3)
    fit, _ = fit_of(campaign)
    tried = list(better(campaign, fit))
    least = stats.chi2.isf(1e-4 / 6, 1)
    gains = [replace(one, gain=0.0) for one in tried[:-1]] + [replace(tried[-1], gain=over * least)]
    monkeypatch.setattr(judged, "better", lambda *_: iter(gains))
    assert (unmodelled(campaign, fit, scale) is not None) is said
    if scale == 1.0:
        assert (unmodelled(campaign, fit, 0.25) is not None) is said


def test_the_interval_reaches_as_far_as_the_farthest_answer(monkeypatch, rng):
    campaign = campaign_of(rng, FRAME, images=3)
    fit, _ = fit_of(campaign)
    one, two = list(better(campaign, fit))[:2]
    turns = np.array([3e-5, -1e-5, 0.0]), np.array([-1e-5, 2e-5, 1e-6])
    found = [replace(one, gain=50.0, turn_E=turns[0]), replace(two, gain=90.0, turn_E=turns[1])]
    monkeypatch.setattr(judged, "better", lambda *_: iter(found))
    finding = unmodelled(campaign, fit)
    first, second = (1.0 + 1.96 / np.sqrt(gain) for gain in (50.0, 90.0))
    np.testing.assert_allclose(finding.reach_E, [3e-5 * first, 2e-5 * second, 1e-6 * second])
    assert finding.weight == 1
    assert "chi-square would fall by 90" in finding.sentence


@pytest.mark.slow
@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line-scan"])
def test_good_campaigns_have_gains_of_chance(camera, rng):
    """Of 40 campaigns with the true numbers: each gain is chi-square of one degree of freedom."""
    gains = np.array(
        [[one.gain for one in better(c, fit_of(c)[0])] for c in (campaign_of(rng, camera) for _ in range(40))]
    )
    for column in gains.mT:
        assert stats.kstest(column, stats.chi2(1).cdf).pvalue > 1e-3
