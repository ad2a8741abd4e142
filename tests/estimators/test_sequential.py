"""The filter: gls for a constant mounting whatever images share, and honest about one that drifts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from harness import scene, still

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators import sequential
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.estimators.sequential import Sequential
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.equation import linearise
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

MODEL = so3.exp(np.array([0.5, -0.8, 1.0]) * DEG) @ C_EK_TRUE


def common(o):
    """Two errors that all sightings have in common: a turn and a stretch of the focal length."""
    H = linearise(o, C_EK_TRUE).H
    turn = H @ np.array([10.0, -5.0, 20.0])[:, None] * ARCSEC
    stretch = 1e-5 * o.xy_K[..., None] / 4e-6
    return np.concatenate([turn, stretch], axis=-1)


@pytest.mark.parametrize("extra", ["plain", "prior", "common errors", "both"])
@pytest.mark.parametrize("problem", ["frame", "frame one site", "line"])
def test_a_constant_mounting_is_that_of_gls(problem, extra, rng):
    """To 1e-6 of a sigma, sigma and chi-square likewise, from more than a degree off."""
    o = scene(problem)
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (20,)))
    if extra in ("prior", "both"):
        table = replace(table, prior_E=np.diag([1.0, 1.0, 1.0]) * (1.0 * DEG) ** 2)
    if extra in ("common errors", "both"):
        table = replace(table, common_px=common(o))
    filtered, gls = Sequential()(table, MODEL), Gls(tolerance=1e-8)(table, MODEL)
    assert np.all(np.abs(so3.log(filtered.C_EK @ gls.C_EK.mT)) < 1e-6 * gls.sigma_E)
    np.testing.assert_allclose(filtered.sigma_E, gls.sigma_E, rtol=1e-6)
    np.testing.assert_allclose(filtered.chi2, gls.chi2, atol=2e-3)
    np.testing.assert_array_equal(filtered.degrees_of_freedom, gls.degrees_of_freedom)


def test_one_pass_as_in_flight_is_near(rng):
    """Each image linearised at what was known with it, from 1.4 deg off: 1e-3 of a sigma."""
    o = scene("frame")
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (20,)))
    flown, gls = Sequential(passes=1)(table, MODEL), Gls()(table, MODEL)
    assert np.all(np.abs(so3.log(flown.C_EK @ gls.C_EK.mT)) < 1e-3 * gls.sigma_E)


def test_the_track_is_gls_of_the_images_so_far(rng):
    o = scene("frame")
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    for count, state in enumerate(Sequential().track(table, C_EK_TRUE), start=1):
        gls = Gls()(table.select(table.image < count), C_EK_TRUE)
        assert np.all(np.abs(so3.log(state.C_EK @ gls.C_EK.mT)) < 1e-3 * gls.sigma_E)
        np.testing.assert_allclose(np.sqrt(np.diag(state.covariance_E)), gls.sigma_E, rtol=1e-3)
    assert count == 3


def test_images_come_in_the_order_of_their_epochs(rng):
    """Images numbered backwards with their epochs give the same drifting answer; without them another."""
    o = scene("frame")
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    backwards = replace(
        table,
        image=2 - table.image,
        epoch_s=table.epoch_s[::-1],
        cov_attitude_E=table.cov_attitude_E[::-1],
        cov_position_J=table.cov_position_J[::-1],
    )
    drifting = Sequential(drift=(2 * ARCSEC,) * 3)
    there, back = drifting(table, C_EK_TRUE), drifting(backwards, C_EK_TRUE)
    assert np.abs(so3.log(there.C_EK @ back.C_EK.mT)).max() < 1e-9 * ARCSEC
    untold = drifting(replace(backwards, epoch_s=table.epoch_s), C_EK_TRUE)
    assert np.abs(so3.log(there.C_EK @ untold.C_EK.mT)).max() > 1e-3 * ARCSEC
    with pytest.raises(InputError, match="epoch_s"):
        drifting(replace(table, epoch_s=None), C_EK_TRUE)


@pytest.mark.slow
def test_a_drifting_mounting_is_followed_with_an_honest_sigma(rng):
    """Random walk of 1.5 arcsec/sqrt(s) over 8 images 30 s apart: error / sigma of the last image has rms 1 per axis,
    and is smaller than that of an estimate which takes the mounting as constant."""
    runs, density = 1500, 1.5 * ARCSEC
    o = observe(truth(FRAME, images=8, markers=4))
    walk = np.cumsum(rng.standard_normal((runs, 8, 3)) * density * np.sqrt(30.0), axis=-2)
    errors = Errors.draw(o, rng, (runs,))
    # the camera drifts against the tracker: to the images it is as if the tracker erred by as much
    table = measure(o, C_EK_TRUE, replace(errors, alpha_E=errors.alpha_E + walk))
    last = so3.exp(walk[:, -1]) @ C_EK_TRUE
    followed = Sequential(drift=(density,) * 3)(table, C_EK_TRUE)
    error = so3.log(followed.C_EK @ last.mT)
    rms = np.sqrt(np.mean((error / followed.sigma_E) ** 2, axis=0))
    np.testing.assert_allclose(rms, 1.0, atol=4.0 / np.sqrt(2.0 * runs))
    constant = so3.log(Gls()(table, C_EK_TRUE).C_EK @ last.mT)
    assert np.all(np.mean(error**2, axis=0) < 0.7 * np.mean(constant**2, axis=0))


def test_one_marker_an_image_needs_no_prior(rng):
    """No image alone fixes the mounting; together they do, as gls has it."""
    o = observe(truth(FRAME, images=6, markers=1, tilt_deg=20.0))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (10,)))
    filtered, gls = Sequential(passes=3)(table, C_EK_TRUE), Gls()(table, C_EK_TRUE)
    assert np.all(filtered.status == Status.OK)
    assert np.all(np.abs(so3.log(filtered.C_EK @ gls.C_EK.mT)) < 1e-4 * gls.sigma_E)


def test_a_prior_of_its_own_counts_in_the_answer():
    """Prior and data that agree in nothing else: with no data worth its name the model stays, at the prior's sigma."""
    o = still(scene("frame"))
    vague = replace(o, sigma_px=1e9 * o.sigma_px)
    prior = (30.0 * ARCSEC, 20.0 * ARCSEC, 10.0 * ARCSEC)
    held = Sequential(prior_sigma=prior)(vague, MODEL)
    np.testing.assert_allclose(held.sigma_E, prior, rtol=1e-6)
    assert np.abs(so3.log(held.C_EK @ MODEL.mT)).max() < 1e-3 * ARCSEC


