"""What is found about an answer decides its status, its message and its interval, and nothing wrong is left to use."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Rival, Status
from starplumb.estimators.robust import Robust
from starplumb.judge import calibrate as judge
from starplumb.judge.consistency import findings
from starplumb.judge.contradictions import (
    Support,
    culprit,
    rejected_images,
    rejected_sightings,
    rival,
    worse_on_the_ground,
)
from starplumb.judge.parameters.separability import Combination, inseparable
from starplumb.judge.residuals import Accuracy
from starplumb.judge.scatter.from_data import from_data
from starplumb.judge.scatter.rotations import ImageRotations, image_rotations
from starplumb.judge.snooping import fit_at
from starplumb.judge.trust import Finding, interval_95, judged, probability, said
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.solve import reliability
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

GOOD, WEAKER, REFUTING = Finding("a", False), Finding("b", True), Finding("c", True, refutes=True)


@pytest.mark.parametrize(
    ("own", "found", "status"),
    [
        (Status.OK, [], Status.OK),
        (Status.OK, [GOOD], Status.OK),
        (Status.WEAK, [GOOD], Status.WEAK),
        (Status.OK, [GOOD, WEAKER], Status.WEAK),
        (Status.OK, [WEAKER, REFUTING], Status.REFUTED),
        (Status.WEAK, [REFUTING], Status.REFUTED),
        (Status.SINGULAR, [REFUTING], Status.SINGULAR),
        (Status.NOT_CONVERGED, [WEAKER], Status.NOT_CONVERGED),
    ],
)
def test_the_heaviest_finding_decides(own, found, status):
    assert judged(own, found) is status


def test_a_message_begins_with_what_weighs_most():
    assert said([GOOD, WEAKER, Finding("n", False, informs=True), REFUTING]) == ("c", "b", "a")


def test_an_interval_is_the_larger_one_and_holds_what_was_found():
    stated = np.diag([1.0, 4.0, 9.0])
    np.testing.assert_allclose(interval_95(stated, None, []), [1.96, 3.92, 5.88])
    np.testing.assert_allclose(interval_95(stated, np.array([3.0, 1.0, 6.0]), []), [3.0, 3.92, 6.0])
    wider = Finding("", True, covariance_E=np.diag([3.0, 0.0, 0.0]))
    other = Finding("", True, reach_E=np.array([0.0, -10.0, 0.0]))
    np.testing.assert_allclose(interval_95(stated, None, [wider, other]), [3.92, 13.92, 5.88])


def rotations(d_E, sigma):
    """Images of equal attitude sigma (3,), exact sightings and positions."""
    m = len(d_E)
    attitude = np.tile(np.diag(np.square(sigma)), (m, 1, 1))
    nothing, none = np.zeros((m, 3, 3)), np.zeros((m, 3, 0))
    exact = nothing + 1e-12 * np.eye(3)
    return ImageRotations(
        np.arange(m), d_E, exact, attitude, nothing, none, none, 0.0 * d_E, (), 10.0, 10, 0.1
    )


def test_the_interval_from_data_is_students(rng):
    """Eight equal images: the textbook's intervals, from 2 x 7 numbers across the boresight and 7 about it."""
    m, stated = 8, np.array([1.0, 1.0, 2.0])
    d = rng.normal(0.0, [3.0, 3.0, 5.0], (m, 3))
    squares = np.sum((d - d.mean(axis=0)) ** 2, axis=0)
    across, about = (squares[0] + squares[1]) / (2 * (m - 1)), squares[2] / (m - 1)
    expected = np.array(
        [np.sqrt(across / m) * stats.t.ppf(0.975, 2 * (m - 1))] * 2
        + [np.sqrt(about / m) * stats.t.ppf(0.975, m - 1)]
    )
    found = from_data(rotations(d, stated), np.eye(3), stated / np.sqrt(m)).half_95_E
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_what_an_image_says_alone_is_least_squares_of_its_sightings(rng):
    """Against the answer from that image with exact attitude and position."""
    o = observe(truth(FRAME, 3, 9))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    whole = Gls()(table, C_EK_TRUE)
    fit = fit_at(whole.unknowns, table, C_EK_TRUE, whole, np.ones(table.n, dtype=bool))
    images = image_rotations(fit)
    for i in range(3):
        exact = replace(
            table,
            weight=(table.image == i).astype(np.float64),
            cov_attitude_E=np.zeros((3, 3, 3)),
            cov_position_J=np.zeros((3, 3, 3)),
        )
        alone = Gls()(exact, C_EK_TRUE)
        np.testing.assert_allclose(images.d_E[i], so3.log(alone.C_EK @ whole.C_EK.mT), rtol=2e-3, atol=1e-9)
        np.testing.assert_allclose(images.sightings_E[i], alone.covariance_E, rtol=2e-3, atol=1e-16)
    assert images.degrees == 2 * 27 - 9


