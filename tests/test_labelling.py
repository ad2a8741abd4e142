"""Markers without names: found, or refused with the reason, never guessed."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from problems import C_EK_TRUE, FRAME, LINE, SIGMAS, truth
from starplumb.estimators.consensus import Directions
from starplumb.estimators.protocol import Status, Verdict
from starplumb.estimators.robust import Robust
from starplumb.identify import labelling, placement
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
    assert "too similar a number to decide between them" in found.refusal
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


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"status": Status.SINGULAR}, "the labels found contradict each other"),
        ({"status": Status.NOT_CONVERGED}, "the labels found contradict each other"),
        ({"verdict": Verdict.SIGHTING}, "the labels found do not determine the alignment"),
    ],
)
def test_labels_that_give_no_alignment_are_refused(changes, said, rng, monkeypatch):
    """Found by agreement, then judged unusable, or rejected one and all, by the estimate made from them."""

    def judged(table, C_EK):
        found = Robust()(table, C_EK)
        fields = {name: np.full_like(getattr(found, name), int(value)) for name, value in changes.items()}
        return replace(found, **fields)

    campaign, detections, _ = unnamed(truth(FRAME, 2, 6), rng, clutter=0.0, bias_px=0.0)
    assert label(campaign, detections).counts["labelled"] == 12
    monkeypatch.setattr(labelling, "Robust", lambda: judged)
    found = label(campaign, detections)
    assert found.refusal == said
    assert found.counts == {"detections": 12, "labelled": 0, "no_landmark": 12, "ambiguous": 0}
    assert np.all(found.landmark == -1)
    np.testing.assert_array_equal(found.C_EK, campaign.C_EK)
    assert found.sightings(detections).image.size == 0


# three detections: the first with two candidates, the second and third claim the same landmark of the same image
PAIRED = SimpleNamespace(image=np.array([0, 0, 0, 0, 1]), landmark=np.array([3, 4, 5, 5, 5]), n_landmarks=6)
DETECTION = np.array([0, 0, 1, 2, 3])


def test_the_best_of_a_detection_and_of_a_landmark_by_hand():
    best = labelling._alone(DETECTION, PAIRED, np.array([2.0, 1.0, 5.0, 4.0, 9.0]))
    assert best.tolist() == [False, True, False, True, True]


@pytest.mark.parametrize(
    ("fits", "only"),
    [
        ([1, 1, 1, 1, 1], [0, 0, 0, 0, 1]),
        ([1, 0, 1, 0, 0], [1, 0, 1, 0, 0]),
        ([0, 1, 1, 1, 1], [0, 1, 0, 0, 1]),
    ],
)
def test_what_fits_two_is_given_to_none_by_hand(fits, only):
    """Neither a detection with two landmarks nor a landmark with two detections in its image; another image is free."""
    assert labelling._only(DETECTION, PAIRED, np.array(fits, dtype=bool)).tolist() == [bool(x) for x in only]


def placements(explained, chance, turn_deg=(0.0, 1.0), detections=30):
    """Rotations about z that explain so many of the detections, and candidates with a gate of 0.1 deg."""
    C = so3.exp(np.array([[0.0, 0.0, angle] for angle in turn_deg]) * DEG)
    sight = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    candidates = SimpleNamespace(
        number_explained=lambda R: explained[int(np.argmin([np.abs(R - one).max() for one in C]))],
        by_chance=chance,
        detections=detections,
        detection=np.arange(2),
        directions=SimpleNamespace(e_K=sight),
        gate=np.full(2, (0.1 * DEG) ** 2),
    )
    return candidates, C


@pytest.mark.parametrize(
    ("explained", "chance", "believed"),
    [(3, 1e-9, False), (4, 1e-9, True), (9, 0.90, True), (9, 0.95, False)],
)
def test_a_placement_is_believed_from_4_detections_on_that_chance_does_not_explain(
    explained, chance, believed
):
    """Two of the nine are those it was made from: 7 or more by chance in either of two rotations, 1e-4 at most."""
    c, C = placements((explained, 0), chance, (0.0, 0.01))
    if explained > 4:
        assert (2.0 * stats.poisson.sf(explained - 3, chance) < 1e-4) == believed
    said = placement._doubt(c, C, np.array([9.0, 0.0]), 0)
    assert said == (
        ""
        if believed
        else f"no placement of the landmarks explains more than {explained} of the 30 detections, "
        "which chance does as well"
    )


@pytest.mark.parametrize(
    ("explained", "chance", "believed"),
    [
        ((12, 8), 0.033, False),
        ((12, 8), 0.031, True),
        ((12, 9), 0.0101, False),
        ((12, 9), 0.0099, True),
        ((25, 6), 3.0, False),
        ((25, 5), 3.0, True),
    ],
)
def test_two_placements_are_told_apart_by_odds_of_a_million(explained, chance, believed):
    """Each match that the rival lacks is worth 1 / chance, at least 2: 31.6^4, 100^3 and 2^19.9 are a million."""
    c, C = placements(explained, chance)
    said = placement._doubt(c, C, np.array([11.0, 7.0]), 0)
    assert said == (
        ""
        if believed
        else f"two placements of the landmarks, 1 deg apart, explain {explained[0]} and {explained[1]} "
        "of the 30 detections, too similar a number to decide between them"
    )


@pytest.mark.parametrize(("turn_deg", "same"), [(0.19, True), (0.21, False)])
def test_placements_within_twice_the_gate_are_one(turn_deg, same):
    """A neighbour of the best explains as much without being a rival."""
    c, C = placements((12, 12), 0.05, (0.0, turn_deg))
    assert (placement._doubt(c, C, np.array([11.0, 10.9]), 0) == "") is same


def test_what_chance_explains_by_hand():
    """Gates of 4 sigma, twice the sighting's own and the image's variance, over the area within reach."""
    own, shared = np.array([1e-4, 1e-4, 1.0]), np.array([1e-4, 3e-4, 0.0])
    directions = Directions(np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3, int), own, shared)
    c = placement.Candidates(None, np.arange(3), directions, 3, 0.01)
    np.testing.assert_allclose(c.gate, [16.0 * 4e-8, 16.0 * 20e-8, 32.0])
    assert c.by_chance == pytest.approx(0.0064 + 0.032 + 1.0)


@pytest.mark.parametrize(
    ("candidates", "said"),
    [
        (0, "no landmark lies within 2 deg of any detection's predicted place"),
        (3, "no two detections of an image match two landmarks within 2 deg of their predicted places"),
    ],
)
def test_why_there_is_no_placement(candidates, said):
    c = SimpleNamespace(detection=np.arange(candidates), reach=2.0 * DEG)
    assert placement._why_nothing(c).startswith(said)


def test_one_detection_an_image_matches_nothing(rng):
    """Pairs of one image fix a rotation: without any the model mounting stays, and the reason says what is missing."""
    true = truth(FRAME, 3, 6)
    campaign, d, _ = unnamed(true, rng, clutter=0.0)
    first = np.array([np.flatnonzero(d.image == i)[0] for i in range(3)])
    alone = Detections(d.image[first], d.column_px[first], d.row_px[first], d.sigma_px[first])
    found = label(campaign, alone)
    assert found.refusal.startswith("no two detections of an image match")
    np.testing.assert_array_equal(found.C_EK, campaign.C_EK)


def exact(shift_sigma, twin):
    """Exact detections in two images, the first (or a second one of its marker) so many sigmas of 0.3 px aside."""
    true = truth(FRAME, 2, 8, sigmas=replace(SIGMAS, landmark=np.full(3, 1e-3)))
    s = true.sightings
    pick = np.append(np.arange(s.image.size), 0) if twin else np.arange(s.image.size)
    column = s.column_px[pick].copy()
    column[-1 if twin else 0] += 0.3 * shift_sigma
    model = replace(true, C_EK=so3.exp(np.array([0.2, -0.1, 0.3]) * DEG) @ C_EK_TRUE)
    return model, Detections(s.image[pick], column, s.row_px[pick], np.full(pick.size, 0.3))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shift_sigma", "twin", "first", "last"),
    [
        (3.3, False, Label.LABELLED, Label.LABELLED),
        (5.0, False, Label.NO_LANDMARK, Label.LABELLED),
        (3.3, True, Label.AMBIGUOUS, Label.AMBIGUOUS),
        (5.0, True, Label.AMBIGUOUS, Label.NO_LANDMARK),
        (7.5, True, Label.LABELLED, Label.NO_LANDMARK),
    ],
)
def test_a_detection_fits_to_one_in_a_thousand_and_is_a_rival_to_twice_that(shift_sigma, twin, first, last):
    """T, the square of the shift less a share that the image's own errors take up, has the critical value 13.8.

    3.3 sigma are 10.9 at most, 5 sigma 25 at most and above 13.8, 7.5 sigma (56 at most) above 27.6.
    """
    found = label(*exact(shift_sigma, twin))
    assert found.refusal == ""
    assert (found.label[0], found.label[-1]) == (first, last)
    assert np.all(found.label[1:-1] == Label.LABELLED)
