"""Algorithm 1: attitude and position from one image, and where it cannot be used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from harness import scene, still

from by_hand import H, R, by_hand
from problems import C_EK_TRUE, FRAME, SIGMAS, truth
from starplumb.estimators.protocol import Status
from starplumb.estimators.published.projective import Projective
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.plan.scene import mark_pixels
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure


def test_position_by_hand():
    """The camera over 0 N 0 E at height H, from coplanar markers alone: a wrong orbit changes nothing.

    The markers lie on the plane x = R of J, whose normal is the vertical at the point below the camera; the level frame
    stands at their mean, 1 km off, so heights of centimetres are removed with the (wrong) orbit: a millimetre.
    """
    o = by_hand()
    wrong = replace(o, r_J=o.r_J + np.array([40.0, 300.0, -200.0]))
    # the geometry as the wrong orbit has it
    u = wrong.p_J - wrong.r_J
    range_m = np.linalg.norm(u, axis=-1)
    e_E = (wrong.C_EJ @ (u / range_m[:, None])[..., None])[..., 0]
    found = Projective()(replace(wrong, e_E=e_E, range_m=range_m), so3.exp([1e-3, 0.0, 0.0]))
    np.testing.assert_allclose(found.r_J, [[R + H, 0.0, 0.0]], atol=1.0)
    assert np.abs(so3.log(found.C_EK)).max() < 0.5 * ARCSEC


def test_position_of_every_image():
    o = still(scene("frame"))
    found = Projective()(o, so3.exp([0.0, 2e-3, 0.0]) @ C_EK_TRUE)
    first = [np.flatnonzero(o.image == i)[0] for i in range(o.n_images)]
    np.testing.assert_allclose(found.r_J, o.r_J[first], atol=1e-3)


def test_heights_ignored_bias_it():
    """Markers scattered over 50 m of height: removed, the truth; ignored, as published, far off."""
    draw = np.random.default_rng(5)
    image, pixel = np.zeros(12, dtype=np.int64), draw.uniform(500.0, 11500.0, (12, 2))
    empty = truth(FRAME, images=1, markers=1, tilt_deg=0.0)
    o = still(observe(mark_pixels(empty, image, pixel, draw.uniform(0.0, 50.0, 12), SIGMAS)))
    removed = so3.log(Projective()(o, C_EK_TRUE).C_EK @ C_EK_TRUE.mT)
    ignored = so3.log(Projective(heights="ignored")(o, C_EK_TRUE).C_EK @ C_EK_TRUE.mT)
    assert np.abs(removed).max() < 1e-5 * ARCSEC
    assert 100.0 * ARCSEC < np.linalg.norm(ignored) < 1000.0 * ARCSEC


def test_tilt_trades_against_position(rng):
    """Hundreds of times the sigma of the methods that use the orbit, and the stated sigma says so."""
    o = scene("frame")
    found = Projective()(measure(o, C_EK_TRUE, Errors.draw(o, rng, (200,))), C_EK_TRUE)
    error = so3.log(found.C_EK @ C_EK_TRUE.mT)
    across = np.abs(np.array([C_EK_TRUE[:, 0] @ e for e in error])).mean()
    assert across > 100.0 * ARCSEC


def test_images_it_cannot_use_are_left_out(rng):
    """Three markers in one image, four on a line in another, six in the third: the answer is the third's alone."""
    o = still(scene("frame"))
    rows = {i: np.flatnonzero(o.image == i) for i in range(3)}
    on_a_line = replace(o, **line(o, rows[1]))
    keep = np.concatenate([rows[0][:3], rows[1][:4], rows[2]])
    found = Projective()(on_a_line.select(keep), C_EK_TRUE)
    assert found.status == Status.OK
    assert np.isnan(found.r_J[:2]).all()
    alone = Projective()(o.select(rows[2]), C_EK_TRUE)
    assert np.abs(so3.log(found.C_EK @ alone.C_EK.mT)).max() < 1e-6 * ARCSEC
    np.testing.assert_allclose(found.covariance_E, alone.covariance_E, rtol=1e-6)


def line(o, rows):
    """Sightings of an image moved onto one line in it, geometry and all."""
    xy, e_E = o.xy_K.copy(), o.e_E.copy()
    xy[rows] = np.linspace(-0.01, 0.01, rows.size)[:, None] * [1.0, 0.5]
    s = np.concatenate([xy[rows], np.ones((rows.size, 1))], axis=-1)
    e_E[rows] = (s / np.linalg.norm(s, axis=-1, keepdims=True)) @ C_EK_TRUE.mT
    return {"xy_K": xy, "e_E": e_E}


@pytest.mark.parametrize("markers", [1, 3])
def test_too_few_markers_everywhere_is_singular(markers):
    o = still(scene("frame"))
    found = Projective()(o.select(np.arange(o.n) % 6 < markers), C_EK_TRUE)
    assert found.status == Status.SINGULAR
    assert np.all(np.isinf(found.covariance_E))
    np.testing.assert_array_equal(found.C_EK, C_EK_TRUE)
