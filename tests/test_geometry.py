"""Ground to pixel and back, with all corrections on, and the covariances that come with the table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from oracles import seen_direction
from problems import C_EK_TRUE, FRAME, LINE, UniformEarth, truth
from starplumb.physics import so3
from starplumb.physics.camera import Distortion, FrameCamera
from starplumb.physics.earth import geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.errors import EpochError, InputError
from starplumb.physics.light import Corrections
from starplumb.physics.orbit import KeplerOrbit
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table import geometry
from starplumb.table.equation import residual_px
from starplumb.table.geometry import locate, observe, position_covariance, project, stations

EVERYTHING = Corrections(light_time=True, aberration=True, refraction=True)
BENT = FrameCamera(2.2, 9e-6, (5999.5, 5999.5), (12000, 12000), Distortion((2.0, -300.0, 0.0), (0.02, -0.01)))


@pytest.mark.parametrize(
    ("camera", "tolerance"), [(FRAME, 1e-6), (BENT, 1e-6), (LINE, 1e-4)], ids=["frame", "bent", "line"]
)
@pytest.mark.parametrize("tilt", [0.0, 15.0, 30.0])
@pytest.mark.parametrize("yaw", [0.0, 90.0])
def test_pixel_to_the_ground_and_back(camera, tolerance, tilt, yaw, rng):
    campaign = truth(camera, images=3, markers=1, tilt_deg=tilt, yaw_deg=yaw, corrections=EVERYTHING)
    image = np.repeat(np.arange(3), 20)
    pixel = rng.uniform(0, 11999, (60, 2))
    height = rng.uniform(-400, 8000, 60)
    p_J = locate(campaign, C_EK_TRUE, image, pixel[:, 0], pixel[:, 1], height)
    np.testing.assert_allclose(itrf_to_geodetic(p_J)[2], height, atol=1e-5)
    back = project(campaign, C_EK_TRUE, image, p_J)
    assert np.max(np.abs(back - pixel)) < tolerance


@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
def test_a_true_scene_has_no_residual_and_its_attitude_is_the_pointing(camera):
    """Markers located by the true mounting are seen where they were located from."""
    o = observe(truth(camera, images=3, markers=5, corrections=EVERYTHING))
    np.testing.assert_allclose(residual_px(o, C_EK_TRUE), 0.0, atol=1e-4 if camera.scans else 1e-6)


def test_the_line_a_point_falls_on_is_where_scipy_finds_it(rng):
    """The row by a search over the interpolated geometry, one least-squares problem for one point."""
    campaign = truth(LINE, images=1, markers=1)
    p_J = locate(campaign, C_EK_TRUE, np.zeros(1, int), [3000.0], [9000.0], 100.0)
    p_J = p_J + np.array([30.0, -50.0, 20.0])
    found = project(campaign, C_EK_TRUE, np.zeros(1, int), p_J)[0]

    def off(pixel):
        t = campaign.images.t_ns[0] + np.int64(np.rint(1e9 * campaign.images.line_period_s[0] * pixel[1]))
        C, _ = campaign.attitude.at(t)
        r, v = campaign.ephemeris.at(t)
        s = C_EK_TRUE.T @ C @ seen_direction(p_J[0], r, v, campaign.corrections)
        return (s[:2] / s[2] - campaign.camera.tan_from_px(pixel[0], 0.0)[0]) * 1e6

    expected = least_squares(off, [3000.0, 9000.0], diff_step=1e-4, xtol=1e-14, ftol=1e-14).x
    np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.parametrize(
    ("place", "where"), [((0.0, 179.999), "antimeridian"), ((89.9, 30.0), "pole"), ((-89.95, 0.0), "pole")]
)
def test_nothing_happens_at_the_antimeridian_or_the_poles(place, where):
    """The same scene turned about the Earth's axis, and one over a pole, where a polar orbit passes."""
    latitude, longitude = np.radians(place)
    orbit = KeplerOrbit(7058e3, 0.0, 90 * DEG, longitude, 0.0, latitude)
    flight = scene.Pass(np.zeros(1), geodetic_to_itrf(latitude, longitude, 0.0)[None], np.zeros(1))
    sigmas = scene.Sigmas(np.full(3, 1e-5), np.ones(3), np.ones(3), 0.3)
    campaign = scene.photograph(FRAME, orbit, UniformEarth(), 0, flight, C_EK_TRUE, sigmas, Corrections())
    pixel = np.array([[100.0, 200.0], [11000.0, 300.0], [500.0, 11500.0], [6000.0, 6000.0]])
    image = np.zeros(4, int)
    p_J = locate(campaign, C_EK_TRUE, image, pixel[:, 0], pixel[:, 1], 50.0)
    np.testing.assert_allclose(itrf_to_geodetic(p_J)[2], 50.0, atol=1e-6)
    np.testing.assert_allclose(project(campaign, C_EK_TRUE, image, p_J), pixel, atol=1e-6)


def test_a_line_of_sight_past_the_earth_has_no_point():
    campaign = truth(FRAME, images=1, markers=1)
    away = C_EK_TRUE @ so3.exp([0.0, 100 * DEG, 0.0])
    p_J = locate(campaign, away, np.zeros(2, int), [0.0, 6000.0], [0.0, 6000.0])
    assert np.all(np.isnan(p_J))


