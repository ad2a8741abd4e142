"""Methods without residuals over their stated covariance, held against least squares that has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators import METHODS
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.judge import calibrate as judge
from starplumb.judge.compare import compare
from starplumb.judge.reference import Reference
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

HALF = np.array([2.0, 3.0, 10.0]) * ARCSEC
LINEAR = ["least-squares", "cross-product", "image-plane", "ground-plane"]


def told(status, turn_arcsec, half_E, weight=0, reference_half=HALF):
    """What is said of an answer ``turn`` away about E, and with which weight and least half-widths."""
    reference = Reference(status, "the reason", so3.exp(np.array(turn_arcsec) * ARCSEC), reference_half)
    found = reference.findings(np.eye(3), half_E, weight)
    return [(one.weight, one.informs, None if one.half_E is None else one.half_E / ARCSEC) for one in found]


def test_an_answer_near_a_good_one_has_an_interval_no_narrower():
    """What the scatter of images says of the interval of least squares holds for other methods too."""
    ((weight, informs, half),) = told(Status.OK, (1.0, 0.0, 19.0), HALF)
    assert (weight, informs) == (0, True)
    np.testing.assert_allclose(half, [3.0, 3.0, 29.0], atol=1e-3)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_answer_farther_than_twice_its_interval_is_weak_and_the_interval_holds_both(axis):
    turn = np.zeros(3)
    turn[axis] = 2.01 * HALF[axis] / ARCSEC
    ((weight, informs, half),) = told(Status.OK, -turn, HALF)
    assert (weight, informs) == (1, False)
    np.testing.assert_allclose(half, turn + HALF / ARCSEC, atol=1e-3)


@pytest.mark.parametrize(
    ("turn", "weight"), [((1.9, 2.9, 9.9), 0), ((2.1, 0.0, 0.0), 1), ((0.0, 0.0, 10.1), 1)]
)
def test_a_method_that_states_no_sigma_is_weak_where_least_squares_is_farther_than_its_own_interval(
    turn, weight
):
    ((found, informs, half),) = told(Status.OK, turn, None)
    assert (found, informs) == (weight, False)
    np.testing.assert_allclose(half, np.array(turn) + HALF / ARCSEC, atol=1e-3)


def test_what_weakens_or_refutes_least_squares_does_so_for_every_method():
    ((weight, informs, half),) = told(Status.WEAK, (1.0, 1.0, 1.0), HALF)
    assert (weight, informs) == (1, False)
    np.testing.assert_allclose(half, [3.0, 4.0, 11.0], atol=1e-3)
    ((weight, informs, half),) = told(Status.WEAK, (1.0, 1.0, 1.0), HALF, weight=1)
    assert (weight, informs) == (0, True)
    np.testing.assert_allclose(half, [3.0, 4.0, 11.0], atol=1e-3)
    for status in (Status.REFUTED, Status.NOT_CONVERGED):
        assert told(status, (0.0, 0.0, 0.0), HALF, reference_half=None) == [(2, False, None)]
        assert told(status, (0.0, 0.0, 0.0), HALF, weight=2, reference_half=None) == []


def calibrated(monkeypatch, campaign, table, method):
    monkeypatch.setattr(judge, "table_of", lambda _: table)
    monkeypatch.setattr(judge, "_evidence", lambda *_: ())
    return judge.calibrate(campaign, METHODS[method]())


@pytest.mark.parametrize("method", [*LINEAR, "wahba", "sequential"])
def test_half_of_the_images_turned_refutes_or_weakens_with_every_method(monkeypatch, rng, method):
    """200 arcsec, 40 sigmas of the attitude, in half of the images: no one-step method has a test of its own."""
    campaign = truth(FRAME, 6, 8)
    o = observe(campaign)
    right = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    turn = np.where(o.image < 3, 200.0 * ARCSEC, 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    good = calibrated(monkeypatch, campaign, right, method)
    wrong = calibrated(monkeypatch, campaign, right.with_geometry(C_EJ=so3.exp(turn) @ right.C_EJ), method)
    assert good.status.usable
    assert wrong.status is not Status.OK
    if wrong.status.usable:
        error = np.abs(so3.log(wrong.C_EK @ C_EK_TRUE.mT))
        assert np.all(error < 2.0 * wrong.interval_95_E)


def test_sightings_that_a_method_leaves_out_are_left_out_of_what_it_is_held_against(rng):
    """One of one's own that drops an image 500 arcsec off, which would refute least squares of all."""
    campaign = truth(FRAME, 6, 8)
    o = observe(campaign)
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))

    def own(table, C_EK):
        keep = table.image != 2
        found = Gls()(table.select(keep), C_EK)
        return replace(found, unknowns=None, chi2=None, verdict=np.where(keep, 0, 1), notes=())

    turn = np.where(table.image == 2, 500.0 * ARCSEC, 0.0)[:, None] * np.array([0.0, 1.0, 0.0])
    spoilt = table.with_geometry(C_EJ=so3.exp(turn) @ table.C_EJ)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judge, "table_of", lambda _: spoilt)
        patch.setattr(judge, "_evidence", lambda *_: ())
        assert judge.calibrate(campaign, own).status.usable
        assert judge.calibrate(campaign, Gls()).status is Status.REFUTED


def test_a_comparison_judges_least_squares_once(monkeypatch, rng):
    campaign = truth(FRAME, 3, 6)
    o = observe(campaign)
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    monkeypatch.setattr(judge, "table_of", lambda _: table)
    monkeypatch.setattr(judge, "_evidence", lambda *_: ())
    runs = []
    monkeypatch.setattr(judge, "Gls", lambda *a, **k: runs.append(1) or Gls(*a, **k))
    answers = compare(campaign, {name: METHODS[name] for name in LINEAR})
    assert [answer.status.usable for answer in answers] == [True] * 4
    assert (
        len(runs) == len(LINEAR) + 1
    )  # each judgement makes one to try another switch with, none to hold against
