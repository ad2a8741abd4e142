"""More unknowns: Jacobians by differences, truth with honest sigmas, and what data cannot tell named as such."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from problems import C_EK_TRUE, FRAME, LINE, SIGMAS, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.estimators.robust import Robust
from starplumb.judge.calibrate import calibrate
from starplumb.judge.parameters.separability import combinations, flight_axes, known
from starplumb.physics import so3
from starplumb.physics.camera import Distortion
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.solve.problem import Problem
from starplumb.table.equation import linearise, predict
from starplumb.table.geometry import observe
from starplumb.table.parameter_names import parameters
from starplumb.table.parameters import OPTICS, LookAngles, Optics, TimeOffset, TrackerMounting
from starplumb.table.simulate import Errors, measure

INF = np.inf
BENT = replace(FRAME, distortion=Distortion((0.3, 20.0, 0.0), (1e-3, -2e-3)))
LOOKS = ("look_x_1", "look_x_2", "look_y_0", "look_y_3")
CASES = {
    "optics": (BENT, Optics(BENT, OPTICS, (INF,) * 8), [5e-3, 3.0, -2.0, 0.2, 30.0, 1e4, 1e-3, 1e-3]),
    "look angles": (LINE, LookAngles(LINE, LOOKS, (INF,) * 4), [1e-5, -2e-5, 1e-5, 3e-5]),
    "clock": (LINE, TimeOffset(("time_offset",), (INF,)), [0.01]),
    "attitude clock": (FRAME, TimeOffset(("time_offset_attitude",), (INF,)), [0.01]),
    "orbit clock": (FRAME, TimeOffset(("time_offset_orbit",), (INF,)), [0.01]),
    "tracker": (FRAME, TrackerMounting("B", np.array([False, True, False])), [0.01, -0.02, 0.01]),
}


@pytest.mark.parametrize("name", CASES)
def test_jacobian_is_the_difference_quotient(name):
    """Where the residual vanishes, which is where Gauss-Newton's own Jacobian is the whole one."""
    camera, parameter, value = CASES[name]
    value = np.array(value)
    o = observe(truth(camera, 3, 5))
    # measure so that the table with ``value`` applied has no residual
    for _ in range(3):
        applied = parameter.apply(o, value)
        o = replace(o, xy_K=o.xy_K + predict(C_EK_TRUE, applied.e_E) - applied.xy_K)
    applied = parameter.apply(o, value)
    design = parameter.moves(applied, value).design(linearise(applied, C_EK_TRUE))
    for j in range(value.size):
        h = np.zeros_like(value)
        h[j] = 1e-4 * abs(value[j])
        ahead, behind = (linearise(parameter.apply(o, value + s * h), C_EK_TRUE).z_px for s in (1, -1))
        quotient = (ahead - behind) / (2.0 * h[j])
        np.testing.assert_allclose(design[..., j], quotient, atol=2e-4 * np.abs(quotient).max(), rtol=0)


def test_optics_agree_with_the_camera_they_describe():
    """Applying a correction gives the tangents of the corrected camera at the same pixels."""
    pixel = np.array([[100.0, 200.0], [9000.0, 4000.0]])
    o = observe(truth(BENT, 1, 2))
    xy, slope = BENT.tan_from_px(*pixel.T)
    value = np.array([0.0055, 2.0, -3.0])
    applied = Optics(BENT, ("focal_length", "principal_column", "principal_row"), (INF,) * 3).apply(
        replace(o, xy_K=xy, slope_K=slope), value
    )
    corrected = replace(BENT, focal_length=2.2055, principal_point_px=(6001.5, 5996.5))
    np.testing.assert_allclose(applied.xy_K, corrected.tan_from_px(*pixel.T)[0], atol=1e-15)