@pytest.mark.parametrize(
    ("factor", "weakens", "refutes"), [(1.01, 0, 0), (1.03, 1, 0), (9.9, 1, 0), (10.1, 1, 1)]
)
def test_residuals_weaken_from_two_percent_and_refute_from_ten_times(factor, weakens, refutes):
    """At 4e5 degrees of freedom 1 % is implausible too."""
    o = observe(truth(FRAME, 8, 8, tilt_deg=20.0, yaw_deg=180.0))
    dof = 400_000
    estimate = replace(Gls()(o, C_EK_TRUE), chi2=np.array(factor**2 * dof), degrees_of_freedom=np.array(dof))
    said = [f for f in findings(o, C_EK_TRUE, estimate, Gls()) if "implausible" in f.sentence]
    assert [(f.weakens, f.refutes) for f in said] == [(weakens, refutes)]


@pytest.mark.parametrize(("after", "refutes"), [(1.49, False), (1.51, True)])
def test_an_answer_that_locates_worse_than_none_is_refuted(after, refutes):
    found = worse_on_the_ground(Accuracy(2.0, 0.0, 5), Accuracy(2.0 * after, 0.0, 5))
    assert (found is not None and found.refutes) == refutes


@pytest.mark.parametrize(("before", "after"), [(None, Accuracy(9.0, 0.0, 5)), (Accuracy(2.0, 0.0, 5), None)])
def test_points_that_could_not_be_located_compare_with_nothing(before, after):
    assert worse_on_the_ground(before, after) is None


def support(images=20, out=()):
    campaign = truth(FRAME, images, 4)
    o = observe(campaign)
    offered = np.ones(o.n, dtype=bool)
    return Support(campaign, o, offered, offered & ~np.isin(o.image, out))


@pytest.mark.parametrize(
    ("ratio", "weight"),
    [(0.14, None), (0.16, 1), (0.79, 1), (0.81, 2)],
    ids=["none", "weak", "still", "even"],
)
def test_a_rival_weakens_and_as_strong_a_one_refutes(ratio, weight):
    turn = np.array([0.0, 3e-4, 0.0])
    found = rival(support(out=(7,)), Rival(np.asarray(ratio), turn, np.asarray(1)))
    assert (None if found is None else found.weight) == weight
    if weight == 1:
        np.testing.assert_array_equal(found.reach_E, turn)
        assert support().campaign.images.ids[7] in found.sentence


def test_images_without_an_offered_sighting_are_counted():
    s = support(images=4)
    offered = s.observations.image < 2
    counted = replace(s, offered=offered, used=offered & (s.observations.image > 0)).counts
    np.testing.assert_array_equal(counted, [[4, 4, 0, 0], [0, 4, 0, 0]])


def test_more_than_a_tenth_of_the_images_rejected_is_weak():
    assert rejected_images(support(out=(3, 4))) is None
    found = rejected_images(support(out=(3, 4, 11)))
    assert found.weight == 1
    assert all(support().campaign.images.ids[i] in found.sentence for i in (3, 4, 11))


@pytest.mark.parametrize("tests", [True, False], ids=["a method that rejects", "one that does not"])
def test_what_a_method_rejects_is_held_against_its_answer(tests):
    s = support(out=(3, 4, 11))
    errors = np.zeros((s.used.size, 2))
    left = SimpleNamespace(before_m=errors + 5.0, after_m=errors + 1.0)
    verdict = np.where(s.used, 0, 1) if tests else None
    estimate = replace(Gls()(s.observations, C_EK_TRUE), verdict=verdict)
    assert [f.weight for f in judge.contradictions(s, estimate, left)] == ([1] if tests else [])


@pytest.mark.parametrize(("rejected", "refutes"), [(9, False), (10, True), (19, True)])
def test_an_answer_of_a_minority_of_the_images_is_refuted(rejected, refutes):
    found = rejected_images(support(out=range(rejected)))
    assert found.refutes is refutes
    assert f"{rejected} of 20 images" in found.sentence
    assert ("starplumb diagnose" in found.sentence) is True


