"""What was known before and the data contradict: against the normal equations without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import starplumb as sp
from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.protocol import AlignmentEstimate, ParameterVector
from starplumb.judge.parameters.known_before import contradicted
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, UM
from starplumb.table.geometry import observe

NAMES = ("focal_length", "k1")


def estimated(x, C, prior_sigma):
    """An estimate of the mounting, and of two parameters if there are so many numbers."""
    vector = None
    if len(x) > 3:
        N = np.linalg.inv(C)
        vector = ParameterVector(NAMES, x[3:], np.array(prior_sigma), np.full(2, 1e9), C, N)
    C_EK = so3.exp(x[:3]) @ C_EK_TRUE
    return AlignmentEstimate(C_EK, C[:3, :3], np.array(0), np.array(1), parameters=vector)


@pytest.fixture
def table():
    return observe(truth(FRAME, images=2, markers=4))


def with_prior(table, prior_E):
    return replace(table, prior_E=prior_E)


def test_the_interval_is_that_of_the_data_where_the_mounting_was_known_wrongly(table):
    """Axis by axis: known to 3 arcsec, measured to 4 arcsec 50 arcsec away."""
    known, measured = 3.0 * ARCSEC, 4.0 * ARCSEC
    away = np.array([50.0, 0.0, 0.0]) * ARCSEC
    C = np.eye(3) / (known**-2 + measured**-2)
    x = C @ away / measured**2
    (found,) = contradicted(with_prior(table, np.eye(3) * known**2), C_EK_TRUE, estimated(x, C, ()), "a.json")
    assert found.weakens
    assert "the data contradict a.json (3, 3, 3 arcsec): the correction is 18 arcsec" in found.sentence
    np.testing.assert_allclose(found.half_E, np.abs(away - x) + 1.96 * measured, rtol=1e-6)


@pytest.mark.parametrize("wrong", [(True, True), (True, False), (False, False)])
def test_of_what_was_known_only_what_is_contradicted_is_left_out(table, rng, wrong):
    """Mounting and one parameter known, another free: against the equations of all data, with and without."""
    A = rng.normal(size=(9, 5))
    N = A.T @ A
    prior = np.diag([0.5, 0.8, 0.7, 0.6]) ** 2
    prior[:3, :3] += 0.1
    P = np.zeros((5, 5))
    P[:4, :4] = np.linalg.inv(
        np.block([[prior[:3, :3], np.zeros((3, 1))], [np.zeros((1, 3)), prior[3:, 3:]]])
    )
    alone = np.array([0.1, -0.1, 0.1, 0.1, 2.0]) + np.array([9.0, -7.0, 8.0, 0, 0]) * wrong[0]
    alone = alone + np.array([0, 0, 0, 40.0, 0]) * wrong[1]
    C = np.linalg.inv(N + P)
    x = C @ N @ alone
    scale = np.diag([ARCSEC] * 3 + [1.0, 1.0])
    estimate = estimated(scale @ x, scale @ C @ scale, [0.6, np.inf])
    found = contradicted(
        with_prior(table, prior[:3, :3] * ARCSEC**2), C_EK_TRUE, estimate, "mounting.sigma_arcsec"
    )
    told = ["mounting.sigma_arcsec" in one.sentence for one in found]
    assert told == [[], [True], [True, False]][sum(wrong)]
    kept = P.copy()
    if wrong[0]:
        kept[:3] = kept[:, :3] = 0.0
    if wrong[1]:
        kept[3] = 0.0
    spread = np.linalg.inv(N + kept)
    expected = np.abs(spread @ N @ alone - x)[:3] + stats.norm.ppf(0.975) * np.sqrt(np.diagonal(spread))[:3]
    for one in found:
        np.testing.assert_allclose(one.half_E / ARCSEC, expected, rtol=1e-3)


def test_what_was_known_of_a_direction_stands_where_the_data_say_nothing(table):
    prior = np.eye(3) * (5.0 * ARCSEC) ** 2
    C = np.diag([3.0, 3.0, 5.0 - 1e-9]) ** 2 * ARCSEC**2
    x = np.array([30.0, 0.0, 0.0]) * ARCSEC
    (found,) = contradicted(with_prior(table, prior), C_EK_TRUE, estimated(x, C, ()), "a prior")
    assert found.half_E[2] == pytest.approx(1.96 * 5.0 * ARCSEC, rel=1e-3)


def test_a_focal_length_known_wrongly_is_said_and_the_truth_is_in_the_interval():
    """Stated to 1 um where it is 400 um off, in eight images that fix it."""
    campaign = sp.demo(images=8, seed=3)
    physics = campaign.loaded.campaign
    camera = replace(physics.camera, focal_length=physics.camera.focal_length + 400.0 * UM)
    wrong = replace(campaign, loaded=replace(campaign.loaded, campaign=replace(physics, camera=camera)))
    found = sp.calibrate(wrong, estimate="focal_length=1um")
    assert found.status != "ok"
    assert (
        found.status == "refuted"
        or "the data contradict the 0.001 mm stated of the focal length" in found.message
    )
    if found.usable:
        error = np.abs(so3.log(found.C_EK @ campaign.C_EK_true.T)) / ARCSEC
        assert np.all(error < found.interval_95_arcsec)