def test_the_slope_of_bent_look_directions_is_their_difference_quotient():
    """d (tan_x, tan_y) / d column with Legendre polynomials of the third degree added, a third as steep as the line."""
    o = observe(truth(LINE, 1, 5))
    column, row = LINE.px_from_tan(o.xy_K).T
    looks = LookAngles(LINE, ("look_x_1", "look_y_3"), (INF, INF))
    value = 0.3 * np.ptp(LINE.tan_x) * np.array([1.0, 0.1])

    def at(moved):
        xy, slope = LINE.tan_from_px(column + moved, row)
        return looks.apply(replace(o, xy_K=xy, slope_K=slope), value)

    quotient = (at(0.5).xy_K - at(-0.5).xy_K) / 1.0
    np.testing.assert_allclose(at(0.0).slope_K[..., 0], quotient, atol=1e-6 * np.abs(quotient).max())


def late(campaign, dt):
    """The campaign as recorded by a camera whose clock says every epoch dt too early."""
    t_ns = campaign.images.t_ns - np.int64(round(dt * 1e9))
    return replace(campaign, images=replace(campaign.images, t_ns=t_ns))


def test_a_late_clock_is_found_by_its_size_and_sign():
    """Epochs 4 ms too early by the whole chain from files' epochs on, no noise; yaw turns make it separable."""
    true = truth(FRAME, 8, 8, tilt_deg=20.0, yaw_deg=90.0)
    estimate = Gls((TimeOffset(("time_offset",), (INF,)),))(observe(late(true, 0.004)), C_EK_TRUE)
    assert estimate.parameters.values[0] == pytest.approx(0.004, abs=2e-6)
    assert np.abs(so3.log(estimate.C_EK @ C_EK_TRUE.mT)).max() < 0.05 * ARCSEC


def test_a_second_tracker_is_found_by_its_size_and_sign(rng):
    o = observe(truth(FRAME, 6, 8))
    second = np.array([False, True, False, True, False, True])
    delta = np.array([40.0, -25.0, 60.0]) * ARCSEC
    wrong = second[o.image][:, None, None]
    table = o.with_geometry(C_EJ=np.where(wrong, so3.exp(delta) @ o.C_EJ, o.C_EJ))
    estimate = Gls((TrackerMounting("B", second),))(table, C_EK_TRUE)
    np.testing.assert_allclose(estimate.parameters.values, delta, atol=0.01 * ARCSEC)
    assert estimate.parameters.names == ("tracker_B_x", "tracker_B_y", "tracker_B_z")


def published_two_images(camera):
    """Two images with two markers each at (+-2.5, +-2.5) km on a diagonal, as published (Tkachenko 2019)."""
    campaign = truth(camera, 2, 1)
    apart = 2500.0 * camera.focal_length / camera.pitch / 690e3
    pixel = 5999.5 + apart * np.array([[-1.0, -1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, 1.0]])
    return scene.mark_pixels(campaign, np.array([0, 0, 1, 1]), pixel, np.zeros(4), SIGMAS)


def test_an_unknown_focal_length_costs_no_more_than_the_bound(rng):
    """A lens 0.25 % longer than stated: errors as large as the stated sigma, that as small as with the lens known."""
    longer = replace(FRAME, focal_length=1.0025 * 2.2)
    o = observe(published_two_images(longer))
    runs = 800
    known_lens = measure(o, C_EK_TRUE, Errors.draw(o, rng, (runs,)))
    xy = known_lens.xy_K * 1.0025  # what the stated lens makes of the same pixels
    table = replace(known_lens, xy_K=xy, slope_K=o.slope_K * 1.0025)
    estimate = Gls((Optics(FRAME, ("focal_length",), (INF,)),))(table, C_EK_TRUE)
    assert np.all(estimate.status == Status.OK)
    error = so3.log(estimate.C_EK @ C_EK_TRUE.mT)
    np.testing.assert_allclose(np.std(error / estimate.sigma_E, axis=0), 1.0, atol=0.1)
    at_best = Gls()(known_lens, C_EK_TRUE)
    assert np.all(estimate.sigma_E < 1.01 * at_best.sigma_E)
    p = estimate.parameters
    off = (p.values[:, 0] - 0.0055) / np.sqrt(p.covariance[:, 3, 3])
    assert np.std(off) == pytest.approx(1.0, abs=0.1)
    assert abs(np.mean(off)) < 0.15


