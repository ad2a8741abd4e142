"""Cameras: pixels to directions and back, by hand, by differences and against the lens formula written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from starplumb.io.campaign.read import load_campaign
from starplumb.physics.camera import Distortion, FrameCamera, LineScanCamera
from starplumb.table.geometry import locate, project

SCALE = 9e-6 / 2.2
LENS = Distortion((0.9, -12.0, 40.0), (0.004, -0.003))


def opencv(x, y, k, p):
    """Distorted point of the OpenCV manual (calib3d), one point at a time."""
    r2 = x**2 + y**2
    radial = 1 + k[0] * r2 + k[1] * r2**2 + k[2] * r2**3
    return (
        x * radial + 2 * p[0] * x * y + p[1] * (r2 + 2 * x**2),
        y * radial + p[0] * (r2 + 2 * y**2) + 2 * p[1] * x * y,
    )


def frame(distortion=None):
    return FrameCamera(2.2, 9e-6, (5999.5, 5000.0), (12000.0, 10000.0), distortion or Distortion())


def wide(distortion=LENS):
    """A short lens, where the distortion bends by hundreds of pixels."""
    return FrameCamera(0.05, 9e-6, (1000.0, 900.0), (2000.0, 1800.0), distortion)


def test_frame_axes_by_hand():
    """x grows with the column, y with the row; the principal point looks along the boresight."""
    xy, _ = frame().tan_from_px([5999.5, 6099.5, 5999.5], [5000.0, 5000.0, 5100.0])
    np.testing.assert_allclose(xy, [[0, 0], [100 * SCALE, 0], [0, 100 * SCALE]], atol=1e-18)


def test_pixel_of_a_direction_by_hand():
    np.testing.assert_allclose(
        frame().px_from_tan([0.001, -0.002]), [5999.5 + 0.001 / SCALE, 5000 - 0.002 / SCALE]
    )


def test_a_distorted_pixel_is_where_the_lens_formula_puts_it():
    x, y = 0.11, -0.07
    xd, yd = opencv(x, y, LENS.k, LENS.p)
    expected = [1000.0 + 0.05 / 9e-6 * xd, 900.0 + 0.05 / 9e-6 * yd]
    np.testing.assert_allclose(wide().px_from_tan([x, y]), expected, rtol=1e-14)
    assert abs(xd - x) * 0.05 / 9e-6 > 3  # the lens does bend: some pixels


@pytest.mark.parametrize(
    ("k", "p", "moved"),
    [
        ((0.5, 0, 0), (0, 0), (0.1 * (1 + 0.5 * 0.01), 0.0)),
        ((0, 0.5, 0), (0, 0), (0.1 * (1 + 0.5 * 1e-4), 0.0)),
        ((0, 0, 0.5), (0, 0), (0.1 * (1 + 0.5 * 1e-6), 0.0)),
        ((0, 0, 0), (0.5, 0), (0.1, 0.5 * 0.01)),
        ((0, 0, 0), (0, 0.5), (0.1 + 0.5 * 3 * 0.01, 0.0)),
    ],
)
def test_each_coefficient_alone_at_a_point_on_the_x_axis(k, p, moved):
    out, _ = Distortion(k, p).apply(np.array([0.1, 0.0]))
    np.testing.assert_allclose(out, moved, atol=1e-17)


@pytest.mark.parametrize(
    "camera", [frame(), wide(), wide(Distortion((0.4, 0, 0)))], ids=["plain", "bent", "radial"]
)
def test_frame_pixel_ray_pixel(camera, rng):
    pixel = rng.uniform(0, camera.size_px, (500, 2))
    xy, _ = camera.tan_from_px(pixel[:, 0], pixel[:, 1])
    np.testing.assert_allclose(camera.px_from_tan(xy), pixel, atol=1e-9)


def slope_by_differences(camera, column, row, h):
    """d xy / d (column, row), (..., 2, 2)."""
    by_column = camera.tan_from_px(column + h, row)[0] - camera.tan_from_px(column - h, row)[0]
    by_row = camera.tan_from_px(column, row + h)[0] - camera.tan_from_px(column, row - h)[0]
    return np.stack([by_column, by_row], axis=-1) / (2 * h)


@pytest.mark.parametrize("camera", [frame(), wide()], ids=["plain", "bent"])
def test_frame_slope_by_differences(camera, rng):
    pixel = rng.uniform(0, camera.size_px, (50, 2))
    _, slope = camera.tan_from_px(pixel[:, 0], pixel[:, 1])
    expected = slope_by_differences(camera, pixel[:, 0], pixel[:, 1], 0.05)
    np.testing.assert_allclose(slope, expected, atol=1e-9 * camera.pitch / camera.focal_length * 1e3)


def test_distortion_jacobian_by_differences(rng):
    xy = rng.uniform(-0.15, 0.15, (50, 2))
    _, jacobian = LENS.apply(xy)
    h = 1e-6
    columns = [(LENS.apply(xy + h * e)[0] - LENS.apply(xy - h * e)[0]) / (2 * h) for e in np.eye(2)]
    np.testing.assert_allclose(jacobian, np.stack(columns, axis=-1), atol=1e-9)


def test_line_scanner_from_optics_by_hand():
    """Columns grow along x; the line stands 40 pixels from the optical axis towards +y; a row is no direction."""
    camera = LineScanCamera.from_optics(2.2, 9e-6, (5999.5, 40.0), 12000)
    xy, slope = camera.tan_from_px([5999.5, 0.0, 11999.0], [7.0, 7.0, 1e6])
    np.testing.assert_allclose(
        xy, SCALE * np.array([[0, 40], [-5999.5, 40], [5999.5, 40]]), rtol=1e-12, atol=1e-16
    )
    np.testing.assert_allclose(slope, np.broadcast_to([[SCALE, 0], [0, 0]], (3, 2, 2)), atol=1e-18)


def test_line_scanner_behind_a_lens_sees_what_the_frame_camera_sees_on_that_row(rng):
    """The same lens behind either detector: the line at row offset 300 of a frame whose principal row is 0."""
    matrix = FrameCamera(0.05, 9e-6, (1000.0, 0.0), (2000.0, 2000.0), LENS)
    line = LineScanCamera.from_optics(0.05, 9e-6, (1000.0, 300.0), 2000, LENS)
    column = np.concatenate([np.arange(2000.0), rng.uniform(0, 1999, 300)])
    expected, _ = matrix.tan_from_px(column, 300.0)
    found, _ = line.tan_from_px(column, 0.0)
    assert np.max(np.abs(found - expected)) * 0.05 / 9e-6 < 1e-4  # pixels


def table():
    """Look angles of three chips, growing towards smaller columns' x: tan_x decreases."""
    column = np.array([0.0, 100.0, 400.0, 1000.0])
    return LineScanCamera(
        column, np.array([2e-3, 1.5e-3, 1e-4, -3e-3]), np.array([1e-4, 2e-4, 0.0, 5e-5]), (1001.0, np.inf)
    )


