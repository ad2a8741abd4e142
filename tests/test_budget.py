"""The budget against the simulator, against published sensitivities' definition, and against calculation by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import starplumb as sp
from starplumb.estimators.gls import Gls
from starplumb.estimators.wahba import Wahba
from starplumb.io.scenario.read import find_scenario, load_scenario
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.plan.bound import Linear, effects
from starplumb.plan.scenario import Initial
from starplumb.study.budget import budget, directions, requirements, response
from starplumb.study.budget_document import about, document, words
from starplumb.study.monte_carlo import Study


@pytest.fixture(scope="module")
def two_images():
    return load_scenario(find_scenario("two-images"))


@pytest.fixture(scope="module")
def scanner():
    return load_scenario(find_scenario("wide-swath"))


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [Gls(), Wahba()])
def test_budget_agrees_with_sampling(two_images, estimator):
    """Variances within their sampling error, 5000 trials, for the optimal and for a plainly weighted estimate."""
    n = 5000
    found = budget(two_images, estimator)
    theta = Study(two_images, {"it": estimator}, 3, n, chunk=n).samples(0)["it"].theta_E
    np.testing.assert_allclose(theta.std(0), found.sigma_E, rtol=3.5 / np.sqrt(2.0 * n))
    correlation = found.true_E / np.outer(found.sigma_E, found.sigma_E)
    np.testing.assert_allclose(np.corrcoef(theta.T), correlation, atol=3.5 / np.sqrt(n))


@pytest.mark.slow
def test_budget_of_a_wrong_model_agrees_with_sampling_where_the_stated_sigma_does_not():
    scenario, n = load_scenario(find_scenario("cubesat-6u-shared-left-out")), 1500
    found = budget(scenario, Gls())
    theta = Study(scenario, {"gls": Gls()}, 3, n, chunk=n).samples(0)["gls"].theta_E
    np.testing.assert_allclose(theta.std(0), found.sigma_E, rtol=3.5 / np.sqrt(2.0 * n))
    stated = np.sqrt(np.diagonal(found.stated_E))
    assert np.max(np.abs(found.sigma_E / stated - 1.0)) > 0.5


def test_parts_add_up_and_the_stated_covariance_is_the_sum(scanner):
    found = budget(scanner, Gls())
    np.testing.assert_allclose(sum(share.covariance_E for share in found.shares), found.true_E, rtol=1e-12)
    np.testing.assert_allclose(found.true_E, found.stated_E, rtol=1e-5, atol=1e-7 * found.true_E.max())


@pytest.mark.parametrize("name", ["tracker A", "gps", "survey", "matching", "bench"])
def test_response_of_the_real_estimator_is_its_dense_gain(scanner, name):
    """gls itself, given one draw after another, against gain times effect: two roads to the same matrix."""
    source = next(s for s in scanner.sources if s.name == name)
    gain = Linear(scanner, scanner.stated_sources).gain
    wanted = effects(scanner, [source])[0].through(gain)
    found = response(scanner, Gls(), source)
    np.testing.assert_allclose(found, wanted, atol=2e-3 * np.abs(wanted).max())


def test_sensitivities_are_the_derivatives_of_sigma(scanner):
    """Against differences of the stated sigma of gls over 1 % of each source's sigma."""
    found = budget(scanner, Gls())
    for share in found.shares:
        around = []
        for factor in (0.99, 1.01):
            sigma = share.source.sigma.copy()
            sigma[share.component] *= factor
            changed = replace(share.source, sigma=sigma)
            told = scanner.with_stated(tuple(changed if s is share.source else s for s in scanner.sources))
            around.append(Gls()(told, scanner.C_EK_true).sigma_E)
        wanted = (around[1] - around[0]) / (0.02 * share.sigma)
        np.testing.assert_allclose(share.derivative_E, wanted, rtol=2e-2, atol=1e-3 * np.abs(wanted).max())


@pytest.mark.slow
def test_one_image_of_markers_far_apart_follows_the_formula_by_hand():
    """One tracker of 5, 5, 12 arcsec over one nadir image: it goes into the alignment as it is, c_j = 1 (28 of A)."""
    found = budget(load_scenario(find_scenario("vhr-0.3m")), Gls())
    tracker = [share for share in found.shares if share.source.name == "tracker"]
    for share in tracker:
        alone = np.zeros(3)
        alone[share.component] = 1.0 / np.sqrt(30.0)  # thirty images
        np.testing.assert_allclose(share.response_E, alone, atol=2e-3)


def test_what_a_source_must_shrink_to_reaches_the_target(scanner):
    target = 1.5 * ARCSEC
    asked = {one.source.name: one for one in requirements(scanner, target)}
    now = Gls()(scanner.stated, scanner.C_EK_true).sigma_E
    assert np.all(now > target)
    met = 0
    for name, one in asked.items():
        for axis in range(3):
            if np.isnan(one.factor[axis]):
                assert one.without_E[axis] > target
                continue
            told = tuple(s.scaled(one.factor[axis]) if s.name == name else s for s in scanner.sources)
            assert Gls()(scanner.with_stated(told), scanner.C_EK_true).sigma_E[axis] == pytest.approx(
                target, rel=1e-3
            )
            met += 1
    assert met > 0