def test_the_covariance_of_everything_is_that_of_the_errors(rng):
    """Alignment, lens, clock: normalised error squared has mean and sd of chi-square with 6 degrees of freedom."""
    o = observe(truth(FRAME, 6, 10, tilt_deg=25.0, yaw_deg=90.0))
    runs = 500
    names = ("focal_length", "k1")
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (runs,)))
    estimate = Gls((Optics(FRAME, names, (INF, INF)), TimeOffset(("time_offset",), (INF,))))(
        table, so3.exp(DEG * np.array([0.3, 0.2, -0.5])) @ C_EK_TRUE
    )
    p = estimate.parameters
    off = np.concatenate([so3.log(estimate.C_EK @ C_EK_TRUE.mT), p.values], axis=-1)
    squared = np.sum(off * np.linalg.solve(p.covariance, off[..., None])[..., 0], axis=-1)
    assert np.mean(squared) == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / runs))
    assert np.std(squared) == pytest.approx(np.sqrt(12.0), rel=0.2)


def test_a_common_error_and_a_prior_are_as_in_the_dense_covariance(rng):
    """With V of all errors, the common one included, and a prior P: covariance (H^T V^-1 H + P^-1)^-1."""
    o = observe(truth(FRAME, 4, 5, shared_site=True))
    table = replace(measure(o, C_EK_TRUE, Errors.draw(o, rng)), prior_E=np.eye(3) * (20.0 * ARCSEC) ** 2)
    table = replace(table, common_px=linearise(table, C_EK_TRUE).H[..., :1] * 10.0 * ARCSEC)
    estimate = Gls()(table, C_EK_TRUE)
    model = linearise(table, estimate.C_EK)
    V = np.einsum("nic,mjc->nimj", table.common_px, table.common_px).reshape(40, 40)
    V += np.diag(np.repeat(table.sigma_px**2, 2))
    for design, covariance, index in (
        (model.H, table.cov_attitude_E, table.image),
        (model.R, table.cov_position_J, table.image),
        (model.R, table.cov_landmark_J, table.landmark),
    ):
        for member in np.unique(index):
            J = np.where((index == member)[:, None, None], design, 0.0).reshape(40, 3)
            V += J @ np.broadcast_to(covariance, (index.max() + 1, 3, 3))[member] @ J.T
    H = model.H.reshape(40, 3)
    wanted = np.linalg.inv(H.T @ np.linalg.solve(V, H) + np.linalg.inv(table.prior_E))
    np.testing.assert_allclose(estimate.covariance_E, wanted, rtol=1e-5, atol=1e-6 * np.max(wanted))
    assert estimate.degrees_of_freedom == 40


def test_a_prior_is_worth_what_it_says():
    """With the prior as the only news the sigma is the prior's: nadir images do not tell pitch from time."""
    o = observe(truth(FRAME, 6, 8, tilt_deg=0.0))
    estimate = Gls((TimeOffset(("time_offset_attitude",), (1e-3,)),))(o, C_EK_TRUE)
    assert np.sqrt(estimate.parameters.covariance[3, 3]) == pytest.approx(1e-3, rel=1e-3)


def told(camera, ps, **scene_options):
    o = observe(truth(camera, 8, 10, **scene_options))
    estimate = Gls(ps)(o, C_EK_TRUE)
    return estimate, combinations(o, estimate)


def test_pitch_and_time_at_nadir_are_named_and_not_reported():
    estimate, found = told(FRAME, (TimeOffset(("time_offset",), (INF,)),), tilt_deg=0.0)
    assert found[0].names == ("the pitch of the alignment", "the time offset")
    assert "cannot separate the pitch of the alignment and the time offset" in found[0].sentence
    assert not known(estimate.parameters, found)[0]


def test_pitch_and_time_in_turned_images_are_told_apart():
    estimate, found = told(FRAME, (TimeOffset(("time_offset",), (INF,)),), tilt_deg=25.0, yaw_deg=90.0)
    assert found == []
    assert known(estimate.parameters, found)[0]