def test_line_table_is_linear_between_its_rows():
    xy, slope = table().tan_from_px([0.0, 50.0, 250.0, 1000.0], 0.0)
    np.testing.assert_allclose(xy, [[2e-3, 1e-4], [1.75e-3, 1.5e-4], [8e-4, 1e-4], [-3e-3, 5e-5]], atol=1e-18)
    np.testing.assert_allclose(slope[2], [[-1.4e-3 / 300, 0], [-2e-4 / 300, 0]])


def test_line_pixel_ray_pixel(rng):
    camera = table()
    column = rng.uniform(0, 1000, 200)
    xy, _ = camera.tan_from_px(column, 0.0)
    pixel = camera.px_from_tan(xy)
    np.testing.assert_allclose(pixel[:, 0], column, atol=1e-9)
    np.testing.assert_allclose(pixel[:, 1], 0.0, atol=1e-9)


def test_line_offset_is_counted_in_pixels_of_the_line():
    camera = LineScanCamera.from_optics(2.2, 9e-6, (50.0, 0.0), 101)
    np.testing.assert_allclose(camera.px_from_tan([10 * SCALE, -3 * SCALE]), [60.0, -3.0], atol=1e-9)


@pytest.mark.parametrize("columns", [1, 2])
def test_the_narrowest_scanners(columns):
    camera = LineScanCamera.from_optics(2.2, 9e-6, (0.0, 0.0), columns)
    np.testing.assert_allclose(
        camera.tan_from_px(columns - 1.0, 0.0)[0], [SCALE * (columns - 1), 0.0], atol=1e-20
    )