def test_a_target_already_met_asks_nothing(two_images):
    assert all(np.all(one.factor == 1.0) for one in requirements(two_images, 100.0 * ARCSEC))


def test_a_stated_prior_is_a_source_that_only_those_have_who_use_it(two_images):
    """By hand ``P = (P_data^-1 + P_0^-1)^-1``: a prior off by what it states beside images that know nothing of it."""
    sigma = np.array([0.3, 0.5, 2.0]) * ARCSEC
    told = replace(two_images, initial=Initial(sigma, stated=True))
    alone = np.linalg.inv(budget(two_images, Gls()).true_E)

    def by_hand(factor):
        return np.linalg.inv(alone + np.diag((factor * sigma) ** -2.0))

    found = budget(told, Gls())
    np.testing.assert_allclose(found.true_E, by_hand(1.0), rtol=1e-4, atol=1e-5 * found.true_E.max())
    assert list(words(told, found))[1] == "the stated sigma is the true one"
    assert [share.label for share in found.shares[-3:]] == ["[initial] x", "[initial] y", "[initial] z"]
    by_response = [response(told, Gls(), share.source) for share in found.shares[-1:]]
    np.testing.assert_allclose(
        by_response[0][:, 0], by_hand(1.0) / sigma, atol=1e-3 * np.max(by_hand(1.0) / sigma)
    )
    np.testing.assert_allclose(budget(told, Wahba()).true_E, budget(two_images, Wahba()).true_E, rtol=1e-6)
    target = 0.8 * float(np.max(found.sigma_E))
    asked = requirements(told, target)[-1]
    worst = int(np.argmax(found.sigma_E))
    assert np.sqrt(by_hand(asked.factor[worst])[worst, worst]) == pytest.approx(target, rel=1e-3)


def test_weak_directions_are_named_in_the_terms_of_the_camera(two_images):
    worst = directions(budget(two_images, Gls()).true_E)[2]
    assert abs((two_images.C_EK_true.T @ worst.axis_E)[2]) > 0.999
    sentence = next(words(two_images, budget(two_images, Gls())))
    assert sentence.startswith("badly determined: a turn about the boresight z of the camera")
    assert "99 % of its variance is pixel" in sentence
    assert about(np.array([0.0, -1.0, 0.05])) == "a turn about the row axis y of the camera"
    assert (
        about(np.array([0.7, 0.7, 0.1]))
        == "a turn about an axis between the columns (x) and the rows (y) of the camera"
    )


def test_words_say_when_the_stated_sigma_is_wrong():
    scenario = load_scenario(find_scenario("cubesat-6u-drift-left-out"))
    assert list(words(scenario, budget(scenario, Gls())))[1].endswith("the stated model is wrong")
    assert list(words(scenario, budget(scenario, Wahba())))[1] == "the method states no covariance"


def test_budget_turns_with_the_tracker(two_images):
    """The same scene with E turned: variances turn, the camera does not notice.  Trackers' axes are fixed to E, so only
    what is not theirs is compared."""
    turn = so3.exp(np.array([0.3, -0.5, 0.2]))
    o = two_images.truth
    rest = tuple(s for s in two_images.sources if s.field != "alpha_E")
    turned = replace(
        two_images,
        truth=o.with_geometry(C_EJ=turn @ o.C_EJ, omega_E=o.omega_E @ turn.T),
        C_EK_true=turn @ two_images.C_EK_true,
        sources=rest,
        stated_sources=rest,
    )
    here = budget(replace(two_images, sources=rest, stated_sources=rest), Gls()).true_E
    np.testing.assert_allclose(budget(turned, Gls()).true_E, turn @ here @ turn.T, atol=1e-6 * here.max())


def test_document_is_complete_and_plain(two_images):
    found = document(two_images, {"gls": Gls(), "wahba": Wahba()}, 2.0 * ARCSEC)
    assert found["schema"] == "starplumb-budget/1"
    method = found["methods"]["gls"]
    total = np.sqrt(np.sum([np.square(s["contribution_arcsec"]) for s in method["sources"]], axis=0))
    np.testing.assert_allclose(total, method["sigma_arcsec"], rtol=1e-9)
    np.testing.assert_allclose(
        np.sum([s["part_of_variance"] for s in method["sources"]], axis=0), 1.0, rtol=1e-9
    )
    assert found["methods"]["wahba"]["stated_sigma_arcsec"] is None
    assert [one["source"] for one in found["target"]["sources"]] == [s.name for s in two_images.sources]
    pixel = next(s for s in method["sources"] if s["source"] == "pixel")
    assert pixel["sensitivity_alone_arcsec_per_px"][2] == pytest.approx(
        pixel["contribution_arcsec"][2] / pixel["sigma_px"]
    )


def test_the_terminal_shows_as_nothing_what_the_report_does():
    """Rounding is no dependence, and what one axis depends on is none the smaller for what another does."""
    (table,) = sp.budget(sp.scenario("two-images")).tables
    slopes = {row[0]: row[3] for row in table.rows}
    assert slopes["focal"] == "0  0  0"
    assert slopes["pixel"].startswith("0.03")
