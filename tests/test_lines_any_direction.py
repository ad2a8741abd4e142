"""A line of detectors in any direction of the image plane gives what the same line along x gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, LINE, truth
from starplumb.estimators.gls import Gls
from starplumb.ground.locate import ground
from starplumb.judge.calibrate import calibrate
from starplumb.physics import so3
from starplumb.physics.camera import LineScanCamera
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.geometry import project
from starplumb.table.parameter_names import parameters

DIRECTIONS = [90.0, *(pytest.param(other, marks=pytest.mark.slow) for other in (30.0, 135.0, 180.0, 270.0))]


def turn(degrees):
    """From the axes in which the line lies along x to K, in which it lies this way."""
    return so3.exp(np.array([0.0, 0.0, degrees * DEG]))


def line(degrees):
    tan = turn(degrees)[:2, :2] @ np.stack([LINE.tan_x, LINE.tan_y])
    return LineScanCamera(LINE.column_px, tan[0], tan[1], LINE.size_px)


@pytest.fixture(scope="module")
def along_x():
    """Six images with 0.3 px of noise and a mounting that is off."""
    campaign = truth(LINE, images=6, markers=9)
    draw, seen = np.random.default_rng(3), campaign.sightings
    noise = 0.3 * draw.standard_normal((2, seen.column_px.size))
    seen = replace(seen, column_px=seen.column_px + noise[0], row_px=seen.row_px + noise[1])
    return replace(
        campaign, sightings=seen, C_EK=so3.exp(np.array([40.0, -30.0, 60.0]) * ARCSEC) @ campaign.C_EK
    )


def turned(campaign, degrees):
    return replace(campaign, camera=line(degrees), C_EK=campaign.C_EK @ turn(degrees).mT)


@pytest.mark.parametrize("degrees", DIRECTIONS)
def test_the_mounting_is_corrected_alike(along_x, degrees):
    wanted, found = (calibrate(c, Gls()) for c in (along_x, turned(along_x, degrees)))
    np.testing.assert_allclose(found.correction_E, wanted.correction_E, rtol=0, atol=1e-9 * ARCSEC)
    np.testing.assert_allclose(found.sigma_E, wanted.sigma_E, rtol=1e-9)
    np.testing.assert_allclose(found.residuals.after_px, wanted.residuals.after_px, rtol=0, atol=1e-6)
    assert found.message == wanted.message


@pytest.mark.parametrize("degrees", DIRECTIONS)
def test_ground_its_covariance_and_pixels_are_the_same(along_x, degrees):
    image = np.zeros(3, dtype=np.int64)
    pixel = np.array([[10.0, 1e2], [6e3, 5e3], [11e3, 11e3]])
    other, spread = turned(along_x, degrees), np.diag(np.array([2.0, 2.0, 20.0]) * ARCSEC) ** 2
    wanted, found = (ground(c, c.C_EK, spread, image, pixel, 100.0, 0.3) for c in (along_x, other))
    np.testing.assert_allclose(found.p_J, wanted.p_J, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.sigma_T, wanted.sigma_T, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(project(other, other.C_EK, image, found.p_J), pixel, rtol=0, atol=2e-5)


@pytest.mark.parametrize("degrees", [30.0, 90.0, 270.0])
def test_a_simulated_line_is_flown_across_the_track(degrees):
    """The pixels of a simulated scene lie where those of a line along x do, whichever way the camera calls it."""
    wanted, found = truth(LINE, images=2), truth(line(degrees), images=2)
    np.testing.assert_allclose(found.C_EK, C_EK_TRUE)
    np.testing.assert_allclose(found.landmarks.r_J, wanted.landmarks.r_J, rtol=0, atol=1e-4)


@pytest.mark.parametrize("degrees", DIRECTIONS)
def test_look_angles_are_those_along_the_line_and_across_it(along_x, degrees):
    """Degree 1 across the line is a turn of the camera and no look angle, whichever way the line runs."""
    found = [calibrate(c, Gls(parameters(["look_angles"], c))) for c in (along_x, turned(along_x, degrees))]
    sigmas = [np.sqrt(np.diagonal(one.estimate.parameters.covariance)) for one in found]
    np.testing.assert_allclose(sigmas[1], sigmas[0], rtol=1e-4)
    sigmas = [one.estimate.sigma_E for one in found]
    np.testing.assert_allclose(sigmas[1], sigmas[0], rtol=1e-4)