@pytest.mark.parametrize(
    ("images_left", "p", "refutes"),
    [
        (6, None, False),  # of 20 alike: 30 % of the sightings
        (5, None, True),
        (6, 0.5, False),
        (5, 0.5, True),
        (9, 0.9e-4, True),
        (9, 1.1e-4, False),
        (10, 0.9e-4, False),
    ],
)
def test_a_minority_of_sightings_must_fit_and_be_more_than_three_tenths(images_left, p, refutes):
    found = rejected_sightings(support(out=range(20 - images_left)), p)
    assert (found is not None and found.refutes) is refutes
    if found is not None:
        assert f"{4 * (20 - images_left)} of 80 sightings are rejected" in found.sentence


@pytest.mark.parametrize(
    ("left", "refutes"), [((1, 2, 2, 1), True), ((3, 3, 3, 2), False), ((2, 2, 2, 5), True)]
)
def test_a_minority_of_which_most_images_keep_fewer_than_three_may_agree_by_chance(left, refutes):
    """Of four images with eight sightings each; what fits by itself, as heights in feet do where they are alike."""
    o = observe(truth(FRAME, 4, 8))
    place = np.arange(o.n) - np.searchsorted(o.image, o.image)
    used = place < np.array(left)[o.image]
    campaign = truth(FRAME, 4, 8)
    found = rejected_sightings(Support(campaign, o, np.ones(o.n, dtype=bool), used), 0.5)
    # of 32 sightings 10 are more than three tenths
    assert (found is not None and found.refutes) is refutes


def calibrated(monkeypatch, campaign, table, estimator):
    """The judgement of drawn measurements of a campaign, whose files say nothing."""
    monkeypatch.setattr(judge, "table_of", lambda _: table)
    monkeypatch.setattr(judge, "_evidence", lambda *_: ())
    return judge.calibrate(campaign, estimator)


def test_half_of_the_images_turned_alike_refute_the_answer(monkeypatch, rng):
    campaign = truth(FRAME, 8, 10)
    o = observe(campaign)
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    turn = so3.exp(np.array([300.0, 0.0, 0.0]) * ARCSEC)
    table = table.with_geometry(C_EJ=np.where((o.image < 4)[:, None, None], turn @ table.C_EJ, table.C_EJ))
    found = calibrated(monkeypatch, campaign, table, Robust())
    assert found.status is Status.REFUTED
    assert found.sentences[0].startswith("rejected sightings in 4 images agree on another answer")
    assert np.linalg.norm(found.estimate.rival.turn_E) == pytest.approx(300.0 * ARCSEC, abs=20.0 * ARCSEC)
    assert found.sigma_E is None
    assert found.covariance_E is None
    assert found.interval_95_E is None
    assert found.from_data is None
    np.testing.assert_array_equal(found.C_EK, campaign.C_EK)
    assert len(found.rejected) >= 40


def test_attitude_stated_three_times_too_small_widens_the_interval(monkeypatch, rng):
    campaign = truth(FRAME, 20, 10)
    o = observe(campaign)
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    table = replace(table, cov_attitude_E=table.cov_attitude_E / 9.0)
    found = calibrated(monkeypatch, campaign, table, Gls())
    assert found.status is Status.WEAK
    assert "the images disagree" in found.message
    assert np.all(found.interval_95_E[:2] > 1.5 * 1.96 * found.sigma_E[:2])


@pytest.mark.slow
def test_good_campaigns_are_left_ok(monkeypatch, rng):
    """Sixty: at most one in a hundred may be weak, so at most three here (one in 30 000 by chance)."""
    campaign = truth(FRAME, 8, 12)
    o = observe(campaign)
    status = [
        calibrated(monkeypatch, campaign, measure(o, C_EK_TRUE, Errors.draw(o, rng)), Robust()).status
        for _ in range(60)
    ]
    assert status.count(Status.OK) >= 57
    assert Status.REFUTED not in status