@pytest.mark.parametrize("camera", [frame(), wide(), table()], ids=["frame", "bent", "line"])
@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_batches(camera, shape, rng):
    column, row = rng.uniform(0, 1000, (2, *shape))
    xy, slope = camera.tan_from_px(column, row)
    assert xy.shape == (*shape, 2)
    assert slope.shape == (*shape, 2, 2)
    assert camera.px_from_tan(xy).shape == (*shape, 2)
    one, _ = camera.tan_from_px(column.flat[0], row.flat[0])
    np.testing.assert_allclose(xy.reshape(-1, 2)[0], one, atol=1e-16)


def test_a_lens_is_straightened_to_rounding(rng):
    """As far as its own formula, written out, bends it: the search ends when its next step would be below rounding."""
    x, y = rng.uniform(-0.11, 0.11, (2, 400))
    bent = np.stack(opencv(x, y, LENS.k, LENS.p), axis=-1)
    ideal, slope = LENS.remove(bent)
    np.testing.assert_allclose(ideal, np.stack([x, y], axis=-1), atol=1e-12, rtol=0)
    h = 1e-6
    for axis in range(2):
        step = h * np.eye(2)[axis]
        quotient = (LENS.remove(bent + step)[0] - LENS.remove(bent - step)[0]) / (2.0 * h)
        np.testing.assert_allclose(slope[..., axis], quotient, atol=1e-6)


@pytest.mark.parametrize("deg", [0.0, 30.0, 90.0, 135.0, 180.0, 270.0])
def test_a_line_of_detectors_may_lie_along_any_direction(deg, rng):
    """A bent line turned about the boresight: columns are found again, and what lies beside it by so many pixels."""
    column = np.linspace(0.0, 999.0, 11)
    straight = np.stack([1e-5 * (column - 500.0), 2e-4 * ((column - 500.0) / 500.0) ** 2], axis=-1)
    turn = np.array(
        [
            [np.cos(np.deg2rad(deg)), -np.sin(np.deg2rad(deg))],
            [np.sin(np.deg2rad(deg)), np.cos(np.deg2rad(deg))],
        ]
    )
    x, y = (straight @ turn.T).T
    camera = LineScanCamera(column, x, y, (1000.0, np.inf))
    at = rng.uniform(0.0, 999.0, 50)
    xy, slope = camera.tan_from_px(at, 0.0)
    np.testing.assert_allclose(camera.px_from_tan(xy), np.stack([at, np.zeros(50)], axis=-1), atol=1e-6)
    beside = 3.0 * np.stack([-slope[..., 1, 0], slope[..., 0, 0]], axis=-1)
    found = camera.px_from_tan(xy + beside)
    assert np.all(np.abs(np.abs(found[:, 1]) - 3.0) < 0.25)
    assert np.all(np.abs(found[:, 0] - at) < 3.0)


def test_detectors_along_y_are_those_along_x_of_a_turned_mounting(shared_cases):
    campaign = load_campaign(shared_cases / "detectors_along_y" / "campaign.toml").campaign
    camera = campaign.camera
    assert np.ptp(camera.tan_x) == 0.0
    # x of the other camera is our y, its y our -x
    along_x = replace(campaign, camera=replace(camera, tan_x=camera.tan_y, tan_y=-camera.tan_x))
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    images, column, row = np.zeros(3, dtype=int), np.array([10.0, 500.0, 987.0]), np.array([0.0, 500.0, 20.0])
    p_J = locate(campaign, campaign.C_EK, images, column, row)
    np.testing.assert_allclose(p_J, locate(along_x, campaign.C_EK @ quarter, images, column, row), atol=1e-6)
    pixel = project(campaign, campaign.C_EK, images, p_J, np.stack([column, row], axis=-1) + 5.0)
    np.testing.assert_allclose(pixel, np.stack([column, row], axis=-1), atol=1e-3)
