"""Markers without names: found, or refused with the reason, never guessed."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, LINE, SIGMAS, truth
from starplumb.estimators.robust import Robust
from starplumb.identify import placement
from starplumb.identify.labelling import Label, label
from starplumb.judge.calibrate import calibrate
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.campaign import Detections


def unnamed(true, rng, clutter=0.3, missed=0.0, error_deg=1.0, bias_px=5.0):
    """Detections in random order with their true landmarks (-1: clutter) and a campaign whose mounting is off.

    Each image is shifted by its own few pixels, as an attitude error would.
    """
    s = true.sightings
    seen = rng.random(s.image.size) >= missed
    false = int(seen.sum() * clutter / (1.0 - clutter))
    image = np.concatenate([s.image[seen], rng.integers(len(true.images.ids), size=false)])
    pixel = np.stack([s.column_px, s.row_px], -1)[seen] + 0.3 * rng.standard_normal((int(seen.sum()), 2))
    pixel += bias_px * rng.standard_normal((len(true.images.ids), 2))[s.image[seen]]
    pixel = np.concatenate([pixel, rng.uniform(100.0, 11900.0, (false, 2))])
    named = np.concatenate([s.landmark[seen], np.full(false, -1)])
    order = rng.permutation(image.size)
    axis = rng.standard_normal(3)
    model = so3.exp(error_deg * DEG * axis / np.linalg.norm(axis)) @ C_EK_TRUE
    detections = Detections(image[order], *pixel[order].T, np.full(order.size, 0.3))
    return replace(true, C_EK=model), detections, named[order]


@pytest.mark.slow
@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
@pytest.mark.parametrize(
    ("clutter", "missed", "error_deg"), [(0.3, 0.0, 1.0), (0.5, 0.5, 1.0), (0.3, 0.2, 2.0), (0.0, 0.0, 0.0)]
)
def test_every_label_is_right(camera, clutter, missed, error_deg, rng):
    true = truth(camera, 6, 8)
    for _ in range(3):
        campaign, detections, named = unnamed(true, rng, clutter, missed, error_deg)
        found = label(campaign, detections)
        assert found.refusal == ""
        given = found.landmark >= 0
        np.testing.assert_array_equal(found.landmark[given], named[given])
        assert np.sum(given) >= np.sum(named >= 0) - 2
        done = calibrate(replace(campaign, sightings=found.sightings(detections)), Robust())
        off = so3.log(done.estimate.C_EK @ C_EK_TRUE.mT) / done.estimate.sigma_E
        assert np.abs(off).max() < 4.5


def test_one_site_seen_by_all_images(rng):
    true = truth(FRAME, 5, 9, shared_site=True)
    jittered = true.landmarks.r_J + rng.uniform(-1500.0, 1500.0, true.landmarks.r_J.shape)
    true = scene.mark_site(true, jittered, SIGMAS)
    campaign, detections, named = unnamed(true, rng)
    found = label(campaign, detections)
    assert found.refusal == ""
    given = found.landmark >= 0
    np.testing.assert_array_equal(found.landmark[given], named[given])


def test_a_regular_grid_larger_than_the_image_is_ambiguous(rng):
    """Markers every 6 km as far as the reach goes: the image looks the same one marker farther on."""
    one = truth(FRAME, 1, 1)
    east_north = 6000.0 * (np.stack(np.meshgrid(*[np.arange(-8, 9)] * 2), -1).reshape(-1, 2))
    latitude, longitude, _ = (x[0] for x in _geodetic(one.landmarks.r_J))
    true = scene.mark_site(one, scene.site_grid(latitude, longitude, 0.0, east_north), SIGMAS)
    campaign, detections, _ = unnamed(true, rng, clutter=0.0, error_deg=0.5)
    found = label(campaign, detections)
    assert "which is right cannot be told" in found.refusal
    assert np.all(found.landmark == -1)


def _geodetic(r_J):
    from starplumb.physics.earth import itrf_to_geodetic

    return itrf_to_geodetic(r_J)


def test_clutter_alone_is_refused(rng):
    campaign, detections, _ = unnamed(truth(FRAME, 6, 8), rng, missed=1.0, clutter=0.0)
    assert detections.image.size == 0
    noise = Detections(rng.integers(6, size=60), *rng.uniform(0.0, 11999.0, (2, 60)), np.full(60, 0.3))
    found = label(campaign, noise)
    assert found.refusal != ""
    assert np.all(found.label == Label.NO_LANDMARK)


def test_too_far_off_is_refused(rng):
    """Six degrees are beyond the stated reach of two."""
    campaign, detections, _ = unnamed(truth(FRAME, 4, 8), rng, error_deg=6.0)
    found = label(campaign, detections)
    assert "2 deg" in found.refusal or "chance" in found.refusal


def test_two_detections_of_one_marker_get_no_label(rng):
    """Three pixels apart, one of them false: neither is taken."""
    true = truth(FRAME, 6, 8)
    campaign, d, named = unnamed(true, rng, clutter=0.0)
    twin = Detections(
        np.append(d.image, d.image[0]),
        np.append(d.column_px, d.column_px[0] + 0.8),
        np.append(d.row_px, d.row_px[0] - 0.7),
        np.append(d.sigma_px, 0.3),
    )
    found = label(campaign, twin)
    assert found.label[0] == found.label[-1] == Label.AMBIGUOUS
    np.testing.assert_array_equal(found.landmark[1:-1], named[1:])
    assert found.counts == {"detections": 49, "labelled": 47, "no_landmark": 0, "ambiguous": 2}


def test_the_rotation_found_is_the_true_one(rng):
    campaign, detections, _ = unnamed(truth(FRAME, 6, 8), rng, bias_px=0.0)
    assert np.abs(so3.log(label(campaign, detections).C_EK @ C_EK_TRUE.mT)).max() < 30.0 * ARCSEC


@pytest.mark.parametrize(
    ("limit", "value"), [("DECIDING", 6), ("CANDIDATES", 150), ("TRIALS", 20_000), ("HYPOTHESES", 60)]
)
def test_some_of_the_detections_decide_for_all(limit, value, rng, monkeypatch):
    """With fewer detections, images, candidates or rotations looked at, every label found is still the right one."""
    monkeypatch.setattr(placement, limit, value)
    monkeypatch.setattr(placement, "FINALISTS", 20)
    campaign, detections, named = unnamed(truth(FRAME, 6, 12), rng, 0.3, 0.1, 1.5)
    found = label(campaign, detections)
    assert found.refusal == ""
    given = found.landmark >= 0
    np.testing.assert_array_equal(found.landmark[given], named[given])
    assert np.sum(given) >= np.sum(named >= 0) - 2


def test_limits_are_kept(rng, monkeypatch):
    """So many detections of an image, and so many candidates, whatever there are."""
    campaign, detections, _ = unnamed(truth(FRAME, 6, 12), rng)
    monkeypatch.setattr(placement, "DECIDING", 10)
    few = placement.Candidates.deciding(campaign, detections, 2.0 * DEG, rng)
    images, count = np.unique(detections.image[np.unique(few.detection)], return_counts=True)
    assert images.size == 6
    assert np.all(count <= 10)
    monkeypatch.setattr(placement, "CANDIDATES", 100)
    fewer = placement.Candidates.deciding(campaign, detections, 2.0 * DEG, rng)
    assert 0 < fewer.table.n <= 100
    assert np.all(np.diff(fewer.detection) >= 0)


@pytest.mark.slow
def test_a_thousand_detections_take_little_memory(rng):
    """Four images of 300 detections among 200 markers each, which all told are 240 000 candidates."""
    campaign, detections, named = unnamed(truth(FRAME, 4, 200), rng, missed=0.1)
    assert detections.image.size > 1000
    tracemalloc.start()
    found = label(campaign, detections)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.refusal == ""
    given = found.landmark >= 0
    np.testing.assert_array_equal(found.landmark[given], named[given])
    assert np.sum(given) > 0.98 * np.sum(named >= 0)
    assert peak < 250e6
