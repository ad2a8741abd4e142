"""What an answer rests on: the sizes that matter by wrong campaigns, the sigmas by estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.documents.from_calibration import result_document
from starplumb.estimators.gls import Gls
from starplumb.judge.calibrate import calibrate
from starplumb.physics import so3
from starplumb.physics.camera import LineScanCamera
from starplumb.table.geometry import observe
from starplumb.table.parameter_names import parameters


def calibrated(campaign, estimator=None):
    """From a model a little off, so that there is something to correct."""
    model = so3.exp(np.array([1e-4, -2e-4, 3e-4])) @ C_EK_TRUE
    return calibrate(replace(campaign, C_EK=model), estimator or Gls())


def later(campaign, ms):
    t_ns = campaign.images.t_ns + np.int64(round(1e6 * ms))
    return replace(campaign, images=replace(campaign.images, t_ns=t_ns))


def longer(campaign, mm):
    camera = campaign.camera
    return replace(campaign, camera=replace(camera, focal_length=camera.focal_length + 1e-3 * mm))


def unrefracted(campaign, percent):
    """The marks of a scene with that part of the refraction, seen without any."""
    part, o = percent / 100.0, observe(campaign)
    light = replace(campaign.corrections, refraction=True)
    whole = observe(replace(campaign, corrections=light))
    return replace(o, e_E=o.e_E + part * (whole.e_E - o.e_E))


@pytest.mark.parametrize(
    ("estimate", "change", "camera"),
    [("time_offset", later, FRAME), ("focal_length", longer, FRAME), (None, unrefracted, LINE)],
    ids=["time", "focal length", "refraction"],
)
def test_an_error_of_that_size_moves_the_answer_by_a_sigma(estimate, change, camera):
    """About the axis that it moves most; the others by as much less as is said."""
    campaign = truth(camera, 6, 8, tilt_deg=20.0, yaw_deg=40.0 if camera is FRAME else 0.0)
    done = calibrated(campaign)
    (found,) = [one for one in done.rests_on if one.of.key == estimate]
    axis = int(np.argmin(found.matters))
    wrong = change(campaign, found.matters[axis])
    table = wrong if change is unrefracted else observe(wrong)
    sigma_E = done.estimate.sigma_E
    moved = np.abs(so3.log(Gls()(table, C_EK_TRUE).C_EK @ done.estimate.C_EK.mT)) / sigma_E
    np.testing.assert_allclose(moved, found.matters[axis] / found.matters, atol=0.02)
    if estimate is not None:
        free = Gls(parameters([estimate], campaign))(observe(campaign), C_EK_TRUE)
        np.testing.assert_allclose(found.sigma_E, free.sigma_E, rtol=2e-3)


def narrow():
    """Eight images of a line that look alike, so that a bent line turns them all."""
    return truth(LINE, 8, 20, tilt_deg=5.0)


def test_a_line_scanner_rests_on_its_look_angles():
    """The root mean square of what each term does, at that size; message, notices and status."""
    campaign = narrow()
    done = calibrated(campaign)
    (found,) = [one for one in done.rests_on if one.of.key == "look_angles"]
    sigma_E, c = done.estimate.sigma_E, LINE
    u = np.linspace(-1.0, 1.0, 400)
    column = np.interp(u, [-1.0, 1.0], c.column_px[[0, -1]])
    tans = [np.interp(column, c.column_px, tan) for tan in (c.tan_x, c.tan_y)]
    terms = {"x1": (0, u), "x2": (0, 1.5 * u**2 - 0.5), "x3": (0, 2.5 * u**3 - 1.5 * u)}
    terms |= {"y2": (1, terms["x2"][1]), "y3": (1, terms["x3"][1])}
    pixel = np.hypot(*(tan[-1] - tan[0] for tan in tans)) / np.ptp(c.column_px)
    turns = []
    for axis, bend in terms.values():
        bent = [tan + (bend * pixel if i == axis else 0.0) for i, tan in enumerate(tans)]
        camera = LineScanCamera(column, *bent, c.size_px)
        estimate = Gls()(observe(replace(campaign, camera=camera)), C_EK_TRUE)
        turns.append(so3.log(estimate.C_EK @ done.estimate.C_EK.mT))
    np.testing.assert_allclose(found.matters, sigma_E / np.sqrt(np.sum(np.square(turns), axis=0)), rtol=0.03)
    free = Gls(parameters(["look_angles"], campaign))(observe(campaign), C_EK_TRUE)
    np.testing.assert_allclose(found.sigma_E, free.sigma_E, rtol=5e-3)


def test_it_is_said_where_ordinary_knowledge_is_not_enough():
    """With markers ten times as good as usual the answer is better than a pixel of look angles; nothing weakens."""
    campaign = narrow()
    fine = replace(
        campaign,
        cov_attitude_E=campaign.cov_attitude_E / 100.0,
        sigma_position=campaign.sigma_position / 10.0,
    )
    (rough, good) = (calibrated(each) for each in (campaign, fine))
    said = [text for text in good.sentences if " rests on " in text]
    assert len(said) == 1
    assert good.rests_on[0].urgency > 1.0
    assert good.rests_on[0].sentence == said[0]
    assert good.status == rough.status
    document = result_document(good, "gls", ("camera", "tracker"), {}, {})
    assert [one["what"] for one in document["rests_on"]] == [one.of.words for one in good.rests_on]
    calm = replace(campaign, cov_attitude_E=1e4 * campaign.cov_attitude_E)
    assert not [text for text in calibrated(calm).sentences if " rests on " in text]


def test_what_is_estimated_or_considered_is_not_rested_on():
    campaign = replace(truth(FRAME, 6, 8, tilt_deg=20.0, yaw_deg=40.0), considered=(("time_offset", 1e-3),))
    done = calibrated(campaign, Gls(parameters(["focal_length"], campaign)))
    assert {one.of.key for one in done.rests_on} == {"principal_point", None}


def test_a_growth_that_is_lost_in_rounding_is_hopeless(monkeypatch):
    """Of normal equations singular to the last digit the inverse may have a variance below 0."""
    exact, seen = np.linalg.inv, []

    def rounded(N):
        seen.append(len(N)) if N.ndim == 2 else None
        return -exact(N) if N.ndim == 2 and len(N) > min(seen) else exact(N)

    monkeypatch.setattr("starplumb.judge.conventions.rests_on.np.linalg.inv", rounded)
    found = calibrated(truth(FRAME, 4, 8)).rests_on
    assert found
    assert all(np.isinf(one.grown).all() for one in found)
    assert "these views cannot tell it" in next(one for one in found if one.of.key).sentence
