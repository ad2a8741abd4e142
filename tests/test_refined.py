"""Least squares of all runs of a study together is that of each run alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.wahba import Wahba
from starplumb.io.scenario.read import find_scenario, load_scenario
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.solve.refinement import Scene
from starplumb.study import refined
from starplumb.study.monte_carlo import Study
from starplumb.study.refined import Refined, of_scene
from starplumb.table.equation import linearise
from starplumb.table.geometry import observe
from starplumb.table.parameters import TimeOffset
from starplumb.table.simulate import Errors, measure

RUNS = 12
MODEL = so3.exp(np.array([0.5, -0.8, 1.0]) * DEG) @ C_EK_TRUE


def scene_of(pattern, rng):
    """A table whose errors are shared in one way or another."""
    if pattern == "one site":
        return observe(truth(FRAME, images=4, markers=5, shared_site=True))
    table = observe(truth(LINE if pattern == "line" else FRAME, images=4, markers=5))
    n, eye = table.n, np.eye(3)
    match pattern:
        case "some again":  # a third of the landmarks in two images, in any order
            again = np.where(np.arange(n) % 3 == 0, table.landmark[::-1], table.landmark)
            return replace(table, landmark=again[rng.permutation(n)])
        case "uneven":
            order = rng.permutation(n)[: n - 4]
            return table.select(order)
        case "not seen":
            return replace(table, weight=(np.arange(n) % 4 != 1).astype(float))
        case "ellipses":
            root = np.eye(2) + 0.4 * rng.standard_normal((n, 2, 2))
            ellipse = root @ root.mT
            return replace(
                table, ellipse=2.0 * ellipse / np.trace(ellipse, axis1=-2, axis2=-1)[:, None, None]
            )
        case "common":
            turn = linearise(table, C_EK_TRUE).H @ np.array([10.0, -5.0, 20.0])[:, None] * ARCSEC
            return replace(table, common_px=np.concatenate([turn, 250.0 * table.xy_K[..., None]], axis=-1))
        case "prior":
            return replace(table, prior_E=eye * (20.0 * ARCSEC) ** 2)
    return table


@pytest.mark.parametrize(
    "pattern",
    ["own", "line", "one site", "some again", "uneven", "not seen", "ellipses", "common", "prior"],
)
def test_runs_together_are_runs_alone(pattern, rng, monkeypatch):
    table = scene_of(pattern, rng)
    scene = Scene.of(table, C_EK_TRUE)
    runs = measure(table, C_EK_TRUE, Errors.draw(table, rng, (RUNS,)))
    models = np.broadcast_to(MODEL, (RUNS, 3, 3))
    if pattern == "prior":  # a prior that a model a degree off contradicts is no prior
        models = so3.exp(20.0 * ARCSEC * rng.standard_normal((RUNS, 3))) @ C_EK_TRUE
    assert scene is not None
    assert np.all(scene.squares(runs.select(scene.seen), np.broadcast_to(C_EK_TRUE, (RUNS, 3, 3)))[1])
    monkeypatch.setattr(Refined, "_completed", None)  # no run may be left to the method
    compared(Refined(Gls(), scene)(runs, models), runs, models)


def compared(together, runs, models):
    """Each run alone, iterated further than by default."""
    alone = [Gls(tolerance=1e-8)(runs.run((i,)), models[i]) for i in range(len(models))]
    sigma = np.stack([a.sigma_E for a in alone])
    off = so3.log(together.C_EK @ np.stack([a.C_EK for a in alone]).mT) / sigma
    assert np.max(np.abs(off)) < 1e-6
    np.testing.assert_allclose(together.sigma_E, sigma, rtol=1e-6)
    np.testing.assert_allclose(together.chi2, [a.chi2 for a in alone], atol=1e-4)
    np.testing.assert_array_equal(together.status, [a.status for a in alone])
    np.testing.assert_array_equal(together.degrees_of_freedom, [a.degrees_of_freedom for a in alone])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two-images", "cubesat-6u", "wide-swath", "vhr-0.3m"])
def test_a_shipped_scenario_is_solved_exactly(name):
    scenario = load_scenario(find_scenario(name))
    study = Study(scenario, {}, 3, RUNS)
    runs, models = study.measured(study.generator(0), RUNS)
    estimator = of_scene(Gls(), scenario)
    assert isinstance(estimator, Refined)
    compared(estimator(runs, models), runs, models)


@pytest.mark.parametrize("off_deg", [0.01, 1.0, 30.0, 175.0])
def test_no_model_is_too_far_off(off_deg, rng, monkeypatch):
    table = scene_of("own", rng)
    runs = measure(table, C_EK_TRUE, Errors.draw(table, rng, (3,)))
    axes = rng.standard_normal((3, 3))
    turn = off_deg * DEG * axes / np.linalg.norm(axes, axis=-1, keepdims=True)
    models = so3.exp(turn) @ C_EK_TRUE
    scene, starts = Scene.of(table, C_EK_TRUE), []
    monkeypatch.setattr(Refined, "_completed", None)  # no run may be left to the method
    closed = refined.rotation
    monkeypatch.setattr(refined, "rotation", lambda o: starts.append(o.batch) or closed(o))
    compared(Refined(Gls(), scene)(runs, models), runs, models)
    assert starts == ([] if off_deg <= 1.0 else [(3,)])


def test_runs_far_from_the_scene_are_left_to_the_method(rng):
    """Attitude errors of 3 deg beside pixels of 1e-3: the covariances of the runs are not near the scene's."""
    table = observe(truth(FRAME, images=3, markers=5))
    table = replace(
        table,
        sigma_px=np.full(table.n, 1e-3),
        cov_attitude_E=table.cov_attitude_E * 0.0 + np.eye(3) * (3 * DEG) ** 2,
    )
    scene = Scene.of(table, C_EK_TRUE)
    assert scene is not None
    runs = measure(table, C_EK_TRUE, Errors.draw(table, rng, (4,)))
    models = np.broadcast_to(MODEL, (4, 3, 3))
    assert not np.any(scene.squares(runs, np.broadcast_to(C_EK_TRUE, (4, 3, 3)))[1])
    together, plain = Refined(Gls(), scene)(runs, models), Gls()(runs, models)
    for name in ("C_EK", "covariance_E", "status", "chi2", "iterations"):
        np.testing.assert_array_equal(getattr(together, name), getattr(plain, name))


def test_a_few_runs_are_left_to_the_method(rng):
    """One run of six is measured with an attitude 2 deg off, which the covariance of the scene does not know."""
    table = observe(truth(FRAME, images=3, markers=5))
    errors = Errors.draw(table, rng, (6,))
    errors.alpha_E[4] += 2.0 * DEG
    runs, models = measure(table, C_EK_TRUE, errors), np.broadcast_to(MODEL, (6, 3, 3))
    scene = Scene.of(table, C_EK_TRUE)
    assert scene is not None
    compared(Refined(Gls(), scene)(runs, models), runs, models)


def test_what_is_not_least_squares_of_the_alignment_alone_stays_as_it_is():
    scenario = load_scenario(find_scenario("two-images"))
    for other in (Wahba(), Gls((TimeOffset(("time_offset",), (0.1,)),))):
        assert of_scene(other, scenario) is other
    table = scenario.stated
    assert Scene.of(replace(table, weight=np.full(table.n, 0.5)), scenario.C_EK_true) is None
    one = replace(table, weight=(np.arange(table.n) == 0).astype(float))
    assert Scene.of(one, scenario.C_EK_true) is None
