"""Real products with blunders planted among their ground points: the same answer as without them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from starplumb.estimators.gls import Gls
from starplumb.estimators.robust import Robust
from starplumb.io.vendors.digitalglobe import read_digitalglobe
from starplumb.io.vendors.digitalglobe_geo import Optics
from starplumb.io.vendors.dimap import read_dimap
from starplumb.judge.calibrate import calibrate
from starplumb.physics import so3
from starplumb.physics.earth import geodetic_to_itrf
from starplumb.table.campaign import Landmarks, Sightings
from starplumb.table.geometry import locate

QUICKBIRD = Optics(principal_distance_mm=8836.202, pitch_mm=0.01191396, origin_mm=(9.54684, 164.02773))


def with_points(campaign, pixel, p_J):
    n = len(pixel)
    landmarks = Landmarks(tuple(map(str, range(n))), p_J, np.tile(0.09 * np.eye(3), (n, 1, 1)))
    image = np.zeros(n, dtype=np.int64)
    sightings = Sightings(image, np.arange(n), *pixel.T, np.full(n, 0.1), np.zeros(n, dtype=bool))
    return replace(campaign, landmarks=landmarks, sightings=sightings)


def pleiades(shared_data, rng):
    """60 nodes of the vendor's own grid, 0.3 m of survey noise, raw quaternions."""
    rasterio = pytest.importorskip("rasterio")
    folder = shared_data / "pleiades1b"
    with rasterio.open(next(folder.glob("GRID*.tif"))) as file:
        bands, tags, place = file.read(), file.tags(), file.transform
    row, column, layer = (*rng.integers(0, 65, (2, 60)), 2 * rng.integers(0, 9, 60))
    pixel = np.stack([place.c + 0.5 + column * place.a, place.f + 0.5 + row * place.e], axis=-1) - 1.0
    height = np.array([float(tags[f"ALTITUDE_B{b}"]) for b in layer])
    latitude, longitude = np.radians(bands[layer + 1, row, column]), np.radians(bands[layer, row, column])
    p_J = geodetic_to_itrf(latitude, longitude, height) + 0.3 * rng.standard_normal((60, 3))
    campaign = read_dimap(next(folder.glob("PHRDIMAP*.XML")), "raw").campaign(0.5, [2.0, 2.0, 4.0])
    return with_points(campaign, pixel, p_J)


def quickbird(shared_data, rng):
    """60 points of the image as its own four corners calibrate it, 0.3 m of survey noise, from an identity mount."""
    product = read_digitalglobe(next((shared_data / "quickbird2").glob("*.IMD")), QUICKBIRD)
    corners, campaign = product.corners, product.campaign()
    by_corners = with_points(campaign, np.stack([corners.column_px, corners.row_px], -1), corners.r_J)
    C_EK = calibrate(by_corners, Gls()).estimate.C_EK
    low, high = (
        np.min([corners.column_px, corners.row_px], axis=1),
        np.max([corners.column_px, corners.row_px], axis=1),
    )
    pixel = rng.uniform(low + 100.0, high - 100.0, (60, 2))
    p_J = locate(campaign, C_EK, np.zeros(60, dtype=np.int64), *pixel.T, rng.uniform(0.0, 300.0, 60))
    return with_points(campaign, pixel, p_J + 0.3 * rng.standard_normal((60, 3)))


@pytest.mark.parametrize("product", [pleiades, quickbird])
def test_ten_percent_of_blunders_change_nothing(product, shared_data, rng):
    """Six of sixty: three measured 5 to 40 px off, three with each other's labels."""
    campaign = product(shared_data, rng)
    clean = calibrate(campaign, Gls())
    s, wrong = campaign.sightings, np.array([3, 11, 20, 31, 44, 52])
    pixel = np.stack([s.column_px, s.row_px], axis=-1)
    away = rng.uniform(5.0, 40.0, 3)[:, None] * np.array([[1.0, 0.3], [-0.5, 1.0], [0.7, -0.8]])
    pixel[wrong[:3]] += away
    pixel[wrong[3:]] = np.roll(pixel[wrong[3:]], 1, axis=0)
    spoilt = replace(campaign, sightings=replace(s, column_px=pixel[:, 0], row_px=pixel[:, 1]))
    done = calibrate(spoilt, Robust())
    assert done.status.usable
    apart = so3.log(done.estimate.C_EK @ clean.estimate.C_EK.mT)
    assert np.all(np.abs(apart) < clean.estimate.sigma_E)
    out = {r.landmark for r in done.rejected}
    assert set(wrong) <= out
    # the raw attitude wanders within the image by several times the stated noise: some good points go as well
    assert len(out) <= 15
    assert all("sighting: predicted minus measured" in r.reason for r in done.rejected)
