"""What errors of the reference do to the chips of an image, by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from starplumb.imagery.own_scatter import moved_px, seen_of_reference
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