def test_an_image_outside_the_series_is_named():
    campaign = truth(FRAME, images=3, markers=2)
    t_ns = campaign.images.t_ns.copy()
    t_ns[1] += 10_000_000_000
    late = replace(campaign, images=replace(campaign.images, t_ns=t_ns))
    with pytest.raises(
        EpochError,
        match=r"image 'image02': found the epoch .* in a gap of the attitude .* nearest sample is 9 s",
    ) as caught:
        observe(late)
    assert late.sightings.image[caught.value.row] == 1


def test_a_scanners_rows_outside_the_series_are_named():
    campaign = truth(LINE, images=2, markers=2)
    s = campaign.sightings
    row = s.row_px.copy()
    row[3] += 20000
    with pytest.raises(EpochError, match="image 'image02'"):
        observe(replace(campaign, sightings=replace(s, row_px=row)))


def test_rows_of_a_scanner_are_epochs_and_of_a_frame_are_not():
    frame, line = truth(FRAME, images=1, markers=1), truth(LINE, images=1, markers=1)
    zero = np.zeros(2, int)
    still, moving = stations(frame, zero, [0.0, 1000.0]), stations(line, zero, [0.0, 1000.0])
    assert np.all(still.r_J[0] == still.r_J[1])
    travelled = np.linalg.norm(moving.r_J[1] - moving.r_J[0])
    assert travelled == pytest.approx(np.linalg.norm(moving.v_J[0]) * 0.41, rel=1e-4)
    late = line.images.t_ns[0] + 410_000_000
    np.testing.assert_allclose(moving.C_EJ[1], line.attitude.at(late)[0], atol=1e-15)


def test_earth_fixed_position_sigmas_stay_where_they_are():
    campaign = replace(truth(FRAME, images=2, markers=1), sigma_position=np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(position_covariance(campaign)[1], np.diag([1.0, 4.0, 9.0]))


def test_inertial_position_sigmas_are_turned_with_the_earth():
    """An error along the inertial x axis, seen from an Earth turned by 30 deg, lies at -30 deg of longitude."""
    turn_ns = np.int64(round(30 * DEG / 7.292115e-5 * 1e9))
    campaign = truth(FRAME, images=1, markers=1)
    campaign = replace(
        campaign,
        position_frame="GCRF",
        sigma_position=np.array([2.0, 0.0, 0.0]),
        images=replace(campaign.images, t_ns=np.array([turn_ns])),
    )
    along = 2.0 * np.array([np.cos(30 * DEG), -np.sin(30 * DEG), 0.0])
    np.testing.assert_allclose(position_covariance(campaign)[0], np.outer(along, along), atol=1e-6)


def test_the_table_states_the_campaigns_errors():
    campaign = truth(FRAME, images=2, markers=3)
    campaign = replace(
        campaign,
        cov_attitude_E=np.array([np.diag([1.0, 4.0, 9.0]), np.diag([16.0, 25.0, 36.0])]) * ARCSEC**2,
        sigma_mounting=np.array([10.0, 20.0, 30.0]) * ARCSEC,
    )
    o = observe(campaign)
    np.testing.assert_allclose(o.cov_attitude_E[1], np.diag([16.0, 25.0, 36.0]) * ARCSEC**2)
    np.testing.assert_allclose(o.prior_E, np.diag([100.0, 400.0, 900.0]) * ARCSEC**2)
    np.testing.assert_array_equal(o.weight, np.ones(6))


def test_marker_sigmas_are_along_east_north_and_up():
    """A marker surveyed to 1, 2 and 5 m, seen along its own axes."""
    lat, lon = 40 * DEG, 120 * DEG
    marker = scene.survey(geodetic_to_itrf(lat, lon, 0.0)[None], np.array([1.0, 2.0, 5.0]))
    to_local = Rotation.from_euler("ZY", [lon, -lat]).as_matrix().T  # rows: up, east, north
    np.testing.assert_allclose(
        to_local @ marker.covariance_J[0] @ to_local.T, np.diag([25.0, 1.0, 4.0]), atol=1e-9
    )


# Refusals -----------------------------------------------------------------------------------------------------


def test_a_point_that_no_row_of_a_scanner_sees_is_refused():
    """The other side of the Earth: the search must neither return a row nor go on for ever."""
    campaign = truth(LINE, images=1, markers=1)
    zero = np.zeros(1, int)
    antipode = -locate(campaign, C_EK_TRUE, zero, [3000.0], [0.0], 0.0)
    with pytest.raises((InputError, EpochError), match=r"row|epoch"):
        project(campaign, C_EK_TRUE, zero, antipode)


def test_a_search_that_does_not_settle_is_refused(monkeypatch):
    """A step that never shrinks below the tolerance: no answer, and after a few rounds."""
    campaign = truth(LINE, images=1, markers=1)
    zero, steps = np.zeros(1, int), []

    def restless(campaign, C_EK, pixel, directions):
        steps.append(pixel)
        return np.full_like(pixel, (-1.0) ** len(steps))

    monkeypatch.setattr(geometry, "scan_step", restless)
    p_J = locate(campaign, C_EK_TRUE, zero, [3000.0], [0.0], 0.0)
    with pytest.raises(InputError, match="the search for the row of a point did not converge"):
        project(campaign, C_EK_TRUE, zero, p_J, [[3000.0, 0.0]])
    assert 10 < len(steps) < 100
