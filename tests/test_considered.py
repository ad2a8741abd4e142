"""Parameters that are considered and landmarks that err alike: by changed campaigns, dense matrices and Monte Carlo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from helpers import CAMPAIGN, write_good_campaign
from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.fit import Unknowns
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.judge.calibrate import calibrate
from starplumb.judge.error_shares import shares
from starplumb.judge.scatter.rotations import image_rotations
from starplumb.judge.snooping import fit_at
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.session.calibration import estimator_of
from starplumb.table.equation import linearise, residual_px
from starplumb.table.geometry import observe
from starplumb.table.sharing import with_shared
from starplumb.table.simulate import Errors, measure

RUNS = 400
PX = 9e-6 / 2.2


def legendre_2(campaign, a):
    """The line's tangents across with ``a P_2`` added, u = -1 .. 1 over it."""
    c = campaign.camera
    u = np.linspace(-1.0, 1.0, 200)
    column = np.interp(u, [-1.0, 1.0], c.column_px[[0, -1]])
    tan_x, tan_y = (np.interp(column, c.column_px, tan) for tan in (c.tan_x, c.tan_y))
    return replace(c, column_px=column, tan_x=tan_x + a * (3.0 * u**2 - 1.0) / 2.0, tan_y=tan_y)


def with_camera(campaign, **changes):
    return replace(campaign, camera=replace(campaign.camera, **changes))


def later(campaign, dt):
    images = campaign.images
    return replace(campaign, images=replace(images, t_ns=images.t_ns + np.int64(round(1e9 * dt))))


def refracted(campaign, part):
    return replace(campaign, corrections=replace(campaign.corrections, refraction=part > 0.0))


CASES = {
    "focal_length": (FRAME, 5e-5, 1e-6, lambda c, x: with_camera(c, focal_length=2.2 + x)),
    "principal_row": (FRAME, 3.0, 1.0, lambda c, x: with_camera(c, principal_point_px=(5999.5, 5999.5 + x))),
    "look_x_2": (LINE, 0.7 * PX, 0.1 * PX, lambda c, x: replace(c, camera=legendre_2(c, x))),
    "time_offset": (LINE, 4e-3, 1e-4, later),
    "refraction": (FRAME, 0.5, 1.0, refracted),
}
"""Camera, sigma, a step, and the campaign changed by hand."""


@pytest.mark.parametrize("name", CASES)
def test_what_is_considered_moves_the_marks_as_the_changed_campaign_has_them(name):
    camera, sigma, step, change = CASES[name]
    campaign = truth(camera, 4, 8, tilt_deg=20.0)
    o = observe(campaign)
    stated = with_shared(replace(campaign, considered=((name, sigma),)), o, C_EK_TRUE).common_px
    zero = residual_px(observe(change(campaign, 0.0)), C_EK_TRUE)
    by_hand = (residual_px(observe(change(campaign, step)), C_EK_TRUE) - zero) / step * sigma
    assert stated.shape[-1] == 1
    sign = np.sign(np.sum(stated[..., 0] * by_hand))
    np.testing.assert_allclose(sign * stated[..., 0], by_hand, atol=5e-3 * np.abs(by_hand).max())


def test_landmarks_close_together_err_alike():
    """By the whole covariance of all residuals: ``R (exp(-d / 4 km) S) R^T``, of one survey each."""
    campaign = truth(FRAME, 2, 6, shared_site=True)
    o = observe(campaign)
    names = ("a", "a", "b", "b", "a", "a")
    landmarks = replace(campaign.landmarks, sources=names, correlation_length=4000.0)
    stated = with_shared(replace(campaign, landmarks=landmarks), o, C_EK_TRUE)
    R, (p, S) = linearise(o, C_EK_TRUE).R, (landmarks.r_J, landmarks.covariance_J)
    whole = np.zeros((o.n, 2, o.n, 2))
    for i, j in np.ndindex(o.n, o.n):
        a, b = o.landmark[i], o.landmark[j]
        alike = np.exp(-np.linalg.norm(p[a] - p[b]) / 4000.0) if names[a] == names[b] else 0.0
        # one survey has one covariance along the ground; it turns by 1e-3 from end to end
        whole[i, :, j] = alike * R[i] @ (S[a] + S[b]) / 2.0 @ R[j].T
    common = stated.common_px.reshape(2 * o.n, -1)
    np.testing.assert_allclose(common @ common.T, whole.reshape(2 * o.n, -1), atol=3e-3 * np.abs(whole).max())
    assert not np.any(stated.cov_landmark_J)


