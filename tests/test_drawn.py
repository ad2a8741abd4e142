"""Drawn ground and its pictures: against a tree of nearest neighbours, integrals done by hand and the camera's own
projection."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial import cKDTree

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.imagery.drawn.fields import SCATTER, cells
from starplumb.imagery.drawn.ground import Ground, Look
from starplumb.imagery.drawn.noise import hashed, octaves, waves
from starplumb.imagery.drawn.plane import Plane
from starplumb.imagery.drawn.relief import ErrorField, relief
from starplumb.imagery.drawn.render import Sensor, View, picture
from starplumb.imagery.drawn.sky import Sky
from starplumb.physics.earth import C_JT, geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.units import DEG
from starplumb.table.geometry import locate, project

GROUND = Ground(4, 1.5)


def test_every_place_lies_in_the_cell_of_its_nearest_seed():
    """And its distance from the border is that to the line half way to the second nearest."""
    x, y = np.linspace(-700.0, 400.0, 83), np.linspace(5000.0, 5900.0, 71)
    found = cells(5, 60.0, x, y)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(-20, 20), np.arange(75, 110)))
    seeds = 60.0 * np.stack(
        [k + 0.5 + SCATTER * (hashed(5 + s, i, j) - 0.5) for s, k in ((1, i), (2, j))], axis=-1
    )
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    _, near = cKDTree(seeds).query(places, k=2)
    for mine, rank in ((found.own, 0), (found.other, 1)):
        np.testing.assert_array_equal(found.i[mine], i[near[:, rank]])
        np.testing.assert_array_equal(found.j[mine], j[near[:, rank]])
    one, two = seeds[near[:, 0]], seeds[near[:, 1]]
    across = (two - one) / np.linalg.norm(two - one, axis=-1, keepdims=True)
    np.testing.assert_allclose(found.gap, np.vecdot(0.5 * (one + two) - places, across), atol=1e-8)


def test_noise_has_the_stated_mean_and_variance():
    lattice = np.arange(
        0.25, 400.0
    )  # a quarter of a step off: one of the phases over which the variance is a mean
    values = np.concatenate(
        [waves(3, 1.0, lattice + k, lattice + q).ravel() for k in (0, 0.5) for q in (0, 0.25)]
    )
    assert abs(values.mean()) < 0.01
    assert values.std() == pytest.approx(1.0, abs=0.06)
    assert octaves(8, 1.0, 16.0, 0.5, lattice, lattice).std() == pytest.approx(1.0, abs=0.1)


def test_ground_is_the_same_wherever_and_however_finely_it_is_drawn():
    x, y = np.arange(0.0, 900.0, 5.0), np.arange(-400.0, 800.0, 4.0)
    look = Look(season=0.3, changed=0.2, seed=2)
    whole = GROUND.draw(x, y, look)
    np.testing.assert_array_equal(GROUND.draw(x[50::7], y[20::11], look), whole[20::11, 50::7])
    assert not np.array_equal(Ground(5, 1.5).draw(x, y, look), whole)


@pytest.mark.slow
def test_looks_change_what_they_say():
    x = np.arange(0.0, 6000.0, 25.0)
    now = GROUND.draw(x, x)
    std = now.std()
    assert std == pytest.approx(1.0, abs=0.1)
    season = GROUND.draw(x, x, Look(season=0.3)) - now
    assert season.std() / std == pytest.approx(0.3, rel=0.15)
    changed = GROUND.draw(x, x, Look(changed=0.1, seed=1)) != now
    assert changed.mean() == pytest.approx(0.1, abs=0.02)
    elsewhere = GROUND.draw(x, x, Look(changed=0.1, seed=2)) != now
    assert np.mean(changed & elsewhere) < 0.03
    band = GROUND.draw(x, x, Look(band=1))
    assert abs(np.corrcoef(band.ravel(), now.ravel())[0, 1]) < 0.8


@dataclass(frozen=True)
class Grating:
    """Brightness ``sin(k . x)``: blurred, it is the same wave, weaker by a factor known by hand."""

    k: tuple[float, float]
    detail: float = 0.25

    def draw(self, x, y, look=None):
        return np.sin(self.k[0] * x + self.k[1] * y[:, None])


@pytest.mark.parametrize("k", [(0.3, 0.2), (1.1, -0.7), (0.0, 2.0)])
@pytest.mark.parametrize("psf", [0.0, 0.5])
def test_a_pixel_is_the_integral_over_its_blurred_square(k, psf):
    """Fourier: a Gaussian of s weakens the wave by ``exp(-s^2 k^2 / 2)``, a unit square by ``sinc`` each way."""
    found = picture(
        Grating(k), lambda column, row: tuple(np.meshgrid(column, row)), (40, 30), psf, spacing=1.0
    )
    weaker = np.exp(-0.5 * psf**2 * (k[0] ** 2 + k[1] ** 2)) * np.prod(np.sinc(np.array(k) / (2.0 * np.pi)))
    expected = weaker * np.sin(k[0] * np.arange(40.0) + k[1] * np.arange(30.0)[:, None])
    np.testing.assert_allclose(found, expected, atol=0.006)
    slope = np.sum(found * expected) / np.sum(expected**2)
    assert slope == pytest.approx(1.0, abs=0.01)


def view(camera):
    """Image 0 of a true campaign over hills, cut to 60 x 50 pixels about its middle."""
    campaign = truth(camera, 1, 1, tilt_deg=12.0)
    middle = locate(campaign, C_EK_TRUE, np.zeros(1, dtype=int), np.array([30.0]), np.array([25.0]), 400.0)
    latitude, longitude, _ = (float(value[0]) for value in itrf_to_geodetic(middle))
    plane = Plane(latitude, longitude)
    hills = relief(3, plane, (-900.0, 900.0), (-900.0, 900.0), 30.0, 100.0, 100.0)
    return View(campaign, C_EK_TRUE, hills, plane, GROUND)


@pytest.mark.parametrize(
    "camera", [pytest.param(FRAME, id="frame"), pytest.param(LINE, id="line-scan", marks=pytest.mark.slow)]
)
def test_the_ground_of_a_pixel_is_seen_in_that_pixel(camera):
    """The camera's own projection is the inverse; the terrain is looked up at the place found."""
    seen = view(camera)
    column, row = np.arange(0.0, 60.0, 0.5), np.arange(0.0, 50.0, 0.5)
    x, y = (values.ravel() for values in seen.places(0)(column, row))
    latitude, longitude = seen.plane.geodetic(x, y)
    p_J = geodetic_to_itrf(latitude, longitude, seen.terrain.at(latitude, longitude))
    back = project(seen.campaign, seen.C_EK, np.zeros(x.size, dtype=int), p_J)
    expected = np.stack(np.meshgrid(column, row), axis=-1).reshape(-1, 2)
    np.testing.assert_allclose(back, expected, atol=2e-3)


