"""The covariance beside a lens that is mostly noise: by hand, by SciPy, by exact residuals, and by many campaigns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.bent import Sampled, SecondOrder, bent, surely
from starplumb.estimators.fit import Fit, State, Unknowns
from starplumb.estimators.gls import Gls
from starplumb.judge.calibrate import calibrate
from starplumb.judge.error_shares import LENS, shares
from starplumb.physics import so3
from starplumb.physics.camera import Distortion
from starplumb.plan import scene
from starplumb.table.campaign import SharedErrors
from starplumb.table.geometry import observe
from starplumb.table.parameters import OPTICS, Optics, TimeOffset
from starplumb.table.simulate import Errors, measure

OPTICAL = Optics(FRAME, OPTICS, (np.inf,) * 8)


def sure(names, values, covariance):
    whole = np.eye(3 + len(names))
    whole[3:, 3:] = covariance
    return surely(State(np.eye(3), np.array(values)), names, whole).values


@pytest.mark.parametrize(("value", "expected"), [(1.9, 0.0), (-4.0, -3.0), (100.0, 99.96)])
def test_within_two_sigmas_a_coefficient_vanishes(value, expected):
    found = sure(("focal_length", "k1"), [0.3, 2.0 * value], np.diag([1.0, 4.0]))
    np.testing.assert_allclose(found, [0.3, 2.0 * expected], atol=1e-12)


def test_one_that_vanishes_leaves_the_other_as_it_is_without_it():
    """k1 and k2 of sigma 1, correlated by -0.96: with k2 = 0 k1 is 10 - 0.96 = 9.04, of sigma 0.28."""
    rho = -0.96
    alone, sigma = 10.0 - rho * -1.0, np.sqrt(1.0 - rho**2)
    found = sure(("k1", "k2"), [10.0, -1.0], np.array([[1.0, rho], [rho, 1.0]]))
    np.testing.assert_allclose(found, [alone * (1.0 - 4.0 * (sigma / alone) ** 2), 0.0], atol=1e-12)


def test_what_trades_with_a_number_that_vanishes_follows_it():
    """A principal point of 1.5 sigma that a turn about y makes up for by a half: both fall back."""
    covariance = np.eye(5)
    covariance[1, 3] = covariance[3, 1] = 0.5
    state = State(so3.exp(np.array([0.0, 0.75e-4, 0.0])), np.array([1.5, 30.0]))
    scale = np.array([1.0, 1e-4, 1.0, 1.0, 1.0])
    found = surely(state, ("principal_column", "k1"), covariance * np.outer(scale, scale))
    np.testing.assert_allclose(found.values, [0.0, 30.0 * (1.0 - 4.0 / 900.0)], atol=1e-12)
    np.testing.assert_allclose(so3.log(found.C_EK), 0.0, atol=1e-12)


def residuals(rng, k):
    """Columns of a bent problem of k numbers in so many rows, and the terms that bend it."""
    i, j = np.triu_indices(k)
    return rng.normal(size=(30, k + i.size)), i, j


def test_without_bending_the_covariance_is_the_inverse_of_the_information(rng):
    A, i, j = residuals(rng, 3)
    A[:, 3:] = 0.0
    found = SecondOrder(A.T @ A, 3, i, j).covariance
    np.testing.assert_allclose(found, np.linalg.inv(A[:, :3].T @ A[:, :3]), rtol=1e-3)


def test_minima_are_those_that_scipy_finds(rng):
    A, i, j = residuals(rng, 2)
    A[:, 2:] *= 0.3
    e = rng.normal(size=(5, 30))
    found = SecondOrder(A.T @ A, 2, i, j).minima(e @ A)
    for own, t in zip(e, found, strict=True):

        def cost(t, own=own):
            return np.sum((A @ np.concatenate([t, t[i] * t[j]]) - own) ** 2)

        np.testing.assert_allclose(t, minimize(cost, np.zeros(2), tol=1e-10).x, atol=2e-3)


def scattered(camera=FRAME, images=8, markers=60, sigma_px=0.3):
    """A true table of so many images and marks."""
    c = truth(camera, images, markers, tilt_deg=15.0, yaw_deg=60.0)
    return c, replace(observe(c), sigma_px=np.full(images * markers, sigma_px))


def seen_without(o, lens):
    """The table with marks where this lens has them, read without it."""
    xy_K, slope_K = FRAME.tan_from_px(*replace(FRAME, distortion=lens).px_from_tan(o.xy_K).T)
    return replace(o, xy_K=xy_K, slope_K=np.array(slope_K))


def test_second_order_residuals_are_those_of_the_exact_equation(rng):
    """Of a table without errors, where errors of one sigma lead to: the square sum that the equations have there, its
    images' errors eliminated, against the first and the second order of it."""
    o = seen_without(scattered()[1], Distortion((3.0, 0.0, 0.0)))
    at = State(C_EK_TRUE, np.array([0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0]))
    fit = Fit(Unknowns((OPTICAL,)), o, at, C_EK_TRUE)
    covariance = fit.solve().covariance
    unit = np.sqrt(np.diagonal(covariance))
    second = Sampled(fit, 1.0).second_order(np.arange(11), unit)
    held = np.concatenate([np.zeros(3), unit[3:] / np.array(OPTICAL.range)])
    first = []
    for t in rng.normal(size=(6, 11)) @ np.linalg.cholesky(covariance / np.outer(unit, unit)).T:
        there = replace(fit, state=at.moved(unit * t))
        found = there.solve()
        known = np.sum((there.state.values / np.array(OPTICAL.range)) ** 2)
        exact = found.chi2 + found.x @ found.information @ found.x - known
        own = np.sum((held * t) ** 2)
        assert second.cost(t[None], np.zeros((1, 77)))[0] - own == pytest.approx(exact, rel=0.05)
        first.append(t @ second.G[:11, :11] @ t - own - exact)
    assert np.max(np.abs(first)) > 10.0


