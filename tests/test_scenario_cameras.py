"""Scenarios of several cameras: the mounting of one against another before launch, by budget and by sampling."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

import starplumb as sp
from starplumb.estimators.cameras.jointly import Jointly
from starplumb.estimators.gls import Gls
from starplumb.judge.calibrate import calibrate
from starplumb.judge.mountings import mountings
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC
from starplumb.plan import scene
from starplumb.report.plan import of_cameras
from starplumb.table.error_sources import draw
from starplumb.table.geometry import observe

OPTICS = {
    "model": "frame",
    "focal_length_mm": 2200.0,
    "pixel_pitch_um": 9.0,
    "image_size_px": [12000, 12000],
    "principal_point_px": [5999.5, 5999.5],
}


def camera(name, turn_deg):
    return {
        **OPTICS,
        "name": name,
        "mounting": {"from": name, "to": "str", "rotation_vector_deg": turn_deg},
    }


BANDS = {
    "scenario": {"name": "bands", "epoch": "2026-06-21T08:00:00"},
    "orbit": {"model": "circular", "altitude_km": 600.0, "inclination_deg": 97.8},
    "site": {"latitude_deg": 44.45, "longitude_deg": 34.0},
    "cameras": [camera("A", [0.0, 0.0, 0.0]), camera("B", [0.1, 0.2, 90.0])],
    "trackers": [{"name": "tracker", "sigma_arcsec": [5.0, 5.0, 12.0]}],
    "passes": [{"pitch_deg": [-10.0, -5.0, 0.0, 5.0, 10.0], "yaw_deg": [0.0, 90.0, 0.0, 90.0, 0.0]}],
    "markers": {"layout": "grid", "on": "image", "count": [3, 3], "extent": 0.8, "height_m": [0.0, 800.0]},
    "truth": {
        "gps": {"error": "position", "sigma_m": 3.0, "frame": "ITRF"},
        "survey": {"error": "landmark", "sigma_m": 0.3},
        "mark": {"error": "pixel", "sigma_px": 0.3},
    },
}
STEREO = [camera("A", [0.0, 0.0, 0.0]), camera("B", [22.0, 0.0, 0.0])]
AGAINST = "gls B against A"


def rig(**changes):
    return sp.scenario(deepcopy({**BANDS, **changes}))


@pytest.fixture(scope="module")
def bands():
    return rig()


def sigma(found, name):
    return np.array(found.document["methods"][name]["sigma_arcsec"])


@pytest.mark.slow
@pytest.mark.parametrize("cameras", [BANDS["cameras"], STEREO], ids=["bands", "22 deg ahead"])
def test_a_budget_is_the_sigma_of_a_campaign_that_is_drawn(rng, cameras):
    """Drawn with its errors stated in the campaign, and calibrated as campaigns of several cameras are."""
    one = rig(cameras=cameras)
    true = replace(
        one.data.campaign,
        cov_attitude_E=np.diag((np.array([5.0, 5.0, 12.0]) * ARCSEC) ** 2),
        sigma_position=np.full(3, 3.0),
        landmarks=scene.survey(one.data.campaign.landmarks.r_J, np.full(3, 0.3)),
        sightings=replace(
            one.data.campaign.sightings, sigma_px=np.full_like(one.data.campaign.sightings.sigma_px, 0.3)
        ),
    )
    errors = draw(observe(true), one.data.sources, rng, ())
    errors = replace(errors, late_s=None)
    given = scene.measured(true, errors, true.C_EK)
    found = calibrate(given, Jointly(("A", "B"), lambda gls: gls, Gls()))
    stated = mountings(found)
    budget = sp.budget(one)
    for name, P in (("gls", stated.covariance_of(0)), (AGAINST, stated.covariance_against_first(1))):
        assert sigma(budget, name) == pytest.approx(np.sqrt(np.diagonal(P)) / ARCSEC, rel=2e-3)


def test_what_cameras_share_cancels_in_what_they_differ_by(bands):
    """The star tracker and the orbit move both alike; two calibrations apart would carry them twice."""
    parts = {
        share["source"]: share["contribution_arcsec"]
        for share in sp.budget(bands).document["methods"][AGAINST]["sources"]
    }
    assert max(parts["tracker"][:2]) < 0.02  # of 5 arcsec; what is left is the turn that its bands differ by
    assert min(parts["mark"]) > 0.01
    alone = sp.budget(one_camera())
    assert np.all(np.sqrt(2.0) * sigma(alone, "gls")[:2] > 10.0 * sigma(sp.budget(bands), AGAINST)[:2])


def one_camera(**changes):
    document = {key: value for key, value in BANDS.items() if key != "cameras"}
    return sp.scenario({**deepcopy(document), "camera": OPTICS, **changes})


def test_the_focal_length_of_each_camera_is_its_own(bands):
    """One draw for both would cancel in their difference."""
    from starplumb.plan.error_catalogue import Flight, focal_length

    truth = bands.data.truth
    source = focal_length(Flight.of_table(truth), "focal", 1e-6)
    assert source.groups == 2
    assert np.array_equal(source.group, truth.camera)


@pytest.mark.slow
def test_sampling_confirms_what_is_stated_of_each_camera():
    """The second looks ahead and is turned, so that its sigmas differ about every axis."""
    two = rig(cameras=[camera("A", [0.0, 0.0, 0.0]), camera("B", [20.0, 8.0, 60.0])])
    study = sp.simulate(two, trials=600, seed=7).document
    assert list(study["methods"]) == ["gls", AGAINST]
    budget = sp.budget(two)
    for name, found in study["methods"].items():
        assert not found["failed"]
        for k, axis in enumerate("xyz"):
            # 600 trials: the standard error of a sigma is 2.9 %
            rms = found["axes"][axis]["rms_arcsec"]["value"]
            assert rms == pytest.approx(sigma(budget, name)[k], rel=0.1)
            assert found["axes"][axis]["error_over_stated"]["value"] == pytest.approx(1.0, abs=0.1)
        assert found["nees"]["value"] == pytest.approx(1.0, abs=0.1)


def test_markers_of_a_site_are_seen_by_all(bands):
    on_site = {"layout": "grid", "count": [3, 3], "extent_km": 12.0}
    one = rig(
        markers=on_site, cameras=[camera("A", [0.0, 0.0, 0.0]), camera("B", [0.1, 0.2, 0.0])]
    ).data.campaign
    assert len(one.landmarks.ids) == 9
    assert len(bands.data.campaign.landmarks.ids) == 2 * 5 * 9
    each = [set(one.sightings.landmark[one.rig.of_image[one.sightings.image] == k]) for k in range(2)]
    assert each[0] & each[1] == set(range(9))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"camera": OPTICS}, r"camera: found beside \[\[cameras\]\]"),
        (
            {"mounting": {"from": "camera", "to": "str", "quaternion_xyzw": [0, 0, 0, 1]}},
            r"mounting: found beside",
        ),
        (
            {
                "cameras": [
                    BANDS["cameras"][0],
                    {**STEREO[1], "mounting": {**STEREO[1]["mounting"], "to": "other"}},
                ]
            },
            r'cameras\.1\.mounting\.from: found "B" to "other", wanted "B" on one side, and "str" on the other',
        ),
        ({"cameras": [BANDS["cameras"][0]] * 2}, r'cameras\.1\.name: found the camera "A" again'),
        (
            {"truth": {**BANDS["truth"], "look": {"error": "look-angles", "sigma_px": 1.0}}},
            "found look-angles for several",
        ),
        (
            {"cameras": STEREO, "markers": {"layout": "grid", "count": [3, 3], "extent_km": 12.0}},
            r"cameras\.1: found 0 markers in its images",
        ),
    ],
    ids=["both", "mounting", "tracker", "name", "look angles", "looks elsewhere"],
)
def test_mistakes_are_said_in_a_sentence(changes, sentence):
    with pytest.raises(InputError, match=sentence):
        rig(**changes)


def test_what_takes_one_camera_says_so(bands):
    with pytest.raises(InputError, match="methods: found 'wahba', wanted gls"):
        sp.budget(bands, "gls,wahba")


@pytest.mark.slow
def test_a_plan_says_how_its_images_tell_the_cameras_apart(tmp_path):
    """By hand: what both cameras share cancels, so that n images of nine markers, each measured twice to 0.3 px of
    0.844 arcsec, leave 0.358 / 3 / sqrt(n) arcsec across, and that over the rms field angle about the line of sight."""
    on_site = {"layout": "grid", "count": [3, 3], "extent_km": 12.0}
    cameras = [camera("A", [0.0, 0.0, 0.0]), camera("B", [0.1, 0.2, 0.0])]
    found = sp.plan_images(rig(cameras=cameras, markers=on_site), 3, days=3.0)
    one = sp.plan_images(one_camera(markers=on_site), 3, days=3.0)
    assert one.document["images"] == found.document["images"]
    assert one.document["cameras"] == []
    (said,) = found.document["cameras"]
    assert (said["camera"], said["against"]) == ("B", "A")
    look = np.radians([image["look_deg"] for image in found.document["images"]])
    across, range_km = 0.3 * 0.844 * np.sqrt(2.0) / 3.0, 600.0 / np.cos(look)
    field = np.sqrt(np.sum(6.0 / 9.0 * (6.0 / range_km) ** 2 * (1.0 + np.cos(look) ** 2)))
    wanted = [across / np.sqrt(look.size), across / np.sqrt(look.size), across / field]
    assert said["sigma_arcsec"] == pytest.approx(wanted, rel=0.1)  # of a flat Earth
    sentence = "B against A, by whose mounting the images are chosen, is then known to"
    assert any(sentence in text for text in found.sentences)
    found.save(tmp_path)
    assert sentence in (tmp_path / "plan.html").read_text()


def test_a_plan_that_is_given_a_mounting_says_what_of_the_other_camera_it_leaves_out():
    one = {"camera": "B", "against": "A", "sigma_arcsec": [1.0, 2.0, 3.0], "left_out": None}
    (all_counts,) = of_cameras({"cameras": [one]})
    assert "is then known to" in all_counts
    (said,) = of_cameras({"cameras": [{**one, "left_out": "what mission.db says of B"}]})
    assert "then known" not in said
    assert "by the planned images and what is given of A; what mission.db says of B is left out" in said


def test_a_large_scene_has_the_gain_of_a_small_one(monkeypatch):
    """By elimination, beyond the size of which the dense covariance is formed, as below it."""
    from starplumb.plan import bound

    two = rig(cameras=[camera("A", [5.0, 0.0, 0.0]), camera("B", [20.0, 8.0, 60.0])]).data
    dense = bound.Linear(two, two.sources)
    expected, gain = dense.covariance_all_E, dense.gain
    monkeypatch.setattr(bound, "MOST_SIGHTINGS", 0)
    eliminated = bound.Linear(two, two.sources)
    np.testing.assert_allclose(eliminated.covariance_all_E, expected, rtol=1e-6, atol=1e-9 * expected.max())
    np.testing.assert_allclose(eliminated.gain, gain, rtol=1e-5, atol=1e-6 * np.abs(gain).max())
