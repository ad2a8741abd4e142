"""The measurement equation: signs by hand, every Jacobian by differences, invariance under turned frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import oracles
from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.physics import so3
from starplumb.physics.camera import Distortion, FrameCamera
from starplumb.physics.light import Corrections
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.equation import linearise, pixel_residual, predict, residual_px
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors, measure

BENT = FrameCamera(2.2, 9e-6, (5999.5, 5999.5), (12000, 12000), Distortion((2.0, -300.0, 0.0), (0.02, -0.01)))
CAMERAS = {"frame": FRAME, "bent": BENT, "line": LINE}
NO_LIGHT = Corrections(light_time=False, aberration=False)


def by_hand(p_J, xy=(0.0, 0.0), corrections=NO_LIGHT):
    """One marker, one image; camera at the origin, E along J; pixels of 1e-5 rad."""
    blank = {
        "image": np.zeros(1, int),
        "landmark": np.zeros(1, int),
        "xy_K": np.array([xy], float),
        "slope_K": 1e-5 * np.eye(2)[None],
        "line_period_s": np.zeros(1),
        "C_EJ": np.eye(3)[None],
        "omega_E": np.zeros((1, 3)),
        "r_J": np.zeros((1, 3)),
        "v_J": np.zeros((1, 3)),
        "p_J": np.array([p_J], float),
        "e_E": np.zeros((1, 3)),
        "row_rate_E": np.zeros((1, 3)),
        "range_m": np.zeros(1),
        "sigma_px": np.ones(1),
        "weight": np.ones(1),
        "cov_attitude_E": np.zeros((1, 3, 3)),
        "cov_position_J": np.zeros((1, 3, 3)),
        "cov_landmark_J": np.zeros((1, 3, 3)),
        "corrections": corrections,
    }
    return Observations(**blank).with_geometry()


def noisy(camera, rng, **options):
    o = observe(truth(camera, **options))
    return measure(o, C_EK_TRUE, Errors.draw(o, rng))


@pytest.mark.parametrize(
    ("p", "z"), [((1.0, 0, 1000), (100, 0)), ((0, 1.0, 1000), (0, 100)), ((0, 0, 1000), (0, 0))]
)
def test_a_marker_to_the_right_is_predicted_right_of_the_centre(p, z):
    np.testing.assert_allclose(residual_px(by_hand(p), np.eye(3))[0], z, atol=1e-9)


@pytest.mark.parametrize(("axis", "moves"), [(0, (0, 1)), (1, (-1, 0)), (2, (0, 0))])
def test_a_camera_model_turned_about_one_axis_moves_the_prediction(axis, moves):
    """Model turned by +theta about x: the camera's z leans to -y, a marker ahead seems to lie at +y."""
    o = by_hand((0.0, 0.0, 1000.0))
    z = residual_px(o, so3.exp(1e-4 * np.eye(3)[axis]))[0]
    np.testing.assert_allclose(z, 10 * np.array(moves), atol=1e-6)
    np.testing.assert_allclose(linearise(o, np.eye(3)).H[0, :, axis], 1e5 * np.array(moves), atol=1e-9)


def test_a_camera_model_turned_about_the_boresight_turns_the_picture_back():
    o = by_hand((10.0, 0.0, 1000.0))
    np.testing.assert_allclose(linearise(o, np.eye(3)).H[0, :, 2], [0, -1000], atol=1e-9)


