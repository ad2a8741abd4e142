"""The error of a session taken from the data: found again, in the covariance, said; and trackers that wander."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from helpers import CAMPAIGN, write_good_campaign
from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.io.campaign.read import load_campaign
from starplumb.judge.calibrate import calibrate
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.physics.trackers import FusedAttitude, TrackerSeries
from starplumb.physics.units import ARCSEC
from starplumb.plan import scene
from starplumb.table.campaign import SharedErrors
from starplumb.table.geometry import observe
from starplumb.table.sharing import shared_sources
from starplumb.table.simulate import Errors

ESTIMATE = SharedErrors("image", session_estimated=True)


def flown(rng, sigma_arcsec, sessions=12, each=3):
    """A measured campaign whose images of a session share an error about each axis, and that asks for it."""
    campaign = truth(FRAME, sessions * each, 8, tilt_deg=15.0, yaw_deg=60.0)
    o, number = observe(campaign), np.repeat(np.arange(sessions), each)
    shared = sigma_arcsec * ARCSEC * rng.standard_normal((sessions, 3))[number]
    errors = Errors.draw(o, rng)
    measured = scene.measured(campaign, replace(errors, alpha_E=errors.alpha_E + shared), C_EK_TRUE)
    names = tuple(f"s{k}" for k in number)
    images = replace(measured.images, sessions=names, passes=names)
    return replace(measured, images=images, attitude_errors=ESTIMATE, position_errors=SharedErrors("image"))


def test_the_error_of_sessions_is_found_again_and_in_the_sigma(rng):
    """20 arcsec beside 5, 5, 12 of an image, from 12 sessions: known to 1 / sqrt(2 . 11 . 3) and the scene's shape."""
    campaign = flown(rng, 20.0)
    done = calibrate(campaign, Gls())
    root = done.campaign.attitude_errors.session_sigma / ARCSEC
    variance = np.trace(root @ root.T) / 3.0
    assert 12.0 < np.sqrt(variance) < 30.0
    assert done.status == Status.OK
    (said,) = [text for text in done.sentences if "images of a session share" in text]
    assert "estimated from 12 sessions" in said
    # the answer's variance holds that of the mean of 12 sessions
    contained = np.diag(root @ root.T) / 12.0
    assert np.all((done.sigma_E / ARCSEC) ** 2 > 0.9 * contained)
    without = calibrate(replace(campaign, attitude_errors=SharedErrors("image")), Gls())
    assert np.all(done.sigma_E > 1.3 * without.sigma_E)
    own, _ = [source for source in done.from_data.sources if source.kind.startswith("session")]
    assert own.ratio == pytest.approx(1.0, abs=0.1)
    assert done.interval_95_E is not None
    assert np.all(done.interval_95_E > 1.96 * done.sigma_E)


def test_few_sessions_are_said_to_widen_the_interval(rng):
    done = calibrate(flown(rng, 20.0, sessions=3, each=4), Gls())
    assert any("5 sessions or more would narrow the interval" in text for text in done.sentences)
    wider = done.interval_95_E / (1.96 * done.sigma_E)
    assert np.max(wider) > 1.2


def test_one_session_tells_nothing(rng):
    campaign = flown(rng, 20.0, sessions=1, each=4)
    with pytest.raises(InputError, match="with 1 sessions of 4 images, wanted two sessions or more"):
        calibrate(campaign, Gls())


@pytest.mark.slow
def test_intervals_with_an_estimated_session_hold(rng):
    """95 % of 40 campaigns of 8 sessions, within four of its deviations; those that know of no session do not."""
    held: dict[bool, list] = {True: [], False: []}
    for _ in range(40):
        campaign = flown(rng, 15.0, sessions=8)
        for asked in held:
            stated = campaign.attitude_errors if asked else SharedErrors("image")
            done = calibrate(replace(campaign, attitude_errors=stated), Gls())
            half = done.interval_95_E if asked else 1.96 * done.estimate.sigma_E
            held[asked].append(np.abs(so3.log(done.C_EK @ C_EK_TRUE.mT)) < half)
    least = 0.95 - 4 * np.sqrt(0.95 * 0.05 / 40)
    assert np.all(np.mean(held[True], axis=0) > least)
    assert np.min(np.mean(held[False], axis=0)) < least


def test_what_asks_for_it_is_read(tmp_path):
    text = CAMPAIGN.replace("[attitude]\n", '[attitude]\nsession_sigma_arcsec = "estimate"\n')
    campaign = load_campaign(write_good_campaign(tmp_path, campaign=text)).campaign
    assert campaign.attitude_errors.session_estimated
    assert campaign.attitude_errors.session_sigma is None
    wrong = CAMPAIGN.replace("[attitude]\n", '[attitude]\nsession_sigma_arcsec = "guess"\n')
    with pytest.raises(
        InputError, match=r'attitude\.session_sigma_arcsec: found "guess", wanted .*"estimate"'
    ):
        load_campaign(write_good_campaign(tmp_path / "b", campaign=wrong))


def test_two_trackers_wander_by_half_of_each():
    """Of equal weight, with roots about E: the sum of a quarter of each covariance."""
    campaign = truth(FRAME, 2, 4)
    series, sigma = campaign.one_attitude, np.array([5.0, 5.0, 12.0]) * ARCSEC
    fused = FusedAttitude(tuple(TrackerSeries(name, series, np.eye(3), sigma) for name in "ab"), "mean")
    a, b = np.diag([2.0, 2.0, 4.0]) * ARCSEC, np.diag([4.0, 2.0, 0.0]) * ARCSEC
    root = fused.root_E(campaign.images.t_ns, np.stack([a, b]))
    errors = SharedErrors("image", wander_sigma=root, wander_time_s=1e9)
    (wander,) = shared_sources(replace(campaign, attitude_errors=errors), observe(campaign))
    block = wander.gain @ wander.gain.mT
    np.testing.assert_allclose(
        block, np.broadcast_to((a @ a + b @ b) / 4.0, block.shape), rtol=1e-6, atol=1e-20
    )
