"""Whole images located through nodes: the same points as pixel by pixel, and terrain met where the ray meets it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.ground.geolocation import positions, terrain_below
from starplumb.ground.grid import Terrain, geodetic_rows, locate_on_terrain, locate_rows
from starplumb.physics import so3
from starplumb.physics.camera import Distortion
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.units import DEG
from starplumb.table.geometry import locate

BENT = replace(FRAME, distortion=Distortion((0.3, 20.0, 0.0), (1e-3, -2e-3)))
ROWS, COLUMNS = np.linspace(0.0, 11999.0, 5), np.linspace(0.0, 11999.0, 41)


def rough_line():
    """A line scanner whose detectors zigzag by five pixels: no smooth curve."""
    column = np.arange(0.0, 12000.0, 40.0)
    scale = 9e-6 / 2.2
    zigzag = 5.0 * scale * np.where(np.arange(column.size) % 2, 1.0, -1.0)
    return replace(
        LINE, column_px=column, tan_x=scale * (column - 6000.0) + 0.3 * zigzag, tan_y=scale * 40.0 + zigzag
    )


@pytest.mark.parametrize("camera", [FRAME, BENT, LINE, rough_line()], ids=["frame", "bent", "line", "rough"])
@pytest.mark.parametrize("height", [0.0, 2500.0])
def test_nodes_give_what_each_pixel_gives(camera, height):
    campaign = truth(camera, 2, 1, tilt_deg=25.0)
    found = locate_rows(campaign, C_EK_TRUE, 1, ROWS, COLUMNS, height)
    row, column = (x.ravel() for x in np.meshgrid(ROWS, COLUMNS, indexing="ij"))
    single = locate(campaign, C_EK_TRUE, np.ones(row.size, dtype=int), column, row, height)
    np.testing.assert_allclose(found.reshape(-1, 3), single, atol=1e-4, rtol=0)
    geodetic = geodetic_rows(campaign, C_EK_TRUE, 1, ROWS, COLUMNS, height).reshape(-1, 2)
    latitude, longitude, _ = itrf_to_geodetic(single)
    np.testing.assert_allclose(geodetic, np.stack([latitude, longitude], -1), atol=2e-11, rtol=0)


def hills(campaign, image):
    """Terrain of 1200 m about an image, posts every 60 m."""
    corners = geodetic_rows(campaign, C_EK_TRUE, image, ROWS, COLUMNS).reshape(-1, 2)
    low, high = corners.min(axis=0) - 0.1 * DEG, corners.max(axis=0) + 0.1 * DEG
    step = 60.0 / 6.37e6
    latitude, longitude = (np.arange(low[i], high[i], step) for i in range(2))
    height = 600.0 + 600.0 * np.sin(latitude[:, None] * 1200.0) * np.cos(longitude[None, :] * 1500.0)
    return Terrain(height, float(low[0]), float(low[1]), (step, step))


def test_the_point_lies_on_the_terrain_and_on_the_line_of_sight():
    campaign = truth(LINE, 1, 1, tilt_deg=25.0)
    terrain = hills(campaign, 0)
    place, height = locate_on_terrain(campaign, C_EK_TRUE, 0, ROWS, COLUMNS, terrain)
    assert np.ptp(height) > 800.0
    np.testing.assert_allclose(terrain.at(place[..., 0], place[..., 1]), height, atol=0.02)
    row, column = (x.ravel() for x in np.meshgrid(ROWS, COLUMNS, indexing="ij"))
    seen = locate(campaign, C_EK_TRUE, np.zeros(row.size, dtype=int), column, row, height.ravel())
    latitude, longitude, _ = itrf_to_geodetic(seen)
    np.testing.assert_allclose(6.37e6 * (place[..., 0].ravel() - latitude), 0.0, atol=0.01)
    np.testing.assert_allclose(6.37e6 * (place[..., 1].ravel() - longitude), 0.0, atol=0.01)


def test_terrain_by_hand():
    """Bilinear between posts, empty beside them, a grid from the north, and longitudes across the date line."""
    terrain = Terrain(np.array([[0.0, 10.0], [20.0, 30.0]]), 0.5, np.pi - 0.005, (-0.01, 0.01))
    assert terrain.at(np.array(0.495), np.array(np.pi)) == pytest.approx(15.0)
    assert terrain.at(np.array(0.5), np.array(-np.pi + 0.004)) == pytest.approx(9.0)
    assert np.isnan(terrain.at(np.array(0.501), np.array(np.pi)))
    assert np.isnan(terrain.at(np.array(0.495), np.array(3.0)))


def test_pixels_beside_the_terrain_are_empty():
    campaign = truth(FRAME, 1, 1)
    whole = hills(campaign, 0)
    half = replace(whole, height=whole.height[: whole.height.shape[0] // 2])
    _, height = locate_on_terrain(campaign, C_EK_TRUE, 0, ROWS, COLUMNS, half)
    assert 0.2 < np.mean(np.isnan(height)) < 0.8


@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
def test_pixels_past_the_earth_are_nan_and_the_others_where_each_is_alone(camera):
    """Turned so far that the horizon crosses the image: a wider camera, to see it."""
    wide = (
        replace(camera, pitch=200.0 * camera.pitch)
        if camera is FRAME
        else replace(camera, tan_x=200.0 * camera.tan_x)
    )
    campaign = truth(wide, 1, 1)
    turn = so3.exp(np.array([0.0, 60.0 * DEG, 0.0])) if camera is FRAME else np.eye(3)
    found = locate_rows(campaign, turn @ C_EK_TRUE, 0, ROWS, COLUMNS).reshape(-1, 3)
    row, column = (x.ravel() for x in np.meshgrid(ROWS, COLUMNS, indexing="ij"))
    single = locate(campaign, turn @ C_EK_TRUE, np.zeros(row.size, dtype=int), column, row, 0.0)
    assert 0.1 < np.mean(np.isnan(found[:, 0])) < 0.9
    np.testing.assert_allclose(found, single, atol=1e-4, rtol=0)
    geodetic = geodetic_rows(campaign, turn @ C_EK_TRUE, 0, ROWS, COLUMNS).reshape(-1, 2)
    met = np.isfinite(single[:, 0])
    latitude, longitude, _ = itrf_to_geodetic(single[met])
    np.testing.assert_allclose(geodetic[met, 0], latitude, atol=2e-11, rtol=0)
    np.testing.assert_allclose(np.sin(geodetic[met, 1] - longitude), 0.0, atol=2e-11)
    assert np.isnan(geodetic[~met]).all()


def test_looking_past_the_earth_alone_meets_nothing():
    campaign = truth(FRAME, 1, 1)
    away = so3.exp(np.array([0.0, 120.0 * DEG, 0.0])) @ C_EK_TRUE
    assert np.isnan(locate_rows(campaign, away, 0, ROWS, COLUMNS)).all()
    (block,) = positions(campaign, away, 0, ROWS, COLUMNS, 0.0)
    assert np.isnan(block).all()
    with pytest.raises(InputError, match="found no line of sight that meets the Earth"):
        terrain_below(campaign, away, 0, ROWS, COLUMNS, lambda latitude, _: 0.0 * latitude, 100.0)
