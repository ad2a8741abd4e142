"""A parameter that one image alone shows: against the adjustment without that image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.gls import Gls
from starplumb.judge import calibrate as judge
from starplumb.judge.parameters.single_image import resting
from starplumb.judge.snooping import fit_at
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.parameters import TimeOffset
from starplumb.table.simulate import Errors, measure

CLOCK = Gls((TimeOffset(("time_offset_attitude",), (np.inf,)),))
TURNING = 3


@pytest.fixture
def turning(rng):
    """Six images, of which one turns by 1 deg/s and the others do not, its attitude wrong by 200 arcsec along it."""
    campaign = truth(FRAME, 6, 8)
    o = observe(campaign)
    rate = np.where(o.image == TURNING, np.radians(1.0), 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    table = replace(measure(o, C_EK_TRUE, Errors.draw(o, rng)), omega_E=rate)
    wrong = np.where(o.image == TURNING, 200.0 * ARCSEC, 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    return campaign, table.with_geometry(C_EJ=so3.exp(wrong) @ table.C_EJ), table


def found(table, used=None):
    estimate = CLOCK(table if used is None else table.select(used), C_EK_TRUE)
    return estimate, fit_at(CLOCK.unknowns, table, C_EK_TRUE, estimate, np.ones(table.n, dtype=bool))


def test_a_clock_that_one_image_shows_is_said_to_rest_on_it(turning):
    campaign, table, _ = turning
    estimate, fit = found(table)
    (one,) = resting(fit, estimate.parameters)
    assert (one.name, one.image) == ("time_offset_attitude", TURNING)
    sentence = one.finding(campaign.images.ids).sentence
    assert f"the attitude rests on image {campaign.images.ids[TURNING]} alone" in sentence
    assert one.sigma[0] == pytest.approx(np.sqrt(estimate.parameters.covariance[3, 3]), rel=1e-3)


def test_the_interval_holds_the_answer_without_that_image(turning):
    _, table, _ = turning
    estimate, fit = found(table)
    (one,) = resting(fit, estimate.parameters)
    without, _ = found(table, table.image != TURNING)
    moved = so3.log(without.C_EK @ estimate.C_EK.mT)
    np.testing.assert_allclose(
        one.half_E, np.abs(moved) + 1.96 * without.sigma_E, rtol=1e-3, atol=0.02 * ARCSEC
    )
    assert np.linalg.norm(moved) > ARCSEC


def test_a_parameter_that_is_not_found_or_that_others_show_is_not_named(turning):
    _, table, right = turning
    estimate, fit = found(right)
    assert abs(estimate.parameters.values[0]) < 4.0 * np.sqrt(estimate.parameters.covariance[3, 3])
    assert resting(fit, estimate.parameters) == []
    everywhere = replace(
        table,
        omega_E=np.tile(np.radians([1.0, 0.0, 0.0]), (table.n, 1)) * np.sign(table.image % 2 - 0.5)[:, None],
    )
    estimate, fit = found(everywhere.with_geometry(C_EJ=so3.exp(0.5 * everywhere.omega_E) @ right.C_EJ))
    assert abs(estimate.parameters.values[0]) > 0.4
    assert resting(fit, estimate.parameters) == []
    assert resting(fit, None) == []


@pytest.mark.parametrize(("others", "rests"), [(0.12, True), (0.18, False)])
def test_an_image_carries_a_parameter_from_nine_tenths_on(turning, others, rests):
    """The other five turn to and fro at a part r of its rate: without it sigma grows by about sqrt(1 + 0.17 / r^2)."""
    _, table, right = turning
    to_and_fro = others * np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
    to_and_fro[TURNING] = 0.0
    rate = table.omega_E + to_and_fro[table.image][:, None] * np.radians([1.0, 0.0, 0.0])
    wrong = so3.exp(0.5 * rate) @ right.C_EJ  # half a second
    estimate, fit = found(replace(table, omega_E=rate).with_geometry(C_EJ=wrong))
    assert [one.image for one in resting(fit, estimate.parameters)] == [TURNING] * rests


def test_two_images_of_which_one_is_no_answer_leave_no_interval_of_use(turning):
    """Without the turning image one sighting is left, which fixes no rotation: radians, and no crash."""
    _, table, _ = turning
    first = np.flatnonzero(table.image == 0)[:1]
    keep = np.isin(np.arange(table.n), first) | (table.image == TURNING)
    two = replace(table, weight=keep.astype(float))
    estimate = CLOCK(two.select(keep), C_EK_TRUE)
    fit = fit_at(CLOCK.unknowns, two, C_EK_TRUE, estimate, keep)
    (one,) = resting(fit, estimate.parameters)
    assert np.max(one.half_E) > 1.0


def test_the_answer_is_weak(turning, monkeypatch):
    campaign, table, _ = turning
    monkeypatch.setattr(judge, "table_of", lambda _: table)
    monkeypatch.setattr(judge, "_evidence", lambda *_: ())
    done = judge.calibrate(campaign, CLOCK)
    assert done.status.name == "WEAK"
    assert "rests on image" in done.message