@pytest.mark.parametrize(("axis", "moves"), [(0, (-1, 0)), (1, (0, -1)), (2, (0, 0))])
def test_a_camera_displaced_to_the_right_sees_the_marker_left(axis, moves):
    np.testing.assert_allclose(
        linearise(by_hand((0, 0, 1000.0)), np.eye(3)).R[0, :, axis], 100 * np.array(moves)
    )


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("theta_arcsec", [0.0, 0.02, 2.0, 200.0, 3600.0])
def test_residual_and_jacobians_by_differences(camera, theta_arcsec, rng):
    """Against directions, light effects and a search for the row written elsewhere."""
    o = noisy(camera, rng, images=2, markers=3, tilt_deg=20.0, yaw_deg=70.0)
    C = so3.exp(theta_arcsec * ARCSEC * np.array([0.6, -0.5, 0.62])) @ C_EK_TRUE
    model, sens = linearise(o, C), oracles.sensitivities(o, C)
    # away from the measured row the motion during the scan changes: second order in the residual
    curvature = 3e-6 * np.max(np.abs(model.z_px)) if camera.scans or camera is BENT else 1e-9
    np.testing.assert_allclose(
        model.z_px.ravel(), oracles.residual(o, C), rtol=curvature, atol=1e-7 + 1e-5 * curvature
    )
    scale = np.max(np.abs(sens.mounting))
    close = {"rtol": 0, "atol": scale * (1e-8 + 10 * curvature)}
    np.testing.assert_allclose(model.H.reshape(-1, 3), sens.mounting, **close)
    for j in range(o.n):
        rows, i, k = slice(2 * j, 2 * j + 2), 3 * o.image[j], 3 * o.landmark[j]
        np.testing.assert_allclose(-model.H[j], sens.attitude[rows, i : i + 3], **close)
        # light effects move with the camera: 3e-5 of the sensitivity
        near = {"rtol": 0, "atol": np.max(np.abs(sens.position)) * (1e-4 + 10 * curvature)}
        np.testing.assert_allclose(model.R[j], sens.position[rows, i : i + 3], **near)
        np.testing.assert_allclose(-model.R[j], sens.marker[rows, k : k + 3], **near)


@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
@pytest.mark.parametrize(("source", "sign"), [("alpha_E", -1), ("rho_J", 1), ("pi_J", -1), ("pixel", -1)])
def test_errors_enter_with_the_signs_of_the_constitution(camera, source, sign, rng):
    """``z = H (theta - alpha) + R (rho - pi) - pixel``: simulated alone, each error is what the Jacobian says."""
    o = observe(truth(camera, images=3, markers=4))
    errors = Errors.draw(o, rng)
    measured = measure(o, C_EK_TRUE, errors.only(source))
    model = linearise(measured, C_EK_TRUE)
    value = getattr(errors, source)
    expected = {
        "alpha_E": lambda: (model.H @ value[o.image, :, None])[..., 0],
        "rho_J": lambda: (model.R @ value[o.image, :, None])[..., 0],
        "pi_J": lambda: (model.R @ value[o.landmark, :, None])[..., 0],
        "pixel": lambda: value,
    }[source]()
    assert np.max(np.abs(model.z_px)) > 0.1
    np.testing.assert_allclose(model.z_px, sign * expected, atol=3e-3)


def test_the_scans_motion_by_differences():
    """``row_rate_E`` is the apparent direction one row later less one row earlier, halved."""
    campaign = truth(LINE, images=2, markers=3, corrections=NO_LIGHT)
    o = observe(campaign)
    s = campaign.sightings
    later, earlier = (
        observe(replace(campaign, sightings=replace(s, row_px=s.row_px + d))).e_E for d in (100.0, -100.0)
    )
    np.testing.assert_allclose(
        (later - earlier) / 200.0, o.row_rate_E, rtol=1e-4, atol=1e-4 * np.abs(o.row_rate_E).max()
    )


