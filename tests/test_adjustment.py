"""The shared-error solver against dense matrices written out here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.physics.covariance import square_root
from starplumb.physics.units import ARCSEC
from starplumb.solve import adjustment, arrow, covisibility, elimination
from starplumb.solve.adjustment import solve
from starplumb.solve.conjugate import conjugate_gradients
from starplumb.solve.tridiagonal import BlockTridiagonal
from starplumb.table.equation import linearise
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure


def dense(o, model, A, information=None, step=None):
    """Same problem with one covariance of all observations: x, its covariance, alpha, rho, pi and chi-square."""
    n, m, L, width = o.n, o.n_images, o.n_landmarks, A.shape[-1]
    H, R_image, R_marker = (np.zeros((2 * n, 3 * count)) for count in (m, m, L))
    for j in range(n):
        rows, i, k = slice(2 * j, 2 * j + 2), 3 * o.image[j], 3 * o.landmark[j]
        H[rows, i : i + 3] = -model.H[j]
        R_image[rows, i : i + 3] = model.R[j]
        R_marker[rows, k : k + 3] = -model.R[j]
    spread = [(H, block_diag(*o.cov_attitude_E)), (R_image, block_diag(*o.cov_position_J))]
    spread.append((R_marker, block_diag(*o.cov_landmark_J)))
    V = np.diag(np.repeat(o.sigma_px**2, 2)) + sum(J @ cov @ J.T for J, cov in spread)
    kept = np.repeat(o.weight > 0, 2)
    W = np.zeros_like(V)
    W[np.ix_(kept, kept)] = np.linalg.inv(V[np.ix_(kept, kept)])
    A, z = A.reshape(2 * n, width), model.z_px.reshape(2 * n)
    information = np.zeros((width, width)) if information is None else information
    step = np.zeros(width) if step is None else step
    N = A.T @ W @ A + information
    x = -np.linalg.solve(N, A.T @ W @ z - information @ step) if width else np.zeros(0)
    w = z + A @ x
    chi2 = w @ W @ w + (x - step) @ information @ (x - step)
    shared = [(cov @ J.T @ W @ w).reshape(-1, 3) for J, cov in spread]
    return x, np.linalg.inv(N) if width else N, *shared, chi2


def check(o, model, A, found, information=None, step=None):
    x, covariance, alpha, rho, pi, chi2 = dense(o, model, A, information, step)
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found.x, x, atol=1e-7 * max([1e-30, *sigma]))
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-7, atol=1e-9 * max([1e-30, *sigma]) ** 2)
    np.testing.assert_allclose(found.alpha_E, alpha, atol=1e-6 * ARCSEC)
    np.testing.assert_allclose(found.rho_J, rho, atol=1e-6)
    repeated = np.bincount(o.landmark, minlength=o.n_landmarks) > 1
    np.testing.assert_allclose(found.pi_J[repeated], pi[repeated], atol=1e-6)
    np.testing.assert_array_equal(found.pi_J[~repeated], 0.0)
    assert found.chi2 == pytest.approx(chi2, rel=1e-8)


@pytest.fixture(params=["dense", "images first", "landmarks first", "woven"])
def way(request, monkeypatch):
    """How the shared errors are eliminated: of a small table, and of a large one by either side."""
    if request.param != "dense":
        monkeypatch.setattr(adjustment, "LARGE", 0)
        monkeypatch.setattr(adjustment, "MANY", 0)
        monkeypatch.setattr(arrow, "CHUNK", 7)
        monkeypatch.setattr(elimination, "WINDOW", 100)
        monkeypatch.setattr(covisibility, "LEAST", 1)
        cheaper = covisibility._cheaper
        goes = request.param != "landmarks first"
        monkeypatch.setattr(elimination, "SPARSE", 0.0 if goes else np.inf)
        monkeypatch.setattr(elimination, "STORED", 0 if request.param == "woven" else elimination.STORED)
        monkeypatch.setattr(covisibility, "_cheaper", lambda *a: np.full_like(cheaper(*a), goes))
    return request.param


@pytest.fixture(params=["own", "site", "mixed"])
def problem(request, rng, way):
    """Own markers; one site; a site of which each image sees another part, one marker twice, and one image none."""
    o = observe(
        truth(
            LINE if request.param == "own" else FRAME, images=4, markers=6, shared_site=request.param != "own"
        )
    )
    if request.param == "mixed":
        keep = rng.permutation(o.n)[: o.n // 2]
        keep = np.append(keep[o.image[keep] != 2], keep[0])
        o = o.select(keep)
    return measure(o, C_EK_TRUE, Errors.draw(o, rng))


def test_alignment_is_the_dense_solution(problem):
    model = linearise(problem, C_EK_TRUE)
    check(problem, model, model.H, solve(problem, model, model.H))


def test_any_number_of_common_parameters(problem, rng):
    model = linearise(problem, C_EK_TRUE)
    for A in (
        model.H[..., :0],
        model.H[..., :1],
        np.concatenate([model.H, rng.standard_normal((problem.n, 2, 2))], -1),
    ):
        check(problem, model, A, solve(problem, model, A))


def test_prior(problem, rng):
    model = linearise(problem, C_EK_TRUE)
    root = rng.standard_normal((3, 3)) / ARCSEC
    information, step = root @ root.T, np.array([3.0, -2.0, 5.0]) * ARCSEC
    check(problem, model, model.H, solve(problem, model, model.H, information, step), information, step)


@pytest.mark.parametrize("zero", ["cov_attitude_E", "cov_position_J", "cov_landmark_J"])
def test_a_source_stated_as_zero(problem, zero):
    o = replace(problem, **{zero: np.zeros_like(getattr(problem, zero))})
    model = linearise(o, C_EK_TRUE)
    check(o, model, model.H, solve(o, model, model.H))


def test_an_error_stated_along_one_axis_only(problem):
    """A singular covariance: the height of the markers alone is unsure."""
    up = problem.p_J[0] / np.linalg.norm(problem.p_J[0])
    o = replace(problem, cov_landmark_J=np.broadcast_to(9.0 * np.outer(up, up), problem.cov_landmark_J.shape))
    model = linearise(o, C_EK_TRUE)
    check(o, model, model.H, solve(o, model, model.H))


def test_weight_zero_is_absence(problem, rng):
    weight = np.ones(problem.n)
    weight[rng.permutation(problem.n)[:3]] = 0.0
    o = replace(problem, weight=weight)
    model = linearise(o, C_EK_TRUE)
    found = solve(o, model, model.H)
    part = problem.select(weight > 0)
    model = linearise(part, C_EK_TRUE)
    expected = solve(part, model, model.H)
    np.testing.assert_allclose(found.x, expected.x, atol=1e-12)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-8)
    assert found.chi2 == pytest.approx(expected.chi2)
    np.testing.assert_array_equal(found.v[weight == 0], 0.0)


def chain(rng):
    """Fourteen images in two parts: each meets the next two, some landmarks are seen once, one twice in an image."""
    o = observe(truth(FRAME, images=14, markers=24, tilt_deg=0.0))
    landmark = np.where(rng.random(o.n) < 0.2, o.landmark, 0)
    shared = np.flatnonzero(landmark == 0)
    first = o.image[shared] // 7 * 7
    landmark[shared] = 7 * first + 5 * (o.image[shared] - first) + rng.integers(12, size=shared.size)
    landmark[0] = landmark[1]
    return measure(replace(o, landmark=landmark), C_EK_TRUE, Errors.draw(o, rng))


@pytest.mark.slow
def test_a_chain_of_images_is_solved_block_by_block(way, rng):
    """Several blocks and two components, against one dense matrix."""
    o = chain(rng)
    model = linearise(o, C_EK_TRUE)
    check(o, model, model.H, solve(o, model, model.H))
    places = np.unique(o.landmark, return_counts=True)
    again = np.flatnonzero(np.isin(o.landmark, places[0][places[1] > 1]))
    place = np.unique(o.landmark[again], return_inverse=True)[1]
    plans = covisibility.plans(o.image[again], place, o.n_images, place.max() + 1)
    if way in ("images first", "landmarks first"):
        plan = plans[way == "landmarks first"]
        assert plan.blocks.size > 5
        block = np.searchsorted(plan.blocks, plan.column, side="right") - 1
        assert np.all((block == plan.window[plan.row]) | (block == plan.window[plan.row] + 1))


def test_the_side_goes_that_leaves_less():
    """Of ten images and two hundred landmarks the landmarks; of a hundred images of five, beside them, the images."""
    image = np.concatenate([np.repeat(np.arange(10), 200), 10 + np.repeat(np.arange(100), 5)])
    landmark = np.concatenate([np.tile(np.arange(200), 10), 200 + np.tile(np.arange(5), 100)])
    of_images, of_landmarks = covisibility.plans(image, landmark, 110, 205)
    assert sorted(of_landmarks.kept) == list(range(10))
    assert sorted(of_landmarks.gone) == list(range(200))
    assert sorted(of_images.gone) == list(range(10, 110))
    assert sorted(of_images.kept) == list(range(200, 205))


def test_what_is_not_a_number_has_no_solution(way):
    o = observe(truth(FRAME, images=4, markers=9, shared_site=True))
    model = linearise(o, C_EK_TRUE)
    model.z_px[3] = np.nan
    with np.errstate(invalid="ignore"):
        found = solve(o, model, model.H)
    assert not np.isfinite(found.chi2)


def test_residuals_of_repeated_markers_are_the_pixel_noise_left(rng):
    o = observe(truth(FRAME, images=4, markers=9, shared_site=True))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    model = linearise(o, C_EK_TRUE)
    found = solve(o, model, model.H)
    noise = model.z_px + (model.H @ (found.x + found.alpha_E[o.image])[..., None])[..., 0]
    noise -= (model.R @ (found.rho_J[o.image] - found.pi_J[o.landmark])[..., None])[..., 0]
    np.testing.assert_allclose(found.v * o.sigma_px[:, None], noise, atol=1e-9)


def test_order_of_sightings_and_names_of_images_do_not_matter(problem, rng):
    model = linearise(problem, C_EK_TRUE)
    expected = solve(problem, model, model.H)
    shuffled = problem.select(rng.permutation(problem.n))
    turn = np.roll(np.arange(problem.n_images), 1)
    back = np.argsort(turn)
    o = replace(
        shuffled,
        image=turn[shuffled.image],
        cov_attitude_E=shuffled.cov_attitude_E[back],
        cov_position_J=shuffled.cov_position_J[back],
    )
    model = linearise(o, C_EK_TRUE)
    found = solve(o, model, model.H)
    np.testing.assert_allclose(found.x, expected.x, atol=1e-13)
    np.testing.assert_allclose(found.alpha_E[turn], expected.alpha_E, atol=1e-13)
    assert found.chi2 == pytest.approx(expected.chi2)


@pytest.mark.parametrize("site", [False, True])
def test_batches_are_single_runs_side_by_side(site, rng):
    o = observe(truth(FRAME, images=3, markers=4, shared_site=site))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng, (2, 3)))
    weight = np.ones((2, 3, o.n))
    weight[1, 2, :2] = 0.0
    o = replace(o, weight=weight)
    model = linearise(o, C_EK_TRUE)
    together = solve(o, model, model.H)
    names = ("xy_K", "C_EJ", "r_J", "p_J", "e_E", "row_rate_E", "range_m", "weight")
    batched = {name: getattr(o, name) for name in names if getattr(o, name).shape[:2] == (2, 3)}
    one = replace(o, **{name: value[1, 2] for name, value in batched.items()})
    model = linearise(one, C_EK_TRUE)
    alone = solve(one, model, model.H)
    for name in ("x", "covariance", "alpha_E", "rho_J", "pi_J", "v", "chi2"):
        np.testing.assert_allclose(getattr(together, name)[1, 2], getattr(alone, name), rtol=1e-7, atol=1e-10)


def test_what_is_not_determined_has_no_covariance_and_takes_no_step(problem):
    model = linearise(problem, C_EK_TRUE)
    A = np.concatenate([model.H[..., :1], np.zeros((problem.n, 2, 1))], axis=-1)
    found = solve(problem, model, A)
    assert np.all(np.isinf(found.covariance))
    np.testing.assert_array_equal(found.x, 0.0)
    twice = solve(problem, model, np.concatenate([model.H, model.H], axis=-1))
    assert np.all(np.isinf(twice.covariance))


def test_square_root(rng):
    M = rng.standard_normal((4, 3, 3))
    covariance = M @ M.mT
    S = square_root(covariance)
    np.testing.assert_allclose(S @ S.mT, covariance, atol=1e-13)
    np.testing.assert_array_equal(square_root(np.zeros((3, 3))), 0.0)


def test_many_markers_shared_by_many_images_stay_small_in_memory(rng):
    """Forty images of one site of 150 markers: nothing as large as rows times landmarks is formed."""
    import tracemalloc

    o = observe(truth(FRAME, images=40, markers=144, shared_site=True, tilt_deg=0.0))
    o = replace(o, sigma_px=np.full(o.n, 0.3))
    model = linearise(o, C_EK_TRUE)
    tracemalloc.start()
    solve(o, model, model.H)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    dense_rows = 2 * o.n * 3 * o.n_landmarks * 8
    assert peak < 0.5 * dense_rows


def test_numbers_that_are_not_finite_end_the_iterations_at_once():
    """Of a large table each iteration takes a second, and three thousand are allowed."""
    calls = []
    right = np.array([[1.0], [np.nan]])
    with pytest.raises(np.linalg.LinAlgError):
        conjugate_gradients(lambda y: calls.append(y) or y, lambda r: r, right)
    assert len(calls) <= 1


def test_rounding_does_not_make_a_matrix_indefinite():
    """A singular one, of an image whose sightings all but fix it: two equal rows of ones."""
    factored = BlockTridiagonal.factor([np.ones((2, 2))], [])
    right = np.ones((2, 1))
    np.testing.assert_allclose(np.ones((2, 2)) @ factored.solve(right), right, rtol=1e-12)
