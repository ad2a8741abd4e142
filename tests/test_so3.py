"""Rotations: against hand, SciPy, group laws and differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG

ANGLES = np.array(
    [0.0, 1e-300, 1e-12, 0.02 * ARCSEC, 2 * ARCSEC, 200 * ARCSEC, DEG, 0.0999, 0.1001, 1.0, 3.0, 179.9 * DEG]
)
AXES = ["x", "y", "z"]


def rotation_vectors(rng, angles=ANGLES):
    """One random axis for each angle, (n, 3)."""
    axis = rng.standard_normal((len(angles), 3))
    return angles[:, None] * axis / np.linalg.norm(axis, axis=-1, keepdims=True)


def test_a_quarter_turn_about_each_axis_carries_the_next_axis_into_the_one_after():
    x, y, z = np.eye(3)
    quarter = 90 * DEG
    np.testing.assert_allclose(so3.exp(quarter * z) @ x, y, atol=1e-15)
    np.testing.assert_allclose(so3.exp(quarter * x) @ y, z, atol=1e-15)
    np.testing.assert_allclose(so3.exp(quarter * y) @ z, x, atol=1e-15)


def test_skew_is_the_cross_product(rng):
    v, w = rng.standard_normal((2, 5, 3))
    np.testing.assert_allclose((so3.skew(v) @ w[..., None])[..., 0], np.cross(v, w), atol=1e-15)
    np.testing.assert_array_equal(so3.skew([0, 0, 1]) @ [1, 0, 0], [0, 1, 0])


def test_exp_is_scipys_and_the_matrix_exponential(rng):
    v = rotation_vectors(rng)
    np.testing.assert_allclose(so3.exp(v), Rotation.from_rotvec(v).as_matrix(), atol=2e-15)
    for vector in v:
        np.testing.assert_allclose(so3.exp(vector), expm(so3.skew(vector)), atol=2e-14)


def test_log_undoes_exp_to_rounding_at_every_size(rng):
    v = rotation_vectors(rng)
    np.testing.assert_allclose(so3.log(so3.exp(v)), v, rtol=1e-13, atol=2e-16)


@pytest.mark.parametrize("short_of_pi", [1e-3, 1e-6, 1e-9, 0.0])
def test_log_near_half_a_turn_keeps_axis_and_angle(rng, short_of_pi):
    for v in rotation_vectors(rng, np.full(5, np.pi - short_of_pi)):
        found = so3.log(so3.exp(v))
        assert np.linalg.norm(found) == pytest.approx(np.pi - short_of_pi, abs=2e-15)
        # at pi itself v and -v are one rotation
        same = min(np.linalg.norm(found - v), np.linalg.norm(found + v) if short_of_pi < 1e-12 else np.inf)
        assert same < 1e-13


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_quaternion_of_a_turn_about_one_axis(axis):
    expected = np.zeros(4)
    expected[axis], expected[3] = np.sin(0.2), np.cos(0.2)
    np.testing.assert_allclose(so3.to_quaternion(so3.exp(0.4 * np.eye(3)[axis])), expected, atol=1e-16)
    np.testing.assert_allclose(so3.from_quaternion(expected), so3.exp(0.4 * np.eye(3)[axis]), atol=1e-16)


def test_quaternions_are_scipys_whatever_their_sign_and_length(rng):
    q = rng.standard_normal((50, 4))
    expected = Rotation.from_quat(q).as_matrix()
    np.testing.assert_allclose(so3.from_quaternion(q), expected, atol=1e-15)
    np.testing.assert_allclose(so3.from_quaternion(-3.0 * q), expected, atol=1e-15)
    back = so3.to_quaternion(expected)
    assert np.all(back[:, 3] >= 0)
    np.testing.assert_allclose(back, Rotation.from_matrix(expected).as_quat(canonical=True), atol=1e-15)


def test_quaternions_of_half_turns():
    half_turns = np.array([np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1])])
    np.testing.assert_allclose(np.abs(so3.to_quaternion(half_turns)), np.eye(4)[:3], atol=1e-16)


def test_nearest_is_the_polar_factor_and_never_a_mirror(rng):
    C = Rotation.random(random_state=3).as_matrix()
    stretched = C @ (np.eye(3) + 0.1 * np.diag([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(so3.nearest(stretched), C, atol=1e-15)
    mirrored = so3.nearest(C @ np.diag([1.0, 1.0, -0.9]))
    assert np.linalg.det(mirrored) == pytest.approx(1.0)


def test_composition_is_the_product(rng):
    a, b = rotation_vectors(rng), rotation_vectors(rng)
    expected = (Rotation.from_rotvec(a) * Rotation.from_rotvec(b)).as_rotvec()
    np.testing.assert_allclose(so3.log(so3.exp(a) @ so3.exp(b)), expected, atol=1e-13)


@pytest.mark.parametrize(
    "angle", [0.0, 0.02 * ARCSEC, 2 * ARCSEC, 200 * ARCSEC, DEG, 0.0999, 0.1001, 1.0, 3.0]
)
def test_left_jacobian_by_differences(rng, angle):
    v = rotation_vectors(rng, np.array([angle]))[0]
    h = 1e-5
    columns = [so3.log(so3.exp(v + h * e) @ so3.exp(v - h * e).mT) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(so3.left_jacobian(v), np.stack(columns, axis=-1), atol=2e-10)


def test_left_jacobian_has_no_joint_at_its_change_of_formula(rng):
    """``J v = v`` and ``J = R J^T`` hold on either side to rounding, as J is defined."""
    v = rotation_vectors(rng, np.array([1e-9, 0.0999999, 0.1000001, 0.5]))
    J = so3.left_jacobian(v)
    np.testing.assert_allclose((J @ v[..., None])[..., 0], v, atol=1e-16)
    np.testing.assert_allclose(J, so3.exp(v) @ J.mT, atol=3e-15)


@pytest.mark.parametrize("shape", [(), (1,), (2, 3), (0,)])
def test_batches_are_the_single_calls_side_by_side(rng, shape):
    v = rng.standard_normal((*shape, 3))
    flat = v.reshape(-1, 3)
    for function in (so3.exp, so3.left_jacobian, so3.skew):
        together = function(v)
        assert together.shape == (*shape, 3, 3)
        for one, vector in zip(together.reshape(-1, 3, 3), flat, strict=True):
            np.testing.assert_allclose(one, function(vector), atol=1e-15)
    assert so3.log(so3.exp(v)).shape == (*shape, 3)
    assert so3.to_quaternion(so3.exp(v)).shape == (*shape, 4)
    assert so3.nearest(so3.exp(v)).shape == (*shape, 3, 3)
