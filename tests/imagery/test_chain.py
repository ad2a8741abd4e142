"""The whole way from raw images to sightings, in a small world whose cameras are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from world import RawArray, world

from starplumb.imagery.acquisition import Peak, acquire, peak, standing
from starplumb.imagery.candidates import candidate_places, structure
from starplumb.imagery.chain import Wanted, floor_of, measure_image, measure_images
from starplumb.imagery.chips import unlikely
from starplumb.imagery.matching.least_squares import Match
from starplumb.imagery.pointing import pointed
from starplumb.imagery.scene import Scene, binned, reduced
from starplumb.imagery.verdicts import Brightness, Verdict
from starplumb.physics import so3
from starplumb.plan.demo import demo
from starplumb.table.geometry import project

PIXEL = 9e-6 / 2.2
MOUNTING = np.diag(np.array([20.0, 20.0, 20.0]) * PIXEL) ** 2
OWN = np.diag(np.array([4.0, 4.0, 4.0]) * PIXEL) ** 2
FEW = Wanted(grid=(4, 4))


def errors(scene, rotations, measured):
    """Errors (n, 2) of the chips used of images, by the rotations that took them, and the same over their sigmas."""
    e, z = [], []
    for image in measured:
        used = image.used
        p_J = np.array([c.p_J for c in used])
        index = np.full(len(used), image.image)
        true = project(scene.campaign, rotations[image.image], index, p_J)
        off = np.array([c.pixel for c in used]) - true
        L = np.linalg.cholesky(np.array([c.covariance for c in used]))
        e.append(off)
        z.append(np.linalg.solve(L, off[..., None])[..., 0])
    return np.concatenate(e), np.concatenate(z)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["frame", "line-scan"])
def test_images_that_are_off_by_many_pixels_are_measured_to_a_hundredth_with_honest_sigmas(rng, kind):
    scene, rotations = world(rng, kind)
    measured = list(measure_images(scene, MOUNTING, OWN, FEW))
    assert [image.reason for image in measured] == ["", ""]
    e, z = errors(scene, rotations, measured)
    assert len(e) >= 28
    assert np.abs(e).max() < 0.1
    # 56 numbers or more: their rms is known to a tenth
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.35


@pytest.mark.slow
def test_cloud_is_refused_and_an_image_of_somewhere_else_left_out(rng):
    scene, rotations = world(rng, images=3)
    clouded = scene.raws[0].values.copy()
    clouded[:, :100] = 2500.0 + 5.0 * rng.normal(size=(240, 100))
    raws = (RawArray(clouded), RawArray(scene.raws[1].values.T.copy()), scene.raws[2])
    scene = replace(scene, raws=raws)
    first, second, third = measure_images(scene, MOUNTING, OWN, FEW)
    under = [chip.candidate for chip in first.chips if chip.candidate.pixel[0] < 70.0]
    assert under
    assert {c.verdict for c in under} == {Verdict.CLOUD}
    assert "bright" in under[0].reason
    assert second.reason.startswith("transposed it is found")
    assert not second.chips
    assert not third.reason
    e, z = errors(scene, rotations, [first, third])
    assert np.abs(e).max() < 0.1
    assert np.sqrt(np.mean(z**2)) < 1.5


@pytest.mark.slow
def test_where_no_place_stands_out_no_image_is_measured(rng):
    scene, _ = world(rng, images=1, size=140)
    scene = replace(scene, raws=(RawArray(rng.normal(900.0, 100.0, (140, 140))),))
    (only,) = measure_images(scene, MOUNTING, OWN, FEW)
    assert "no place of the search stands out" in only.reason
    assert not only.chips


@pytest.mark.slow
def test_a_turn_about_the_boresight_is_found(rng):
    scene, rotations = world(rng, images=1)
    turned = so3.exp(np.array([0.0, 0.0, 0.03]))
    scene = replace(scene, campaign=replace(scene.campaign, C_EK=scene.campaign.C_EK @ turned))
    sigma = np.array([20.0 * PIXEL, 20.0 * PIXEL, 0.02])
    acquired = acquire(scene, sigma, np.full(3, 4.0 * PIXEL))
    assert acquired.clear
    assert abs(so3.log(rotations[0].T @ acquired.C_EK[0])[2]) < 0.015
    found = measure_image(scene, acquired, 0, sigma, FEW)
    assert not found.reason
    assert np.abs(so3.log(rotations[0].T @ found.C_EK)[:2]).max() < 0.1 * PIXEL
    assert abs(so3.log(rotations[0].T @ found.C_EK)[2]) < 3e-4


def flat_scene():
    campaign, _ = demo("frame", 2, 3)
    return Scene(campaign, (), None, lambda latitude, _: np.full(latitude.shape, 120.0), 30.0)


def test_the_rotation_of_an_image_is_found_among_wrong_places(rng):
    scene = flat_scene()
    true = scene.campaign.C_EK @ so3.exp(PIXEL * np.array([30.0, -20.0, 9.0]))
    pixel = rng.uniform(0.0, 11_999.0, (60, 2))
    p_J = scene.ground(true, 1, pixel)
    wrong = np.arange(60) % 5 < 2
    seen = pixel + np.where(wrong[:, None], rng.uniform(-40.0, 40.0, (60, 2)), rng.normal(0.0, 0.1, (60, 2)))
    fitted = pointed(scene.campaign, scene.campaign.C_EK, 1, seen, p_J, 1.0, np.full(3, 100.0 * PIXEL))
    np.testing.assert_array_equal(fitted.agrees, ~wrong)
    off = so3.log(true.T @ fitted.C_EK) / PIXEL
    assert np.abs(off[:2]).max() < 0.15
    # a tenth of a pixel at 3 000 px from the axis
    assert abs(off[2]) < 1e-4 / PIXEL
    assert np.std(fitted.residual_px[~wrong]) == pytest.approx(0.1, rel=0.25)


def test_ground_that_is_not_known_gives_no_point():
    scene = replace(flat_scene(), height_at=lambda latitude, _: np.full(latitude.shape, np.nan))
    assert np.isnan(scene.ground(scene.campaign.C_EK, 0, np.array([[10.0, 20.0]]))).all()


def test_binning_takes_means_of_what_is_known(rng):
    values = rng.normal(size=(7, 9))
    values[0, 0] = np.nan
    values[2:4, 2:4] = [[np.nan, np.nan], [np.nan, 5.0]]
    ours = binned(values, 2)
    assert ours.shape == (3, 4)
    assert ours[0, 0] == pytest.approx(np.mean([values[0, 1], values[1, 0], values[1, 1]]))
    assert np.isnan(ours[1, 1])
    assert ours[2, 3] == pytest.approx(values[4:6, 6:8].mean())
    raw = RawArray(rng.normal(size=(103, 57)))
    np.testing.assert_allclose(reduced(raw, 5), binned(raw.values, 5))


def test_of_a_cell_the_place_with_structure_is_taken(rng):
    values = 100.0 + 0.01 * rng.normal(size=(300, 300))
    values[120:170, 120:170] += rng.normal(size=(50, 50)) * 20.0
    places = candidate_places(RawArray(values), (1, 1), 48, 8)
    np.testing.assert_allclose(places, [[149.5, 149.5]], atol=30.0)
    assert candidate_places(RawArray(values), (3, 2), 48, 8).shape == (6, 2)
    assert candidate_places(RawArray(values[:50]), (3, 2), 48, 8).shape == (0, 2)
    stripes = np.tile(np.sin(np.arange(48.0)), (48, 1))
    assert structure(stripes) < 1e-12
    assert structure(stripes + stripes.T) > 1e-3
    assert structure(np.full((48, 48), np.nan)) == 0.0


def test_chips_of_neighbouring_cells_do_not_show_the_same_pixels_twice(rng):
    values = np.zeros((200, 200))
    # all structure about the corner of four cells
    values[76:124, 76:124] = rng.normal(size=(48, 48))
    places = candidate_places(RawArray(values), (4, 4), 48, 8)
    apart = np.abs(places[:, None] - places).max(axis=-1)[np.triu_indices(len(places), 1)]
    assert len(places) > 8
    assert apart.min() >= 24.0
    best = places[np.argmin(np.abs(places - 99.5).max(axis=1))]
    assert np.abs(best - 99.5).max() < 15.0
    # cells smaller than a chip's half: some have no place of their own
    crowded = candidate_places(RawArray(rng.normal(size=(120, 120))), (6, 6), 48, 8)
    assert 4 <= len(crowded) < 36


def test_a_bare_window_is_told_by_its_brightness():
    brightness = Brightness.of(np.linspace(0.0, 1000.0, 1001)[None])
    assert brightness.bare(np.full((4, 4), 990.0))[0] == Verdict.CLOUD
    assert brightness.bare(np.full((4, 4), 20.0))[0] == Verdict.WATER
    assert brightness.bare(np.full((4, 4), 480.0))[0] == Verdict.NO_TEXTURE


def test_cloud_is_told_from_a_bright_field_by_the_values_of_its_image(rng):
    ground = rng.normal(900.0, 100.0, (200, 200))
    cloudy = ground.copy()
    cloudy[:, :40] = rng.normal(2400.0, 60.0, (200, 40))
    field = rng.normal(1080.0, 20.0, (48, 48))
    assert not Brightness.of(ground).clouded(field)
    of_cloudy = Brightness.of(cloudy)
    assert not of_cloudy.clouded(field)
    field[:, :12] = 2400.0
    assert of_cloudy.clouded(field)
    field[:, 4:] = 900.0
    assert not of_cloudy.clouded(field)


def found_with(agreement=0.9, kept=0.9, sigma=0.02, place=(23.5, 23.5)):
    none = np.zeros((48, 48))
    covariance = np.diag([sigma**2, 1e-4])
    return Match(
        np.array(place), np.zeros(2), covariance, np.zeros((2, 2)), 1.0, 0.0, agreement, kept, none, none
    )


@pytest.mark.parametrize(
    ("found", "shift", "verdict"),
    [
        (found_with(), (0.0, 0.0), None),
        (found_with(agreement=-0.9), (0.0, 0.0), None),
        (found_with(agreement=0.3), (0.0, 0.0), Verdict.NO_MATCH),
        (found_with(kept=0.1), (0.0, 0.0), Verdict.CHANGED),
        (found_with(agreement=0.45, kept=0.2), (0.0, 0.0), Verdict.CHANGED),
        (found_with(sigma=0.3), (0.0, 0.0), Verdict.NO_TEXTURE),
        # a window that lies by a shift lower in the piece is found by as much higher
        (found_with(place=(22.0, 24.5)), (1.5, -1.0), None),
        (found_with(place=(22.0, 24.5)), (0.0, 0.0), Verdict.NO_MATCH),
    ],
)
def test_a_match_is_believed_by_what_it_says_of_itself(found, shift, verdict):
    refused = unlikely(found, Peak(np.array(shift), 9.0, 1.0))
    assert (None if refused is None else refused[0]) == verdict


def test_the_floor_is_what_residuals_scatter_beyond_their_sigmas(rng):
    variance = rng.uniform(0.01, 0.03, (400, 2)) ** 2
    own = rng.normal(size=(400, 2)) * np.sqrt(variance)
    assert floor_of(own, variance) < 0.01
    more = own + rng.normal(0.0, 0.05, (400, 2))
    more[:40] += 3.0
    assert floor_of(more, variance) == pytest.approx(0.055, abs=0.01)
    assert floor_of(more[:2], variance[:2]) == 0.0


def test_a_peak_is_told_from_the_next_and_placed_between_cells():
    y, x = np.mgrid[-20:21, -20:21].astype(float)
    rough = 0.05 * np.sin(37.0 * x + 11.0 * y**2)
    surface = rough + np.exp(-((x - 6.3) ** 2 + (y + 4.2) ** 2) / 4.0)
    surface += 0.5 * np.exp(-((x + 9.0) ** 2 + y**2) / 4.0)
    found = peak(standing(surface))
    np.testing.assert_allclose(found.shift, [6.3, -4.2], atol=0.1)
    assert found.height / found.second == pytest.approx(2.0, rel=0.15)
    assert not standing(np.full((9, 9), 3.0)).any()
