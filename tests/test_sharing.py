"""Errors that images, sessions, surveys and samples share: drawn by hand, and met by the sigma stated of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from helpers import CAMPAIGN, IMAGES, LANDMARKS, write_good_campaign
from problems import C_EK_TRUE, FRAME, LINE, SIGMAS, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.judge.calibrate import calibrate
from starplumb.judge.error_shares import shares
from starplumb.physics import so3
from starplumb.physics.earth import C_JT, itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.trackers import FusedAttitude, TrackerSeries
from starplumb.physics.units import ARCSEC
from starplumb.plan import scene
from starplumb.table.campaign import SharedErrors
from starplumb.table.equation import residual_px
from starplumb.table.geometry import observe
from starplumb.table.sharing import chained, numbered, passes, sessions, with_shared
from starplumb.table.simulate import Errors, measure

RUNS = 400
SIGMA = np.array([5.0, 5.0, 12.0]) * ARCSEC
PAIRS = tuple("aabb")
"""Passes or sessions of four images."""
OF_PAIRS = np.array([0, 0, 1, 1])


def process(rng, t_s, time_s, runs, width):
    """An exponentially correlated process of variance 1 at sorted times, step by step: (runs, times, width)."""
    x = np.empty((runs, t_s.size, width))
    x[:, 0] = rng.normal(size=(runs, width))
    for i, kept in enumerate(np.exp(-np.diff(t_s) / time_s), start=1):
        x[:, i] = kept * x[:, i - 1] + np.sqrt(1.0 - kept**2) * rng.normal(size=(runs, width))
    return x


def sharing(campaign, **stated):
    """The campaign with pairs of images as its passes and sessions, and what is stated of attitude and position."""
    images = replace(campaign.images, passes=PAIRS, sessions=PAIRS)
    return replace(campaign, images=images, **stated)


def attitude_of_a_pass(campaign, o, rng):
    alpha = rng.normal(size=(RUNS, 2, 3))[:, OF_PAIRS] * SIGMA
    return sharing(campaign, attitude_errors=SharedErrors("pass")), {"alpha_E": alpha}


def attitude_of_the_campaign(campaign, o, rng):
    alpha = np.repeat(rng.normal(size=(RUNS, 1, 3)), 4, axis=1) * SIGMA
    return sharing(campaign, attitude_errors=SharedErrors("campaign")), {"alpha_E": alpha}


def attitude_that_is_correlated(campaign, o, rng):
    t_s = (campaign.images.t_ns - campaign.images.t_ns[0]) * 1e-9
    alpha = process(rng, t_s, 40.0, RUNS, 3) * SIGMA
    stated = SharedErrors(correlation_time_s=40.0)
    return replace(campaign, attitude_errors=stated), {"alpha_E": alpha}


def attitude_of_a_session_besides(campaign, o, rng):
    further = np.array([3.0, 4.0, 6.0]) * ARCSEC
    alpha = rng.normal(size=(RUNS, 4, 3)) * SIGMA + rng.normal(size=(RUNS, 2, 3))[:, OF_PAIRS] * further
    stated = SharedErrors("image", session_sigma=further)
    return sharing(campaign, attitude_errors=stated), {"alpha_E": alpha}


def attitude_that_wanders(campaign, o, rng):
    """Within each image the rows are exposed one after another."""
    further, turn = np.array([2.0, 2.0, 4.0]) * ARCSEC, np.zeros((RUNS, o.n, 3))
    for i in range(4):
        rows = np.flatnonzero(o.image == i)
        rows = rows[np.argsort(campaign.sightings.row_px[rows])]
        t_s = 1e-9 * (campaign.images.exposed(o.image[rows], campaign.sightings.row_px[rows]))
        turn[:, rows] = process(rng, t_s - t_s[0], 1.0, RUNS, 3) * further
    stated = SharedErrors("image", wander_sigma=further, wander_time_s=1.0)
    alpha = rng.normal(size=(RUNS, 4, 3)) * SIGMA
    return replace(campaign, attitude_errors=stated), {"alpha_E": alpha, "turn_E": turn}


def position_of_the_campaign(campaign, o, rng):
    rho = np.repeat(rng.normal(size=(RUNS, 1, 3)), 4, axis=1) * campaign.sigma_position
    return replace(campaign, position_errors=SharedErrors("campaign")), {"rho_J": rho}


def position_of_a_session_besides(campaign, o, rng):
    further = np.array([20.0, 10.0, 30.0])
    rho = rng.normal(size=(RUNS, 4, 3)) * campaign.sigma_position
    rho = rho + rng.normal(size=(RUNS, 2, 3))[:, OF_PAIRS] * further
    return sharing(campaign, position_errors=SharedErrors("image", session_sigma=further)), {"rho_J": rho}


def survey(campaign, o, rng):
    further, landmarks = np.array([20.0, 10.0, 30.0]), campaign.landmarks
    names = tuple("ab"[i % 2] for i in range(o.n_landmarks))
    latitude, longitude, _ = itrf_to_geodetic(landmarks.r_J)
    own = np.linalg.cholesky(landmarks.covariance_J) @ rng.normal(size=(RUNS, o.n_landmarks, 3, 1))
    common = (rng.normal(size=(RUNS, 2, 3)) * further)[:, np.arange(o.n_landmarks) % 2, :, None]
    pi = own + C_JT(latitude, longitude) @ common
    return replace(campaign, landmarks=replace(landmarks, common_sigma=further, sources=names)), {
        "pi_J": pi[..., 0]
    }


def time(campaign, o, rng):
    sigma = np.array([2e-3, 1e-3, 3e-3, 0.0])
    images = replace(campaign.images, sigma_time_s=sigma)
    return replace(campaign, images=images), {"late_s": rng.normal(size=(RUNS, 4)) * sigma}


ALL = (
    attitude_of_a_pass,
    attitude_of_the_campaign,
    attitude_that_is_correlated,
    attitude_of_a_session_besides,
    attitude_that_wanders,
    position_of_the_campaign,
    position_of_a_session_besides,
    survey,
    time,
)


def scene_of(shared, camera):
    """Four images; of a coarse orbit where its error is the one that is shared."""
    coarse = replace(SIGMAS, position=np.array([30.0, 20.0, 30.0]))
    sigmas = coarse if shared is position_of_the_campaign else SIGMAS
    return truth(camera, 4, 8, tilt_deg=20.0, yaw_deg=0.0 if camera is LINE else 60.0, sigmas=sigmas)


def campaigns(shared, camera, rng):
    """Estimates of many campaigns and their errors; all errors that are not shared are drawn as the table states."""
    campaign = scene_of(shared, camera)
    o = observe(campaign)
    stated, drawn = shared(campaign, o, rng)
    errors = replace(Errors.draw(o, rng, (RUNS,)), **drawn)
    estimate = Gls()(measure(with_shared(stated, o, C_EK_TRUE), C_EK_TRUE, errors), C_EK_TRUE)
    return estimate, so3.log(estimate.C_EK @ C_EK_TRUE.mT)


@pytest.mark.slow
@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
@pytest.mark.parametrize("shared", ALL, ids=[one.__name__ for one in ALL])
def test_the_sigma_is_met(shared, camera, rng):
    """error / sigma has deviation 1 on each axis and chi-square its mean, all within 4 sigma of 400 campaigns."""
    estimate, error = campaigns(shared, camera, rng)
    assert np.all(estimate.status == Status.OK)
    np.testing.assert_allclose(np.std(error / estimate.sigma_E, axis=0), 1.0, atol=4 / np.sqrt(2 * RUNS))
    dof = int(estimate.degrees_of_freedom[0])
    assert np.mean(estimate.chi2) == pytest.approx(dof, abs=4 * np.sqrt(2 * dof / RUNS))


@pytest.mark.slow
@pytest.mark.parametrize("shared", ALL, ids=[one.__name__ for one in ALL])
def test_without_the_statement_the_sigma_is_not_met(shared, rng):
    """The same errors, unstated: a sigma or chi-square is clearly wrong, so that the test above can fail."""
    campaign = scene_of(shared, LINE)
    o = observe(campaign)
    _, drawn = shared(campaign, o, rng)
    estimate = Gls()(measure(o, C_EK_TRUE, replace(Errors.draw(o, rng, (RUNS,)), **drawn)), C_EK_TRUE)
    score = so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E
    dof = int(estimate.degrees_of_freedom[0])
    off = np.abs(np.std(score, axis=0) - 1.0) > 4 / np.sqrt(2 * RUNS)
    assert np.any(off) or abs(np.mean(estimate.chi2) - dof) > 4 * np.sqrt(2 * dof / RUNS)


def test_white_noise_of_raw_samples():
    """Samples moved one by one and interpolated by the series itself; it turns by 1e-3 from one to the next."""
    campaign, C_EK = truth(LINE, 3, 8), C_EK_TRUE
    o = observe(campaign)
    stated = with_shared(replace(campaign, attitude_errors=SharedErrors("sample")), o, C_EK)
    series, step = campaign.one_attitude, 1e-6
    t_ns = campaign.images.exposed(o.image, campaign.sightings.row_px)
    used = np.unique(series.weights(t_ns)[0])
    total = np.zeros((o.n, 2, o.n, 2))
    for sample in used.tolist():
        for axis in range(3):
            q = series.q_EF.copy()
            q[sample] = so3.to_quaternion(so3.exp(step * np.eye(3)[axis]) @ so3.from_quaternion(q[sample]))
            moved = observe(replace(campaign, attitude=replace(series, q_EF=q)))
            z = residual_px(moved, C_EK) - residual_px(o, C_EK)
            block = z * SIGMA[axis] / step
            total += block[:, :, None, None] * block
    common = stated.common_px.reshape(o.n * 2, -1)
    found = (common @ common.T).reshape(total.shape)
    np.testing.assert_allclose(found, total, atol=2e-3 * np.abs(total).max())
    assert not np.any(stated.cov_attitude_E)
    assert common.shape[1] < 3 * used.size, (common.shape, used.size)


# ---------------------------------------------------------------- groups


def test_times_chain_over_gaps():
    t = np.array([10.0, 0.0, 1.5, 12.0, 30.0])
    assert chained(t, 2.0).tolist() == [1, 0, 0, 1, 2]
    assert chained(t, 1.9).tolist() == [1, 0, 0, 2, 3]


def test_passes_and_sessions_as_stated_or_by_time():
    campaign = truth(FRAME, 4, 4)
    assert passes(campaign).tolist() == [0, 0, 0, 0]
    named = replace(campaign, images=replace(campaign.images, passes=("p", "q", "q", "p")))
    assert passes(named).tolist() == [0, 1, 1, 0]
    assert sessions(named).tolist() == [0, 1, 1, 0]
    both = replace(named, images=replace(named.images, sessions=("s", "s", "t", "t")))
    assert passes(both).tolist() == [0, 1, 1, 0]
    assert sessions(both).tolist() == [0, 0, 1, 1]
    assert numbered(("b", "a", "b")).tolist() == [0, 1, 0]


def test_a_campaign_without_shared_errors_keeps_its_table():
    campaign = truth(FRAME, 3, 4)
    o = observe(campaign)

    def unasked():
        raise AssertionError

    assert with_shared(campaign, o, unasked) is o
    stated = replace(campaign, attitude_errors=SharedErrors("pass"))
    names = with_shared(stated, o, C_EK_TRUE).common_of
    assert names == ("attitude",) * 3


def test_too_many_shared_errors_are_refused(monkeypatch):
    campaign = replace(truth(FRAME, 3, 4), attitude_errors=SharedErrors("campaign"))
    monkeypatch.setattr("starplumb.table.sharing.MOST_NUMBERS", 71)
    with pytest.raises(InputError, match="12 sightings that share 3 errors, wanted at most 2"):
        calibrate(campaign, Gls())


# ---------------------------------------------------------------- files

STATED = {
    "attitude": "correlation_time_s = 30.0\nsession_sigma_arcsec = [1.0, 1.0, 2.0]\n"
    "wander = { sigma_arcsec = [2.0, 2.0, 4.0], correlation_time_s = 1.5 }\n",
    "ephemeris": 'shared_by = "pass"\nsession_sigma_m = 2.0\n',
    "landmarks": "common_sigma_m = [0.5, 0.5, 1.0]\n",
}


def stated_text(**sections):
    text = CAMPAIGN
    for section, keys in sections.items():
        text = text.replace(f"[{section}]\n", f"[{section}]\n{keys}")
    return text


def tables():
    image_rows = zip(
        IMAGES.splitlines(), ["pass,session,sigma_time_s", "p1,s1,0.002", "p2,s1,0.0"], strict=True
    )
    landmark_rows = zip(LANDMARKS.splitlines(), ["source", "gnss", "map", "map"], strict=True)
    return {
        "images": "".join(f"{a},{b}\n" for a, b in image_rows),
        "landmarks": "".join(f"{a},{b}\n" for a, b in landmark_rows),
    }


def test_what_is_shared_is_read_and_written(tmp_path):
    path = write_good_campaign(tmp_path / "a", campaign=stated_text(**STATED), **tables())
    for campaign in (load_campaign(path).campaign, None):
        if campaign is None:
            campaign = load_campaign(write_campaign(tmp_path / "b", load_campaign(path).campaign)).campaign
        attitude, position = campaign.attitude_errors, campaign.position_errors
        assert (attitude.shared_by, attitude.correlation_time_s, attitude.wander_time_s) == (None, 30.0, 1.5)
        np.testing.assert_allclose(attitude.session_sigma / ARCSEC, [1.0, 1.0, 2.0])
        np.testing.assert_allclose(attitude.wander_sigma / ARCSEC, [2.0, 2.0, 4.0])
        assert position.shared_by == "pass"
        np.testing.assert_array_equal(position.session_sigma, 2.0)
        np.testing.assert_array_equal(campaign.landmarks.common_sigma, [0.5, 0.5, 1.0])
        assert campaign.landmarks.sources == ("gnss", "map", "map")
        assert (campaign.images.passes, campaign.images.sessions) == (("p1", "p2"), ("s1", "s1"))
        np.testing.assert_array_equal(campaign.images.sigma_time_s, [0.002, 0.0])


@pytest.mark.parametrize(
    ("section", "keys", "complaint"),
    [
        (
            "attitude",
            'shared_by = "pass"\ncorrelation_time_s = 3.0\n',
            "attitude.correlation_time_s: found it beside",
        ),
        ("ephemeris", 'shared_by = "sample"\n', 'ephemeris.shared_by: found "sample"'),
        (
            "ephemeris",
            'shared_by = "image"\ncorrelation_time_s = 3.0\n',
            "ephemeris.correlation_time_s: found it",
        ),
        ("attitude", "wander = { sigma_arcsec = 2.0 }\n", "attitude.wander.correlation_time_s: missing"),
        ("landmarks", "common_sigma_m = -1.0\n", "landmarks.common_sigma_m: found -1"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, section, keys, complaint):
    with pytest.raises(InputError, match=complaint.replace(".", r"\.")):
        load_campaign(write_good_campaign(tmp_path, campaign=stated_text(**{section: keys})))


def test_a_negative_sigma_of_time_is_refused(tmp_path):
    images = tables()["images"].replace("0.002", "-0.002")
    with pytest.raises(InputError, match=r"row 2, column sigma_time_s: found -0\.002"):
        load_campaign(write_good_campaign(tmp_path, images=images))


@pytest.mark.slow
@pytest.mark.parametrize("shared", ALL, ids=[one.__name__ for one in ALL])
def test_the_budget_adds_up_with_what_is_shared(shared, rng):
    """The parts of the sources sum to the covariance, each in its own name."""
    true = scene_of(shared, LINE)
    campaign = scene.measured(true, Errors.draw(observe(true), rng), C_EK_TRUE)
    stated, _ = shared(campaign, observe(campaign), rng)
    done = calibrate(stated, Gls())
    parts = shares(done)
    total = np.sum(list(parts.values()), axis=0)
    np.testing.assert_allclose(total, done.covariance_E, rtol=1e-6, atol=1e-9 * np.trace(done.covariance_E))
    assert "errors in common" not in parts


def test_a_session_s_error_of_two_trackers_is_fused_like_the_attitude():
    """Two trackers of equal weight: half of each error, their squares added."""
    campaign = truth(FRAME, 2, 4)
    series = campaign.one_attitude
    fused = FusedAttitude(tuple(TrackerSeries(name, series, np.eye(3), SIGMA) for name in "ab"), "mean")
    roots = np.stack([np.diag([2.0, 2.0, 4.0]), np.diag([0.0, 6.0, 3.0])])
    found = fused.root_E(campaign.images.t_ns, roots)
    np.testing.assert_allclose(found, np.tile(np.diag([1.0, np.sqrt(10.0), 2.5]), (2, 1, 1)))
