"""Least squares while nothing objects; what is wrong is left out, and nothing for a spread of all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from harness import scene

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.default import Default
from starplumb.estimators.fit import Fit, State, Unknowns
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status, Verdict
from starplumb.estimators.robust import Robust
from starplumb.estimators.spread import further_spread
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure


def measured(o, rng, batch=()):
    return measure(o, C_EK_TRUE, Errors.draw(o, rng, batch))


def turned(o, d_arcsec):
    """The measured attitude of image i turned by d (m, 3) arcsec about E's axes."""
    return o.with_geometry(C_EJ=so3.exp(np.asarray(d_arcsec)[o.image] * ARCSEC) @ o.C_EJ)


def images_out(estimate, o):
    """Images without a sighting in the solution."""
    return [i for i in range(o.n_images) if not np.any(estimate.verdict[o.image == i] == int(Verdict.USED))]


def beyond(estimate):
    """Largest error over its sigma."""
    return np.abs(so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E).max()


@pytest.mark.slow
@pytest.mark.parametrize("problem", ["frame", "frame turned", "frame one site", "line"])
def test_good_campaigns_have_the_answer_of_gls(problem, rng):
    """At the level 5e-4: of 400 more than three that object are improbable (p = 5e-5)."""
    table = measured(scene(problem), rng, (100,))
    plain, found = Gls()(table, C_EK_TRUE), Default()(table, C_EK_TRUE)
    apart = np.abs(so3.log(found.C_EK @ plain.C_EK.mT)).max(axis=-1)
    assert np.sum(apart > 1e-9 * ARCSEC) <= 1
    assert np.sum(np.any(found.verdict != 0, axis=-1)) <= 1


def test_a_wrong_sighting_a_wrong_image_and_a_wrong_landmark_go(rng):
    o = observe(truth(FRAME, 12, 9, shared_site=True))
    table = measured(o, rng)
    xy = table.xy_K.copy()
    xy[5] += 1e-3
    p_J = table.p_J + np.where((o.landmark == 3)[:, None], [60.0, -40.0, 0.0], 0.0)
    d = np.zeros((12, 3))
    d[7] = 80.0, -50.0, 20.0
    table = turned(replace(table, xy_K=xy).with_geometry(p_J=p_J), d)
    assert Gls()(table, C_EK_TRUE).status == Status.OK
    found = Default()(table, C_EK_TRUE)
    assert found.status == Status.OK
    assert images_out(found, o) == [7]
    assert found.verdict[5] == int(Verdict.SIGHTING)
    rest = (o.landmark == 3) & (o.image != 7)
    assert np.all(found.verdict[rest] == int(Verdict.LANDMARK))
    assert beyond(found) < 4.0


SPREADS = {
    "larger variance": lambda t, rng: 4.0 * rng.normal(0.0, [5.0, 5.0, 12.0], (t.size, 3)),
    "drift": lambda t, _: np.outer(np.linspace(-1.0, 1.0, t.size), [40.0, -20.0, 0.0]),
    "sessions": lambda t, _: np.outer((t.argsort() // 8) % 2 == 1, [35.0, 20.0, 0.0]),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", SPREADS)
def test_no_image_leaves_for_what_all_images_have(kind, rng):
    """Robust leaves images out, one after another; the default keeps them, and its answer is that of gls."""
    o = observe(truth(FRAME, 24, 6))
    table = turned(measured(o, rng), SPREADS[kind](o.epoch_s, rng))
    assert len(images_out(Robust()(table, C_EK_TRUE), o)) > 2
    found, plain = Default()(table, C_EK_TRUE), Gls()(table, C_EK_TRUE)
    assert images_out(found, o) == []
    assert np.abs(so3.log(found.C_EK @ plain.C_EK.mT)).max() < 1e-3 * ARCSEC


def test_among_images_that_scatter_a_wrong_one_and_a_wrong_sighting_still_go(rng):
    o = observe(truth(FRAME, 16, 8))
    d = 2.0 * rng.normal(0.0, [5.0, 5.0, 12.0], (16, 3))
    d[4] += 2000.0, 0.0, 0.0
    table = turned(measured(o, rng), d)
    xy = table.xy_K.copy()
    xy[0] += 1e-3
    found = Default()(replace(table, xy_K=xy), C_EK_TRUE)
    assert images_out(found, o) == [4]
    assert found.verdict[0] == int(Verdict.SIGHTING)


@pytest.mark.parametrize("times", [1.5, 5.0])
def test_noise_larger_than_stated_rejects_nothing(times, rng):
    o = observe(truth(FRAME, 8, 20))
    o = replace(o, cov_landmark_J=1e-4 * o.cov_landmark_J)
    table = replace(measured(o, rng), sigma_px=o.sigma_px / times)
    found = Default()(table, C_EK_TRUE)
    assert not np.any(found.verdict)
    np.testing.assert_array_equal(found.C_EK, Gls()(table, C_EK_TRUE).C_EK)


def test_most_sightings_within_a_few_pixels_wrong_are_no_larger_noise(rng):
    o = observe(truth(FRAME, 8, 20))
    table = measured(o, rng)
    wrong = rng.random(o.n) < 0.6
    moved = table.xy_K + np.where(wrong[:, None], rng.uniform(-5e-5, 5e-5, (o.n, 2)), 0.0)  # 12 px
    found = Default()(replace(table, xy_K=moved), C_EK_TRUE)
    assert np.mean(found.verdict[wrong] != int(Verdict.USED)) > 0.9
    assert np.mean(found.verdict[~wrong] != int(Verdict.USED)) < 0.1
    assert beyond(found) < 4.0


def test_a_batch_is_its_runs(rng):
    o = observe(truth(FRAME, 6, 8))
    table = measured(o, rng, (3,))
    xy = np.array(np.broadcast_to(table.xy_K, (3, o.n, 2)))
    xy[1, 4] += 1e-3
    found = Default()(replace(table, xy_K=xy), C_EK_TRUE)
    assert [int(np.sum(v != 0)) for v in found.verdict] == [0, 1, 0]
    for i in range(3):
        alone = Default()(replace(table, xy_K=xy).run((i,)), C_EK_TRUE)
        np.testing.assert_array_equal(found.C_EK[i], alone.C_EK)


def test_no_spread_is_told_from_images_of_which_none_is_right(rng):
    """One sighting is left of one image, which fixes no rotation: there is nothing to compare the others with."""
    table = measured(observe(truth(FRAME, 3, 5)), rng)
    used = replace(table, weight=np.where(np.arange(table.n) == 0, 1.0, 0.0))
    fit = Fit(Unknowns(), used, State(C_EK_TRUE, np.zeros(0)), C_EK_TRUE)
    assert further_spread(fit, np.ones(table.n, dtype=bool)) is None