@pytest.mark.parametrize(
    ("factor", "found", "times"),
    [
        (1.03, [WEAKER], 1.03),
        (1.03, [GOOD], 1.0),
        (1.01, [WEAKER], 1.0),
        (0.5, [WEAKER], 1.0),
        (9.0, [WEAKER], 9.0),
    ],
)
def test_without_the_scatter_of_images_residuals_widen_an_interval(factor, found, times):
    """By the residuals' rms over the stated one, 2 % more or above, where something weakens the answer."""
    o = observe(truth(FRAME, 3, 4))
    estimate = replace(Gls()(o, C_EK_TRUE), chi2=np.array(factor**2 * 21), degrees_of_freedom=np.array(21))
    widened = judge._interval(estimate, None, found)
    np.testing.assert_allclose(widened, 1.96 * times * estimate.sigma_E, rtol=1e-3)


def of_each(campaign, sighting, image, landmark):
    """Statistics of a campaign whose second sighting, image and landmark alone stand out, by so much."""
    n = campaign.sightings.image.size
    counts = (n, len(campaign.images.ids), len(campaign.landmarks.ids))
    T = [
        np.where(np.arange(k) == 1, value, 1.0)
        for k, value in zip(counts, (sighting, image, landmark), strict=True)
    ]
    dof = [np.full(k, d) for k, d in zip(counts, (2, 40, 6), strict=True)]
    return reliability.Tested(*zip(T, dof, strict=True), repeated=np.arange(counts[2]))


@pytest.mark.parametrize(
    ("over", "named"),
    [
        ((1.2, 1.1, 1.0), "the sighting of landmark"),
        ((1.1, 1.2, 1.0), "image"),
        ((1.1, 1.0, 1.2), "landmark"),
    ],
    ids=["sighting", "image", "landmark"],
)
def test_the_culprit_is_largest_over_its_own_critical_value(over, named):
    """Chi-square's quantiles at 1e-4 for 2, 40 and 6 degrees of freedom: 18.4, 82.1 and 27.9 (of any textbook)."""
    s = support(images=2)
    T = np.array(over) * stats.chi2.isf(1e-4, [2, 40, 6])
    words = culprit(s.campaign, s.observations, of_each(s.campaign, *T), s.used)
    assert words.startswith(named)
    which = {"image": 1, "landmark": 2}.get(named, 0)
    assert words.endswith(f"fits worst, at {np.sqrt(T[which]):.3g} sigma")


def test_a_sighting_left_out_is_no_culprit():
    s = support(images=2)
    used = np.arange(s.used.size) != 1
    tested = of_each(s.campaign, 1e4, 200.0, 1.0)
    assert culprit(s.campaign, s.observations, tested, used).startswith("image")


@pytest.mark.parametrize(
    ("found", "weight"), [([], 0), ([GOOD], 0), ([GOOD, WEAKER], 1), ([REFUTING, GOOD], 2)], ids=str
)
def test_a_culprit_weighs_as_much_as_what_else_is_found(monkeypatch, found, weight):
    s = support(images=2)
    monkeypatch.setattr(judge, "findings", lambda *_: found)
    monkeypatch.setattr(judge, "culprit", lambda *_: "worst")
    snooping = SimpleNamespace(tested=None)
    for p, told in ((0.0099, True), (0.0101, False)):
        monkeypatch.setattr(judge, "_chi2_p", lambda _, p=p: p)
        weights = [f.weight for f in judge._consistent(s, None, None, snooping) if f.sentence == "worst"]
        assert weights == ([weight] if told else [])


def test_a_probability_below_the_smallest_number_is_not_zero():
    assert probability(2.06e-6) == "p = 2.1e-06"
    assert probability(0.0) == "p < 1e-300"


@pytest.mark.parametrize(
    ("growth", "members", "misfit", "weight"),
    [
        (31.0, (1, 4), 3.01, 2),
        (31.0, (1, 4), 2.99, 1),
        (31.0, (2, 3), 3.01, 2),
        (31.0, (3, 4), 3.01, 1),
        (29.0, (1, 4), 3.01, 0),
    ],
)
def test_an_alignment_not_separated_from_a_parameter_is_anywhere_where_residuals_are_large(
    growth, members, misfit, weight
):
    o = observe(truth(FRAME, 3, 4))
    estimate = replace(Gls()(o, C_EK_TRUE), chi2=np.array(100 * misfit**2), degrees_of_freedom=np.array(100))
    found = inseparable(Combination(members, ("the pitch", "the row"), growth), estimate)
    assert found.weight == weight
    assert ("nothing bounds" in found.sentence) is (weight == 2)