def free(*parameters):
    return Gls(parameters)


@pytest.mark.slow
def test_the_sigmas_are_those_of_many_campaigns(rng):
    """Twelve images of 80 marks of 1 px: errors of 50 campaigns against the sigmas of five of them, which those of
    the normal equations fall short of."""
    true = scattered(images=12, markers=80, sigma_px=1.0)[1]
    errors, sigmas, straight = [], [], []
    for run in range(50):
        o = measure(true, C_EK_TRUE, Errors.draw(true, rng))
        gls = free(OPTICAL)
        if run < 5:
            found = gls(o, C_EK_TRUE)
            sigmas.append(np.diagonal(found.parameters.covariance))
            straight.append(np.diagonal(found.parameters.straight))
        else:
            found = gls.estimate(o, C_EK_TRUE, gls.start(o, C_EK_TRUE))
        errors.append([*so3.log(found.C_EK @ C_EK_TRUE.T), *found.parameters.values])
    square = np.mean(np.square(errors), axis=0)[:3]
    assert np.all(square / np.mean(sigmas, axis=0)[:3] < 1.4)
    assert np.max(square / np.mean(straight, axis=0)[:3]) > 1.4


def test_without_a_lens_among_the_unknowns_nothing_is_drawn(rng):
    true = scattered(images=3, markers=10)[1]
    o = measure(true, C_EK_TRUE, Errors.draw(true, rng))
    only = Optics(FRAME, ("focal_length", "principal_column"), (np.inf,) * 2)
    assert free(only, TimeOffset(("time_offset",), (0.01,)))(o, C_EK_TRUE).parameters.straight is None


def test_of_a_lens_that_is_known_well_beforehand_nothing_is_drawn(rng):
    true = scattered(images=6, markers=20)[1]
    o = measure(true, C_EK_TRUE, Errors.draw(true, rng))
    held = Optics(FRAME, ("k1", "p1"), (1e-4, 1e-7))
    found = free(held)(o, C_EK_TRUE)
    fit = Fit(found.unknowns, o, State(found.C_EK, found.parameters.values), C_EK_TRUE)
    assert found.parameters.straight is None
    assert bent(fit, found.parameters.covariance) is None


@pytest.mark.slow
def test_few_images_of_many_marks_and_many_of_few_grow_as_the_whole(rng, monkeypatch):
    """A third of the sightings, thinned within images or by whole images, says what all say."""
    true = scattered(images=24, markers=40, sigma_px=1.0)[1]
    o = measure(true, C_EK_TRUE, Errors.draw(true, rng))
    found = free(OPTICAL)(o, C_EK_TRUE).parameters
    for rows, images in ((300, 8), (300, 24)):
        monkeypatch.setattr("starplumb.estimators.bent.ROWS", rows)
        monkeypatch.setattr("starplumb.estimators.bent.IMAGES", images)
        again = free(OPTICAL)(o, C_EK_TRUE).parameters
        np.testing.assert_allclose(again.straight, found.straight, rtol=1e-9)
        np.testing.assert_allclose(np.diagonal(again.covariance / found.covariance), 1.0, atol=0.35)


def calibrated(rng, sigma_px, lens=None):
    """A campaign of noisy marks with all of the optics unknown, the true lens stated."""
    camera = FRAME if lens is None else replace(FRAME, distortion=lens)
    c = scattered(camera, 12, 80)[0]
    c = replace(c, sightings=replace(c.sightings, sigma_px=np.full(960, sigma_px)))
    measured = scene.measured(c, Errors.draw(observe(c), rng), C_EK_TRUE)
    own = SharedErrors("image")
    measured = replace(measured, attitude_errors=own, position_errors=own)
    return calibrate(measured, free(replace(OPTICAL, camera=camera)))


@pytest.mark.slow
def test_a_calibration_says_it_and_shows_its_share(rng):
    done = calibrated(rng, 1.0)
    assert any("what is estimated of the lens is mostly noise" in text for text in done.sentences)
    total = np.sum(list(shares(done).values()), axis=0)
    np.testing.assert_allclose(np.diagonal(total), np.diagonal(done.covariance_E), rtol=0.02)
    assert LENS in shares(done)
    assert np.all(done.interval_95_E >= 1.959 * done.sigma_E)


@pytest.mark.slow
def test_of_a_lens_that_distorts_by_far_more_than_its_noise_nothing_is_said(rng):
    done = calibrated(rng, 0.3, Distortion((40.0, 8000.0, 0.0)))
    assert not any("mostly noise" in text for text in done.sentences)