def test_the_principal_point_is_a_rotation():
    names = ("principal_column", "principal_row", "focal_length")
    estimate, found = told(FRAME, (Optics(FRAME, names, (INF,) * 3),))
    involved = {name for combination in found for name in combination.names}
    assert {"the principal point's column", "the principal point's row"} <= involved
    assert "the focal length" not in involved
    assert list(known(estimate.parameters, found)) == [False, False, True]


def test_yaw_and_a_tilted_line_are_the_same():
    _, found = told(LINE, (LookAngles(LINE, ("look_y_1", "look_x_2"), (INF, INF)),))
    assert found[0].names == ("the yaw of the alignment", "the look angles' y term of degree 1")


def test_axes_of_flight_by_hand():
    """A camera looking along z of E that flies along x of E: roll, pitch and yaw are x, y and z."""
    o = observe(truth(FRAME, 1, 2))
    still = replace(o, C_EJ=np.broadcast_to(np.eye(3), (2, 3, 3)), v_J=np.array([[7e3, 0.0, 50.0]] * 2))
    np.testing.assert_allclose(flight_axes(still, np.eye(3)), np.eye(3), atol=1e-12)


def test_a_calibration_refuses_what_it_cannot_know():
    """Through the door a user takes: weak or singular, in words."""
    campaign = truth(LINE, 4, 12)
    done = calibrate(campaign, Gls(parameters(["look_y_1"], campaign)))
    assert done.status is Status.SINGULAR
    assert "cannot separate the yaw of the alignment" in done.message
    mild = truth(FRAME, 6, 8, tilt_deg=0.0)
    done = calibrate(mild, Gls(parameters(["time_offset"], mild)))
    assert done.status is Status.WEAK
    plain = calibrate(mild, Gls(parameters(["focal_length"], mild)))
    assert plain.status in (Status.OK, Status.WEAK)
    assert plain.combinations == ()


def test_a_wrong_lens_and_wrong_labels_at_once(rng):
    """Robust with the focal length free: the lens 0.25 % off moves markers by up to 15 px and is no blunder."""
    longer = replace(FRAME, focal_length=1.0025 * 2.2)
    o = observe(truth(longer, 12, 12))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    xy = table.xy_K * 1.0025
    wrong = rng.permutation(o.n)[: round(0.3 * o.n)]
    xy[wrong] = xy[np.roll(wrong, 1)]
    table = replace(table, xy_K=xy, slope_K=o.slope_K * 1.0025)
    estimate = Robust(Gls((Optics(FRAME, ("focal_length",), (INF,)),)))(table, C_EK_TRUE)
    assert estimate.status == Status.OK
    assert np.abs(so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E).max() < 4.0
    sigma = np.sqrt(estimate.parameters.covariance[3, 3])
    assert abs(estimate.parameters.values[0] - 0.0055) < 4.0 * sigma
    assert np.sum((estimate.verdict == 0) != ~np.isin(np.arange(o.n), wrong)) <= 4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("focus", "'focus'.*wanted one or more of focal_length"),
        ("focal_length=5", r"focal_length=5, wanted a positive number with its unit \(m, mm, um\)"),
        ("time_offset=5mm", r"wanted a positive number with its unit \(s, ms, us\)"),
        ("focal_length=1e300mm", r"focal_length=1e300mm, wanted .* as sigma, 1e-06 to 1e\+07 mm"),
        ("focal_length=1e-300mm", r"focal_length=1e-300mm, wanted .* 1e-06 to 1e\+07 mm"),
        ("time_offset=1e200s", r"time_offset=1e200s, wanted .* 1e-06 to 1e\+07 ms"),
        ("principal_point=1e-300px", r"principal_column=1e-300px, wanted .* 1e-06 to 1e\+07 px"),
        ("distortion=1e9", r"k1=1e9, wanted a positive number as sigma, 1e-06 to 1e\+07, such"),
        ("look_angles", "wanted focal_length or distortion for a frame camera"),
        ("trackers", "wanted a column tracker"),
    ],
)
def test_a_wrong_wish_is_refused_in_a_sentence(text, words):
    with pytest.raises(InputError, match=words):
        parameters([text], truth(FRAME, 2, 2))


