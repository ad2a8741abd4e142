"""What errors of the reference do to the chips of an image, by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from starplumb.imagery.own_scatter import moved_px, seen_of_reference, unexplained_px
from starplumb.imagery.scene import Scene
from starplumb.plan.demo import demo
from starplumb.table.geometry import stations

PIXEL = 9e-6 / 2.2


def seen(pixel):
    campaign, _ = demo("frame", 2, 3)
    scene = Scene(campaign, (), None, lambda latitude, _: np.full(latitude.shape, 100.0), 30.0)
    p_J = scene.ground(campaign.C_EK, 0, np.asarray(pixel, dtype=float))
    used = [SimpleNamespace(p_J=p) for p in p_J]
    return scene, SimpleNamespace(image=0, C_EK=campaign.C_EK, used=used), p_J


PLACES = [[1000.0, 1000.0], [6000.0, 6000.0], [11000.0, 3000.0]]


def test_a_metre_of_height_moves_a_chip_by_its_parallax():
    scene, image, p_J = seen(PLACES)
    moved = moved_px(scene, image, p_J)
    r_J = stations(scene.campaign, np.zeros(3, int), np.array(PLACES)[:, 1]).r_J
    sight = p_J - r_J
    up = p_J / np.linalg.norm(p_J, axis=-1, keepdims=True)
    distance = np.linalg.norm(sight, axis=-1)
    across = np.sqrt(1.0 - np.sum(up * sight, axis=-1) ** 2 / distance**2)
    # the sphere's vertical is within 0.2 deg of the ellipsoid's, a pixel's angle within 1 % of that at the axis
    np.testing.assert_allclose(
        np.linalg.norm(moved[..., 2], axis=-1),
        across / distance / PIXEL,
        rtol=0.02,
        atol=0.004 / 600e3 / PIXEL,
    )
    # a metre along the ground, in a direction across the line of sight, is a pixel's part of its own size
    level = np.linalg.norm(moved[..., :2], axis=(-2, -1))
    cosine = np.sqrt(1.0 - across**2)
    np.testing.assert_allclose(level, np.sqrt(1.0 + cosine**2) / distance / PIXEL, rtol=0.02)


def test_what_chips_share_does_not_scatter_them():
    scene, image, p_J = seen(PLACES)
    sigma = np.array([0.5, 0.5, 3.0])
    alone = seen_of_reference(scene, image, sigma, 0.0)
    moved = moved_px(scene, image, p_J)
    by_hand = np.mean([np.trace(m @ np.diag(sigma**2) @ m.T) for m in moved]) / 2.0
    assert alone == pytest.approx(by_hand, rel=1e-12)
    apart = [np.linalg.norm(p_J[i] - p_J[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
    shared = np.mean(np.exp(-np.array(apart) / 5000.0))
    assert seen_of_reference(scene, image, sigma, 5000.0) == pytest.approx(alone * (1.0 - shared), rel=1e-12)
    assert seen_of_reference(scene, image, sigma, 1e9) < 1e-4 * alone


SIGMA_M, LENGTH_M, MATCHED_PX = np.array([0.1, 0.1, 0.3]), 20e3, 0.02


def scattered(rng, extra_px, images=40):
    """Images of sixteen chips whose residuals are matching's errors, the reference's by its covariance, a rotation's
    and more of ``extra_px``."""
    grid = [[c, r] for c in (2000.0, 4500.0, 7000.0, 9500.0) for r in (2000.0, 4500.0, 7000.0, 9500.0)]
    scene, image, p_J = seen(grid)
    moved, n = moved_px(scene, image, p_J), len(p_J)
    apart = np.linalg.norm(p_J[:, None] - p_J, axis=-1)
    root = np.linalg.cholesky(np.exp(-apart / LENGTH_M))
    for _ in range(images):
        error_m = root @ rng.normal(0.0, SIGMA_M, (n, 3))
        residual = np.einsum("nak,nk->na", moved, error_m) + rng.normal(0.0, 5.0, 2)
        residual += rng.normal(0.0, np.hypot(MATCHED_PX, extra_px), (n, 2))
        told = zip(p_J, residual, strict=True)
        covariance = MATCHED_PX**2 * np.eye(2)
        used = [SimpleNamespace(p_J=p, residual_px=r, covariance=covariance) for p, r in told]
        yield scene, SimpleNamespace(image=0, C_EK=image.C_EK, used=used)


@pytest.mark.parametrize("extra_px", [0.05, 0.2])
def test_what_neither_matching_nor_the_reference_explains_is_found_again(rng, extra_px):
    """Of 1160 degrees of freedom, so to some 2 to 3 %."""
    each = list(scattered(rng, extra_px))
    found = unexplained_px(each[0][0], [image for _, image in each], SIGMA_M, LENGTH_M)
    assert found == pytest.approx(extra_px, rel=0.1)


def test_errors_of_neighbours_are_no_scatter_of_their_own(rng):
    """One image alone is explained by its own sigmas and the reference's in about half of the cases, and nearly so in
    the others; without the reference it would be 0.027 px on average."""
    found = [unexplained_px(scene, [image], SIGMA_M, LENGTH_M) for scene, image in scattered(rng, 0.0)]
    assert np.mean(np.array(found) == 0.0) > 0.3
    assert np.sqrt(np.mean(np.square(found))) < 0.7 * MATCHED_PX


def test_nothing_is_said_of_no_image():
    scene, image, _ = seen(PLACES)
    assert unexplained_px(scene, [], SIGMA_M, LENGTH_M) == 0.0
    image.used = []
    assert unexplained_px(scene, [image], SIGMA_M, LENGTH_M) == 0.0
