"""Wrong sightings that agree among themselves: the images choose between clusters, and the loser is a rival."""

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.agreement import Clusters, agreed, contradicting, large
from starplumb.estimators.protocol import Status
from starplumb.estimators.robust import Robust
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure


def clusters(rng, image, share, d_arcsec, rows=None):
    """Clusters of 5 arc seconds each."""
    image = np.asarray(image)
    found = tuple(np.zeros(5, dtype=np.int64) for _ in image) if rows is None else rows
    d_E = ARCSEC * (
        np.asarray(d_arcsec)[:, None] * np.array([1.0, 0.0, 0.0]) + rng.normal(0.0, 5.0, (image.size, 3))
    )
    S_E = np.tile((5.0 * ARCSEC) ** 2 * np.eye(3), (image.size, 1, 1))
    return Clusters(image, found, np.asarray(share), d_E, S_E)


def test_the_smaller_clusters_win_where_they_alone_agree(rng):
    """Six images: 40 % of each say 0, 60 % of each another angle far apart."""
    off = [300.0, -300.0, 600.0, -600.0, 900.0, -900.0]
    found = clusters(rng, np.repeat(range(6), 2), [0.4, 0.6] * 6, np.ravel([[0.0, angle] for angle in off]))
    answer = agreed(found)
    np.testing.assert_array_equal(np.sort(answer.clusters), range(0, 12, 2))
    np.testing.assert_allclose(answer.S_E, (5.0 * ARCSEC) ** 2 / 6.0 * np.eye(3), atol=1e-20)
    np.testing.assert_allclose(answer.d_E, np.mean(found.d_E[::2], axis=0), atol=1e-15)
    assert 1.5 < answer.votes < 2.4


def test_an_image_has_one_vote(rng):
    """Four clusters of one image against one each of two."""
    found = clusters(rng, [0, 0, 0, 0, 1, 2], [0.25] * 4 + [1.0, 1.0], [500.0] * 4 + [0.0, 0.0])
    np.testing.assert_array_equal(np.sort(agreed(found).clusters), [4, 5])


def test_a_cluster_half_as_large_as_the_largest_may_be_right_and_a_smaller_one_not(rng):
    found = clusters(rng, [0, 0, 0, 1], [0.6, 0.3, 0.29, 0.2], [0.0] * 4)
    np.testing.assert_array_equal(large(found).share, [0.6, 0.3, 0.2])


def test_three_rejected_sightings_that_agree_contradict(rng):
    rows = (np.arange(3), np.arange(3, 5), np.arange(5, 9))
    found = clusters(rng, [0, 0, 1], [0.3, 0.2, 1.0], [0.0] * 3, rows)
    used = np.zeros(9, dtype=bool)
    assert contradicting(found, used).size == 2
    used[[5, 6]] = True  # half of the third are used
    np.testing.assert_array_equal(contradicting(found, used).image, [0])


def shifted(o, share, px, rng, *, alike):
    """A share of each image's markers moved together; in all images alike, or each in a direction of its own."""
    xy, turn = o.xy_K.copy(), rng.uniform(0.0, 2.0 * np.pi)
    for image in range(o.n_images):
        mine = np.flatnonzero(o.image == image)
        chosen = rng.choice(mine, round(share * mine.size), replace=False)
        turn = turn if alike else rng.uniform(0.0, 2.0 * np.pi)
        move = px * np.array([np.cos(turn), np.sin(turn)])
        xy[chosen] += (o.slope_K[chosen] @ move[:, None])[..., 0]
    return replace(o, xy_K=xy)


def test_most_markers_of_each_image_shifted_together_are_found(rng):
    """60 % of each image by 100 pixels, each image in another direction: the 40 % that agree are right."""
    o = observe(truth(FRAME, 8, 15))
    table = shifted(measure(o, C_EK_TRUE, Errors.draw(o, rng)), 0.6, 100.0, rng, alike=False)
    estimate = Robust()(table, C_EK_TRUE)
    assert estimate.status == Status.OK
    assert np.max(np.abs(so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E)) < 4.0
    assert 0.1 < estimate.rival.support < 0.8


@pytest.mark.parametrize("share", [0.4, 0.5])
def test_markers_shifted_alike_everywhere_support_a_rival_where_they_point(share, rng):
    """The rival's rotation is that of the shift, and its support the ratio of the two shares."""
    o = observe(truth(FRAME, 8, 20))
    table = shifted(measure(o, C_EK_TRUE, Errors.draw(o, rng)), share, 100.0, rng, alike=True)
    estimate = Robust()(table, C_EK_TRUE)
    rival = estimate.rival
    assert rival.images == 8
    assert rival.support == pytest.approx(share / (1.0 - share), abs=0.2)
    assert (estimate.status == Status.REFUTED) == (share == 0.5)
    if share == 0.4:
        pixel = 9e-6 / 2.2
        assert np.linalg.norm(rival.turn_E) == pytest.approx(100.0 * pixel, rel=0.2)


def test_good_sightings_have_no_rival(rng):
    o = observe(truth(FRAME, 6, 12))
    for _ in range(4):
        assert Robust()(measure(o, C_EK_TRUE, Errors.draw(o, rng)), C_EK_TRUE).rival.support == 0.0
