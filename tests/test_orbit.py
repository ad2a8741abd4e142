"""Orbits and pointing: energy, J2 drift rates, and the signs of pitch, roll and yaw, one axis at a time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

from starplumb.physics.orbit import C_RO, GM_EARTH, KeplerOrbit, pointing, turned
from starplumb.physics.units import DEG

R_UP = np.array([7e6, 0.0, 0.0])
V_NORTH = np.array([0.0, 0.0, 7.5e3])
"""Over the equator at longitude 0, flying north: ahead is north (z), the left is west (-y), down is -x."""


def test_kepler_motion_is_the_integrated_one():
    orbit = KeplerOrbit(7000e3, 0.02, 1.2, 0.4, 0.9, 0.3, j2=0.0)
    r, v = orbit.at(0.0)
    solution = solve_ivp(
        lambda _, s: np.concatenate([s[3:], -GM_EARTH * s[:3] / np.linalg.norm(s[:3]) ** 3]),
        (0, 5000),
        np.concatenate([r, v]),
        method="DOP853",
        rtol=1e-12,
        atol=1e-6,
    )
    np.testing.assert_allclose(np.concatenate(orbit.at(5000.0)), solution.y[:, -1], atol=1e-2)


def test_elements_at_epoch_by_hand():
    """On the equator at perigee with the node on x: r = a (1 - e) x, v = sqrt(GM/a (1 + e)/(1 - e)) y."""
    r, v = KeplerOrbit(7000e3, 0.1, 0.0, 0.0, 0.0, 0.0, j2=0.0).at(0.0)
    np.testing.assert_allclose(r, [6300e3, 0, 0], atol=1e-6)
    np.testing.assert_allclose(v, [0, np.sqrt(GM_EARTH / 7000e3 * 1.1 / 0.9), 0], atol=1e-9)


@pytest.mark.parametrize("at", [0.0, 1234.0, 86400.0])
def test_velocity_is_the_derivative_of_the_drifting_position(at):
    orbit, h = KeplerOrbit(7058e3, 0.01, 98.07 * DEG, 0.4, 0.9, 0.3), 0.5
    slope = (
        8 * (orbit.at(at + h)[0] - orbit.at(at - h)[0]) - orbit.at(at + 2 * h)[0] + orbit.at(at - 2 * h)[0]
    ) / (12 * h)
    np.testing.assert_allclose(slope, orbit.at(at)[1], atol=1e-6)


def test_a_sun_synchronous_node_turns_a_degree_a_day():
    """At 7058 km and 98.07 deg the node follows the Sun, 0.9856 deg a day: the positions stay in a plane that does."""
    orbit = KeplerOrbit(7058e3, 0.0, 98.07 * DEG, 0.0, 0.0, 0.0)
    t = 86400.0 + np.arange(0, 6000, 500.0)
    r, _ = orbit.at(t)
    node = 0.9856 * DEG * t / 86400
    normal = np.stack(
        [
            np.sin(node) * np.sin(orbit.inclination),
            -np.cos(node) * np.sin(orbit.inclination),
            0 * t + np.cos(orbit.inclination),
        ],
        axis=-1,
    )
    assert np.max(np.abs(np.sum(r * normal, axis=-1))) < 7058e3 * 0.005 * DEG


def test_perigee_stands_still_at_the_critical_inclination():
    orbit = KeplerOrbit(7500e3, 0.05, np.arccos(np.sqrt(0.2)), 0.0, 0.5, 0.0)
    period = 2 * np.pi * np.sqrt(7500e3**3 / GM_EARTH)
    passage = minimize_scalar(
        lambda t: np.linalg.norm(orbit.at(t)[0]) / 1e6, (14.9 * period, 15 * period, 15.1 * period), tol=1e-12
    ).x
    r, _ = orbit.at(passage)
    latitude_argument = np.arcsin(r[2] / np.linalg.norm(r) / np.sin(orbit.inclination))
    assert latitude_argument == pytest.approx(0.5, abs=1e-4)


def test_orbital_axes_by_hand():
    """x ahead (north), y opposite to the orbit normal (east), z down."""
    np.testing.assert_allclose(C_RO(R_UP, V_NORTH).T, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-15)


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw", "looks"),
    [
        (0, 10, 0, [-np.cos(10 * DEG), 0, np.sin(10 * DEG)]),  # ahead: north
        (10, 0, 0, [-np.cos(10 * DEG), -np.sin(10 * DEG), 0]),  # left: west
        (0, 0, 10, [-1, 0, 0]),
    ],
)
def test_positive_turns_by_hand(roll, pitch, yaw, looks):
    C = turned(C_RO(R_UP, V_NORTH), roll * DEG, pitch * DEG, yaw * DEG)
    np.testing.assert_allclose(C[:, 2], looks, atol=1e-15)


def test_positive_yaw_turns_the_axis_ahead_to_the_right():
    C = turned(C_RO(R_UP, V_NORTH), 0.0, 0.0, 90 * DEG)
    np.testing.assert_allclose(C[:, 0], [0, 1, 0], atol=1e-15)  # east


def test_pointing_looks_at_its_target_with_rows_along_the_flight(rng):
    target = np.array([6.37e6, 1e5, -2e5])
    C = pointing(R_UP, V_NORTH, target)
    np.testing.assert_allclose(C[:, 2], (target - R_UP) / np.linalg.norm(target - R_UP), atol=1e-15)
    assert C[:, 1] @ V_NORTH > 0
    assert abs(C[:, 0] @ V_NORTH) < 1e-9
    assert np.linalg.det(C) == pytest.approx(1)


def test_pointing_down_has_rows_along_the_track_and_columns_to_the_left():
    C = pointing(R_UP, V_NORTH, np.zeros(3))
    np.testing.assert_allclose(C[:, 1], [0, 0, 1], atol=1e-15)  # rows grow northwards
    np.testing.assert_allclose(C[:, 0], [0, -1, 0], atol=1e-15)  # columns grow to the west
    np.testing.assert_allclose(C[:, 2], [-1, 0, 0], atol=1e-15)


def test_yaw_turns_the_picture_about_the_boresight():
    straight, turned_by = (pointing(R_UP, V_NORTH, np.zeros(3), yaw) for yaw in (0.0, 90 * DEG))
    np.testing.assert_allclose(turned_by[:, 2], straight[:, 2], atol=1e-15)
    np.testing.assert_allclose(turned_by[:, 0], straight[:, 1], atol=1e-15)  # x goes where y was


def test_batches(rng):
    r, v = KeplerOrbit(7058e3, 0.001, 1.7, 0.3, 0.2, 0.6).at(rng.uniform(0, 1e4, (2, 3)))
    assert r.shape == v.shape == (2, 3, 3)
    C = pointing(r, v, 0.9 * r, rng.uniform(0, 1, (2, 3)))
    assert C.shape == C_RO(r, v).shape == (2, 3, 3, 3)
    np.testing.assert_allclose(C @ C.mT, np.broadcast_to(np.eye(3), C.shape), atol=1e-15)