def everything(camera):
    """A campaign that considers several things at once, and its landmarks' errors alike over 30 km."""
    campaign = truth(camera, 4, 8, tilt_deg=20.0, yaw_deg=60.0 if camera is FRAME else 0.0)
    own = {"focal_length": 1e-4, "principal_row": 4.0} if camera is FRAME else {"look_x_2": 2.0 * PX}
    landmarks = replace(campaign.landmarks, covariance_J=100.0 * campaign.landmarks.covariance_J)
    landmarks = replace(landmarks, correlation_length=30e3)
    considered = tuple({**own, "time_offset": 3e-3, "refraction": 2.0}.items())
    return replace(campaign, landmarks=landmarks, considered=considered)


@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
def test_the_covariance_is_that_of_dense_least_squares(camera):
    campaign = everything(camera)
    o = with_shared(campaign, observe(campaign), C_EK_TRUE)
    model = linearise(o, C_EK_TRUE)
    V = np.einsum("nip,mjp->nimj", o.common_px, o.common_px)
    for i, j in np.argwhere(o.image[:, None] == o.image):
        V[i, :, j] += model.H[i] @ o.cov_attitude_E[o.image[i]] @ model.H[j].T
        V[i, :, j] += model.R[i] @ o.cov_position_J[o.image[i]] @ model.R[j].T
    V = V.reshape(2 * o.n, -1) + np.diag(np.repeat(o.sigma_px**2, 2))
    H = model.H.reshape(-1, 3)
    dense = np.linalg.inv(H.T @ np.linalg.solve(V, H))
    found = Gls()(o, C_EK_TRUE).covariance_E
    sigma = np.sqrt(np.diag(dense))
    np.testing.assert_allclose(found / sigma / sigma[:, None], dense / sigma / sigma[:, None], atol=1e-6)
    plain = replace(campaign, considered=(), landmarks=replace(campaign.landmarks, correlation_length=None))
    less = Gls()(with_shared(plain, observe(plain), C_EK_TRUE), C_EK_TRUE).sigma_E
    assert np.max(sigma / less) > 1.5


def chips(camera, length, shared_site=False):
    """Four images of 25 chips whose reference is alike over a length, its errors five times the pixels' noise."""
    campaign = truth(
        camera, 4, 25, tilt_deg=20.0, yaw_deg=60.0 if camera is FRAME else 0.0, shared_site=shared_site
    )
    covariance_J = 20.0 * campaign.landmarks.covariance_J
    return replace(
        campaign, landmarks=replace(campaign.landmarks, covariance_J=covariance_J, correlation_length=length)
    )


