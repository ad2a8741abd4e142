"""Where a judgement turns: hand-made numbers just below and just above each limit that the documentation states."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import stats

from by_hand import by_hand
from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.fit import Fit, State, Unknowns
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import AlignmentEstimate, ParameterVector, Status
from starplumb.estimators.usable import _stated
from starplumb.judge.calibrate import calibrate
from starplumb.judge.compare import compare
from starplumb.judge.consistency import _confirmed, findings
from starplumb.judge.parameters.separability import (
    Combination,
    combinations,
    flight_axes,
    in_words,
    known,
    ruins_alignment,
    without_gain,
)
from starplumb.judge.residuals import residuals
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.plan import scene
from starplumb.solve.normal import Cofactors, Eliminated
from starplumb.solve.reliability import Reliability, Solution
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors


def estimate_with(o: Observations, **changes: object) -> AlignmentEstimate:
    return replace(Gls()(o, C_EK_TRUE), **changes)


@pytest.fixture(scope="module")
def table() -> Observations:
    return observe(truth(FRAME, images=8, markers=8, tilt_deg=20.0, yaw_deg=180.0))


@pytest.mark.parametrize(
    ("p", "said", "weakens"),
    [
        (0.9e-4, "implausible (p", True),
        (1.1e-4, None, None),
        (1 - 1.1e-4, None, None),
        (1 - 0.9e-4, "implausibly small", False),
    ],
)
def test_a_chi_square_is_implausible_beyond_one_in_ten_thousand(table, p, said, weakens):
    """On either side; too large weakens, too small is only said."""
    chi2 = np.array(stats.chi2.isf(p, 125))
    found = findings(
        table, C_EK_TRUE, estimate_with(table, chi2=chi2, degrees_of_freedom=np.array(125)), Gls()
    )
    found = [f for f in found if "implausib" in f.sentence]
    assert [f.weakens for f in found] == ([] if said is None else [weakens])
    assert all(said in f.sentence for f in found)


@pytest.mark.parametrize(
    ("across_arcsec", "about_arcsec", "weak"),
    [
        (2.0, 39.0, False),
        (2.0, 41.0, True),
        (1.0, 29.0, False),
        (1.0, 31.0, True),
        (10.0, 190.0, False),
        (10.0, 210.0, True),
    ],
)
def test_the_angle_about_the_boresight_is_weak_where_20_times_worse_and_above_30_arcsec(
    table, across_arcsec, about_arcsec, weak
):
    sigma = np.array([across_arcsec, 0.5 * across_arcsec, about_arcsec]) * ARCSEC
    covariance_E = C_EK_TRUE @ np.diag(sigma**2) @ C_EK_TRUE.T
    found = findings(table, C_EK_TRUE, estimate_with(table, covariance_E=covariance_E), Gls())
    assert [f.weakens for f in found if "angle about the boresight" in f.sentence] == ([True] if weak else [])


def test_nothing_left_over_is_said_and_does_not_weaken(table):
    estimate = estimate_with(table, chi2=np.array(0.0), degrees_of_freedom=np.array(0))
    found = [
        f for f in findings(table, C_EK_TRUE, estimate, Gls()) if "no observation is left over" in f.sentence
    ]
    assert [f.weakens for f in found] == [False]


def traded(growth: float, with_alignment: bool = True) -> tuple[AlignmentEstimate, Observations]:
    """Two parameters beside an alignment known to 1", one of them traded against the roll (or the other parameter).

    Two quantities of unit sigma alone whose information has the off-diagonal c trade with a growth of
    1 / sqrt(1 - c): c = 1 - 1 / growth^2.
    """
    o = observe(truth(FRAME, images=2, markers=4))
    # with an identity mounting, rows for no velocity: the axes of flight are those of E
    o = replace(o, v_J=np.zeros_like(o.v_J))
    c = 1.0 - growth**-2.0
    N = np.eye(5)
    i = 1 if with_alignment else 3  # x of flight is the camera's y axis where there is no track
    N[i, 4] = N[4, i] = c
    vector = ParameterVector(
        names=("focal_length", "k1"),
        values=np.zeros(2),
        prior_sigma=np.full(2, np.inf),
        range=np.full(2, 1e9),
        covariance=np.linalg.inv(N),
        information=N,
    )
    estimate = AlignmentEstimate(np.eye(3), np.eye(3), np.array(0), np.array(1), parameters=vector)
    return estimate, o


@pytest.mark.parametrize(
    ("names", "listed"),
    [
        (("a",), "separate a: each"),
        (("a", "b"), "separate a and b: each"),
        (("a", "b", "c"), "separate a, b and c: each"),
    ],
)
def test_a_combination_names_all_its_members(names, listed):
    assert listed in Combination(tuple(range(len(names))), names, 12.0).sentence


@pytest.mark.parametrize(
    ("growth", "said", "reported", "ruined"),
    [
        (9.0, None, True, False),
        (11.0, "can hardly separate", True, False),
        (29.0, "can hardly separate", True, False),
        (31.0, "cannot separate", False, False),
        (990.0, "cannot separate", False, False),
        (1010.0, "cannot separate", False, True),
    ],
)
def test_a_combination_is_said_from_10_unknown_from_30_and_ruins_the_alignment_from_1000(
    growth, said, reported, ruined
):
    estimate, o = traded(growth)
    found = combinations(o, estimate)
    assert [c.growth for c in found] == ([] if said is None else [pytest.approx(growth, rel=1e-3)])
    for c in found:
        assert said in c.sentence
        assert c.names == ("the roll of the alignment", "the distortion k1")
        assert ("none of them is reported as known" in c.sentence) is not reported
    assert list(known(estimate.parameters, found)) == [True, reported]
    assert ruins_alignment(found) is ruined


def test_parameters_among_themselves_do_not_ruin_the_alignment():
    estimate, o = traded(2000.0, with_alignment=False)
    found = combinations(o, estimate)
    assert found[0].names == ("the focal length", "the distortion k1")
    assert not ruins_alignment(found)
    assert not known(estimate.parameters, found).any()


@pytest.mark.parametrize(("share", "members"), [(0.28, 2), (0.32, 3)])
def test_a_quantity_with_less_than_three_tenths_of_the_largest_part_is_no_member(share, members):
    """Information with unit diagonal whose weakest direction is (1, 1, share) by construction, of sigma 15."""
    estimate, o = traded(15.0)
    weakest = 15.0**-2.0
    N = np.eye(5)
    N[1, 4] = N[4, 1] = -(1.0 - weakest) * (1.0 - 0.5 * share**2)
    for i in (1, 4):
        N[i, 3] = N[3, i] = -0.5 * share * (1.0 - weakest)
    vector = replace(estimate.parameters, covariance=np.linalg.inv(N), information=N)
    found = combinations(o, replace(estimate, parameters=vector))
    assert found[0].growth == pytest.approx(15.0)
    assert len(found[0].members) == members


@pytest.mark.parametrize(("sigma", "good"), [(0.29, True), (0.31, False)])
def test_a_parameter_known_to_less_than_three_tenths_of_its_range_is_reported(sigma, good):
    estimate, _ = traded(1.0001)
    vector = replace(
        estimate.parameters, range=np.array([1.0, 1e9]), covariance=np.diag([1, 1, 1, sigma**2, 1.0])
    )
    assert list(known(vector, [])) == [good, True]


@pytest.mark.parametrize(("sigma", "said"), [(0.94, False), (0.96, True)])
def test_a_parameter_that_hardly_gains_on_its_prior_is_said_to(sigma, said):
    estimate, _ = traded(1.0001)
    vector = replace(
        estimate.parameters, prior_sigma=np.array([1.0, np.inf]), covariance=np.diag([1, 1, 1, sigma**2, 1.0])
    )
    assert [("the focal length" in sentence) for sentence in without_gain(vector)] == ([True] if said else [])


@pytest.mark.parametrize(
    ("growth", "status"),
    [(25.0, Status.OK), (40.0, Status.WEAK), (900.0, Status.WEAK), (1500.0, Status.SINGULAR)],
)
def test_what_cannot_be_separated_decides_the_status(growth, status):
    """An estimator that is content, with a covariance that is not: the campaign's status is that of the combination."""
    campaign = truth(FRAME, images=8, markers=8, tilt_deg=20.0, yaw_deg=180.0)

    def content(o, C_EK):
        found = Gls()(o, C_EK)
        vector, turn = traded(growth)[0].parameters, np.eye(5)
        turn[:3, :3] = flight_axes(o, found.C_EK)
        scale = np.array([ARCSEC] * 3 + [1.0, 1.0])
        covariance = turn @ np.linalg.inv(swapped(growth)) @ turn.T * np.outer(scale, scale)
        return replace(found, unknowns=None, parameters=replace(vector, covariance=covariance))

    assert calibrate(campaign, content).status is status


