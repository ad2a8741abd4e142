"""What is said of an estimate: each sentence where it is due, none where it is not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from problems import C_EK_TRUE, FRAME, LINE, SIGMAS, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.wahba import Wahba
from starplumb.judge.consistency import boresight_sigmas, chi2_p, field_radius, findings
from starplumb.physics import so3
from starplumb.physics.light import Corrections
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.solve import chunks
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure


def measured(rng, camera=FRAME, **options):
    o = observe(truth(camera, **options))
    return measure(o, C_EK_TRUE, Errors.draw(o, rng))


def say(o, C_EK_model=C_EK_TRUE, estimator=None):
    estimator = estimator or Gls()
    return findings(o, C_EK_model, estimator(o, C_EK_model), estimator)


@pytest.mark.parametrize(("chi2", "dof"), [(3.0, 9), (9.0, 9), (80.0, 45), (0.0, 3)])
def test_probability_is_scipys(chi2, dof):
    assert chi2_p(chi2, dof) == pytest.approx(stats.chi2.sf(chi2, dof))


def test_nothing_left_over_is_no_contradiction():
    assert chi2_p(0.0, 0) == 1.0


def test_sigmas_about_the_cameras_axes_by_hand():
    """Camera x, y, z along the tracker's y, z, x: what is known about E's y is known about K's x."""
    C_EK = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(boresight_sigmas(C_EK, np.diag([1.0, 4.0, 9.0])), [2.0, 3.0, 1.0])


def test_field_radius_by_hand(rng):
    """Two images with a pair each, 0.02 apart in x and 0.04 in y: 0.01 and 0.02 from the middle."""
    o = measured(rng, images=2, markers=2)
    xy = np.array([[0.0, 0.5], [0.02, 0.5], [0.1, 0.2], [0.1, 0.24]])
    assert field_radius(replace(o, xy_K=xy)) == pytest.approx(np.sqrt((0.01**2 + 0.02**2) / 2))


@pytest.mark.slow
def test_a_sound_campaign_is_left_without_a_word(rng):
    """Views turned by half a turn tell the aberration; thirty good campaigns, no sentence."""
    for _ in range(30):
        assert say(measured(rng, images=8, markers=8, tilt_deg=20.0, yaw_deg=180.0)) == []


def test_one_image_is_weak(rng):
    found = [f for f in say(measured(rng, images=1, markers=6)) if "only one image" in f.sentence]
    assert [f.weakens for f in found] == [True]


def test_markers_in_one_corner_leave_the_boresight_angle_weak(rng):
    campaign = truth(FRAME, images=3, markers=1)
    image = np.repeat(np.arange(3), 4)
    campaign = scene.mark_pixels(campaign, image, 6000 + rng.uniform(0, 40, (12, 2)), 0.0, SIGMAS)
    o = observe(campaign)
    found = [
        f
        for f in say(measure(o, C_EK_TRUE, Errors.draw(o, rng)))
        if "angle about the boresight" in f.sentence
    ]
    assert [f.weakens for f in found] == [True]
    assert "markers farther apart would determine it" in found[0].sentence


@pytest.mark.parametrize(
    ("factor", "says", "weakens"),
    [
        (0.4, r"implausible \(p = .*residuals are 2\.\d times what the stated sigmas allow", True),
        (3.0, r"implausibly small: the residuals are only 0\.3\d? times", False),
    ],
)
def test_an_implausible_chi_square(rng, factor, says, weakens):
    o = measured(rng, images=8, markers=8, tilt_deg=20.0, yaw_deg=180.0)
    scaled = replace(
        o,
        sigma_px=factor * o.sigma_px,
        **{
            name: factor**2 * getattr(o, name)
            for name in ("cov_attitude_E", "cov_position_J", "cov_landmark_J")
        },
    )
    found = [f for f in say(scaled) if "chi-square" in f.sentence]
    assert [f.weakens for f in found] == [weakens]
    assert re.search(says, found[0].sentence)


@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
@pytest.mark.parametrize("switch", [True, False])
def test_a_wrong_aberration_switch_is_said_aloud(rng, camera, switch):
    """Half the images turned about the boresight: one mounting cannot absorb 5 arcsec to both sides."""
    light = Corrections(light_time=True, aberration=switch)
    o = measured(rng, camera, images=20, markers=8, tilt_deg=20.0, yaw_deg=180.0, corrections=light)
    assert not any("aberration" in f.sentence for f in say(o))
    wrong = o.with_geometry(corrections=replace(light, aberration=not switch))
    found = [f for f in say(wrong) if "looks wrong" in f.sentence]
    assert [f.weakens for f in found] == [True]
    stated, better = ("false", "true") if switch else ("true", "false")
    assert (
        f"the switch aberration = {stated} looks wrong: aberration = {better} explains" in found[0].sentence
    )