def test_wishes_in_their_units():
    campaign = truth(FRAME, 2, 2)
    found = parameters(["focal_length=5.5mm", "principal_point=3px", "time_offset_orbit=10ms"], campaign)
    assert found[0].sigma == (0.0055, 3.0, 3.0)
    assert found[1].sigma == (0.01,)
    with pytest.raises(InputError, match="line-scan camera"):
        parameters(["focal_length"], truth(LINE, 2, 2))


@pytest.mark.parametrize("name", ["optics", "look angles"])
def test_the_design_is_the_difference_quotient_whatever_the_residuals(name, rng):
    """Of the residual itself, with 30 px of noise in it: what the derivative says is no average over its noise."""
    camera, parameter, value = CASES[name]
    true = observe(truth(camera, 3, 5))
    px = 30.0 * rng.standard_normal((true.n, 2))
    o = replace(true, xy_K=true.xy_K + (true.slope_K @ px[..., None])[..., 0])
    value = np.array(value) if name == "optics" else np.zeros(len(value))
    prior = np.eye(3 + value.size), np.zeros(3 + value.size)

    def at(v, theta):
        return Problem(o, (parameter,), so3.exp(theta) @ C_EK_TRUE, v, prior).linear(o)

    _, model, A = at(value, np.zeros(3))
    assert np.abs(model.z_px).max() > 30.0
    steps = np.concatenate([np.full(3, 1e-7), 1e-4 * np.abs(CASES[name][2])])
    for j, h in enumerate(steps):
        d = np.zeros(steps.size)
        d[j] = h
        ahead, behind = (at(value + s * d[3:], s * d[:3])[1].z_px for s in (1, -1))
        quotient = (ahead - behind) / (2.0 * h)
        off = np.abs(A[..., j] - quotient) / np.abs(quotient).max()
        # a scanner's slope is that of the measured row; a lens leaves nothing
        assert np.max(off) < (2e-5 if name == "optics" else 2e-3)


@pytest.mark.parametrize("sigma_px", [0.3, 3.0])
def test_optics_are_those_of_the_full_nonlinear_problem(sigma_px, rng):
    """By SciPy with every error of every image as an unknown, its own derivatives, and the camera that results."""
    names = ("focal_length", "k1", "k2")
    o = observe(truth(FRAME, 4, 60))
    o = replace(o, sigma_px=np.full(o.n, sigma_px), cov_landmark_J=1e-8 * o.cov_landmark_J)
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    pixel, own = FRAME.px_from_tan(o.xy_K), 3 + len(names)
    roots = np.linalg.cholesky(o.cov_attitude_E), np.linalg.cholesky(o.cov_position_J)
    size = np.array([ARCSEC] * 3 + [1e-5, 1e-2, 1.0])

    def residual(u):
        x, images = size * u[:own], u[own:].reshape(o.n_images, 2, 3, 1)
        alpha, rho = ((root @ images[:, i])[..., 0][o.image] for i, root in enumerate(roots))
        lens = replace(FRAME.distortion, k=(x[4], x[5], 0.0))
        camera = replace(FRAME, focal_length=FRAME.focal_length + x[3], distortion=lens)
        e_E = o.e_E + np.einsum("nij,nj->ni", o.C_EJ, rho) / o.range_m[:, None]
        e_E = np.einsum("nij,nj->ni", so3.exp(-alpha), e_E)
        s_K = e_E @ (so3.exp(x[:3]) @ C_EK_TRUE)
        off = camera.px_from_tan(s_K[:, :2] / s_K[:, 2:]) - pixel
        return np.concatenate([off.ravel() / sigma_px, u[own:]])

    found = least_squares(
        residual, np.zeros(own + 6 * o.n_images), "3-point", xtol=1e-14, ftol=1e-14, gtol=1e-12
    )
    estimate = Gls((Optics(FRAME, names, (INF,) * 3),), tolerance=1e-5)(o, C_EK_TRUE)
    d = (
        np.concatenate([so3.log(estimate.C_EK @ C_EK_TRUE.T), estimate.parameters.values])
        - size * found.x[:own]
    )
    sigma = np.sqrt(np.diag(estimate.parameters.covariance))
    assert np.max(np.abs(d) / sigma) < 2e-4