def swapped(growth: float) -> np.ndarray:
    """Information of (roll, pitch, yaw, two parameters) in which the roll and the last trade."""
    N = np.eye(5)
    N[0, 4] = N[4, 0] = 1.0 - growth**-2.0
    return N


@pytest.mark.parametrize(("share", "dof"), [(0.02, 5), (0.045, 5), (0.055, 6), (0.2, 6)])
def test_a_direction_of_an_image_is_tested_where_a_twentieth_of_an_error_shows(share, dof):
    """Five numbers fully controlled, the sixth by ``share``: T sums v^2 / control over those that are tested."""
    control = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, share])
    cofactors = Cofactors((np.eye(6) - control)[None], np.zeros((0, 3, 3)), np.zeros((0, 6, 3)))
    errors = np.full((1, 6, 1), -2.0)  # C of z alone, whose negative is the error
    shared = Eliminated(errors, np.zeros((0, 3, 1)), lambda: cofactors)
    tested = Solution(np.zeros(0), np.zeros((0, 0)), shared, cofactors)
    assert tested.images[1][0] == dof
    assert tested.images[0][0] == pytest.approx(20.0 + (4.0 / share if dof == 6 else 0.0))


@pytest.mark.parametrize(("share", "dof"), [(0.5e-6, 1), (2e-6, 2), (0.02, 2)])
def test_a_sighting_is_tested_however_little_of_it_is_controlled(share, dof):
    """By 2 % as well as by a millionth; below that its residual is zero whatever its error."""
    control = np.diag([1.0, share])
    tested = Reliability(
        used=np.ones(1, dtype=bool),
        v=np.array([[2.0, 3.0 * share]]),
        hat=(np.eye(2) - control)[None],
        per_px=np.zeros((1, 2, 2)),
        effect=np.zeros((1, 3, 2)),
    )
    assert tested.sightings[1][0] == dof
    assert tested.sightings[0][0] == pytest.approx(4.0 + (9.0 * share if dof == 2 else 0.0), rel=1e-9)


