"""Check points that contradict an answer take away its status; good ones, and a few wrong ones, do not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from starplumb.estimators.default import Default
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.judge.calibrate import calibrate
from starplumb.physics import so3
from starplumb.physics.earth import C_JT, itrf_to_geodetic
from starplumb.plan.demo import demo
from starplumb.report.calibration.summary import summary_sentences
from starplumb.table.campaign import Campaign

RANGE_M = 683e3
"""About how far the markers of the demo are."""


def east(campaign: Campaign, moved: np.ndarray, metres: float) -> Campaign:
    """The landmarks of some sightings (n,) as surveyed so far to the east."""
    r_J = campaign.landmarks.r_J.copy()
    latitude, longitude, _ = itrf_to_geodetic(r_J)
    which = np.unique(campaign.sightings.landmark[moved])
    assert not np.isin(campaign.sightings.landmark[~moved], which).any()
    r_J[which] += metres * C_JT(latitude, longitude)[which, :, 0]
    return replace(campaign, landmarks=replace(campaign.landmarks, r_J=r_J))


@pytest.fixture(scope="module")
def good():
    campaign, C_EK_true = demo("frame", 6, 11)[:2]
    return campaign, C_EK_true


def test_good_check_points_say_nothing(good):
    done = calibrate(good[0], Gls())
    assert done.status is Status.OK
    assert "check point" not in done.message


def test_the_contradiction_is_the_chi_square_that_they_add(good):
    campaign = east(good[0], good[0].sightings.check, 4.0)
    done = calibrate(campaign, Gls())
    assert done.status is Status.WEAK
    every = replace(campaign.sightings, check=np.zeros(campaign.sightings.check.size, dtype=bool))
    both = calibrate(replace(campaign, sightings=every), Gls()).estimate
    n = int(np.sum(campaign.sightings.check))
    scale = max(1.0, done.estimate.chi2 / done.estimate.degrees_of_freedom)
    added = (both.chi2 - done.estimate.chi2) / scale
    assert both.degrees_of_freedom - done.estimate.degrees_of_freedom == 2 * n
    count, factor, p = re.search(
        r"the (\d+) check points contradict .* they lie ([\d.]+) times .*\(p = ([\d.e-]+)\)", done.message
    ).groups()
    assert int(count) == n
    assert float(factor) == pytest.approx(np.sqrt(added / (2 * n)), rel=0.02)
    assert np.log(float(p)) == pytest.approx(chi2.logsf(added, 2 * n), rel=0.02)


def test_a_factor_that_changes_nothing_is_not_told(good, monkeypatch):
    """Very many check points make a hundredth improbable, as they do of the control points."""
    campaign = east(good[0], good[0].sightings.check, 4.0)
    monkeypatch.setattr("starplumb.judge.accuracy.check_points.EXACT", 10.0)
    assert calibrate(campaign, Gls()).status is Status.OK


@pytest.mark.parametrize("method", [Gls(), Default()], ids=["gls", "default"])
def test_the_interval_holds_what_the_check_points_say(good, method):
    """Control points 9 m off turn the answer by their angle at the camera, and only the check points know."""
    campaign, C_EK_true = good
    before = calibrate(campaign, method)
    done = calibrate(east(campaign, ~campaign.sightings.check, 9.0), method)
    moved_E = so3.log(done.estimate.C_EK @ before.estimate.C_EK.mT)
    assert np.linalg.norm(moved_E) == pytest.approx(9.0 / RANGE_M, rel=0.3)
    assert done.status is Status.WEAK
    assert np.all(done.interval_95_E > 1.9 * done.sigma_E + 0.8 * np.abs(moved_E))
    assert np.all(np.abs(so3.log(done.estimate.C_EK @ C_EK_true.mT)) < done.interval_95_E)


def test_what_nothing_bounds_is_refuted(good):
    done = calibrate(east(good[0], good[0].sightings.check, 60.0), Gls())
    assert done.status is Status.REFUTED
    assert "check points contradict the answer" in done.sentences[0]
    assert "nothing bounds what is wrong: run starplumb diagnose" in done.sentences[0]


def test_a_few_wrong_check_points_are_named_and_change_nothing(good):
    campaign = good[0]
    row = int(np.flatnonzero(campaign.sightings.check)[3])
    column_px = campaign.sightings.column_px.copy()
    column_px[row] += 40.0
    done = calibrate(replace(campaign, sightings=replace(campaign.sightings, column_px=column_px)), Gls())
    assert done.status is Status.OK
    name = campaign.landmarks.ids[campaign.sightings.landmark[row]]
    image = campaign.images.ids[campaign.sightings.image[row]]
    assert f"1 of 12 check points is wrong by itself ({name} in {image}," in done.message
    np.testing.assert_allclose(done.correction_E, calibrate(campaign, Gls()).correction_E, atol=1e-12)


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_said(rng):
    """Of forty good campaigns of other seeds none is doubted; the level is one in ten thousand."""
    for seed in rng.integers(1, 10**6, 40).tolist():
        done = calibrate(demo("line-scan" if seed % 3 == 0 else "frame", 2 + seed % 5, seed)[0], Gls())
        assert "check points contradict" not in done.message


def test_check_points_of_an_image_that_is_left_out_are_not_compared(good):
    """One image has another attitude than stated: its check points are off by kilometres, and no fault of theirs."""
    campaign, C_EK_true = good
    s = campaign.sightings
    off = replace(s, column_px=np.where(s.image == 2, s.column_px + 900.0, s.column_px))
    done = calibrate(replace(campaign, sightings=off), Default())
    assert np.linalg.norm(so3.log(done.C_EK @ C_EK_true.mT)) < 5.0 * np.linalg.norm(done.sigma_E)
    assert {r.image for r in done.rejected} == {2}
    of_it = int(np.sum(s.check & (s.image == 2)))
    assert of_it > 0
    checked = done.accuracy(after=True, check=True)
    assert checked is not None
    assert checked.n == int(np.sum(s.check)) - of_it
    assert checked.rmse < 50.0
    assert "check point" not in done.message
    assert any(f"; {of_it} more of images that are left out" in line for line in summary_sentences(done))
