"""Orientation correlation: by symmetry and against the plain sums."""

from __future__ import annotations

import numpy as np
from blobs import Blobs, grid

from starplumb.imagery.matching.orientation import agreement, correlation, orientation


def test_a_slope_has_the_doubled_angle_of_its_gradient():
    x, y = grid(31)
    for angle in (0.0, 0.4, 1.3, 2.5):
        q = orientation(np.cos(angle) * x + np.sin(angle) * y)[10:-10, 10:-10]
        np.testing.assert_allclose(q, np.exp(2j * angle), atol=1e-6)


def test_a_reversed_contrast_is_the_same_and_a_quarter_turn_the_opposite(rng):
    image = Blobs.draw(rng).at(*grid(60))
    q = orientation(image)
    np.testing.assert_allclose(orientation(-3.0 * image + 7.0), q, atol=1e-9)
    np.testing.assert_allclose(orientation(np.rot90(image)), -np.rot90(q), atol=1e-9)
    assert np.abs(q).max() <= 1.0 + 1e-12


def test_near_missing_pixels_and_on_flat_ground_there_is_no_orientation(rng):
    image = Blobs.draw(rng).at(*grid(60))
    holed = image.copy()
    holed[20:25, 30:40] = np.nan
    q = orientation(holed)
    assert not q[18:27, 30:40].any()
    assert not q[20:25, 28:42].any()
    np.testing.assert_allclose(np.angle(q[:10, :10]), np.angle(orientation(image)[:10, :10]), atol=1e-9)
    assert not orientation(np.full((20, 20), 5.0)).any()
    assert not orientation(np.full((20, 20), np.nan)).any()


def test_the_correlation_is_the_plain_sum_over_the_chip(rng):
    search, chip = (np.exp(1j * rng.uniform(0, 7, shape)) for shape in ((12, 14), (5, 4)))
    search[3:6, 7:9] = 0.0
    search[0, 0] *= 0.3
    ours = correlation(search, chip)
    assert ours.shape == (8, 11)
    for i, j in np.ndindex(8, 11):
        part = search[i : i + 5, j : j + 4]
        there = np.abs(part) > 0
        expected = np.sum(part * chip.conj()).real / np.sqrt(
            np.sum(np.abs(part) ** 2) * np.sum(np.abs(chip[there]) ** 2)
        )
        np.testing.assert_allclose(ours[i, j], expected, atol=1e-12)


def test_a_chip_is_found_where_it_was_cut_out_under_noise_and_a_bright_edge(rng):
    image = Blobs.draw(rng, 160.0, 400).at(*grid(140))
    search = -image + rng.normal(0.0, 0.1, image.shape)
    search[:, 100:] += 50.0
    c = correlation(orientation(search), orientation(image[30:78, 45:93]))
    assert np.unravel_index(np.argmax(c), c.shape) == (30, 45)
    far = c.copy()
    far[26:35, 41:50] = 0.0
    assert c.max() > 2.0 * far.max()


def test_agreement_tells_the_same_from_the_unlike(rng):
    image, other = Blobs.draw(rng).at(*grid(60)), Blobs.draw(rng).at(*grid(60))
    mixed = image.copy()
    mixed[:, 30:] = other[:, 30:]
    a = agreement(orientation(image), orientation(mixed))
    assert a[5:-5, 5:18].min() > 0.9
    assert np.mean(a[5:-5, 42:-5]) < 0.4
