"""Images whose times are wrong one by one: against dense least squares, against geometry, and from campaigns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.gls import Gls
from starplumb.judge import calibrate as judge
from starplumb.judge.scatter.from_data import FromData, SourceFound, from_data
from starplumb.judge.scatter.rotations import image_rotations
from starplumb.judge.scatter.sources import findings_of_sources
from starplumb.judge.scatter.times import TimesFound, times_found
from starplumb.judge.scatter.variances import Component, Projector
from starplumb.judge.snooping import fit_at
from starplumb.physics import so3
from starplumb.table.geometry import observe
from starplumb.table.sharing import with_shared
from starplumb.table.simulate import Errors, measure

M = 6


def some_images(rng):
    """Own errors and one in common of six images, what a second does to each, and the residuals' projector."""
    own = rng.normal(size=(M, 3, 3))
    common = rng.normal(size=(M, 3, 1))
    component = Component("a", own @ own.mT + np.eye(3), common)
    return component, rng.normal(size=(M, 3)), Projector([component], np.ones(1))


def dense(component):
    V = np.zeros((3 * M, 3 * M))
    for i in range(M):
        V[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = component.own[i]
    Z = component.common.reshape(3 * M, -1)
    return V + Z @ Z.T


def test_the_gain_is_that_of_dense_least_squares_with_a_free_time_for_each_image(rng):
    component, u, projector = some_images(rng)
    d, root = 3.0 * rng.normal(size=(M, 3)), np.linalg.cholesky(dense(component))
    mean, late = np.tile(np.eye(3), (M, 1)), np.zeros((3 * M, M))
    late[np.arange(3 * M), np.repeat(np.arange(M), 3)] = u.reshape(-1)
    y, X = np.linalg.solve(root, d.reshape(-1)), np.linalg.solve(root, np.hstack([mean, late]))
    without = y - X[:, :3] @ np.linalg.lstsq(X[:, :3], y)[0]
    free = y - X @ np.linalg.lstsq(X, y)[0]
    found = times_found(projector, d, u)
    assert found.p == pytest.approx(stats.chi2.sf(without @ without - free @ free, M), rel=1e-9)


def test_a_time_that_all_share_cannot_be_told_and_costs_no_degree(rng):
    """Images that a second turns alike: one combination of times is the mounting's."""
    _, _, projector = some_images(rng)
    u, d = np.tile([1.0, 0.5, 0.0], (M, 1)), 2.0 * rng.normal(size=(M, 3))
    found, moved = times_found(projector, d, u), times_found(projector, d + 7.0 * u, u)
    assert moved.p == pytest.approx(found.p, rel=1e-6)
    assert found.p > 1e-12
    assert times_found(projector, d, 0.0 * u) is None


@pytest.mark.slow
def test_the_size_of_times_is_found_and_what_they_do_to_the_answer(rng):
    """The mean of the variance over draws, and the covariance of the weighted mean, Student's t left out."""
    component, u, projector = some_images(rng)
    root, s, draws = np.linalg.cholesky(dense(component)), 3.0, 4000
    found, moved = [], []
    for _ in range(draws):
        t = s * rng.normal(size=M)
        d = (root @ rng.normal(size=3 * M)).reshape(M, 3) + t[:, None] * u
        found.append(times_found(projector, d, u))
        moved.append(np.sum(projector.gain @ (t[:, None] * u)[..., None], axis=0)[:, 0])
    variance = np.array([one.sigma_s**2 for one in found])
    assert np.mean(variance) == pytest.approx(s**2, abs=4.0 * np.std(variance) / np.sqrt(draws) + 0.02 * s**2)
    student = stats.t.ppf(0.975, M) / 1.96
    one = next(one for one in found if one.sigma_s > 0.0)
    per_variance = one.covariance_E / one.sigma_s**2 / student**2
    np.testing.assert_allclose(
        np.cov(np.array(moved).T) / s**2, per_variance, atol=0.1 * np.trace(per_variance)
    )


def rotations(table):
    whole = Gls()(table, C_EK_TRUE)
    fit = fit_at(whole.unknowns, table, C_EK_TRUE, whole, np.ones(table.n, dtype=bool))
    return image_rotations(fit)


def late(o, seconds):
    t = np.asarray(seconds)[o.image][:, None]
    return o.with_geometry(C_EJ=so3.exp(t * o.omega_E) @ o.C_EJ, r_J=o.r_J + t * o.v_J)


def test_what_a_second_does_to_an_image_is_that_of_a_late_one(rng):
    """One image 1 ms late, by difference; the others stay where they are."""
    o = observe(truth(FRAME, 4, 8, yaw_deg=40.0))
    exact = measure(o, C_EK_TRUE, Errors.draw(o, rng).only("no source"))
    moved = rotations(late(exact, [0.0, 0.0, 1e-3, 0.0])).d_E - rotations(exact).d_E
    relative = (moved - moved[0]) / 1e-3  # the answer itself moves for all
    expected = rotations(exact).per_second_E[2]
    np.testing.assert_allclose(relative[2], expected, atol=2e-3 * np.linalg.norm(expected))
    np.testing.assert_allclose(relative[[1, 3]], 0.0, atol=2e-3 * np.linalg.norm(expected))


@pytest.mark.parametrize(
    ("p", "source_p", "said"), [(0.9e-3, 0.5, True), (1.1e-3, 0.5, False), (1e-9, 1e-9, False)]
)
def test_times_are_said_where_no_source_explains_the_scatter(p, source_p, said):
    across = SourceFound("across", "the across", "arcsec", 5.0, 10.0, 2.0, (1.6, 2.6), source_p)
    times = TimesFound(p, 0.0123, np.eye(3))
    found = findings_of_sources(FromData(8, None, None, (across,), times=times), 8)
    told = [one for one in found if "along the flight" in one.sentence]
    assert [one.weakens for one in told] == [True] * said
    if said:
        assert "wrong by 12 ms" in told[0].sentence
        np.testing.assert_array_equal(told[0].covariance_E, np.eye(3))


def scatter(o):
    whole = Gls()(o, C_EK_TRUE)
    return from_data(rotations(o), whole.C_EK, whole.sigma_E)


def test_times_are_seen_that_no_source_shows_and_none_where_all_are_right(rng):
    """8 ms are 18 arcsec, 3.5 sigmas of the attitude; counted in 20 draws, and false alarms in as many."""
    o = observe(truth(FRAME, 10, 8, yaw_deg=90.0))
    seen = {"times": 0, "sources": 0, "right": 0}
    for _ in range(20):
        exact = measure(o, C_EK_TRUE, Errors.draw(o, rng))
        found, right = scatter(late(exact, 0.008 * (np.arange(10) // 2 % 2))), scatter(exact)
        seen["times"] += found.times.p < 1e-3
        seen["sources"] += min(source.p for source in found.sources) < 1e-3 / 3
        seen["right"] += right.times.p < 1e-3
    assert seen["right"] == 0
    assert seen["times"] >= seen["sources"] + 4


def test_an_answer_of_late_images_is_weak_and_names_their_times(monkeypatch, rng):
    """Without any other error: 9.5 arcsec to either side, 1.9 sigmas of the attitude in ten images."""
    campaign = truth(FRAME, 10, 8, yaw_deg=90.0)
    o = observe(campaign)
    right = measure(o, C_EK_TRUE, Errors.draw(o, rng).only("no source"))
    monkeypatch.setattr(judge, "_evidence", lambda *_: ())
    found = []
    for wrong in (0.0, 0.0085):
        table = late(right, wrong * (np.arange(10) // 2 % 2))
        monkeypatch.setattr(judge, "table_of", lambda _, table=table: table)
        found.append(judge.calibrate(campaign, Gls()))
    assert [one.status.name for one in found] == ["OK", "WEAK"]
    assert "the images disagree along the flight" in found[1].message
    assert np.all(found[1].interval_95_E[:2] > 1.2 * found[0].interval_95_E[:2])


def test_a_stated_sigma_of_times_explains_them(rng):
    """The same residuals with and without sigma_time_s."""
    campaign = truth(FRAME, 10, 8, yaw_deg=90.0)
    o = observe(campaign)
    table = late(measure(o, C_EK_TRUE, Errors.draw(o, rng)), 0.01 * rng.normal(size=10))
    images = replace(campaign.images, sigma_time_s=np.full(10, 0.01))
    p = []
    for one in (table, with_shared(replace(campaign, images=images), table, C_EK_TRUE)):
        p.append(scatter(one).times.p)
    assert p[0] < 1e-3 < p[1]
