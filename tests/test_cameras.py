"""Several cameras on one tracker: by structure, against dense matrices, by statistics and from files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import starplumb as sp
from command import starplumb
from helpers import CAMPAIGN, IMAGES, write_good_campaign
from problems import C_EK_TRUE
from rigs import AFT, FORE, rig_truth
from starplumb.estimators.cameras.jointly import Jointly
from starplumb.estimators.default import Default
from starplumb.estimators.fit import State
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.judge.calibrate import calibrate
from starplumb.judge.mountings import _estimated, mountings
from starplumb.physics import so3
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.timescales import format_iso
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan.scene import measured
from starplumb.solve import chunks
from starplumb.table.cameras.mounting import CameraMounting
from starplumb.table.cameras.views import moments
from starplumb.table.campaign import some_of
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

NAMED = CAMPAIGN.replace("[camera]\n", '[[cameras]]\nname = "A"\n').replace(
    '[mounting]\nfrom = "camera"\nto = "star_tracker"\nquaternion_xyzw = [0.0, 0.0, 0.0, 1.0]\n',
    'mounting = { from = "A", to = "star_tracker", quaternion_xyzw = [0.0, 0.0, 0.0, 1.0] }\n',
)
SECOND = """
[[cameras]]
name = "B"
model = "frame"
focal_length_mm = 2200.0
pixel_pitch_um = 9.0
image_size_px = [12000, 12000]
principal_point_px = [5999.5, 5999.5]
mounting = { from = "B", to = "star_tracker", quaternion_xyzw = [0.0, 0.0, 0.0, 1.0] }
"""
WITH_CAMERAS = IMAGES.replace("time\n", "time,camera\n").replace("500\n", "500,{}\n")
OFF = np.array([[0.0, 0.0, 0.0], [800.0, -500.0, 300.0], [-3000.0, 2000.0, 1000.0]]) * ARCSEC


def jointly(names, method=lambda gls: gls, tolerance=1e-3):
    return Jointly(tuple(names), method, Gls(tolerance=tolerance))


def delivered(campaign, rng, off=OFF):
    """What is delivered of a true campaign: measured with errors, the model mountings off."""
    model = so3.exp(np.array([300.0, -200.0, 100.0]) * ARCSEC) @ C_EK_TRUE
    given = measured(campaign, Errors.draw(observe(campaign), rng, ()), model)
    k = len(campaign.rig.names)
    return replace(given, rig=replace(campaign.rig, C_KC=campaign.rig.C_KC @ so3.exp(off[:k])))


def alone(o, k):
    """The table of one camera."""
    return replace(o.select(np.flatnonzero(o.camera == k)), camera=None, C_KC=None)


# By structure -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [np.zeros(3), np.array([0.02, -0.3, 0.4])])
def test_the_derivative_by_a_mounting_is_that_of_the_residual(value):
    """By differences, at a mounting 30 deg off its model too, of a camera that looks elsewhere."""
    o = observe(rig_truth((AFT,), images=2))
    second = CameraMounting(1, "B", reach=10.0)

    def fit(x):
        return Gls((second,)).unknowns.problem(o, state_at(x), C_EK_TRUE)

    A, step = fit(value).A, 1e-6
    for j in range(3):
        ahead, behind = (fit(value + s * step * np.eye(3)[j]).model.z_px for s in (1.0, -1.0))
        expected = (ahead - behind) / (2.0 * step)
        scale = np.max(np.abs(expected))
        np.testing.assert_allclose(A[..., 3 + j] / scale, expected / scale, atol=2e-8)
    assert not np.any(A[o.camera == 0, :, 3:])


def state_at(values):
    return State(C_EK_TRUE, np.asarray(values))


def test_images_of_one_moment_share_their_errors(rng):
    campaign = rig_truth((FORE, AFT), images=3)
    assert moments(campaign).tolist() == [0, 1, 2] * 3
    late = rig_truth((FORE,), images=3, apart_s=0.1)
    assert moments(late).tolist() == list(range(6))


def test_a_table_in_chunks_is_the_same_as_at_once(rng, monkeypatch):
    o = observe(rig_truth((FORE, AFT)))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, ()))
    whole = jointly("ABC")(table, C_EK_TRUE)
    monkeypatch.setattr(chunks, "LARGE", 50)
    monkeypatch.setattr(chunks, "CHUNK", 40)
    parts = jointly("ABC")(table, C_EK_TRUE)
    np.testing.assert_allclose(parts.parameters.values, whole.parameters.values, atol=1e-12)
    np.testing.assert_allclose(parts.parameters.covariance, whole.parameters.covariance, rtol=1e-8)


def test_cameras_that_share_no_moment_are_two_campaigns(rng):
    """What two cameras have in common is the errors of a moment; without any they are two runs."""
    o = observe(rig_truth((FORE,), apart_s=0.2))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, ()))
    both = jointly("AB")(table, C_EK_TRUE)
    for k, C in enumerate((C_EK_TRUE, C_EK_TRUE @ FORE)):
        own = Gls()(alone(table, k), C)
        found = both.C_EK if k == 0 else both.C_EK @ FORE @ so3.exp(both.parameters.values)
        off = so3.log(found @ own.C_EK.mT)
        np.testing.assert_allclose(off / own.sigma_E, 0.0, atol=1e-3)
        if k == 0:
            np.testing.assert_allclose(both.sigma_E, own.sigma_E, rtol=1e-6)


# Against dense matrices ---------------------------------------------------------------------------------------


def dense(o, C_EK_model):
    """Least squares over everything, by SciPy: mountings, errors of moments and landmarks, of whitened residuals.

    Written from the geometry alone; unknowns are (theta, epsilon of B, and unit errors of moments and landmarks).
    """
    m, n_landmarks = o.n_images, o.n_landmarks
    S_a, S_r, S_p = (np.linalg.cholesky(P) for P in (o.cov_attitude_E, o.cov_position_J, o.cov_landmark_J))
    C_KC = o.C_KC[o.camera]

    def residual(x):
        theta, epsilon = x[:3], x[3:6]
        unit = np.split(x[6:], np.cumsum([3 * m, 3 * m]))
        alpha = (S_a @ unit[0].reshape(m, 3, 1))[..., 0]
        rho = (S_r @ unit[1].reshape(m, 3, 1))[..., 0]
        pi = (S_p @ unit[2].reshape(n_landmarks, 3, 1))[..., 0]
        C_EK = Rotation.from_rotvec(theta).as_matrix() @ C_EK_model
        own = np.where((o.camera == 1)[:, None, None], Rotation.from_rotvec(epsilon).as_matrix(), np.eye(3))
        C_EC = C_EK @ C_KC @ own
        # a measured attitude is the true one with its error on top; positions likewise
        C_EJ = Rotation.from_rotvec(-alpha[o.image]).as_matrix() @ o.C_EJ
        moved = o.with_geometry(C_EJ=C_EJ, r_J=o.r_J - rho[o.image], p_J=o.p_J - pi[o.landmark])
        s = (np.swapaxes(C_EC, -1, -2) @ moved.e_E[..., None])[..., 0]
        px = np.linalg.solve(o.slope_K, (s[:, :2] / s[:, 2:] - o.xy_K)[..., None])[..., 0]
        return np.concatenate([(px / o.sigma_px[:, None]).ravel(), *unit])

    start = np.zeros(6 + 3 * (2 * m + n_landmarks))
    exact = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15)
    found = least_squares(residual, start, jac="3-point", x_scale="jac", **exact)
    return found.x, np.linalg.inv(found.jac.T @ found.jac)[:6, :6], 2.0 * found.cost


@pytest.mark.slow
def test_shared_errors_against_dense_least_squares(rng):
    """The whole nonlinear problem by SciPy, with every error an unknown: to 1e-3 sigma, and the covariance."""
    o = observe(rig_truth((FORE,), images=3, markers=4))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, ()))
    x, P, chi2 = dense(table, C_EK_TRUE)
    found = jointly("AB")(table, C_EK_TRUE)
    theta = so3.log(found.C_EK @ C_EK_TRUE.mT)
    sigma = np.sqrt(np.diagonal(P))
    off = (np.concatenate([theta, found.parameters.values]) - x[:6]) / sigma
    np.testing.assert_allclose(off, 0.0, atol=1e-3)
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.parameters.covariance)), sigma, rtol=1e-4)
    np.testing.assert_allclose(found.chi2, chi2, rtol=1e-5)


def test_shared_errors_against_the_whole_covariance(rng):
    """One linear step with one dense covariance of all residuals: x = -(A^T V^-1 A)^-1 A^T V^-1 z, to 1e-6 sigma."""
    o = observe(rig_truth((FORE, AFT)))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, ()))
    found = jointly("ABC", tolerance=1e-9)(table, C_EK_TRUE)

    def about(errors):
        state = State(found.C_EK, found.parameters.values, errors)
        return found.unknowns.problem(table, state, C_EK_TRUE)

    at = about(None)
    for _ in range(4):  # linear about the errors of the moments, as they are found
        at = about(at.image_errors(np.zeros(at.A.shape[-1]), np.zeros((), dtype=bool)))
    model, A = at.model, at.A.reshape(2 * table.n, -1)
    G = [np.zeros((2 * table.n, 3 * count)) for count in (o.n_images, o.n_images, o.n_landmarks)]
    for i in range(table.n):
        moved = (o.image[i], model.H[i]), (o.image[i], model.R[i]), (o.landmark[i], model.R[i])
        for block, (k, M) in zip(G, moved, strict=True):
            block[2 * i : 2 * i + 2, 3 * k : 3 * k + 3] = M
    covariances = table.cov_attitude_E, table.cov_position_J, table.cov_landmark_J
    V = block_diag(*table.noise_px) + sum(
        g @ block_diag(*P) @ g.T for g, P in zip(G, covariances, strict=True)
    )
    N = A.T @ np.linalg.solve(V, A)
    step = -np.linalg.solve(N, A.T @ np.linalg.solve(V, model.z_px.reshape(-1)))
    sigma = np.sqrt(np.diagonal(np.linalg.inv(N)))
    np.testing.assert_allclose(step / sigma, 0.0, atol=3e-6)
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.parameters.covariance)) / sigma, 1.0, atol=1e-6)


# By statistics ------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_errors_over_sigmas_and_the_gain(rng):
    """200 draws: errors of a relative mounting over their sigma, and a tenth of what two runs apart would have."""
    o = observe(rig_truth((so3.exp(np.array([0.5, 2.0, 1.0]) * DEG),), images=12, markers=12))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (200,)))
    found = Gls((CameraMounting(1, "B"),))(table, C_EK_TRUE)
    sigma = np.sqrt(np.diagonal(found.parameters.covariance, axis1=-2, axis2=-1))[:, 3:]
    score = found.parameters.values / sigma
    np.testing.assert_allclose(np.sqrt(np.mean(score**2, axis=0)), 1.0, atol=0.15)  # 3 sigma of 200 draws
    np.testing.assert_allclose(np.mean(score, axis=0), 0.0, atol=0.25)
    apart = np.hypot(*(Gls()(alone(table.run((0,)), k), C_EK_TRUE @ o.C_KC[k]).sigma_E for k in (0, 1)))
    assert np.all(apart[:2] / sigma.mean(axis=0)[:2] > 10.0)


def test_errors_of_the_unknowns_turn_a_mounting_as_differences_say(rng):
    """At a mounting of a second camera that is 28 deg off its model."""
    c = calibrate(delivered(rig_truth((AFT,)), rng), jointly("AB"))
    p, value = c.estimate.parameters, np.array([0.02, -0.3, 0.4])
    C_EC, T, _ = _estimated(c, replace(p, values=value))
    step = 1e-6
    for j in range(3):
        moved, *_ = _estimated(c, replace(p, values=value + step * np.eye(3)[j]))
        np.testing.assert_allclose(T[3:, 3 + j], so3.log(moved[1] @ C_EC[1].T) / step, atol=1e-5)


@pytest.mark.parametrize("method", [lambda gls: gls, Default])
def test_model_mountings_far_off_do_not_matter(method, rng):
    campaign = rig_truth((FORE, AFT))
    given = delivered(campaign, rng)
    found = mountings(calibrate(given, jointly("ABC", method)))
    for k, C in enumerate(C_EK_TRUE @ campaign.rig.C_KC):
        error = so3.log(found.C_EC[k] @ C.mT)
        P = found.covariance_of(k)
        assert error @ np.linalg.solve(P, error) < 21.1  # chi-square of 3, once in 10 000
    against = so3.log(found.C_EC[0].mT @ found.C_EC[1] @ FORE.mT)  # about K's axes
    P = found.C_EC[0].mT @ found.covariance_against_first(1) @ found.C_EC[0]
    assert against @ np.linalg.solve(P, against) < 21.1


def test_blunders_in_one_camera_are_left_out(rng):
    campaign = rig_truth((FORE,))
    given = delivered(campaign, rng)
    s, wrong = given.sightings, np.array([3, 20, 60])
    column = s.column_px.copy()
    column[wrong] += 40.0
    found = calibrate(replace(given, sightings=replace(s, column_px=column)), jointly("AB", Default))
    assert found.status is Status.OK
    names = [(given.images.ids[r.image], given.landmarks.ids[r.landmark]) for r in found.rejected]
    assert names == [(given.images.ids[s.image[i]], given.landmarks.ids[s.landmark[i]]) for i in wrong]


def test_a_camera_without_enough_markers_is_named(rng):
    campaign = rig_truth((FORE,))
    mine = campaign.rig.of_image[campaign.sightings.image]
    few = np.flatnonzero((mine == 0) | (np.cumsum(mine == 1) == 1))
    given = delivered(replace(campaign, sightings=some_of(campaign.sightings, few)), rng)
    found = calibrate(given, jointly("AB"))
    assert found.status is Status.WEAK
    assert "the mounting of camera B is not determined" in found.message
    assert mountings(found).covariance_of(1) is None


# From files ---------------------------------------------------------------------------------------------------


def test_one_named_camera_is_the_same_to_the_last_bit(tmp_path):
    folders = write_good_campaign(tmp_path / "a"), write_good_campaign(tmp_path / "b", campaign=NAMED)
    a, b = (sp.calibrate(sp.read_campaign(path)).document for path in folders)
    assert b.pop("mounting")["from"] == "A"
    a["mounting"].pop("from")
    (mounting,) = b.pop("mountings")
    assert mounting["sigma_arcsec"] == a["sigma_arcsec"]
    assert b.pop("mountings_covariance_arcsec2") == a["covariance_arcsec2"]
    a.pop("mounting")
    for document in (a, b):
        document.pop("inputs")
    assert a == b


def test_a_campaign_of_several_cameras_is_read_as_it_was_written(tmp_path, rng):
    given = delivered(rig_truth((FORE, AFT), images=3, markers=4), rng)
    path = write_campaign(tmp_path, given)
    back = load_campaign(path).campaign
    assert back.rig.names == given.rig.names
    np.testing.assert_array_equal(back.rig.of_image, given.rig.of_image)
    np.testing.assert_allclose(back.rig.C_KC, given.rig.C_KC, atol=1e-14)
    done = starplumb("calibrate", path, "--out", tmp_path / "result")
    assert done.status == 0, done.err
    assert "B against A: sigma" in done.out
    document = json.loads((tmp_path / "result" / "result.json").read_text())
    found = mountings(calibrate(given, jointly("ABC", Default)))
    assert [each["camera"] for each in document["mountings"]] == ["A", "B", "C"]
    for k, each in enumerate(document["mountings"]):
        np.testing.assert_allclose(each["matrix"], found.C_EC[k], atol=1e-10)
    joint = np.array(document["mountings_covariance_arcsec2"])
    np.testing.assert_allclose(joint, found.covariance_E / ARCSEC**2, rtol=1e-4)
    assert document["mounting"]["matrix"] == document["mountings"][0]["matrix"]
    against = document["mountings"][2]["against_first"]
    np.testing.assert_allclose(
        against["covariance_arcsec2"],
        joint[6:, 6:] + joint[:3, :3] - joint[6:, :3] - joint[:3, 6:],
        rtol=1e-6,
    )


@pytest.mark.parametrize(
    ("campaign", "images", "said"),
    [
        (NAMED + SECOND, IMAGES, "found no column camera, wanted it for several [[cameras]]"),
        (
            NAMED + SECOND,
            WITH_CAMERAS.format("A", "C"),
            "one of the cameras A, B",
        ),
        (NAMED + SECOND.replace('name = "B"', 'name = "A"'), IMAGES, "found the camera 'A' again"),
        (NAMED + SECOND.replace('from = "B"', 'from = "Z"'), IMAGES, "cameras.1.mounting.from: found 'Z'"),
        (
            NAMED + SECOND.replace("1.0] }", "1.0], sigma_arcsec = 5.0 }"),
            IMAGES,
            "cameras.1.mounting.sigma_arcsec",
        ),
        (CAMPAIGN + SECOND, IMAGES, "camera: found beside [[cameras]]"),
        (NAMED.replace('name = "A"', 'name = "A B"'), IMAGES, "a name of letters, digits"),
        (NAMED + SECOND + 'pixel_origin = "corner"\n', IMAGES, "wanted 'center' as for the first camera"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, campaign, images, said):
    path = write_good_campaign(tmp_path, campaign=campaign, images=images)
    with pytest.raises(InputError) as caught:
        load_campaign(path)
    assert said in str(caught.value).replace('"', "'")


@pytest.mark.parametrize(
    "asked",
    [["--method", "wahba"], ["--estimate", "focal_length"], ["--drift", "auto"]],
)
def test_what_needs_one_camera_is_refused_in_a_sentence(tmp_path, rng, asked):
    path = write_campaign(tmp_path, delivered(rig_truth(images=2, markers=4), rng))
    done = starplumb("calibrate", path, *asked)
    assert done.status == 2
    assert "cameras" in done.err
    assert len(done.err.strip().splitlines()) == 1


def test_each_camera_has_its_own_frame_in_the_kernel(tmp_path, rng, clean_pool):
    spice = pytest.importorskip("spiceypy")
    given = delivered(rig_truth((FORE, AFT), images=3, markers=4), rng)
    path = write_campaign(tmp_path, given)
    text = path.read_text().replace(
        'name = "C"\n', 'name = "C"\nspice = { name = "SAT_AFT", id = 1400077 }\n'
    )
    path.write_text(text)
    result = sp.calibrate(sp.read_campaign(path))
    result.save(tmp_path / "result")
    spice.furnsh(str(tmp_path / "result" / "mounting.tf"))
    found = mountings(result.calibration)
    for frame, C in zip(("A", "B", "SAT_AFT"), found.C_EC, strict=True):
        np.testing.assert_allclose(spice.pxform(frame, "STAR_TRACKER", 0.0), C, atol=1e-12)
    assert [spice.namfrm(frame) for frame in ("A", "B", "SAT_AFT")] == [1400001, 1400003, 1400077]
    spice.kclear()


def test_a_pixel_is_located_by_the_camera_that_saw_it(tmp_path, rng):
    """Of the third camera, turned by a quarter: its landmarks lie where its pixels are located, and back."""
    campaign = rig_truth((FORE, AFT), images=3, markers=6)
    given = delivered(campaign, rng)
    path = write_campaign(tmp_path, given)
    read = sp.read_campaign(path)
    result = sp.calibrate(read)
    result.save(tmp_path / "kept", report=False)
    s = given.sightings
    row = int(np.flatnonzero(given.rig.of_image[s.image] == 2)[0])
    p_J, image = given.landmarks.r_J[s.landmark[row]], given.images.ids[s.image[row]]
    height = itrf_to_geodetic(p_J)[2]
    for known in (result, tmp_path / "kept" / "result.json"):
        at = sp.locate(
            read, known, image=image, column=s.column_px[row], row=s.row_px[row], height_m=float(height)
        )
        assert np.linalg.norm(np.array(at.document["itrf_m"]) - p_J) < 60.0  # 5 arcsec from 700 km, 3 sigma
        assert at.document["sigma_east_north_up_m"] is not None
    back = sp.project(read, result, itrf_m=at.document["itrf_m"], image=image).document["points"][0]
    np.testing.assert_allclose(
        [back["column_px"], back["row_px"]], [s.column_px[row], s.row_px[row]], atol=1e-3
    )
    assert sp.predict(result, format_iso(given.images.t_ns[:1], "UTC")[0], camera="C").document["from"] == "C"
    every = sp.project(read, result).document["points"]
    assert {point["image_id"] for point in every} == set(given.images.ids)