@pytest.mark.slow
def test_landmarks_seen_again_are_not_new_information(rng):
    """Place errors of 30 m rule over images of one marker set: the stated sigma holds, while the filter that takes
    every sighting for a landmark of its own states less than half of its error."""
    o = observe(truth(FRAME, images=8, markers=4, shared_site=True))
    survey = np.tile(900.0 * np.eye(3), (o.n_landmarks, 1, 1))
    o = replace(o, cov_landmark_J=survey, cov_attitude_E=0.01 * o.cov_attitude_E)
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (800,)))
    own = replace(table, landmark=np.arange(o.n), cov_landmark_J=survey[o.landmark])
    rms = {}
    for name, t in (("carried", table), ("forgotten", own)):
        found = Sequential()(t, C_EK_TRUE)
        rms[name] = np.sqrt(np.mean((so3.log(found.C_EK @ C_EK_TRUE.mT) / found.sigma_E) ** 2, axis=0))
    np.testing.assert_allclose(rms["carried"], 1.0, atol=4.0 / np.sqrt(1600.0))
    assert np.all(rms["forgotten"] > 2.0)


def test_images_are_adjusted_together_and_a_landmark_costs_only_its_sightings(rng, monkeypatch):
    """Twelve images linearised at one mounting are adjusted at once, and no landmark of their own is an unknown."""
    o = observe(truth(FRAME, images=12, markers=3))
    sizes = []
    counted = sequential.squares_by_image
    monkeypatch.setattr(
        sequential,
        "squares_by_image",
        lambda part, model, A: sizes.append((part.n_images, A.shape)) or counted(part, model, A),
    )
    Sequential()(measure(o, C_EK_TRUE, Errors.draw(o, rng)), MODEL)
    assert o.n_landmarks == 36
    assert set(sizes) == {(12, (36, 2, 3))}
