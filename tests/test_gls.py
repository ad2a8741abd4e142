"""Generalised least squares: thousands of campaigns against its sigmas, the Cramer-Rao bound and a closed formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import oracles
from problems import C_EK_TRUE, FRAME, LINE, SIGMAS, truth
from starplumb.estimators.fit import Fit, State, Unknowns
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.estimators.wahba import Wahba
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

RUNS = 2000
CAMERAS = {"frame": FRAME, "line": LINE}
SOURCES = ("alpha_E", "rho_J", "pi_J", "pixel")
TINY_PX = 1e-3
"""Pixel noise that stands for none, yet above what is second order in the other errors."""

# A line scanner turned by 90 deg would move along its own line and see nothing; frames are turned so below.
SCENES = {
    "one image": {"images": 1, "markers": 9},
    "one tilted image": {"images": 1, "markers": 9, "tilt_deg": 30.0},
    "two images, half turn": {"images": 2, "markers": 6, "tilt_deg": 0.0, "yaw_deg": 180.0},
    "four images, turned": {"images": 4, "markers": 6, "tilt_deg": 20.0, "yaw_deg": 60.0},
    "one site from four places": {"images": 4, "markers": 9, "tilt_deg": 10.0, "shared_site": True},
    "thirty images": {"images": 30, "markers": 4, "tilt_deg": 25.0, "yaw_deg": 60.0},
}


def sigmas_of(source):
    """Stated sigmas with one source alone."""
    none = np.zeros(3)
    return scene.Sigmas(
        attitude=SIGMAS.attitude if source == "alpha_E" else none,
        position=SIGMAS.position if source == "rho_J" else none,
        landmark=SIGMAS.landmark if source == "pi_J" else none,
        pixel=SIGMAS.pixel if source == "pixel" else TINY_PX,
    )


def fly(o, rng, runs=RUNS, estimator=None, C_EK=C_EK_TRUE):
    """Estimates of many campaigns with the errors the table states, and their errors theta_E (runs, 3)."""
    estimate = (estimator or Gls())(measure(o, C_EK_TRUE, Errors.draw(o, rng, (runs,))), C_EK)
    return estimate, so3.log(estimate.C_EK @ C_EK_TRUE.mT)


def check_statistics(estimate, error):
    """error / sigma has mean 0 and deviation 1 on each axis, chi-square its mean and variance, all within 4 sigma."""
    assert np.all(estimate.status == Status.OK)
    n = len(error)
    score = error / estimate.sigma_E
    np.testing.assert_allclose(np.mean(score, axis=0), 0.0, atol=4 / np.sqrt(n))
    np.testing.assert_allclose(np.std(score, axis=0), 1.0, atol=4 / np.sqrt(2 * n))
    # together with its correlations: the squared Mahalanobis distance is chi-square of 3
    distance = np.vecdot(error, np.linalg.solve(estimate.covariance_E, error[..., None])[..., 0])
    assert np.mean(distance) == pytest.approx(3, abs=4 * np.sqrt(6 / n))
    dof = int(estimate.degrees_of_freedom[0])
    assert np.mean(estimate.chi2) == pytest.approx(dof, abs=4 * np.sqrt(2 * dof / n))
    spread = np.sqrt((2 + 12 / dof) / n)  # relative, of the variance of a chi-square
    assert np.var(estimate.chi2) == pytest.approx(2 * dof, rel=4 * spread)


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("options", SCENES.values(), ids=SCENES)
def test_all_errors_together(camera, options, rng):
    check_statistics(*fly(observe(truth(camera, **options)), rng))


@pytest.mark.slow
@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("scene_name", ["one image", "four images, turned", "one site from four places"])
def test_each_error_alone(camera, scene_name, source, rng):
    o = observe(truth(camera, sigmas=sigmas_of(source), **SCENES[scene_name]))
    check_statistics(*fly(o, rng))


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_rmse_is_the_independent_cramer_rao_bound(camera, rng):
    """Within 2 % on each axis, from 20000 campaigns (each deviation is known to 0.5 %)."""
    o = observe(truth(camera, images=3, markers=5, tilt_deg=15.0, yaw_deg=60.0))
    bound = np.sqrt(np.diag(oracles.cramer_rao(o, C_EK_TRUE)))
    error = np.concatenate([fly(o, rng)[1] for _ in range(10)])
    np.testing.assert_allclose(np.sqrt(np.mean(error**2, axis=0)), bound, rtol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("options", SCENES.values(), ids=SCENES)
def test_stated_covariance_is_the_bound_of_dense_differences(camera, options, rng):
    o = observe(truth(camera, **{**options, "images": min(options["images"], 5)}))
    estimate = Gls()(o, C_EK_TRUE)
    bound = oracles.cramer_rao(o, C_EK_TRUE)
    sigma = np.sqrt(np.diag(bound))
    np.testing.assert_allclose(
        estimate.covariance_E / np.outer(sigma, sigma), bound / np.outer(sigma, sigma), atol=1e-3
    )


def closed_formula(images, markers, distance, radius):
    """Variances about (x, y) and z of each source, rad^2: N x M geometry near the nadir.

    s_xy^2 = [s_st^2 + (s_gps/H)^2]/N + [(s_gcp/H)^2 + s_pix^2]/(N M),
    s_z^2 = s_st,z^2/N + [(s_gcp/H)^2 + s_pix^2]/(N M r^2).
    """
    pixel = SIGMAS.pixel * FRAME.pitch / FRAME.focal_length
    marker = SIGMAS.landmark[0] / distance
    total = images * markers
    return {
        "alpha_E": (SIGMAS.attitude[0] ** 2 / images, SIGMAS.attitude[2] ** 2 / images),
        "rho_J": ((SIGMAS.position[0] / distance) ** 2 / images, 0.0),
        "pi_J": (marker**2 / total, marker**2 / (total * radius**2)),
        "pixel": (pixel**2 / total, pixel**2 / (total * radius**2)),
    }


@pytest.fixture(scope="module")
def nadir_table():
    """Four vertical images of a centred grid of 25 markers each, the tracker's axes along the camera's."""
    images, side = 4, 5
    campaign = truth(FRAME, images=images, markers=1, tilt_deg=0.0, sigmas=SIGMAS)
    pixel = np.stack(np.meshgrid(*[np.linspace(500, 11499, side)] * 2), axis=-1).reshape(-1, 2)
    image = np.repeat(np.arange(images), side**2)
    campaign = scene.mark_pixels(campaign, image, np.tile(pixel, (images, 1)), 0.0, SIGMAS)
    o = observe(campaign)
    radius = np.sqrt(np.mean(np.sum((o.xy_K - [np.mean(o.xy_K[:, 0]), np.mean(o.xy_K[:, 1])]) ** 2, axis=-1)))
    return o, closed_formula(images, side**2, np.mean(o.range_m), radius)


def test_stated_sigmas_are_those_of_the_closed_formula(nadir_table):
    o, formula = nadir_table
    xy, z = (np.sqrt(sum(formula[source][i] for source in SOURCES)) for i in (0, 1))
    np.testing.assert_allclose(Gls()(o, C_EK_TRUE).sigma_E, [xy, xy, z], rtol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("source", SOURCES)
def test_each_source_passes_into_the_estimate_as_the_closed_formula_says(nadir_table, source, rng):
    """The estimator weighs all errors as stated while only one of them happens; 3 axes to 6 % (4 sigma)."""
    o, formula = nadir_table
    errors = Errors.draw(o, rng, (RUNS,)).only(source)
    estimate = Gls()(measure(o, C_EK_TRUE, errors), C_EK_TRUE)
    error = so3.log(estimate.C_EK @ C_EK_TRUE.mT) @ C_EK_TRUE  # about the camera's axes
    xy, z = np.sqrt(formula[source])
    found = np.std(error, axis=0)
    np.testing.assert_allclose(found[:2], xy, rtol=0.07)
    if source == "rho_J":
        assert found[2] < 0.02 * xy
    else:
        np.testing.assert_allclose(found[2], z, rtol=0.07)


@pytest.mark.slow
def test_gain_over_equal_weights(rng):
    """Markers in a corner of each image: equal weights pay for the shared errors with the angle about the boresight.

    A displaced cluster turns an error across the boresight into one about it, 1 / (field angle) times as large.
    """
    campaign = truth(FRAME, images=6, markers=1, tilt_deg=10.0)
    image = np.repeat(np.arange(6), 6)
    pixel = 9000 + rng.uniform(0, 2900, (36, 2)) * np.array([1, 1]) - 8000 * (image[:, None] % 2)
    o = observe(scene.mark_pixels(campaign, image, pixel, 0.0, SIGMAS))
    errors = Errors.draw(o, rng, (RUNS,))
    measured = measure(o, C_EK_TRUE, errors)
    gls, equal = (
        np.std(so3.log(estimator(measured, C_EK_TRUE).C_EK @ C_EK_TRUE.mT) @ C_EK_TRUE, axis=0)
        for estimator in (Gls(), Wahba())
    )
    gain = equal / gls
    assert np.all(gain > 0.98)
    assert 5 < gain[2] < 30


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5, -0.7, 0.51)])
@pytest.mark.parametrize("angle_deg", [1.0, 90.0, 179.0])
def test_any_initial_error_gives_the_same_answer(camera, axis, angle_deg, rng):
    o = observe(truth(camera, images=3, markers=4))
    measured = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    axis = np.array(axis) / np.linalg.norm(axis)
    near, far = (Gls()(measured, C) for C in (C_EK_TRUE, so3.exp(angle_deg * DEG * axis) @ C_EK_TRUE))
    assert np.linalg.norm(so3.log(near.C_EK @ far.C_EK.mT)) < 1e-6 * ARCSEC
    assert far.chi2 == pytest.approx(near.chi2)
    assert far.status == Status.OK


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_the_answer_is_scipys_on_the_same_residuals(camera, rng):
    """least_squares with the dense covariance, and with every shared error as an unknown and nothing linearised."""
    o = observe(truth(camera, images=2, markers=4, shared_site=True))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    start = so3.exp([1e-4, 2e-4, -3e-4]) @ C_EK_TRUE
    estimate = Gls()(o, start)
    for C, chi2 in (oracles.dense_gls(o, start), oracles.joint_adjustment(o, start)[::4]):
        off = so3.log(C @ estimate.C_EK.mT)
        assert np.all(np.abs(off) < 1e-3 * estimate.sigma_E)
        assert chi2 == pytest.approx(float(estimate.chi2), rel=1e-4)


@pytest.mark.slow
def test_image_and_marker_errors_are_those_of_the_joint_adjustment(rng):
    o = observe(truth(FRAME, images=2, markers=4, shared_site=True))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    C, alpha, rho, pi, _ = oracles.joint_adjustment(o, C_EK_TRUE)
    found = Fit(Unknowns(), o, State(C, np.zeros(0)), C_EK_TRUE).whole.shared_errors()
    np.testing.assert_allclose(found.alpha_E, alpha, atol=1e-3 * ARCSEC)
    np.testing.assert_allclose(found.rho_J, rho, atol=1e-3)
    np.testing.assert_allclose(found.pi_J, pi, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_statistics_with_a_prior(camera, rng):
    """The model mounting is drawn from its stated error too: the prior sharpens the estimate and its sigma honestly."""
    prior = np.array([2.0, 3.0, 10.0]) * ARCSEC
    o = replace(observe(truth(camera, images=2, markers=4)), prior_E=np.diag(prior**2))
    theta = prior * rng.standard_normal((RUNS, 3))
    estimate, error = fly(o, rng, C_EK=so3.exp(theta) @ C_EK_TRUE)
    assert estimate.degrees_of_freedom[0] == 2 * 8
    check_statistics(estimate, error)
    assert np.all(estimate.sigma_E[0] < prior)
    bound = np.sqrt(np.diag(oracles.cramer_rao(o, C_EK_TRUE)))
    np.testing.assert_allclose(estimate.sigma_E[0], bound, rtol=1e-3)


def test_a_wide_prior_changes_nothing_and_a_tight_one_holds(rng):
    o = observe(truth(FRAME, images=2, markers=4))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    model = so3.exp([0.2, -0.3, 0.4]) @ C_EK_TRUE
    free = Gls()(o, model)
    wide = Gls()(replace(o, prior_E=1e6 * np.eye(3)), model)
    assert np.linalg.norm(so3.log(wide.C_EK @ free.C_EK.mT)) < 1e-6 * ARCSEC
    tight = Gls()(replace(o, prior_E=1e-24 * np.eye(3)), so3.exp([1e-5, 0, 0]) @ C_EK_TRUE)
    np.testing.assert_allclose(so3.log(tight.C_EK @ C_EK_TRUE.mT), [1e-5, 0, 0], atol=1e-11)


def test_ragged_images_and_absent_markers(rng):
    """Images of one to six markers, some of them unseen in some runs: the statistics hold all the same."""
    o = observe(truth(FRAME, images=6, markers=6, tilt_deg=15.0))
    o = o.select(np.concatenate([np.flatnonzero(o.image == i)[: i + 1] for i in range(6)]))
    measured = measure(o, C_EK_TRUE, Errors.draw(o, rng, (RUNS,)))
    weight = (rng.uniform(size=(RUNS, o.n)) < 0.8).astype(float)
    estimate = Gls()(replace(measured, weight=weight), C_EK_TRUE)
    error = so3.log(estimate.C_EK @ C_EK_TRUE.mT)
    score = error / estimate.sigma_E
    np.testing.assert_allclose(np.std(score, axis=0), 1.0, atol=4 / np.sqrt(2 * RUNS))
    np.testing.assert_array_equal(estimate.degrees_of_freedom, 2 * weight.sum(axis=-1) - 3)
    excess = np.mean(estimate.chi2 - estimate.degrees_of_freedom)
    assert excess == pytest.approx(0, abs=4 * np.sqrt(2 * np.mean(estimate.degrees_of_freedom) / RUNS))


def test_weight_zero_is_absence(rng):
    o = observe(truth(FRAME, images=3, markers=4))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    wild = o.xy_K.copy()
    wild[[2, 7]] += 0.5
    weight = np.ones(o.n)
    weight[[2, 7]] = 0.0
    muted, removed = (
        Gls()(replace(o, weight=weight, xy_K=wild), C_EK_TRUE),
        Gls()(o.select(weight > 0), C_EK_TRUE),
    )
    assert np.linalg.norm(so3.log(muted.C_EK @ removed.C_EK.mT)) < 1e-6 * ARCSEC
    assert muted.chi2 == pytest.approx(float(removed.chi2))
    assert muted.degrees_of_freedom == removed.degrees_of_freedom == 17


def test_a_batch_of_any_shape_is_its_runs_alone(rng):
    o = observe(truth(LINE, images=2, markers=4))
    errors = Errors.draw(o, rng, (2, 3))
    many = Gls()(measure(o, C_EK_TRUE, errors), C_EK_TRUE)
    assert many.C_EK.shape == many.covariance_E.shape == (2, 3, 3, 3)
    assert (
        many.status.shape
        == many.chi2.shape
        == many.degrees_of_freedom.shape
        == many.iterations.shape
        == (2, 3)
    )
    for index in np.ndindex(2, 3):
        alone = Gls()(
            measure(o, C_EK_TRUE, Errors(*(getattr(errors, name)[index] for name in SOURCES))), C_EK_TRUE
        )
        assert alone.C_EK.shape == (3, 3)
        np.testing.assert_allclose(many.C_EK[index], alone.C_EK, atol=1e-13)
        np.testing.assert_allclose(many.covariance_E[index], alone.covariance_E, rtol=1e-6)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_turning_e_turns_the_answer_with_it(camera, rng):
    o = observe(truth(camera, images=2, markers=4))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    Q = so3.exp([0.5, -1.0, 2.0])
    turned = replace(
        o, C_EJ=Q @ o.C_EJ, omega_E=o.omega_E @ Q.mT, cov_attitude_E=Q @ o.cov_attitude_E @ Q.mT
    ).with_geometry()
    here, there = Gls()(o, C_EK_TRUE), Gls()(turned, Q @ C_EK_TRUE)
    assert np.linalg.norm(so3.log(Q @ here.C_EK @ there.C_EK.mT)) < 1e-6 * ARCSEC
    np.testing.assert_allclose(there.covariance_E, Q @ here.covariance_E @ Q.mT, rtol=1e-6, atol=1e-16)


def few(rng, chosen, **changes):
    o = observe(truth(FRAME, images=2, markers=4))
    return replace(measure(o, C_EK_TRUE, Errors.draw(o, rng)).select(np.array(chosen, dtype=int)), **changes)


def test_one_marker_is_singular(rng):
    o = few(rng, [0])
    for estimator in (Gls(), Wahba()):
        assert estimator(o, C_EK_TRUE).status == Status.SINGULAR
        assert "at least two markers well apart, or a prior" in Status.SINGULAR.text


def test_one_marker_and_a_prior_is_enough(rng):
    sigma = 600 * ARCSEC
    o = few(rng, [0], prior_E=sigma**2 * np.eye(3))
    estimate = Gls()(o, so3.exp(np.array([300, -200, 100]) * ARCSEC) @ C_EK_TRUE)
    assert estimate.status == Status.OK
    assert estimate.degrees_of_freedom == 2
    about = np.sqrt(np.diag(C_EK_TRUE.mT @ estimate.covariance_E @ C_EK_TRUE))
    assert np.all(about[:2] < 15 * ARCSEC)
    assert about[2] == pytest.approx(sigma, rel=1e-2)


def test_two_markers_are_enough(rng):
    estimate = Gls()(few(rng, [0, 3]), C_EK_TRUE)
    assert estimate.status == Status.OK
    assert np.all(np.abs(so3.log(estimate.C_EK @ C_EK_TRUE.mT)) < 5 * estimate.sigma_E)


def test_all_markers_in_one_spot_are_singular(rng):
    assert Gls()(few(rng, [0, 0, 0, 0]), C_EK_TRUE).status == Status.SINGULAR


def test_nothing_seen_at_all_is_singular(rng):
    assert Gls()(few(rng, []), C_EK_TRUE).status == Status.SINGULAR
    o = few(rng, [0, 1, 5])
    assert Gls()(replace(o, weight=np.zeros(3)), C_EK_TRUE).status == Status.SINGULAR


def test_an_image_without_observations_has_no_say(rng):
    o = few(rng, [0, 1, 2, 3])
    assert o.n_images == 2
    estimate = Gls()(o, C_EK_TRUE)
    assert estimate.status == Status.OK
    louder = Gls()(
        replace(o, cov_attitude_E=o.cov_attitude_E * np.array([1.0, 1e6])[:, None, None]), C_EK_TRUE
    )
    np.testing.assert_allclose(louder.covariance_E, estimate.covariance_E, rtol=1e-9)


def test_a_marker_behind_the_camera_is_no_answer(rng):
    """One sighting contradicts all others by half a turn: what fits best leaves it behind the camera."""
    o = few(rng, [0, 1, 2, 3, 4, 5])
    C_EJ = o.C_EJ.copy()
    C_EJ[5] = np.diag([-1.0, 1.0, -1.0]) @ C_EJ[5]
    estimate = Gls()(o.with_geometry(C_EJ=C_EJ), C_EK_TRUE)
    assert estimate.status == Status.NOT_CONVERGED


def test_one_bad_run_does_not_touch_its_neighbours(rng):
    o = observe(truth(FRAME, images=2, markers=4))
    measured = measure(o, C_EK_TRUE, Errors.draw(o, rng, (3,)))
    weight = np.ones((3, o.n))
    weight[1, 1:] = 0.0
    estimate = Gls()(replace(measured, weight=weight), C_EK_TRUE)
    assert list(estimate.status) == [Status.OK, Status.SINGULAR, Status.OK]
    assert np.all(np.isfinite(estimate.sigma_E[[0, 2]]))


def test_wahba_alone_is_the_rotation_that_made_the_directions(rng):
    """Perfect directions, any mounting: found to rounding in one step."""
    o = observe(truth(FRAME, images=3, markers=5))
    C = Rotation.random(random_state=2).as_matrix()
    o = replace(o, e_E=o.e_K @ C.T)
    assert np.linalg.norm(so3.log(Wahba()(o, np.eye(3)).C_EK @ C.T)) < 1e-12
    expected, _ = Rotation.align_vectors(o.e_E, o.e_K)
    np.testing.assert_allclose(Wahba()(o, np.eye(3)).C_EK, expected.as_matrix(), atol=1e-10)
