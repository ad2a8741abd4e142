"""The result of one campaign as what another one knows: the whole covariance, not three sigmas."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import starplumb as sp
from command import demo as written_demo
from command import starplumb
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC


def test_two_campaigns_one_after_the_other_are_their_information_summed(tmp_path):
    """Two demos of one mounting: the informations add up, and so do the pulls."""
    first = sp.calibrate(sp.demo(images=8, seed=1), method="gls")
    alone = sp.calibrate(sp.demo(images=8, seed=2), method="gls")
    first.save(tmp_path, report=False)
    for prior in (first, tmp_path / "result.json"):
        found = sp.calibrate(sp.demo(images=8, seed=2), method="gls", prior=prior)
        N = [np.linalg.inv(one.covariance_arcsec2) for one in (first, alone)]
        covariance = np.linalg.inv(N[0] + N[1])
        np.testing.assert_allclose(found.covariance_arcsec2, covariance, rtol=2e-3, atol=1e-3)
        apart = so3.log(alone.C_EK @ first.C_EK.T) / ARCSEC
        np.testing.assert_allclose(found.correction_arcsec, covariance @ N[1] @ apart, atol=0.02)


def earlier(path, days, deg=0.0):
    """A saved result of images so many days before, of a mounting turned by so much."""
    document = json.loads(path.read_text())
    ends = np.array([document["span"][end].rstrip("Z") for end in ("first", "last")], dtype="datetime64[ns]")
    ends -= np.timedelta64(round(days * 86400.0), "s")
    document["span"] = dict(zip(("first", "last"), map(str, ends), strict=True))
    turned = so3.exp(np.radians([deg, 0.0, 0.0])) @ np.array(document["mounting"]["matrix"])
    document["mounting"]["matrix"] = turned.tolist()
    document["mounting"]["quaternion_xyzw"] = so3.to_quaternion(turned).tolist()
    path.write_text(json.dumps(document))
    return path


def test_a_prior_of_minutes_a_month_before_keeps_its_covariance(tmp_path):
    """Its mounting showed no motion, and is said to be taken to rest: the informations add up as of one campaign, to a
    thousandth of a sigma."""
    first = sp.calibrate(sp.demo(images=8, seed=1), method="gls")
    alone = sp.calibrate(sp.demo(images=8, seed=2), method="gls")
    first.save(tmp_path, report=False)
    at_once = sp.calibrate(sp.demo(images=8, seed=2), method="gls", prior=first)
    path = earlier(tmp_path / "result.json", 30.0)
    found = sp.calibrate(sp.demo(images=8, seed=2), method="gls", prior=path)
    joint = np.linalg.inv(np.linalg.inv(first.covariance_arcsec2) + np.linalg.inv(alone.covariance_arcsec2))
    np.testing.assert_allclose(found.sigma_arcsec, np.sqrt(np.diagonal(joint)), rtol=1e-3)
    np.testing.assert_allclose(found.correction_arcsec, at_once.correction_arcsec, atol=1e-6)
    assert f"the prior {path}: taken to be at rest over the 30 d from its images to these" in found.message
    assert "taken to be at rest" not in at_once.message


def test_a_prior_of_another_mounting_a_day_before_is_contradicted(tmp_path):
    """However far it is, no answer is called good."""
    sp.calibrate(sp.demo(images=8, seed=1), method="gls").save(tmp_path, report=False)
    for deg in (0.01, 90.99):  # in all, 91 degrees
        found = sp.calibrate(
            sp.demo(images=8, seed=2), prior=earlier(tmp_path / "result.json", 1.0, deg), method="gls"
        )
        assert found.status in ("weak", "refuted", "not_converged")
        assert "contradict" in found.message
        assert f"the prior {tmp_path / 'result.json'}" in found.message


def test_the_command_takes_a_prior_and_records_it(tmp_path):
    first, second = (written_demo(tmp_path / name, "--images", 3, "--seed", k) for k, name in enumerate("ab"))
    assert starplumb("calibrate", first, "--no-report").status == 0
    prior = first.parent / "result" / "result.json"
    done = starplumb("calibrate", second, "--no-report", "--prior", prior)
    assert done.status == 0
    document = json.loads((second.parent / "result" / "result.json").read_text())
    assert str(prior) in document["inputs"]
    before = json.loads(prior.read_text())
    assert all(a < b for a, b in zip(document["sigma_arcsec"], before["sigma_arcsec"], strict=True))


def test_a_prior_beside_a_stated_sigma_is_refused(tmp_path):
    path = written_demo(tmp_path / "a", "--images", 3)
    first = sp.calibrate(sp.read_campaign(path))
    path.write_text(path.read_text().replace("[mounting]\n", "[mounting]\nsigma_arcsec = 100.0\n"))
    with pytest.raises(InputError, match=r"mounting\.sigma_arcsec: found beside the prior"):
        sp.calibrate(sp.read_campaign(path), prior=first)


def test_data_that_contradict_a_prior_name_its_file(tmp_path):
    """Of a mounting 60 arcsec away; what campaign.toml does not state must not be blamed, and the interval holds the
    truth, from which the prior pulls the answer by half of that."""
    sp.calibrate(sp.demo(images=3, seed=1)).save(tmp_path, report=False)
    document = json.loads((tmp_path / "result.json").read_text())
    turned = so3.exp(np.radians([60.0 / 3600.0, 0.0, 0.0])) @ np.array(document["mounting"]["matrix"])
    document["mounting"]["matrix"] = turned.tolist()
    document["mounting"]["quaternion_xyzw"] = so3.to_quaternion(turned).tolist()
    (tmp_path / "result.json").write_text(json.dumps(document))
    campaign = sp.demo(images=3, seed=2)
    found = sp.calibrate(campaign, method="gls", prior=tmp_path / "result.json")
    assert found.status == "weak"
    assert f"the data contradict the prior {tmp_path / 'result.json'} (" in found.message
    assert "mounting.sigma_arcsec" not in found.message
    error = np.abs(so3.log(found.C_EK @ campaign.C_EK_true.T)) / ARCSEC
    assert error[0] > 20.0
    assert np.all(error < found.interval_95_arcsec)


def test_a_prior_of_the_same_sightings_is_refused(tmp_path):
    path = written_demo(tmp_path / "a", "--images", 3)
    assert starplumb("calibrate", path, "--no-report").status == 0
    prior = path.parent / "result" / "result.json"
    done = starplumb("calibrate", path, "--no-report", "--out", tmp_path / "b", "--prior", prior)
    assert done.status == 2
    assert f"the prior {prior} was made from the same observations.csv" in done.err
    campaign = sp.demo(images=3)
    with pytest.raises(InputError, match="the prior was made from the same"):
        sp.calibrate(campaign, prior=sp.calibrate(campaign))


@pytest.mark.parametrize(
    ("method", "status", "named"),
    [("default", "refuted", True), ("gls", "refuted", True), ("robust", "not_converged", False)],
)
def test_a_prior_half_a_degree_off_leaves_no_answer(method, status, named):
    """It pulls so far that no sighting is near the answer."""
    first = sp.calibrate(sp.demo(images=8, seed=1))
    estimate = first.calibration.estimate
    turned = replace(estimate, C_EK=so3.exp(np.radians([0.5, 0.0, 0.0])) @ estimate.C_EK)
    prior = replace(first, calibration=replace(first.calibration, estimate=turned))
    found = sp.calibrate(sp.demo(images=8, seed=2), prior=prior, method=method)
    assert found.status == status
    assert ("the data contradict the prior (" in found.message) == named


def test_landmarks_of_both_campaigns_are_said_to_count_twice(tmp_path):
    """Markers of two campaigns have the names of the example; those of a third share one."""
    first, second = sp.calibrate(sp.demo(images=3, seed=4)), sp.demo(images=3, seed=5)
    first.save(tmp_path, report=False)
    physics = second.loaded.campaign
    names = tuple(name if name == "gcp005" else f"b{name}" for name in physics.landmarks.ids)
    renamed = replace(physics, landmarks=replace(physics.landmarks, ids=names))
    third = replace(second, loaded=replace(second.loaded, campaign=renamed))
    for prior, name in (
        (first, "the prior"),
        (tmp_path / "result.json", f"the prior {tmp_path / 'result.json'}"),
    ):
        found = sp.calibrate(third, prior=prior)
        assert found.status == "ok"
        assert f"1 landmark of {name} occurs here too (gcp005)" in found.message
    assert "30 landmarks of the prior" in sp.calibrate(second, prior=tmp_path / "result.json").message
    (tmp_path / "residuals.csv").unlink()  # normals.json names them too
    assert "30 landmarks of the prior" in sp.calibrate(second, prior=tmp_path / "result.json").message
    (tmp_path / "normals.json").unlink()
    assert "occur here" not in sp.calibrate(second, prior=tmp_path / "result.json").message


def test_few_images_that_show_no_motion_are_a_prior_and_a_prediction():
    """Two images: no test of motion is made of them, so nothing bounds what is possible a day later."""
    first = sp.calibrate(sp.demo(images=2, seed=4), method="gls")
    assert first.document["motion"] is None
    later = sp.predict(first, "2025-06-22T10:30:00").covariance_arcsec2
    assert np.all(np.diagonal(later) > np.diagonal(first.covariance_arcsec2))
    alone = sp.calibrate(sp.demo(images=8, seed=5), method="gls")
    found = sp.calibrate(sp.demo(images=8, seed=5), method="gls", prior=first)
    assert np.all(found.sigma_arcsec < 0.95 * alone.sigma_arcsec)