def test_what_is_stated_of_a_sighting_by_hand():
    """0.1 px of 4 urad on two axes; 3" of attitude on three; 10 m of position and 2 m of survey from 600 km."""
    o = by_hand()
    pixel = 2.0 * (0.1 * 4e-6) ** 2
    np.testing.assert_allclose(_stated(o), np.full(o.n, pixel), rtol=1e-12)
    arcsec = np.pi / 648000.0
    told = replace(
        o,
        cov_attitude_E=np.diag([3.0, 3.0, 3.0])[None] * 3.0 * arcsec**2,
        cov_position_J=100.0 * np.eye(3)[None],
        cov_landmark_J=np.tile(4.0 * np.eye(3), (o.n, 1, 1)),
    )
    places = 3.0 * 104.0 / o.range_m**2
    np.testing.assert_allclose(_stated(told), pixel + 27.0 * arcsec**2 + places, rtol=1e-9)


def test_the_residuals_of_one_marker_by_hand():
    """Measured 10 px too far along the columns, which run east at 2.4 m a pixel: located 24 m east of the marker."""
    o = by_hand()
    o = replace(o, sigma_px=np.full(o.n, 0.3))
    xy = o.xy_K.copy()
    xy[0, 0] += 10.0 * 4e-6
    xy[2, 1] += 5.0 * 4e-6  # rows run south
    fit = Fit(Unknowns(), replace(o, xy_K=xy), State(np.eye(3), np.zeros(0)), np.eye(3))
    found = residuals(fit, np.ones(o.n, dtype=bool))
    np.testing.assert_allclose(found.after_px[[0, 1, 2]], [[-10.0, 0.0], [0.0, 0.0], [0.0, -5.0]], atol=1e-6)
    np.testing.assert_allclose(found.after_m[[0, 1, 2]], [[24.0, 0.0], [0.0, 0.0], [0.0, -12.0]], atol=0.1)
    np.testing.assert_allclose(found.normalised[:3], [10.0 / 0.3, 0.0, 5.0 / 0.3], atol=1e-5)


def test_the_probability_of_a_calibration_is_that_of_its_own_chi_square(rng):
    o = observe(truth(FRAME, images=3, markers=4))
    campaign = scene.measured(truth(FRAME, images=3, markers=4), Errors.draw(o, rng), C_EK_TRUE)
    done = calibrate(campaign, Gls())
    assert done.estimate.degrees_of_freedom == 2 * 12 - 3
    assert done.chi2_p == pytest.approx(stats.chi2.sf(float(done.estimate.chi2), 21), rel=1e-9)


X_K, Y_K = np.eye(3)[0], np.eye(3)[1]


def turned(v_K: np.ndarray) -> np.ndarray:
    """The true mounting turned about the camera's axes, in arcsec."""
    return C_EK_TRUE @ so3.exp(v_K * ARCSEC)


