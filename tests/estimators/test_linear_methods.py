"""What the published linear methods are: their Jacobians, their sums, their bias, and what their sigmas mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from harness import ONE_STEP, scene, still

from by_hand import by_hand
from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.published.ground_plane import GroundPlane
from starplumb.estimators.published.image_plane import ImagePlane
from starplumb.estimators.published.least_squares import LeastSquares
from starplumb.estimators.published.linear_steps import Normal, accumulate, estimate, invert_symmetric
from starplumb.physics import so3
from starplumb.physics.earth import C_JT, itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.light import Corrections
from starplumb.physics.units import ARCMIN, ARCSEC, DEG
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure


@pytest.mark.parametrize("name", ONE_STEP)
@pytest.mark.parametrize("problem", ["frame turned", "line"])
def test_jacobians_are_the_differences(name, problem):
    """q falls by G theta where the mounting turns by T theta, and moves by -S dxy where the measured tangents do."""
    o, equations = still(scene(problem)), ONE_STEP[name]().equations
    here = equations(o, C_EK_TRUE)
    np.testing.assert_allclose(here.q, 0.0, atol=1e-12)
    step = 1e-6
    for axis in np.eye(3):
        d_E = here.T @ (step * axis)
        slope = (equations(o, so3.exp(d_E) @ C_EK_TRUE).q - equations(o, so3.exp(-d_E) @ C_EK_TRUE).q) / (
            2 * step
        )
        np.testing.assert_allclose(slope, -here.G @ axis, atol=1e-9)
    for axis in np.eye(2):
        ahead, behind = (
            equations(replace(o, xy_K=o.xy_K + s * step * axis), C_EK_TRUE).q for s in (1.0, -1.0)
        )
        np.testing.assert_allclose((ahead - behind) / (2 * step), -here.S @ axis, atol=1e-9)


@pytest.mark.parametrize("name", ONE_STEP)
def test_recursive_and_batch_sums_agree_to_rounding(name, rng):
    """(18): B_n and y_n as sightings come in, a marker not seen among them."""
    o = scene("frame")
    o = replace(
        measure(o, C_EK_TRUE, Errors.draw(o, rng, (2,))), weight=np.where(np.arange(o.n) == 4, 0.0, 1.0)
    )
    equations = ONE_STEP[name]().equations(o, np.broadcast_to(C_EK_TRUE, (2, 3, 3)))
    at_once = Normal.of(equations, o.weight)
    *_, last = accumulate(equations, o.weight)
    np.testing.assert_allclose(last.N, at_once.N, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(last.y, at_once.y, rtol=1e-10, atol=1e-18)
    theta, theta_at_once = last.solve()[0], at_once.solve()[0]
    np.testing.assert_allclose(theta, theta_at_once, atol=1e-9 * ARCSEC)


def test_inverse_by_cofactors_is_that_of_lapack(rng):
    A = rng.standard_normal((50, 5, 3)) * [1.0, 1.0, 1e-3]
    N = A.mT @ A
    inverse, singular = invert_symmetric(N)
    assert not singular.any()
    np.testing.assert_allclose(inverse, np.linalg.inv(N), rtol=1e-7, atol=1e-9)
    flat = np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    inverse, singular = invert_symmetric(np.stack([flat, np.zeros((3, 3)), N[0]]))
    assert list(singular) == [True, True, False]
    assert not inverse[:2].any()


def test_a_method_without_a_step_is_refused():
    with pytest.raises(InputError, match="iterations: found 0"):
        ImagePlane(iterations=0)(still(scene("frame")), C_EK_TRUE)


# --- bias ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [10 * ARCMIN, 20 * ARCMIN, 1 * DEG], ids=["10'", "20'", "1 deg"])
@pytest.mark.parametrize("name", ["image-plane", "ground-plane", "cross-product"])
def test_bias_of_one_linear_step(name, size):
    """``1/2 theta_z (z x theta)`` within 5 %, z the boresight, for an error of equal parts across and about it."""
    o = still(observe(truth(FRAME, images=1, markers=12, tilt_deg=5.0)))
    z, x, y = C_EK_TRUE[:, 2], C_EK_TRUE[:, 0], C_EK_TRUE[:, 1]
    for across in (x, y, (x + y) / np.sqrt(2.0)):
        theta = size * (across + z) / np.sqrt(2.0)
        left = ONE_STEP[name]()(o, so3.exp(theta) @ C_EK_TRUE)
        bias = so3.log(left.C_EK @ C_EK_TRUE.mT)
        expected = 0.5 * (z @ theta) * np.cross(z, theta)
        off = bias - z * (z @ bias) - expected
        assert np.linalg.norm(off) < 0.05 * np.linalg.norm(expected)
        again = ONE_STEP[name](iterations=2)(o, so3.exp(theta) @ C_EK_TRUE)
        assert np.linalg.norm(so3.log(again.C_EK @ C_EK_TRUE.mT)) < 0.01 * np.linalg.norm(bias)


def test_least_squares_as_published_takes_the_bias_out():
    """Its two iterations, the default, from 1 deg off: a hundredth of what one step leaves."""
    o, theta = (
        still(observe(truth(FRAME, images=1, markers=12, tilt_deg=5.0))),
        np.full(3, 1 * DEG / np.sqrt(3.0)),
    )
    one, published = (
        np.linalg.norm(so3.log(e(o, so3.exp(theta) @ C_EK_TRUE).C_EK @ C_EK_TRUE.mT))
        for e in (LeastSquares(iterations=1), LeastSquares())
    )
    assert published < 0.01 * one


def test_the_ground_equations_are_14_in_the_level_frame_of_each_marker():
    """(14) itself, marker by marker: where the line of sight passes the marker's level, less the marker."""
    light = Corrections(False, False, False)
    o = still(observe(truth(FRAME, images=2, markers=4, tilt_deg=20.0, corrections=light)))
    C_EK = so3.exp([1e-3, 2e-3, -1e-3]) @ C_EK_TRUE
    q = GroundPlane().equations(o, C_EK).q
    for k in range(o.n):
        latitude, longitude, _ = itrf_to_geodetic(o.p_J[k])
        C_TJ = C_JT(latitude, longitude).T
        X_n, X = C_TJ @ o.p_J[k], C_TJ @ o.r_J[k]
        s = C_TJ @ o.C_EJ[k].T @ C_EK @ [*o.xy_K[k], 1.0]
        passes = X[:2] + (X_n[2] - X[2]) * s[:2] / s[2]
        np.testing.assert_allclose(
            q[k] * (X_n[2] - X[2]) / s[2], passes - X_n[:2], atol=0.02
        )  # of kilometres