def survey_errors(campaign):
    """Cholesky factors of the survey's errors in space and of each (L, L), (L, 3, 3)."""
    p, length = campaign.landmarks.r_J, campaign.landmarks.correlation_length
    alike = np.exp(-np.linalg.norm(p[:, None] - p, axis=-1) / length)
    return np.linalg.cholesky(alike), np.linalg.cholesky(campaign.landmarks.covariance_J)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("camera", "length", "shared_site"), [(FRAME, 3e3, False), (LINE, 20e3, False), (FRAME, 3e3, True)]
)
def test_many_neighbours_are_what_images_see_of_them(camera, length, shared_site):
    """By dense least squares with the whole covariance of a survey: sigma to 1e-3, residuals one by one nearly so."""
    campaign = chips(camera, length, shared_site)
    o, few = observe(campaign), with_shared(campaign, observe(campaign), C_EK_TRUE)
    assert few.common_px.shape[-1] <= 80
    assert set(few.common_of) == {"neighbours"}
    model, (in_space, own) = linearise(o, C_EK_TRUE), survey_errors(campaign)
    by_draw = model.R @ own[o.landmark]
    K = np.einsum("nij,mkj->nimk", by_draw, by_draw)
    K = K * (in_space @ in_space.T)[o.landmark][:, o.landmark][:, None, :, None]
    V = np.array(K)
    for i, j in np.argwhere(o.image[:, None] == o.image):
        V[i, :, j] += model.H[i] @ o.cov_attitude_E[o.image[i]] @ model.H[j].T
        V[i, :, j] += model.R[i] @ o.cov_position_J[o.image[i]] @ model.R[j].T
    V = V.reshape(2 * o.n, -1) + np.diag(np.repeat(o.sigma_px**2, 2))
    H = model.H.reshape(-1, 3)
    dense = np.linalg.inv(H.T @ np.linalg.solve(V, H))
    sigma = np.sqrt(np.diag(dense))
    unit = sigma * sigma[:, None]
    np.testing.assert_allclose(Gls()(few, C_EK_TRUE).covariance_E / unit, dense / unit, atol=1e-3)
    single = few.common_px @ few.common_px.mT + model.R @ few.cov_landmark_J[o.landmark] @ model.R.mT
    whole = K[np.arange(o.n), :, np.arange(o.n)]
    spread = [np.trace(M, axis1=1, axis2=2) for M in (single, whole)]
    if not shared_site:  # a landmark that its neighbours explain more than whole may have somewhat more
        assert np.median(spread[0] / spread[1]) == pytest.approx(1.0, abs=2e-3)
        assert np.all(spread[0] > 0.98 * spread[1])
        assert np.all(spread[0] < 1.2 * spread[1])
    plain = Gls()(o, C_EK_TRUE).sigma_E
    assert np.max(np.abs(plain / sigma - 1.0)) > 0.05


@pytest.mark.slow
def test_the_scatter_within_images_is_what_neighbours_leave(rng):
    """Its squares over their degrees of freedom are one on average, and vary as those of a chi-square."""
    campaign = chips(FRAME, 8e3)
    o, (in_space, own) = observe(campaign), survey_errors(campaign)
    stated = with_shared(campaign, o, C_EK_TRUE)
    ratio = []
    for _ in range(150):
        errors = Errors.draw(o, rng)
        pi_J = np.einsum("lij,lj->li", own, in_space @ rng.standard_normal((o.n_landmarks, 3)))
        table = measure(stated, C_EK_TRUE, replace(errors, pi_J=pi_J))
        estimate = Gls()(table, C_EK_TRUE)
        found = image_rotations(fit_at(Unknowns(), table, C_EK_TRUE, estimate, np.ones(o.n, dtype=bool)))
        ratio.append(found.squares / found.degrees)
    spread = np.sqrt(2.0 / found.degrees)
    assert np.mean(ratio) == pytest.approx(1.0, abs=4.0 * spread / np.sqrt(150))
    assert np.std(ratio) == pytest.approx(spread, rel=0.25)