@pytest.mark.parametrize("right", [True, False])
def test_a_sample_of_a_large_table_confirms_the_aberration_switch(monkeypatch, rng, right):
    """Only where it does not is the whole table estimated again with the other switch."""
    for name, value in (("LARGE", 50), ("CHUNK", 40), ("SAMPLE", 400)):
        monkeypatch.setattr(chunks, name, value)
    o = measured(rng, images=120, markers=8, tilt_deg=20.0, yaw_deg=180.0)
    if not right:
        o = o.with_geometry(corrections=replace(o.corrections, aberration=False))
    asked = []

    def estimator(table, C_EK):
        asked.append((table.n == o.n, table.corrections.aberration))
        return Gls()(table, C_EK)

    assert chunks.sampled(o)
    found = say(o, estimator=estimator)
    assert any("looks wrong" in f.sentence for f in found) is not right
    assert asked[1:3] == [(False, right), (False, not right)]
    assert asked[3:] == ([] if right else [(True, True)])


def test_views_that_cannot_tell_the_aberration_say_so_and_do_not_weaken(rng):
    o = measured(rng, images=6, markers=8, tilt_deg=0.0)
    wrong = o.with_geometry(corrections=Corrections(aberration=False))
    for table in (o, wrong):
        found = [f for f in say(table) if "aberration" in f.sentence]
        assert [f.weakens for f in found] == [False]
        assert [f.informs for f in found] == [table is o]
        assert "views in other directions would decide it" in found[0].sentence
    assert "may be wrong" in found[0].sentence


def test_settings_that_all_fit_absurdly_are_no_argument(rng):
    """Sightings of one image exchanged: the switch that happens to fit better is not recommended."""
    o = measured(rng, images=20, markers=8, tilt_deg=20.0, yaw_deg=180.0)
    mine = np.flatnonzero(o.image == 3)
    xy_K = o.xy_K.copy()
    xy_K[mine] = np.roll(xy_K[mine], 3, axis=0)
    for aberration in (True, False):
        table = replace(o, xy_K=xy_K).with_geometry(corrections=Corrections(aberration=aberration))
        assert not any("aberration" in f.sentence for f in say(table))


@pytest.mark.parametrize(("sigmas_off", "contradicts"), [(1.0, False), (2.5, False), (8.0, True)])
def test_a_prior_that_the_data_contradict_is_named(rng, sigmas_off, contradicts):
    """Known to 30 arcsec by the prior and to 3 by the data, so that a correction is a draw of the former."""
    o = measured(rng, images=8, markers=8, tilt_deg=20.0, yaw_deg=180.0)
    stated = np.full(3, 30.0 * ARCSEC)
    C_EK_model = so3.exp([sigmas_off * stated[0], 0.0, 0.0]) @ C_EK_TRUE
    found = [f for f in say(replace(o, prior_E=np.diag(stated**2)), C_EK_model) if "contradict" in f.sentence]
    assert [f.weakens for f in found] == ([True] if contradicts else [])
    assert all("mounting.sigma_arcsec (30, 30, 30 arcsec)" in f.sentence for f in found)


def test_without_velocities_the_aberration_is_not_judged(rng):
    """One image whose velocity is not known is enough: its direction cannot be corrected."""
    o = measured(rng, images=20, markers=8, tilt_deg=20.0, yaw_deg=180.0)
    wrong = o.with_geometry(corrections=Corrections(light_time=True, aberration=False))
    v = wrong.v_J.copy()
    v[wrong.image == 2] = 0.0
    assert any("aberration" in f.sentence for f in say(wrong))
    assert not any("aberration" in f.sentence for f in say(replace(wrong, v_J=v)))


def test_the_largest_and_smallest_mistakes_of_a_mounting_change_no_verdict(rng):
    o = measured(rng, images=8, markers=8, tilt_deg=20.0, yaw_deg=180.0)
    assert say(o, so3.exp([3.0, 0.0, 0.0]) @ C_EK_TRUE) == []
    assert say(o, so3.exp([1 * ARCSEC, 0.0, 1 * DEG]) @ C_EK_TRUE) == []


def test_nothing_is_said_of_what_has_no_covariance_or_no_answer(rng):
    o = measured(rng, images=2, markers=3)
    assert say(o, estimator=Wahba()) == []
    assert say(o.select(np.array([0]))) == []