# --- sigma --------------------------------------------------------------------------------------------------------


def test_algorithms_2_3_4_and_least_squares_are_one_on_one_image(rng):
    """Same sigma on every axis, stated and on the same 2000 draws, to 1 %."""
    o = observe(truth(FRAME, images=1, markers=6, tilt_deg=5.0))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (2000,)))
    found = {name: kind(iterations=3)(table, C_EK_TRUE) for name, kind in ONE_STEP.items()}
    scatter = {name: so3.log(e.C_EK @ C_EK_TRUE.mT).std(axis=0) for name, e in found.items()}
    for name, e in found.items():
        np.testing.assert_allclose(scatter[name], scatter["image-plane"], rtol=0.01)
        np.testing.assert_allclose(e.sigma_E, found["image-plane"].sigma_E, rtol=0.01)


def misprinted(observations, C_EK):
    """(21) as printed: third column (-x', y')."""
    right = ImagePlane(field="narrow").equations(observations, C_EK)
    G = right.G.copy()
    x, y = -right.G[..., 1, 2], right.G[..., 0, 2]
    G[..., 0, 2], G[..., 1, 2] = -x, y
    return replace(right, G=G)


def test_the_misprint_of_21_loses_the_angle_about_the_boresight():
    """Of 10' about the boresight the printed Jacobian finds none where markers lie all around; the right one all."""
    angles = np.arange(8) * np.pi / 4
    ring = 0.015 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    s = np.concatenate([ring, np.ones((8, 1))], axis=-1)
    few = by_hand()
    around = replace(
        few.select(np.arange(8) % few.n),
        xy_K=ring,
        e_E=s / np.linalg.norm(s, axis=-1, keepdims=True),
        landmark=np.zeros(8, dtype=np.int64),
    )
    off = so3.exp([0.0, 0.0, 10 * ARCMIN])
    printed = estimate(misprinted, around, off, 1, "none")
    np.testing.assert_allclose(so3.log(printed.C_EK)[2], 10 * ARCMIN, rtol=1e-3)  # nothing found
    corrected = ImagePlane(field="narrow")(around, off)
    assert abs(so3.log(corrected.C_EK)[2]) < 1e-3 * 10 * ARCMIN


def test_the_naive_sigma_is_right_for_pixel_noise_and_blind_to_shared_errors(rng):
    """Residuals of an image's markers show their own noise; what the image shares they do not."""
    o = scene("frame")
    errors = Errors.draw(o, rng, (2000,))
    alone = measure(o, C_EK_TRUE, errors.only("pixel"))
    naive = ImagePlane(covariance="naive")(alone, C_EK_TRUE)
    scatter = so3.log(naive.C_EK @ C_EK_TRUE.mT).std(axis=0)
    mean_naive = np.sqrt(np.mean(naive.sigma_E**2, axis=0))
    np.testing.assert_allclose(mean_naive, scatter, rtol=4.0 / np.sqrt(4000.0))
    everything = measure(o, C_EK_TRUE, errors)
    naive = ImagePlane(covariance="naive")(everything, C_EK_TRUE)
    stated = ImagePlane()(everything, C_EK_TRUE)
    scatter = so3.log(naive.C_EK @ C_EK_TRUE.mT).std(axis=0)
    assert np.all(np.sqrt(np.mean(naive.sigma_E**2, axis=0))[:2] < 0.6 * scatter[:2])
    np.testing.assert_allclose(stated.sigma_E.mean(axis=0), scatter, rtol=4.0 / np.sqrt(4000.0))


# --- gls is never worse -------------------------------------------------------------------------------------------

CAMPAIGNS = {
    "frame, 2 images x 2 markers": lambda: truth(FRAME, images=2, markers=2),
    "frame, 4 x 6": lambda: truth(FRAME, images=4, markers=6),
    "frame turned, 4 x 6": lambda: truth(FRAME, images=4, markers=6, tilt_deg=20.0, yaw_deg=80.0),
    "frame, one site, 6 x 4": lambda: truth(FRAME, images=6, markers=4, shared_site=True),
    "line, 3 x 6": lambda: truth(LINE, images=3, markers=6),
}


@pytest.mark.slow
@pytest.mark.parametrize("campaign", CAMPAIGNS)
def test_gls_is_never_worse(campaign, rng):
    """Mean square error on every axis, on the same draws, within three sigmas of the difference."""
    runs = 1500
    o = observe(CAMPAIGNS[campaign]())
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (runs,)))
    best = so3.log(Gls()(table, C_EK_TRUE).C_EK @ C_EK_TRUE.mT) ** 2
    for kind in ONE_STEP.values():
        other = so3.log(kind(iterations=2)(table, C_EK_TRUE).C_EK @ C_EK_TRUE.mT) ** 2
        gain = other - best
        assert np.all(gain.mean(axis=0) > -3.0 * gain.std(axis=0) / np.sqrt(runs))
