"""Normal equations that add up: campaigns of one site summed are their joint solution, and survive their file."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, SIGMAS, truth
from starplumb.documents.normals import NormalsDocument, joined, normals_document
from starplumb.estimators.gls import Gls
from starplumb.judge.calibrate import calibrate
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC
from starplumb.plan import scene
from starplumb.table.campaign import Campaign, SharedErrors, some_of
from starplumb.table.geometry import observe
from starplumb.table.parameter_names import parameters
from starplumb.table.simulate import Errors


def measured(rng, **options) -> Campaign:
    """A measured campaign, its model mounting half a degree off."""
    true = truth(FRAME, 6, 9, **{"tilt_deg": 15.0, "yaw_deg": 60.0, **options})
    off = so3.exp(np.array([0.3, -0.2, 0.4]) * np.pi / 180.0)
    return scene.measured(true, Errors.draw(observe(true), rng), off @ C_EK_TRUE)


def images_of(campaign, chosen):
    """The campaign with the sightings of some images, and a name of its own."""
    s = campaign.sightings
    kept = np.isin(s.image, chosen)
    sightings = some_of(s, kept)
    return replace(campaign, sightings=sightings, name=f"images {chosen}")


def document(campaign, estimator=None):
    found = normals_document(calibrate(campaign, estimator or Gls()))
    return NormalsDocument.from_json(NormalsDocument.of(found).to_json(), "normals.json")


def off(found, wanted):
    """How far a solution lies from another (3,), in its sigmas, and the ratio of the sigmas (3,)."""
    sigma = np.sqrt(np.diagonal(wanted.covariance_E))
    away = so3.log(found.C_EK @ wanted.C_EK.T) / sigma
    return away, np.sqrt(np.diagonal(found.covariance_E)) / sigma


@pytest.mark.parametrize("shared_site", [True, False], ids=["one site", "markers of their own"])
@pytest.mark.parametrize(
    "names", [(), ("time_offset=10ms", "focal_length")], ids=["alone", "with parameters"]
)
def test_the_sum_of_campaigns_is_their_joint_solution(rng, shared_site, names):
    campaign = measured(rng, shared_site=shared_site)
    estimator = Gls(parameters(list(names), campaign))
    parts = [images_of(campaign, chosen) for chosen in ([0, 1], [2, 3, 4], [5, 1])[:2]]
    parts[1] = images_of(campaign, [2, 3, 4, 5])
    whole = calibrate(campaign, estimator).estimate
    found = joined([document(part, estimator) for part in parts])
    away, ratio = off(found, whole)
    assert np.all(np.abs(away) < 1e-3)
    np.testing.assert_allclose(ratio, 1.0, rtol=1e-3)
    assert found.chi2 == pytest.approx(float(whole.chi2), rel=1e-3)
    assert found.count == 2 * campaign.sightings.image.size


def test_a_mean_of_results_is_not(rng):
    """What the sum is for: the survey's error is the same in both campaigns, and their mean's sigma too small."""
    coarse = replace(SIGMAS, landmark=np.full(3, 30.0), attitude=np.full(3, 1.0) * ARCSEC)
    campaign = measured(rng, shared_site=True, yaw_deg=0.0, tilt_deg=0.0, sigmas=coarse)
    parts = [calibrate(images_of(campaign, chosen), Gls()).estimate for chosen in ([0, 1, 2], [3, 4, 5])]
    whole = calibrate(campaign, Gls()).estimate
    mean = np.linalg.inv(sum(np.linalg.inv(part.covariance_E) for part in parts))
    assert np.sqrt(mean[1, 1]) < 0.85 * whole.sigma_E[1]


def test_a_prior_of_the_mounting_is_added_once(rng):
    campaign = replace(measured(rng), sigma_mounting=np.array([600.0, 600.0, 30.0]) * ARCSEC)
    whole = calibrate(campaign, Gls()).estimate
    found = joined([document(images_of(campaign, [0, 1, 2])), document(images_of(campaign, [3, 4, 5]))])
    away, ratio = off(found, whole)
    assert np.all(np.abs(away) < 1e-2)
    np.testing.assert_allclose(ratio, 1.0, rtol=1e-3)


def test_what_a_campaign_shares_stays_its_own(rng):
    """One error of attitude in each of two campaigns: two passes of one campaign, stated so.  What such errors do is
    written down at the closed form of each campaign, some arc seconds away."""
    campaign = measured(rng)
    passes = replace(campaign.images, passes=("p",) * 3 + ("q",) * 3)
    whole = calibrate(replace(campaign, images=passes, attitude_errors=SharedErrors("pass")), Gls()).estimate
    one = replace(campaign, attitude_errors=SharedErrors("campaign"))
    found = joined([document(images_of(one, [0, 1, 2])), document(images_of(one, [3, 4, 5]))])
    away, ratio = off(found, whole)
    assert np.all(np.abs(away) < 5e-3)
    np.testing.assert_allclose(ratio, 1.0, rtol=1e-3)


def test_one_name_for_two_places_is_refused(rng):
    campaign = measured(rng, shared_site=True)
    moved = replace(campaign, landmarks=replace(campaign.landmarks, r_J=campaign.landmarks.r_J + 0.002))
    with pytest.raises(InputError, match=r"found landmark\[gcp001\] at another place"):
        joined([document(campaign), document(moved)])


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda d: d["unknowns"][0]["covariance"].pop(), "mounting.covariance: found 2 x 3, wanted 3 x 3"),
        (lambda d: d["unknowns"][0]["covariance"][0].pop(), "mounting.covariance: found rows of several"),
        (lambda d: d["unknowns"][0]["expected"].pop(), "mounting.expected: found 2, wanted 3"),
        (lambda d: d["images"][0]["information"].pop(), "information: found "),
        (lambda d: d["images"][0]["unknowns"].pop(), "vector: found "),
        (lambda d: d["images"][0]["unknowns"].append("x"), "not among the unknowns"),
        (lambda d: d["images"][0].update(time="2020-06-30T23:59:60"), "found '2020-06-30T23:59:60'"),
        (lambda d: d["unknowns"].append(d["unknowns"][0]), "found a name twice"),
    ],
)
def test_equations_that_do_not_fit_together_are_refused(spoil, says):
    P = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    mounting = {"name": "mounting", "unit": "arcsec", "reference": [0.0] * 3, "expected": [0.0] * 3}
    image = {"image_id": "I1", "time": "2020-01-01T00:00:00", "unknowns": ["mounting"], "count": 1}
    image |= {"information": [1.0, 0.0, 0.0, 1.0, 0.0, 1.0], "vector": [0.0] * 3, "constant": 0.0}
    good = {"schema": "starplumb-normals/1", "campaign": "c", "matrix": P}
    good |= {"unknowns": [mounting | {"covariance": [row[:] for row in P]}], "images": [image]}
    NormalsDocument.from_json(json.dumps(good), "normals.json")
    spoil(good)
    with pytest.raises(InputError, match=f"normals.json: .*{re.escape(says)}"):
        NormalsDocument.from_json(json.dumps(good), "normals.json")


def test_nothing_is_written_of_a_refuted_answer(rng):
    campaign = measured(rng)
    s = campaign.sightings
    wrong = replace(
        campaign, sightings=replace(s, column_px=s.column_px + rng.normal(0.0, 300.0, s.image.size))
    )
    assert normals_document(calibrate(wrong, Gls())) is None