@pytest.mark.slow
@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
def test_the_sigma_is_met(camera, rng):
    """error / sigma has deviation 1 on each axis, with everything drawn by hand; without the statement it has not."""
    campaign = everything(camera)
    plain = replace(campaign, considered=(), landmarks=replace(campaign.landmarks, correlation_length=None))
    o = observe(plain)
    errors = Errors.draw(o, rng, (RUNS,))
    z = 0.0
    for name, sigma in campaign.considered:
        _, _, step, change = CASES[name]
        zero = residual_px(observe(change(plain, 0.0)), C_EK_TRUE)
        moved = (residual_px(observe(change(plain, step)), C_EK_TRUE) - zero) / step
        z = z + sigma * rng.standard_normal((RUNS, 1, 1)) * moved
    p = plain.landmarks.r_J
    alike = np.exp(-np.linalg.norm(p[:, None] - p, axis=-1) / 30e3)
    drawn = np.einsum("ij,rjk->rik", np.linalg.cholesky(alike), rng.standard_normal((RUNS, len(p), 3)))
    pi = (np.linalg.cholesky(plain.landmarks.covariance_J) @ drawn[..., None])[..., 0]
    errors = replace(errors, pixel=errors.pixel - z, pi_J=pi)
    for stated, met in ((campaign, True), (plain, False)):
        estimate = Gls()(measure(with_shared(stated, o, C_EK_TRUE), C_EK_TRUE, errors), C_EK_TRUE)
        assert np.all(estimate.status == Status.OK)
        spread = np.std(so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E, axis=0)
        assert np.all(np.abs(spread - 1.0) < 4.0 / np.sqrt(2 * RUNS)) == met, spread


def test_the_budget_has_what_is_considered(rng):
    campaign = everything(FRAME)
    done = calibrate(campaign, Gls())
    parts = shares(done)
    assert {"optics, as considered", "clock, as considered", "refraction, as considered"} < set(parts)
    total = np.sum(list(parts.values()), axis=0)
    np.testing.assert_allclose(total, done.covariance_E, rtol=1e-6, atol=1e-9 * np.trace(done.covariance_E))


# ---------------------------------------------------------------- files


def considering(text):
    alike = CAMPAIGN.replace("[landmarks]\n", "[landmarks]\ncorrelation_length_m = 500.0\n")
    return alike + "\n[consider]\n" + text


def test_what_is_considered_is_read_and_written(tmp_path):
    text = 'focal_length = "5um"\nprincipal_point = "0.4px"\ntime_offset = "2ms"\nrefraction = "10%"\n'
    first = load_campaign(write_good_campaign(tmp_path / "a", campaign=considering(text))).campaign
    again = load_campaign(write_campaign(tmp_path / "b", first)).campaign
    for campaign in (first, again):
        assert dict(campaign.considered) == pytest.approx(
            {
                "focal_length": 5e-6,
                "principal_column": 0.4,
                "principal_row": 0.4,
                "time_offset": 2e-3,
                "refraction": 0.1,
            },
            rel=1e-12,
        )
        assert campaign.landmarks.correlation_length == 500.0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            'focal_length = "5"\n',
            "consider.focal_length: found focal_length=5, wanted a positive number with",
        ),
        ('look_angles = "0.4px"\n', "consider: found 'look_x_1', wanted focal_length or distortion"),
        (
            'focal_length = "1e200mm"\n',
            "consider.focal_length: found focal_length=1e200mm, wanted a positive",
        ),
        ('refraction = "1e300%"\n', 'consider.refraction: found "1e300%", wanted a positive part'),
        ('refraction = "0.1"\n', 'consider.refraction: found "0.1", wanted a positive part'),
        ('refraction = "1_0%"\n', 'consider.refraction: found "1_0%", wanted a positive part'),
        ('refraction = "٣%"\n', 'consider.refraction: found "٣%", wanted a positive part'),
        (
            'focal_lenght = "5um"\n',
            "consider.focal_lenght: unknown key, the nearest known one is focal_length",
        ),
        ("focal_length = 5.0\n", "consider.focal_length: found 5.0, wanted"),
    ],
)
def test_what_cannot_be_considered_is_refused(tmp_path, text, complaint):
    with pytest.raises(InputError, match=complaint.replace(".", r"\.")):
        load_campaign(write_good_campaign(tmp_path, campaign=considering(text)))


def test_what_is_estimated_is_not_considered_too(tmp_path):
    campaign = replace(truth(FRAME, 2, 4), considered=(("focal_length", 5e-6),))
    with pytest.raises(InputError, match=r"estimate: found 'focal_length', which \[consider\] holds"):
        estimator_of("default", ["focal_length"], campaign)
