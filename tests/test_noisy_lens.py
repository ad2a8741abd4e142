"""The interval of an alignment beside a lens that is mostly noise: by hand, and against a campaign without noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import ParameterVector
from starplumb.judge.calibrate import calibrate
from starplumb.judge.parameters.noisy_lens import surely
from starplumb.physics.camera import Distortion
from starplumb.plan import scene
from starplumb.table.campaign import SharedErrors
from starplumb.table.geometry import observe
from starplumb.table.parameters import OPTICS, Optics
from starplumb.table.simulate import Errors


def vector(names, values, covariance):
    whole = np.eye(3 + len(names))
    whole[3:, 3:] = covariance
    return ParameterVector(
        names, np.array(values), np.full(len(names), np.inf), np.ones(len(names)), whole, whole
    )


@pytest.mark.parametrize(("value", "expected"), [(1.9, 0.0), (-4.0, -3.0), (100.0, 99.96)])
def test_within_two_sigmas_a_coefficient_vanishes(value, expected):
    p = vector(("focal_length", "k1"), [0.3, 2.0 * value], np.diag([1.0, 4.0]))
    np.testing.assert_allclose(surely(p), [0.3, 2.0 * expected], atol=1e-12)


def test_one_that_vanishes_leaves_the_other_as_it_is_without_it():
    """k1 and k2 of sigma 1, correlated by -0.96: with k2 = 0 k1 is 10 - 0.96 = 9.04, of sigma 0.28."""
    rho = -0.96
    p = vector(("k1", "k2"), [10.0, -1.0], np.array([[1.0, rho], [rho, 1.0]]))
    alone, sigma = 10.0 - rho * -1.0, np.sqrt(1.0 - rho**2)
    np.testing.assert_allclose(surely(p), [alone * (1.0 - 4.0 * (sigma / alone) ** 2), 0.0], atol=1e-12)


def flown(rng, sigma_px, noise, camera=FRAME):
    """Twelve images of 80 marks, with or without noise in them, and all of the optics unknown."""
    c = truth(camera, 12, 80, tilt_deg=15.0, yaw_deg=60.0)
    c = replace(c, sightings=replace(c.sightings, sigma_px=np.full(c.sightings.image.size, sigma_px)))
    errors = Errors.draw(observe(c), rng)
    if not noise:
        errors = replace(errors, pixel=0.0 * errors.pixel)
    own = SharedErrors("image")
    measured = scene.measured(c, errors, C_EK_TRUE)
    measured = replace(measured, attitude_errors=own, position_errors=own)
    return calibrate(measured, Gls((Optics(camera, OPTICS, (np.inf,) * 8),)))


@pytest.mark.slow
def test_the_interval_is_that_without_the_noise_of_the_lens(rng):
    done = flown(rng, 10.0, noise=True)
    quiet = flown(rng, 10.0, noise=False)
    assert any("the distortion is mostly noise" in text for text in done.sentences)
    sure = 1.96 * quiet.sigma_E
    assert np.max(sure / (1.96 * done.sigma_E)) > 1.05
    assert np.all(done.interval_95_E > 0.9 * sure)


@pytest.mark.slow
def test_of_a_lens_that_distorts_by_far_more_than_its_noise_nothing_is_said(rng):
    distorted = replace(FRAME, distortion=Distortion((40.0, 8000.0, 0.0)))
    done = flown(rng, 0.3, noise=True, camera=distorted)
    assert not any("mostly noise" in text for text in done.sentences)
