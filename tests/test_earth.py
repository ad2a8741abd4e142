"""The ellipsoid: by hand, against ERFA and extended precision, and the surface of constant height."""

from __future__ import annotations

import erfa
import numpy as np
import pytest

from starplumb.physics.earth import (
    C_JT,
    OMEGA_EARTH,
    WGS84_A,
    WGS84_F,
    geodetic_to_itrf,
    intersect_ellipsoid,
    itrf_to_geodetic,
)

HEIGHTS = (-11e3, 0.0, 9e3, 700e3, 40_000e3)


def places(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Latitudes and longitudes uniform on the sphere, with the poles and the equator among them."""
    latitude = np.concatenate([[np.pi / 2, -np.pi / 2, 0.0], np.arcsin(rng.uniform(-1, 1, n - 3))])
    return latitude, rng.uniform(-np.pi, np.pi, n)


def test_constants_are_those_of_wgs84() -> None:
    assert erfa.eform(1) == pytest.approx((WGS84_A, WGS84_F), rel=1e-15)
    assert OMEGA_EARTH == 7.292115e-5


def test_geodetic_axes_point_where_they_should() -> None:
    b = 6_356_752.314_245_18
    np.testing.assert_allclose(geodetic_to_itrf(0.0, 0.0, 10.0), [WGS84_A + 10, 0, 0], atol=1e-9)
    np.testing.assert_allclose(geodetic_to_itrf(0.0, np.pi / 2, 0.0), [0, WGS84_A, 0], atol=1e-9)
    np.testing.assert_allclose(geodetic_to_itrf(-np.pi / 2, 1.0, 5.0), [0, 0, -b - 5], atol=1e-8)


@pytest.mark.parametrize("height", HEIGHTS)
def test_geodetic_to_itrf_agrees_with_erfa(height: float, rng: np.random.Generator) -> None:
    latitude, longitude = places(rng, 1000)
    expected = erfa.gd2gc(1, longitude, latitude, height)
    np.testing.assert_allclose(geodetic_to_itrf(latitude, longitude, height), expected, atol=1.5e-8)


@pytest.mark.parametrize("height", HEIGHTS)
def test_itrf_to_geodetic_inverts_to_rounding(height: float, rng: np.random.Generator) -> None:
    latitude, longitude = places(rng, 2000)
    e2 = np.longdouble(WGS84_F) * (2 - np.longdouble(WGS84_F))
    normal = WGS84_A / np.sqrt(1 - e2 * np.sin(latitude.astype(np.longdouble)) ** 2)
    rho = (normal + height) * np.cos(latitude.astype(np.longdouble))
    z = (normal * (1 - e2) + height) * np.sin(latitude.astype(np.longdouble))
    r_J = np.stack([rho * np.cos(longitude), rho * np.sin(longitude), z], axis=-1).astype(float)
    lat, lon, h = itrf_to_geodetic(r_J)
    metres = WGS84_A + height
    rounding = 4 * np.spacing(metres)
    assert np.abs(lat - latitude).max() * metres < rounding + np.spacing(np.pi / 2) * metres
    assert (np.abs(lon - longitude) * np.cos(latitude)).max() * metres < rounding
    assert np.abs(h - height).max() < 2 * rounding


def test_the_poles_have_no_longitude_but_a_height() -> None:
    lat, _, h = itrf_to_geodetic([[0.0, 0.0, 7e6], [0.0, 0.0, -7e6], [1e-6, 0.0, 7e6]])
    np.testing.assert_allclose(lat, [np.pi / 2, -np.pi / 2, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(h, 7e6 - 6_356_752.314_245_18, atol=1e-8)
    assert np.isnan(itrf_to_geodetic([0.0, 0.0, 0.0])[0])


def test_local_level_columns_are_east_north_up(rng: np.random.Generator) -> None:
    latitude, longitude = places(rng, 100)
    C = C_JT(latitude, longitude)
    np.testing.assert_allclose(C.mT @ C, np.broadcast_to(np.eye(3), C.shape), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(C), 1.0)
    np.testing.assert_allclose(C_JT(0.0, 0.0), [[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    step = 1e-6
    r_J = geodetic_to_itrf(latitude[3:], longitude[3:], 0.0)
    for axis, moved in (
        (0, geodetic_to_itrf(latitude[3:], longitude[3:] + step, 0.0)),
        (1, geodetic_to_itrf(latitude[3:] + step, longitude[3:], 0.0)),
        (2, geodetic_to_itrf(latitude[3:], longitude[3:], 10.0)),
    ):
        direction = (moved - r_J) / np.linalg.norm(moved - r_J, axis=-1, keepdims=True)
        np.testing.assert_allclose(direction, C[3:, :, axis], atol=2e-6)


@pytest.mark.parametrize("height", [-400.0, 0.0, 1234.5, 9_000.0])
def test_a_ray_ends_at_the_wanted_geodetic_height(height: float, rng: np.random.Generator) -> None:
    latitude, longitude = places(rng, 3000)
    r_J = geodetic_to_itrf(latitude, longitude, rng.uniform(300e3, 900e3, 3000))
    tilt, azimuth = np.radians(rng.uniform(0, 60, 3000)), rng.uniform(0, 2 * np.pi, 3000)
    u_T = np.stack([np.sin(tilt) * np.sin(azimuth), np.sin(tilt) * np.cos(azimuth), -np.cos(tilt)], axis=-1)
    u_J = (C_JT(latitude, longitude) @ u_T[..., None])[..., 0]
    point = intersect_ellipsoid(r_J, 3.0 * u_J, height)
    reached = np.isfinite(point[:, 0])
    assert reached[tilt < np.radians(55)].all()
    _, _, h = erfa.gc2gd(1, point[reached])
    assert np.abs(h - height).max() < 1e-6
    travel = point[reached] - r_J[reached]
    assert (np.vecdot(travel, u_J[reached]) > 0).all()
    np.testing.assert_allclose(np.cross(travel, u_J[reached]), 0.0, atol=1e-7)
    # The nearer of the two crossings: up and ray are opposed there.
    up = C_JT(*itrf_to_geodetic(point[reached])[:2])[..., 2]
    assert (np.vecdot(up, u_J[reached]) < 0).all()


def test_a_surface_of_constant_height_is_not_an_inflated_ellipsoid() -> None:
    """The first guess alone, the ellipsoid of axes a + h and b + h, misses 9 km by centimetres at 45 deg."""
    latitude = np.pi / 4
    r_J = geodetic_to_itrf(latitude, 0.0, 9_000.0)
    axes = np.array([WGS84_A + 9e3, WGS84_A + 9e3, WGS84_A * (1 - WGS84_F) + 9e3])
    assert abs(np.linalg.norm(r_J / axes) - 1) * WGS84_A > 5e-3
    point = intersect_ellipsoid(r_J * 1.1, -r_J, 9_000.0)
    assert abs(itrf_to_geodetic(point)[2] - 9_000.0) < 1e-8


def test_intersection_by_hand_and_where_there_is_none() -> None:
    above = np.array([7e6, 0.0, 0.0])
    directions = np.array([[-2.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], [-0.1, 1.0, 0]])
    points = intersect_ellipsoid(above, directions)
    np.testing.assert_allclose(points[0], [WGS84_A, 0, 0], atol=1e-8)
    assert np.isnan(points[1:]).all()  # behind, level, and past the limb
    assert np.isnan(intersect_ellipsoid([6e6, 0, 0], [-1.0, 0, 0])).all()  # starts below the surface


def test_heights_and_rays_broadcast() -> None:
    heights = np.array([0.0, 100.0, 5000.0])
    point = intersect_ellipsoid([0.0, 0, 7e6], [0.0, 0, -1], heights)
    assert point.shape == (3, 3)
    np.testing.assert_allclose(point[:, 2], 6_356_752.314_245_18 + heights, atol=1e-8)