def test_a_terrain_that_is_too_small_is_said():
    seen = view(FRAME)
    cut = replace(seen, terrain=replace(seen.terrain, height=seen.terrain.height[:20, :20]))
    with pytest.raises(ValueError, match="does not cover image"):
        cut.brightness(0, (60, 50), 0.5)


def test_noise_is_that_of_the_sensor(rng):
    sensor = Sensor(mean_dn=1000.0, gain_dn=200.0, dark_dn=100.0, read_noise_dn=5.0, dn_per_electron=0.25)
    dn = sensor.expose(np.full(40_000, 1.5), rng).astype(float)
    variance = 25.0 + 0.25 * (1300.0 - 100.0) + 1.0 / 12.0
    assert dn.mean() == pytest.approx(1300.0, abs=4.0 * np.sqrt(variance / dn.size))
    low, high = stats.chi2.ppf([1e-4, 1.0 - 1e-4], dn.size - 1) / (dn.size - 1)
    assert low < dn.var(ddof=1) / variance < high
    assert sensor.expose(np.array([99.0, -99.0]), rng).tolist() == [4095, 0]


def test_clouds_cover_what_they_are_said_to():
    column, row = np.arange(700.0), np.arange(500.0)
    clouds = Sky(0.3, seed=6).over((700, 500))
    assert np.mean(clouds.opacity(column, row) > 0.5) == pytest.approx(0.3, abs=0.02)
    flat = clouds.veil(np.zeros((500, 700)), column, row)
    assert np.mean(flat > 2.0) == pytest.approx(0.3, abs=0.05)
    assert flat.min() < -2.0  # in the shadow
    assert not np.any(Sky(0.0).over((70, 50)).veil(np.zeros((50, 70)), column[:70], row[:50]))


@pytest.mark.slow
def test_errors_of_a_reference_are_shared_as_stated(rng):
    draws = [ErrorField.draw(rng, 2.0, 500.0, (0.0, 500.0), (0.0, 375.0)) for _ in range(1500)]
    values = np.array([draw.values for draw in draws])
    apart = draws[0].x[2] - draws[0].x[0]
    covariance = np.mean(values[:, 1, 0] * values[:, 1, 2])
    expected = 4.0 * np.exp(-apart / 500.0)
    assert covariance == pytest.approx(expected, abs=4.0 * np.sqrt((16.0 + expected**2) / 1500.0))
    assert np.mean(values**2) == pytest.approx(4.0, rel=0.1)
    at_nodes = draws[0].at(draws[0].x, draws[0].y)
    np.testing.assert_allclose(at_nodes, values[0], atol=1e-9)


def test_hills_have_the_stated_heights_and_are_the_same_on_every_grid():
    plane = Plane(0.6, -1.2)
    wide = relief(2, plane, (-30e3, 30e3), (-30e3, 30e3), 100.0, 50.0, 40.0)
    assert wide.height.std() == pytest.approx(40.0, rel=0.25)
    assert wide.height.mean() == pytest.approx(170.0, abs=25.0)
    small = relief(2, plane, (-1e3, 1e3), (0.0, 2e3), 100.0, 50.0, 40.0)
    latitude, longitude = plane.geodetic(np.array([-900.0, 300.0]), np.array([1500.0, 100.0]))
    np.testing.assert_allclose(small.at(latitude, longitude), wide.at(latitude, longitude), atol=1e-6)


def test_the_plane_is_true_to_scale_at_its_place():
    plane = Plane(52.0 * DEG, 13.0 * DEG)
    latitude, longitude = plane.geodetic(np.array([0.0, 40.0, 0.0]), np.array([0.0, 0.0, 30.0]))
    p_J = geodetic_to_itrf(latitude, longitude, np.zeros(3))
    level = (p_J - p_J[0]) @ C_JT(plane.latitude, plane.longitude)
    np.testing.assert_allclose(level[:, :2], [[0, 0], [40, 0], [0, 30]], atol=1e-3)
    np.testing.assert_allclose(plane.metres(latitude, longitude), [[0, 40, 0], [0, 0, 30]], atol=1e-8)