@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
def test_turning_e_changes_nothing_but_the_frame(camera, rng):
    o = noisy(camera, rng, images=2, markers=3)
    Q = Rotation.random(random_state=8).as_matrix()
    turned = replace(o, C_EJ=Q @ o.C_EJ, omega_E=o.omega_E @ Q.T).with_geometry()
    before, after = linearise(o, C_EK_TRUE), linearise(turned, Q @ C_EK_TRUE)
    np.testing.assert_allclose(after.z_px, before.z_px, atol=1e-8)
    np.testing.assert_allclose(after.H @ Q, before.H, rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(after.R, before.R, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    "corrections", [NO_LIGHT, Corrections(True, True, True)], ids=["any axis", "Earth's axis"]
)
def test_turning_j_changes_nothing_but_the_frame(corrections, rng):
    """Light time knows the Earth's axis, refraction its shape; without them any turn will do."""
    o = noisy(LINE, rng, images=2, markers=3, corrections=corrections)
    turn = [0, 0, 2.0] if corrections.light_time else [0.3, -1.2, 2.0]
    Q = Rotation.from_rotvec(turn).as_matrix()
    turned = o.with_geometry(C_EJ=o.C_EJ @ Q.T, r_J=o.r_J @ Q.T, v_J=o.v_J @ Q.T, p_J=o.p_J @ Q.T)
    before, after = linearise(o, C_EK_TRUE), linearise(turned, C_EK_TRUE)
    np.testing.assert_allclose(after.z_px, before.z_px, atol=1e-6)
    np.testing.assert_allclose(after.H, before.H, rtol=1e-8, atol=1e-2)
    np.testing.assert_allclose(after.R @ Q, before.R, rtol=1e-9, atol=1e-9)


def test_predicted_tangents_of_a_tilted_direction():
    np.testing.assert_allclose(predict(np.eye(3), np.array([[0.1, -0.2, 2.0]])), [[0.05, -0.1]])


def test_a_marker_behind_the_camera_is_flagged():
    assert linearise(by_hand((0, 1.0, 1000.0)), np.eye(3)).in_front.all()
    assert not linearise(by_hand((0, 1.0, -1000.0)), np.eye(3)).in_front.any()


def test_residual_turns_back_into_tangents(rng):
    o = noisy(LINE, rng, images=2, markers=3, yaw_deg=40.0)
    model = linearise(o, C_EK_TRUE)
    F = predict(C_EK_TRUE, o.e_E) - o.xy_K
    np.testing.assert_allclose((model.B @ model.z_px[..., None])[..., 0], F, atol=1e-15)
    again = pixel_residual(C_EK_TRUE, o.e_E, o.xy_K, o.slope_K, o.row_rate_E)
    np.testing.assert_array_equal(again, model.z_px)


@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
def test_batches_are_single_runs_side_by_side(camera, rng):
    o = observe(truth(camera, images=2, markers=3))
    errors = Errors.draw(o, rng, (2, 3))
    many = measure(o, C_EK_TRUE, errors)
    assert many.batch == (2, 3)
    C = so3.exp(1e-3 * rng.standard_normal((2, 3, 3))) @ C_EK_TRUE
    one = measure(
        o, C_EK_TRUE, Errors(*(getattr(errors, f)[1, 2] for f in ("alpha_E", "rho_J", "pi_J", "pixel")))
    )
    together, alone = linearise(many, C), linearise(one, C[1, 2])
    for name in ("z_px", "H", "R"):
        np.testing.assert_allclose(getattr(together, name)[1, 2], getattr(alone, name), rtol=1e-12, atol=1e-9)


def test_selected_sightings_keep_their_images_and_landmarks(rng):
    o = noisy(FRAME, rng, images=3, markers=2)
    part = o.select(o.image != 1)
    assert (part.n, part.n_images, part.n_landmarks) == (4, 3, 6)
    np.testing.assert_array_equal(residual_px(part, C_EK_TRUE), residual_px(o, C_EK_TRUE)[o.image != 1])
    np.testing.assert_array_equal(o.select(np.array([3, 0])).e_E, o.e_E[[3, 0]])


def test_shapes_are_checked_once(rng):
    o = noisy(FRAME, rng, images=1, markers=2)
    with pytest.raises(ValueError, match=r"e_E has shape \(3, 2\), wanted \(..., 2, 3\)"):
        replace(o, e_E=o.e_E.T)
    with pytest.raises(ValueError, match="past the covariances"):
        replace(o, image=o.image + 1)


def test_measured_directions_are_unit_vectors_of_the_tangents():
    o = by_hand((0, 0, 10.0), xy=(3 * DEG, -0.1))
    np.testing.assert_allclose(o.e_K[0] / o.e_K[0, 2], [3 * DEG, -0.1, 1])
    assert np.linalg.norm(o.e_K) == pytest.approx(1)
