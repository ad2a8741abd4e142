"""Estimators x problems x batch shapes: exact without errors, the same alone or in a batch, and honest in sigma."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from harness import BATCHES, CONVERGED, ONE_STEP, PROBLEMS, SOURCES, STATES_SIGMA, Source, scene, still

from problems import C_EK_TRUE
from starplumb.estimators import METHODS
from starplumb.estimators.protocol import Status
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.equation import linearise
from starplumb.table.simulate import Errors, measure

THETA = np.array([0.3, -0.2, 0.4]) * DEG


@pytest.mark.parametrize("problem", PROBLEMS)
@pytest.mark.parametrize("name", CONVERGED)
def test_exact_without_errors(name, problem):
    """From 0.5 deg off to the truth, to 1e-5 arcsec."""
    estimate = CONVERGED[name]()(still(scene(problem)), so3.exp(THETA) @ C_EK_TRUE)
    assert estimate.status == Status.OK
    assert np.abs(so3.log(estimate.C_EK @ C_EK_TRUE.mT)).max() < 1e-5 * ARCSEC


@pytest.mark.parametrize("batch", BATCHES)
@pytest.mark.parametrize("name", CONVERGED)
def test_a_batch_is_its_runs(name, batch, rng):
    """Model mountings and tables both batched: every run as if alone, to rounding."""
    o = scene("frame one site")
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, batch))
    C = so3.exp(0.2 * DEG * rng.standard_normal((*batch, 3))) @ C_EK_TRUE
    estimate = CONVERGED[name]()(table, C)
    assert estimate.C_EK.shape == (*batch, 3, 3)
    assert estimate.status.shape == batch
    assert estimate.iterations.shape == batch
    for index in np.ndindex(batch):
        alone = CONVERGED[name]()(table.run(index), C[index])
        assert np.abs(so3.log(estimate.C_EK[index] @ alone.C_EK.mT)).max() < 1e-6 * ARCSEC
        if alone.covariance_E is not None:
            np.testing.assert_allclose(
                estimate.covariance_E[index], alone.covariance_E, rtol=1e-5, atol=1e-9 * ARCSEC**2
            )


@pytest.mark.parametrize("name", STATES_SIGMA)  # the closed form does not look at the model
def test_either_side_may_carry_the_batch(name, rng):
    o = scene("frame")
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    C = so3.exp(0.2 * DEG * rng.standard_normal((4, 3))) @ C_EK_TRUE
    many_models = CONVERGED[name]()(table, C)
    assert many_models.C_EK.shape == (4, 3, 3)
    # converged, so the start does not matter
    spread = so3.log(many_models.C_EK @ many_models.C_EK[0].mT)
    assert np.abs(spread).max() < (1e-3 if name == "image-plane narrow" else 1e-4) * ARCSEC
    tables = measure(o, C_EK_TRUE, Errors.draw(o, rng, (4,)))
    assert CONVERGED[name]()(tables, C_EK_TRUE).C_EK.shape == (4, 3, 3)


@pytest.mark.slow
@pytest.mark.parametrize("source", SOURCES, ids=lambda s: s.name)
@pytest.mark.parametrize("name", STATES_SIGMA)
def test_sigma_is_what_each_source_alone_does(name, source: Source, rng):
    """Error / stated sigma has rms 1 on every axis, each source by itself, images turned."""
    runs = 1500
    o = source.alone(scene("frame turned"))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (runs,)))
    estimate = CONVERGED[name]()(table, C_EK_TRUE)
    assert np.all(estimate.status == Status.OK)
    rms = np.sqrt(np.mean((so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E) ** 2, axis=0))
    np.testing.assert_allclose(rms, 1.0, atol=4.0 / np.sqrt(2.0 * runs))


@pytest.mark.slow
@pytest.mark.parametrize("name", STATES_SIGMA)
def test_covariance_is_that_of_the_errors_as_a_whole(name, rng):
    """Normalised error squared: mean 3, sd sqrt(6), so that correlations count too, with landmarks shared by images."""
    runs = 2000
    o = scene("frame one site")
    estimate = CONVERGED[name]()(measure(o, C_EK_TRUE, Errors.draw(o, rng, (runs,))), C_EK_TRUE)
    error = so3.log(estimate.C_EK @ C_EK_TRUE.mT)
    squared = np.sum(error * np.linalg.solve(estimate.covariance_E, error[..., None])[..., 0], axis=-1)
    assert abs(squared.mean() - 3.0) < 4.0 * np.sqrt(6.0 / runs)
    assert abs(squared.std() - np.sqrt(6.0)) < 0.4


def test_an_error_pattern_across_images_is_in_every_sigma(rng):
    """``common_px``: one error, felt by all sightings by one sigma each, here a turn about the boresight."""
    o = scene("frame")
    turn = linearise(o, C_EK_TRUE).H @ (20.0 * ARCSEC * C_EK_TRUE[:, 2:])
    with_turn = replace(o, common_px=turn)
    for name in ("image-plane", "ground-plane", "cross-product", "least-squares", "sequential"):
        before = CONVERGED[name]()(still(o), C_EK_TRUE).covariance_E
        after = CONVERGED[name]()(still(with_turn), C_EK_TRUE).covariance_E
        z = C_EK_TRUE[:, 2]
        assert z @ (after - before) @ z == pytest.approx((20.0 * ARCSEC) ** 2, rel=1e-3)


@pytest.mark.parametrize("name", CONVERGED)
def test_a_marker_not_seen_is_a_marker_left_out(name, rng):
    o = scene("frame")
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    seen = np.ones(o.n)
    seen[[1, 9]] = 0.0
    wild = table.xy_K.copy()
    wild[[1, 9]] += 0.01
    hidden = CONVERGED[name]()(replace(table, weight=seen, xy_K=wild), C_EK_TRUE)
    left_out = CONVERGED[name]()(table.select(seen > 0.0), C_EK_TRUE)
    assert np.abs(so3.log(hidden.C_EK @ left_out.C_EK.mT)).max() < 1e-6 * ARCSEC
    if hidden.covariance_E is not None:
        np.testing.assert_allclose(
            hidden.covariance_E, left_out.covariance_E, rtol=1e-5, atol=1e-9 * ARCSEC**2
        )


@pytest.mark.parametrize("name", METHODS)
def test_one_marker_is_singular_beside_a_run_that_is_not(name, rng):
    """No exception: the batch's other run is what it would have been."""
    o = scene("frame")
    weight = np.ones((2, o.n))
    weight[0, 1:] = 0.0
    table = replace(measure(o, C_EK_TRUE, Errors.draw(o, rng)), weight=weight)
    estimate = METHODS[name]()(table, C_EK_TRUE)
    assert list(estimate.status) == [Status.SINGULAR, Status.OK]
    if estimate.covariance_E is not None:
        assert np.all(np.isinf(estimate.covariance_E[0]))
    alone = METHODS[name]()(table.run((1,)), C_EK_TRUE)
    assert np.abs(so3.log(estimate.C_EK[1] @ alone.C_EK.mT)).max() < 1e-6 * ARCSEC