def about_the_switch(table, correction, shift, chi2=(100.0, 100.0), **other):
    """Sentences on the aberration where a correction (") was found, and the other switch moves the answer by a shift.

    Chi-square is that with the stated and with the other switch, of 125 degrees of freedom.
    """
    dof = np.array(125)
    estimate = estimate_with(table, C_EK=turned(correction), chi2=np.array(chi2[0]), degrees_of_freedom=dof)
    other_chi2 = None if chi2[1] is None else np.array(chi2[1])
    opposite = {"C_EK": turned(correction + shift), "chi2": other_chi2, "degrees_of_freedom": dof}
    found = findings(table, C_EK_TRUE, estimate, lambda o, C: estimate_with(o, **(opposite | other)))
    return [f for f in found if "aberration" in f.sentence]


@pytest.mark.parametrize(
    ("gain", "said", "weakens"),
    [
        (12.1, "looks wrong", True),
        (11.9, "cannot be checked", False),
        (0.0, "cannot be checked", False),
        (-3.9, "cannot be checked", False),
        (-4.1, None, None),
    ],
)
def test_the_aberration_switch_is_wrong_from_a_gain_of_12_and_confirmed_from_a_loss_of_4(
    table, gain, said, weakens
):
    found = about_the_switch(table, 0.0 * X_K, 5.0 * X_K, (100.0, 100.0 - gain))
    assert [f.weakens for f in found] == ([] if said is None else [weakens])
    assert all(said in f.sentence for f in found)


@pytest.mark.parametrize(("after", "wrong"), [(1000.0, False), (125.0 * 4.0, False), (125.0, True)])
def test_a_gain_that_larger_residuals_explain_accuses_no_switch(table, after, wrong):
    """A chi-square smaller by 20 is news at 1 per degree of freedom; at 4 and at 8 it is what 5 and 2.5 are there."""
    (found,) = about_the_switch(table, 0.0 * X_K, 5.0 * X_K, (after + 20.0, after))
    assert ("looks wrong" in found.sentence) is wrong


@pytest.mark.parametrize(("shift_arcsec", "said"), [(1.9, False), (2.1, True)])
def test_a_switch_that_moves_the_boresight_by_less_than_2_arcsec_is_not_worth_a_sentence(
    table, shift_arcsec, said
):
    """However far it turns the camera about the boresight."""
    found = about_the_switch(table, 0.0 * X_K, np.array([0.0, shift_arcsec, 40.0]))
    assert bool(found) is said


@pytest.mark.parametrize(
    ("correction_arcsec", "suspect"),
    [(-3.4, False), (-3.6, True), (-14.9, True), (-15.1, False), (3.6, False)],
)
def test_a_switch_is_suspected_where_the_other_leaves_a_correction_smaller_by_much_of_the_shift(
    table, correction_arcsec, suspect
):
    """A shift of +5" leaves 1.6 of -3.4: 1.8 less, under 0.4 x 5. Of -3.6 it leaves 1.4; beyond 3 x 5 it is no news."""
    (found,) = about_the_switch(table, correction_arcsec * Y_K, 5.0 * Y_K)
    assert ("may be wrong" in found.sentence) is suspect
    assert ("cannot be checked" in found.sentence) is not suspect
    assert found.informs is not suspect
    here, there = abs(correction_arcsec), abs(correction_arcsec + 5.0)
    assert f"across the boresight is {here:.1f} arcsec, with aberration = false {there:.1f}" in found.sentence


@pytest.mark.parametrize(
    ("chi2", "said"), [((12600.0, 12520.0), False), ((12600.0, 12480.0), True), ((12480.0, 12300.0), True)]
)
def test_fits_with_residuals_ten_times_too_large_are_no_argument(table, chi2, said):
    """100 times 125 degrees of freedom is 12500: only where both lie above is nothing said."""
    assert bool(about_the_switch(table, 0.0 * X_K, 5.0 * X_K, chi2)) is said


def test_a_switch_without_an_answer_is_no_argument(table):
    assert about_the_switch(table, 0.0 * X_K, 5.0 * X_K, (100.0, None)) == []
    assert about_the_switch(table, 0.0 * X_K, 5.0 * X_K, status=np.array(int(Status.SINGULAR))) == []


@pytest.mark.parametrize(("rise", "confirmed"), [(11.9, False), (12.1, True), (-20.0, False)])
def test_a_sample_confirms_the_switch_from_a_rise_of_12(table, rise, confirmed):
    def estimator(o, C_EK, **changes):
        stated = o.corrections.aberration == table.corrections.aberration
        return estimate_with(o, **({"chi2": np.array(100.0 if stated else 100.0 + rise)} | changes))

    assert _confirmed(table, C_EK_TRUE, estimator) is confirmed
    assert not _confirmed(table, C_EK_TRUE, partial(estimator, status=np.array(int(Status.SINGULAR))))
    assert not _confirmed(table, C_EK_TRUE, partial(estimator, chi2=None))


@pytest.mark.parametrize("lost", [True, False])
def test_a_switch_is_not_confirmed_beside_an_answer_that_cannot_be_used(table, lost):
    """With the stated switch or with the other one."""

    def estimator(o, C_EK):
        stated = o.corrections.aberration == table.corrections.aberration
        status = Status.SINGULAR if stated is lost else Status.OK
        return estimate_with(o, chi2=np.array(100.0 if stated else 200.0), status=np.array(int(status)))

    assert not _confirmed(table, C_EK_TRUE, estimator)


@pytest.mark.parametrize(
    ("known_from_data", "square", "contradicts"),
    [
        (3, stats.chi2.isf(1.1e-4, 3), False),
        (3, stats.chi2.isf(0.9e-4, 3), True),
        (2, stats.chi2.isf(1.1e-4, 2), False),
        (2, stats.chi2.isf(0.9e-4, 2), True),
    ],
)
def test_a_prior_is_contradicted_beyond_one_in_ten_thousand(table, known_from_data, square, contradicts):
    """A correction d about x of E with the covariance prior less posterior, here (10^2 - 6^2) arcsec^2 = (8")^2.

    Where the data say nothing of z its posterior is its prior, and only two axes can contradict it.
    """
    posterior = np.array([6.0, 6.0, 6.0 if known_from_data == 3 else 10.0]) * ARCSEC
    o = replace(table, prior_E=np.eye(3) * (10.0 * ARCSEC) ** 2)
    C_EK = so3.exp([8.0 * np.sqrt(square) * ARCSEC, 0.0, 0.0]) @ C_EK_TRUE
    estimate = estimate_with(table, C_EK=C_EK, covariance_E=np.diag(posterior**2))
    found = [f for f in findings(o, C_EK_TRUE, estimate, Gls()) if "contradict" in f.sentence]
    assert [f.weakens for f in found] == ([True] if contradicts else [])


@pytest.mark.parametrize(("share", "along_track"), [(0.09, False), (0.11, True)])
def test_the_axes_of_flight_follow_the_track_where_a_tenth_of_the_speed_is_left_across_the_boresight(
    share, along_track
):
    """A camera that looks along z of E and moves nearly along its own line of sight, a little along x."""
    o = by_hand()
    v_E = 7000.0 * np.array([share, 0.0, np.sqrt(1.0 - share**2)])
    o = replace(o, v_J=np.tile(o.C_EJ[0].T @ v_E, (o.n, 1)))
    roll = flight_axes(o, np.eye(3))[:, 0]
    np.testing.assert_allclose(roll, X_K if along_track else Y_K, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("tracker_ST2_y", "the mounting of tracker ST2 about y"),
        ("look_x_3", "the look angles' x term of degree 3"),
        ("principal_row", "the principal point's row"),
        ("p1", "the distortion p1"),
    ],
)
def test_parameters_in_words(name, words):
    assert in_words(name) == words


@pytest.mark.parametrize(
    ("times", "remark"), [(1.04, ()), (1.06, ("sigma up to 1.06 times that of gls",)), (None, ())]
)
def test_a_method_that_knows_less_than_gls_by_a_twentieth_is_said_to(times, remark):
    """Its answer is a hand's breadth from that of gls: two sigmas of gls about x."""
    true = truth(FRAME, images=3, markers=4)
    campaign = replace(true, C_EK=so3.exp([1e-3, 0.0, 0.0]) @ true.C_EK)

    def method(o, C_EK):
        gls = Gls()(o, C_EK)
        d_E = np.array([2.0, 0.0, 0.0]) * gls.sigma_E
        covariance = None if times is None else gls.covariance_E * times**2
        return replace(gls, C_EK=so3.exp(d_E) @ gls.C_EK, covariance_E=covariance, notes=())

    def broken(o, C_EK):
        return replace(method(o, C_EK), status=np.array(int(Status.NOT_CONVERGED)))

    mine, lost = compare(campaign, {"mine": lambda: method, "lost": lambda: broken})
    assert mine.remarks == remark
    np.testing.assert_allclose(mine.from_gls, [2.0, 0.0, 0.0], atol=1e-6)
    assert (mine.sigma_E is None) is (times is None)
    assert lost.sigma_E is None
    assert np.all(np.isnan(lost.from_gls))
    assert lost.remarks == (Status.NOT_CONVERGED.text,)