@pytest.mark.parametrize("name", [*ONE_STEP, "projective", "sequential"])
def test_sigma_of_a_line_scanner_is_that_of_its_pixels(name, rng):
    """A row error is an error of epoch: the scene moves on meanwhile, and the camera's own slope has no row in it."""
    runs = 1000
    o = SOURCES[-1].alone(scene("line"))
    estimate = CONVERGED[name]()(measure(o, C_EK_TRUE, Errors.draw(o, rng, (runs,))), C_EK_TRUE)
    rms = np.sqrt(np.mean((so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E) ** 2, axis=0))
    np.testing.assert_allclose(rms, 1.0, atol=4.0 / np.sqrt(2.0 * runs))


@pytest.mark.parametrize("covariance", ["stated", "none"])
@pytest.mark.parametrize("name", ONE_STEP)
def test_a_camera_turned_away_is_no_answer(name, covariance):
    """60 deg off one step is beyond linearising; 170 deg off it is a small step that leaves the markers behind."""
    for angle in (60.0, 170.0):
        C = so3.exp([angle * DEG, 0.0, 0.0]) @ C_EK_TRUE
        estimate = ONE_STEP[name](iterations=1, covariance=covariance)(still(scene("frame")), C)
        assert estimate.status == Status.NOT_CONVERGED
